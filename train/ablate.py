#!/usr/bin/env python3
"""Which choices earn their compute: variants of one small recipe, each given the same processor time.

  ablate.py --minutes M --out FOLDER [--only NAME ...]

Every variant starts from the same seed, trains for M processor minutes (its scenes' generation
included) with the rate lowered to zero over the last third, and is judged on the same held-out
scenes. FOLDER/NAME.json keeps each result, so that a stopped call goes on; the table is printed as
Markdown.
"""
import argparse
import copy
import itertools
import json
import os
import sys
import time
import types

import torch

import data
import losses
import model as dvsm
import optim
import source
import train


class TwoStages(dvsm.Dvsm):
    """Weight sharing off: rendering has blocks of its own (an encoder and a decoder)."""

    fast_options = 1

    def __init__(self, config):
        super().__init__(config)
        self.render_blocks = copy.deepcopy(self.blocks)
        # Behind its keys and values the encoder's last block is not used: no gradient, no step.
        last = self.blocks[-1]
        for part in (last.cross.q_norm, last.cross.out, last.cross_mlp_norm, last.cross_mlp):
            part.requires_grad_(False)

    def block_weights(self):
        return [*self.blocks.parameters(), *self.render_blocks.parameters()]

    def render(self, cache, cameras, size, patch):
        shared, self.blocks = self.blocks, self.render_blocks
        try:
            return super().render(cache, cameras, size, patch)
        finally:
            self.blocks = shared


class LoneBlock(dvsm.Block):
    """Cross-view attention off in reconstruction: a view's tokens attend to that view alone."""

    def reconstruct(self, x, last):
        x = self.within(x)
        flat = x.flatten(0, 1)
        if last:
            k, v = self.cross.keys_values(self.cross_norm(flat))
        else:
            y, k, v = self.cross(self.cross_norm(flat))
            flat = flat + y
            flat = flat + self.cross_mlp(self.cross_mlp_norm(flat))
        k, v = (t.unflatten(0, x.shape[:2]).transpose(1, 2).flatten(2, 3) for t in (k, v))
        return flat.view_as(x), k, v


class LoneViews(dvsm.Dvsm):
    fast_options = 2

    def __init__(self, config):
        super().__init__(config)
        for block in self.blocks:
            block.__class__ = LoneBlock


CONTEXT = 4


def recipe(dim=192, heads=3, layers=4, patch=8, targets=8, optimiser="muon"):
    """64-pixel pictures, 4 context views, steps of about the same number of tokens."""
    return {
        "model": {"dim": dim, "heads": heads, "layers": layers, "patch": patch},
        "optimiser": optimiser, "lr": 1e-3, "weight_decay": 0.05, "warmup_steps": 20,
        "schedule": "wsd", "clip": 1.0, "average_decay": 0.99,
        "stages": [{"mix": {f"64/{patch}/{patch}": 1.0}, "context": {str(CONTEXT): 1.0},
                    "views": CONTEXT + targets, "tokens": 3072 * 64 // (patch * patch),
                    "reuse": 4}],
    }


# name -> (what it says in the table, recipe, network)
VARIANTS = {
    "base": ("D 192, 4 blocks, patch 8, 8 targets a scene, Muon", recipe(), dvsm.Dvsm),
    "two_stages": ("weight sharing off (encoder and decoder, twice the weights)", recipe(),
                   TwoStages),
    "lone_views": ("cross-view attention off in reconstruction", recipe(), LoneViews),
    "targets_1": ("1 target a scene", recipe(targets=1), dvsm.Dvsm),
    "targets_4": ("4 targets a scene", recipe(targets=4), dvsm.Dvsm),
    "targets_16": ("16 targets a scene", recipe(targets=16), dvsm.Dvsm),
    "patch_16": ("patch 16 (16 tokens a view)", recipe(patch=16), dvsm.Dvsm),
    "wide": ("wide: D 256, 2 blocks", recipe(dim=256, heads=4, layers=2), dvsm.Dvsm),
    "deep": ("deep: D 128, 8 blocks", recipe(dim=128, heads=2, layers=8), dvsm.Dvsm),
    "adamw": ("AdamW for every weight", recipe(optimiser="adamw"), dvsm.Dvsm),
}


def measure(name, minutes, generator, place, held_out_scenes=48):
    """Train one variant; a row of the table."""
    _, chosen, network = VARIANTS[name]
    args = types.SimpleNamespace(seed=0, init=None, out="", gradient_checkpointing=False,
                                 checkpoint_mib=None, plain=False)
    run = train.Run(args, chosen, place, network)
    patch = chosen["model"]["patch"]
    held_out = train.HeldOut(generator, held_out_scenes, CONTEXT, 4, patches=(patch, patch))
    steps = (data.plan(chosen, 0, n) for n in itertools.count())
    loader = data.Loader(generator, steps)
    loss_of, start, share = losses.Loss(), time.process_time(), 0.0
    while share < 1.0:
        step, batch = loader.get()
        lr = optim.learning_rate(chosen, run.step, max(0.0, 3 * share - 2))
        run.train_step(step, batch, loss_of, lr)
        run.step += 1
        run.scenes += step.scenes()
        share = (time.process_time() - start) / (60 * minutes)
    loader.close()
    return {"psnr": held_out.measure(run)[0], "steps": run.step, "scenes": run.scenes,
            "minutes": minutes,
            "weights": sum(weight.numel() for weight in run.net.parameters())}


def table(rows):
    """Markdown; differences are to the base."""
    lines = ["| variant | weights | scenes seen | held-out PSNR | to the base |",
             "|---|---|---|---|---|"]
    base = rows.get("base", {}).get("psnr")
    for name, row in rows.items():
        change = f"{row['psnr'] - base:+.2f} dB" if base is not None and name != "base" else ""
        lines.append(f"| {VARIANTS[name][0]} | {row['weights'] / 1e6:.1f} M | {row['scenes']} "
                     f"| {row['psnr']:.2f} dB | {change} |")
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--minutes", type=float, required=True, help="processor minutes a variant")
    parser.add_argument("--out", required=True, help="folder of the results")
    parser.add_argument("--only", nargs="+", choices=VARIANTS, help="these variants alone")
    parser.add_argument("--library", help="libdio_sim.so (default: build/release/lib)")
    args = parser.parse_args()
    train.keep_memory()
    torch.set_num_threads(1)
    place, generator, rows = train.Place(), source.open_library(args.library), {}
    os.makedirs(args.out, exist_ok=True)
    for name in args.only or VARIANTS:
        path = os.path.join(args.out, f"{name}.json")
        if not os.path.exists(path):
            row = measure(name, args.minutes, generator, place)
            with open(f"{path}.part", "w", encoding="utf-8") as file:
                json.dump(row, file)
            os.rename(f"{path}.part", path)
        with open(path, encoding="utf-8") as file:
            rows[name] = json.load(file)
        if rows[name]["minutes"] != args.minutes:
            raise SystemExit(f"ablate: {path} was made with {rows[name]['minutes']} minutes, not "
                             f"{args.minutes}: use another --out or the same --minutes")
        print(f"{name}: {rows[name]['psnr']:.2f} dB", file=sys.stderr, flush=True)
    print(table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
