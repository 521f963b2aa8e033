"""A contact sheet of random scenes: one picture of each, or a row of views a scene.

    train/start sheet OUT.png [--scenes 64] [--views 1] [--side 128] [--kinds all] [--photos FOLDER]
"""
import argparse
import math

import numpy as np
from PIL import Image

import data
import source


def montage(pictures, across):
    """[N, h, w, 3] bytes in rows of `across`, with a thin border."""
    count, height, width, _ = pictures.shape
    down = math.ceil(count / across)
    sheet = np.full((down * (height + 2), across * (width + 2), 3), 255, np.uint8)
    for i, picture in enumerate(pictures):
        y, x = i // across * (height + 2), i % across * (width + 2)
        sheet[y:y + height, x:x + width] = picture
    return sheet


def main():
    parser = argparse.ArgumentParser(prog="train/start sheet", description=__doc__.splitlines()[0])
    parser.add_argument("out", help="picture file to write")
    parser.add_argument("--scenes", type=int, default=64)
    parser.add_argument("--views", type=int, default=1, help="views of each scene, in a row")
    parser.add_argument("--side", type=int, default=128, help="pixels")
    parser.add_argument("--seed", type=int, default=data.HELD_OUT_SEED)
    parser.add_argument("--kinds", choices=data.KINDS, default="all")
    parser.add_argument("--library", help="libdio_sim.so")
    parser.add_argument("--photos", help="folder of photographs to print on things")
    args = parser.parse_args()
    generator = source.open_library(args.library, args.photos)
    # The order of views is random: of one view a scene it does not matter which.
    pictures, _, _ = generator.batch(args.seed, args.scenes, max(args.views, 2),
                                     (args.side, args.side), data.KINDS[args.kinds])
    pictures = np.asarray(pictures)[:, :args.views].reshape(-1, args.side, args.side, 3)
    across = args.views if args.views > 1 else math.ceil(math.sqrt(args.scenes))
    while args.views > 1 and across * 2 * (args.side + 2) < 1400:
        across *= 2
    Image.fromarray(montage(pictures, across)).save(args.out)


if __name__ == "__main__":
    main()
