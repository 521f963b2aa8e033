#!/usr/bin/env python3
"""Hold the trainer's network against golden cases made by an independent float64 oracle.

  checks.py GOLDEN_DIR        each sub-folder: model.safetensors, scene.json, images/, expected.npz
"""
import os
import sys

import numpy as np
import torch

import geometry
import model as dvsm
import sets

TOLERANCE = 1e-5


def check(folder, dtype):
    """Largest absolute difference of the render, and of the cache, in a case."""
    want = np.load(os.path.join(folder, "expected.npz"))
    net = dvsm.load(os.path.join(folder, "model.safetensors"), dtype).eval()
    scene = sets.load(folder)
    near, far = scene["context"], scene["target"]
    count = len(near["poses"])
    poses = torch.cat([near["poses"], far["poses"]])[None]
    rotation, centre = geometry.normalise_poses(poses, count)
    rotation, centre = rotation.to(dtype), centre.to(dtype)
    with torch.no_grad():
        cache = net.reconstruct(near["pictures"][None].to(dtype),
                                (rotation[:, :count], centre[:, :count],
                                 near["intrinsics"][None].to(dtype)), int(want["p1"]))
        render = net.render(cache, (rotation[:, count:], centre[:, count:],
                                    far["intrinsics"][None].to(dtype)),
                            far["size"], int(want["p2"]))
    worst = np.abs(render[0].double().numpy() - want["render"]).max()
    pairs = (("k0", cache[0][0]), ("v0", cache[0][1]), ("kL", cache[-1][0]), ("vL", cache[-1][1]))
    kept = max(np.abs(tensor[0].double().numpy() - want[name]).max() for name, tensor in pairs)
    return worst, kept


def main(folder):
    failed = False
    for case in sorted(os.listdir(folder)):
        path = os.path.join(folder, case)
        if not os.path.exists(os.path.join(path, "expected.npz")):
            continue
        for dtype in (torch.float32, torch.float64):
            render, cache = check(path, dtype)
            bad = not render <= TOLERANCE
            failed |= bad
            print(f"{case:15s} {str(dtype)[6:]:8s} render {render:.1e}  cache {cache:.1e}"
                  f"{'  FAILED' if bad else ''}")
    return 1 if failed else 0


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__.strip())
    sys.exit(main(sys.argv[1]))
