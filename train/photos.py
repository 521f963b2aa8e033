"""Photographs for textures: square crops of the pictures in a folder.

Debian's wallpaper packages hold some hundred photographs under free licences; `train/start photos`
fetches them into build/train/photos. They stay there: nothing of them is committed or shipped.
"""
import os
import random

import numpy as np
from PIL import Image

SUFFIXES = (".jpg", ".jpeg", ".png", ".webp")
SIDE = 256
CROPS = 3  # of each picture
LIMIT = 384


def find(folder):
    """Pictures below a folder, the largest file of each name-giving folder: wallpapers come in
    many sizes of the same motif, each motif in a folder of its own or under a name of its own."""
    found = {}
    for place, _, names in os.walk(folder):
        for name in sorted(names):
            path = os.path.join(place, name)
            if not name.lower().endswith(SUFFIXES) or os.path.islink(path):
                continue
            stem = os.path.splitext(name)[0]
            # A picture named by its size belongs to the motif that its folders name.
            sized = stem.replace("x", "").replace("_", "").isdigit()
            motif = os.path.dirname(place) if sized else os.path.join(place, stem)
            if motif not in found or os.path.getsize(path) > os.path.getsize(found[motif]):
                found[motif] = path
    return [found[motif] for motif in sorted(found)]


def crops(path, rng):
    """Square parts of a picture at several scales, [SIDE, SIDE, 3] bytes each."""
    with Image.open(path) as picture:
        picture.draft("RGB", (4 * SIDE, 4 * SIDE))
        picture = picture.convert("RGB")
    least = min(picture.size)
    for _ in range(CROPS):
        side = int(least * rng.uniform(0.3, 1.0))
        x, y = (rng.randrange(length - side + 1) for length in picture.size)
        part = picture.resize((SIDE, SIDE), Image.LANCZOS, (x, y, x + side, y + side))
        yield np.asarray(part)


def has_content(crop):
    """Not a flat piece of sky or a plain gradient."""
    grey = crop.astype(np.float32).mean(2)
    return np.abs(np.diff(grey, axis=0)).mean() + np.abs(np.diff(grey, axis=1)).mean() > 2.0


def load(folder):
    """[N, SIDE, SIDE, 3] bytes; the same for the same folder. SystemExit when nothing is there."""
    made = os.path.join(folder, f"crops-{SIDE}.npy")  # reading large pictures takes a minute
    if os.path.exists(made):
        return np.load(made)
    rng, found = random.Random(7), []
    for path in find(folder):
        try:
            found += [crop for crop in crops(path, rng) if has_content(crop)]
        except (OSError, ValueError) as fault:
            print(f"train: {path}: {fault}: left out")
    if not found:
        raise SystemExit(f"train: no photograph ({', '.join(SUFFIXES)}) below {folder}; "
                         "`train/start photos` fetches some")
    rng.shuffle(found)
    found = np.stack(found[:LIMIT])
    try:
        np.save(made + ".part.npy", found)
        os.replace(made + ".part.npy", made)
    except OSError:
        pass  # a folder that cannot be written to: read them again next time
    return found
