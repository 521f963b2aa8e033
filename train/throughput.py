#!/usr/bin/env python3
"""How long a training step takes: PyTorch alone beside what training uses, as a Markdown table.

  throughput.py [--threads N] [--steps N] [--only NAME ...]

The step has the network of recipes/cpu.json and 5 scenes of 4 context and 8 target views: forward,
loss, backward, optimiser, average of the weights; scenes are drawn before. Its products are counted
from the shapes; the matrix rate is that of PyTorch's own product of 2048 x 2048 matrices, measured
first. Fastest of N.
"""
import argparse
import os
import sys
import time
import types

import torch

import data
import fast
import losses
import train

HERE = os.path.dirname(os.path.abspath(__file__))
CONTEXT, VIEWS, SCENES, SIZE = 4, 12, 5, (64, 64)


class Noise:
    """Pictures without a meaning, cameras on a line: time does not depend on what is seen."""

    def batch(self, seed, scenes, views, size, options=0):
        random = torch.Generator().manual_seed(seed)
        poses = torch.eye(4).repeat(scenes, views, 1, 1)
        poses[..., :3, 3] = torch.rand(scenes, views, 3, generator=random)
        pictures = torch.rand(scenes, views, size[1], size[0], 3, generator=random)
        intrinsics = torch.tensor([size[0], size[0], size[0] / 2 - 0.5, size[1] / 2 - 0.5])
        return pictures, poses, intrinsics.repeat(scenes, views, 1)


def products(config):
    """Floating-point operations in a step's matrix products inside the blocks."""
    tokens = SIZE[0] * SIZE[1] // config.patch ** 2
    given, asked = CONTEXT * tokens, (VIEWS - CONTEXT) * tokens
    square = config.dim ** 2
    layer = (given + asked) * 24 * square - asked * 2 * square
    attention = 2 * config.dim * (given + asked) * (tokens + given)
    unused = given * (10 * square + 2 * config.dim * given)  # context rows behind the last keys
    return 3 * 2 * SCENES * (config.layers * (layer + attention) - unused)


def fastest(function, count):
    function()
    times = []
    for _ in range(count):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


def matrix_rate(count):
    """Operations a second of large products, float32 and bfloat16."""
    side, rates = 2048, []
    for kind in (torch.float32, torch.bfloat16):
        a, b = (torch.randn(side, side).to(kind) for _ in range(2))
        rates.append(2 * side ** 3 / fastest(lambda a=a, b=b: a @ b, count))
    return rates


def stepper(recipe, plain, exact):
    """A function that does one step."""
    args = types.SimpleNamespace(seed=0, init=None, out="", gradient_checkpointing=False,
                                 checkpoint_mib=None, plain=plain)
    place = train.Place()
    if exact:
        place.autocast = lambda: torch.autocast("cpu", enabled=False)
    run, loss_of = train.Run(args, recipe, place), losses.Loss()
    step = data.Step(CONTEXT, SIZE, (8, 8), 1, ((0, SCENES),), tuple(range(VIEWS)))
    batch = data.draw(Noise(), step)
    return lambda: run.train_step(step, batch, loss_of, 1e-4)


VARIANTS = {"float32": ("PyTorch, float32", True, True),
            "bfloat16": ("PyTorch, bfloat16", True, False),
            "blocks": ("blocks and Muon in C (`train/blocks`)", False, False)}


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--steps", type=int, default=3)
    parser.add_argument("--only", nargs="+", choices=VARIANTS, default=list(VARIANTS))
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    train.keep_memory()
    recipe = data.load_recipe(os.path.join(HERE, "recipes", "cpu.json"))
    if "blocks" in args.only and not fast.open_library():
        raise SystemExit("throughput: no AVX-512, or the blocks in C are not built (cmake --build "
                         "--preset release --target dio_blocks); name the others with --only")
    rates = matrix_rate(args.steps)
    print(f"{args.threads} threads; products of 2048 x 2048: float32 {rates[0] / 1e9:.0f}, "
          f"bfloat16 {rates[1] / 1e9:.0f} GFLOP/s\n")
    print("| step | seconds | tokens a second | GFLOP/s in products | share of the matrix rate |\n"
          "|---|---|---|---|---|")
    for name in args.only:
        title, plain, exact = VARIANTS[name]
        seconds = fastest(stepper(recipe, plain, exact), args.steps)
        config = train.dvsm.Config(**recipe["model"])
        rate = products(config) / seconds
        tokens = SCENES * VIEWS * SIZE[0] * SIZE[1] // config.patch ** 2
        print(f"| {title} | {seconds:.2f} | {tokens / seconds:.0f} | {rate / 1e9:.0f} | "
              f"{100 * rate / rates[0 if exact else 1]:.0f} % |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
