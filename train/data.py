"""Training scenes: what each step asks for, and threads that have it ready.

A step's make-up and its scenes follow from (seed, step) alone, so a run that is stopped and resumed
sees what it would have seen.
"""
import dataclasses
import itertools
import json
import math
import os
import random
import threading
import time

import torch

# Scenes kept for validation; training seeds start above them.
HELD_OUT_SEED = 1
FIRST_TRAINING_SEED = 1 << 20
# Kinds of scenes a recipe may ask for: options of the generator (drivers/include/dio/sim_batch.h).
KINDS = {"all": 0, "tables": 16, "rooms": 32, "turntables": 64, "streets": 128}
# Grids away from the square, as a difference of tokens across and down.
ASPECTS = ((2, -2), (-2, 2), (1, -1), (-1, 1), (3, -2), (-2, 3))


def load_recipe(path):
    """A recipe of recipes/. One with `base` is that of the file beside it, with what it says itself
    in place; of its stages each says what is different in the base's at the same place."""
    with open(path, encoding="utf-8") as file:
        recipe = json.load(file)
    if "base" not in recipe:
        return recipe
    base = load_recipe(os.path.join(os.path.dirname(path), recipe.pop("base")))
    changes = recipe.pop("stages", [{}] * len(base["stages"]))
    if len(changes) != len(base["stages"]):
        raise SystemExit(f"train: {path}: {len(changes)} stages, its base has "
                         f"{len(base['stages'])}: give as many, {{}} for one that stays")
    stages = [{**stage, **change} for stage, change in zip(base["stages"], changes)]
    return {**base, **recipe, "stages": stages}


@dataclasses.dataclass(frozen=True)
class Step:
    """What one step trains on. Steps with the same seed use the same scenes in another order."""
    context: int
    size: tuple     # pictures, width and height
    patches: tuple  # stage patches (p1, p2)
    seed: int
    kinds: tuple    # (options of the generator, scenes) for each kind drawn
    order: tuple    # of the views: the first `context` are given, the rest are targets

    def scenes(self):
        return sum(count for _, count in self.kinds)

    def targets(self):
        return len(self.order) - self.context


def pick(rng, shares):
    """A key of {key: share}."""
    return rng.choices(list(shares), weights=list(shares.values()))[0]


def draw_kinds(rng, shares, scenes):
    """How many scenes of each kind: ((options, scenes) ...)."""
    drawn = [pick(rng, shares) for _ in range(scenes)]
    return tuple((KINDS[kind], drawn.count(kind)) for kind in shares if kind in drawn)


def draw_size(rng, stage):
    """Picture size and stage patches of a group of steps."""
    side, first, second = (int(n) for n in pick(rng, stage["mix"]).split("/"))
    unit = max(first, second)
    across = down = side // unit
    if across >= 6 and rng.random() < stage.get("aspect_share", 0.0):
        wider, taller = rng.choice(ASPECTS)
        across, down = across + wider, down + taller
    return (across * unit, down * unit), (first, second)


def plan(recipe, seed, step, rank=0, ranks=1):
    """The make-up of a step. All ranks agree on shapes; each has its own scenes.

    `reuse` steps in a row share their scenes, with other views for context each time: for
    trainers that are faster than the generator.
    """
    stage = next(s for s in recipe["stages"] if step < s.get("until_step", math.inf))
    views, reuse = stage["views"], stage.get("reuse", 1)
    group = step // reuse
    shared, own = random.Random(f"{seed}/group {group}"), random.Random(f"{seed}/step {step}")
    size, patches = draw_size(shared, stage)
    tokens = size[0] * size[1] / (patches[0] * patches[1])
    scenes = max(1, round(stage["tokens"] / (views * tokens)))
    mine = random.Random(f"{seed}/group {group}/{rank}")
    kinds = draw_kinds(mine, stage.get("kinds", {"all": 1}), scenes)
    order = tuple(own.sample(range(views), views) if reuse > 1 else range(views))
    first = FIRST_TRAINING_SEED + (seed << 40) + (group * ranks + rank) * 4096
    return Step(int(pick(own, stage["context"])), size, patches, first, kinds, order)


def draw(generator, step):
    """The scenes of a step: pictures, poses, intrinsics, in the generator's order of views."""
    parts, seed = [], step.seed
    for options, scenes in step.kinds:
        parts.append(generator.batch(seed, scenes, len(step.order), step.size, options))
        seed += scenes
    return tuple(torch.cat(tensors) for tensors in zip(*parts))


class Loader:
    """Draws scenes in threads, ahead of the trainer; counts how long the trainer waited."""

    def __init__(self, generator, steps, threads=1, ahead=4, pin=False):
        self.generator, self.pin = generator, pin
        self.groups = itertools.groupby(steps, key=lambda step: (step.seed, step.size))
        self.ready, self.order, self.waited = {}, threading.Condition(), 0.0
        self.slots = threading.Semaphore(ahead + threads)
        self.next_in, self.next_out, self.stopped = 0, 0, False
        self.current = []
        self.workers = [threading.Thread(target=self.work, daemon=True) for _ in range(threads)]
        for worker in self.workers:
            worker.start()

    def work(self):
        while True:
            self.slots.acquire()
            with self.order:
                if self.stopped:
                    return
                ticket, self.next_in = self.next_in, self.next_in + 1
                steps = list(next(self.groups)[1])
            try:
                batch = draw(self.generator, steps[0])
                if self.pin:
                    batch = tuple(tensor if tensor.is_cuda else tensor.pin_memory()
                                  for tensor in batch)
            except Exception as fault:  # the trainer shows it; it would wait for ever otherwise
                batch = fault
            with self.order:
                self.ready[ticket] = [(step, batch) for step in steps]
                self.order.notify_all()

    def get(self):
        """(step, (pictures, poses, intrinsics)) of the next step, in the generator's order."""
        if not self.current:
            start = time.perf_counter()
            with self.order:
                self.order.wait_for(lambda: self.next_out in self.ready)
                self.current = self.ready.pop(self.next_out)
                self.next_out += 1
            self.waited += time.perf_counter() - start
            self.slots.release()
        step, batch = self.current.pop(0)
        if isinstance(batch, Exception):
            raise RuntimeError(f"scene generator failed on {step}") from batch
        return step, batch

    def close(self):
        with self.order:
            self.stopped = True
        for _ in self.workers:
            self.slots.release()


def as_float(pictures):
    """Bytes or floats -> floats in [0, 1]."""
    return pictures.float() / 255 if pictures.dtype == torch.uint8 else pictures
