#!/usr/bin/env python3
"""Score a model file with the C engine: PSNR and SSIM beside nearest-view and plane-sweep pictures.

  evaluate.py generated --out FOLDER [--scenes 64]          make held-out sets (never trained on)
  evaluate.py score --model M --sets FOLDER... [--patches 32,32 16,16] [--out RESULT.json]

FOLDER holds prepared sets, one sub-folder each (scene.json, pictures), of generated scenes or of
real captures. Real captures are for evaluation alone. Needs build/release/bin/diorama; --baselines
names the script that makes the plane-sweep figures (it needs OpenCV's Python module).
"""
import argparse
import json
import os
import re
import subprocess
import sys

import numpy as np
from PIL import Image

REPOSITORY = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
DIORAMA = os.path.join(REPOSITORY, "build", "release", "bin", "diorama")
HELD_OUT_SEED = 1 << 16  # training seeds start at 1 << 20
CONTEXTS, SIZES, TARGETS = (2, 4, 8), (128, 256), 4


def frame(role, name, pose, intrinsics, size):
    fx, fy, cx, cy = (float(v) for v in intrinsics)
    return {"file": name, "role": role, "world_from_camera": [float(v) for v in pose.reshape(-1)],
            "camera": {"width": size, "height": size, "fx": fx, "fy": fy, "cx": cx, "cy": cy,
                       "dist": [0, 0, 0, 0, 0]}}


def rigid(pose):
    """float32 rotations are off by 1e-7; the nearest exact one keeps readers content."""
    pose = np.asarray(pose, np.float64).copy()
    u, _, vt = np.linalg.svd(pose[:3, :3])
    pose[:3, :3] = u @ vt
    return pose


def write_generated(out, library, scenes):
    """FOLDER/g<size>v<context>/<scene>: the same pictures and targets at every size and context."""
    import source
    generator = source.open_library(library)
    largest, views = max(SIZES), max(CONTEXTS) + TARGETS
    for index in range(scenes):
        pictures, poses, intrinsics = (t.numpy()[0] for t in generator.batch(
            HELD_OUT_SEED + index, 1, views, (largest, largest)))
        for size in SIZES:
            scale = size / largest
            scaled = np.concatenate([intrinsics[:, :2] * scale,
                                     (intrinsics[:, 2:] + 0.5) * scale - 0.5], 1)
            small = [Image.fromarray(p).resize((size, size), Image.BOX) for p in pictures]
            for context in CONTEXTS:
                folder = os.path.join(out, f"g{size}v{context}", f"{index:03d}")
                os.makedirs(os.path.join(folder, "images"), exist_ok=True)
                frames = []
                for v in list(range(context)) + list(range(views - TARGETS, views)):
                    name = f"images/{v:03d}.png"
                    small[v].save(os.path.join(folder, name))
                    role = "context" if v < context else "target"
                    frames.append(frame(role, name, rigid(poses[v]), scaled[v], size))
                with open(os.path.join(folder, "scene.json"), "w", encoding="utf-8") as file:
                    json.dump({"name": f"generated-{index:03d}", "camera": frames[0]["camera"],
                               "frames": frames}, file, indent=1)


def run_engine(args, scene, patches):
    """One call of `diorama eval --json`."""
    command = [args.diorama, "eval", "--model", args.model, "--scene", scene, "--json",
               "--threads", str(args.threads), "--deblock", args.deblock]
    if patches:
        command += ["--patch-recon", str(patches[0]), "--patch-render", str(patches[1])]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(f"evaluate: {' '.join(command)}: {done.stderr.strip()}")
    return json.loads(done.stdout)


def run_baselines(args, folders):
    """name -> (plane-sweep PSNR, SSIM), by the baseline script."""
    if not args.baselines:
        return {}
    done = subprocess.run([args.baselines_python, args.baselines, *folders], capture_output=True,
                          text=True, check=True)
    pattern = re.compile(r"^(\S+)\s+nearest.*?sweep\s+([\d.]+) dB ([\d.]+)")
    rows = (pattern.match(line) for line in done.stdout.splitlines())
    return {m.group(1): (float(m.group(2)), float(m.group(3))) for m in rows if m}


def score_folder(args, folder, patches):
    """Rows of one folder of sets and the means, with sets weighing the same."""
    names = sorted(n for n in os.listdir(folder)
                   if os.path.exists(os.path.join(folder, n, "scene.json")))
    if not names:
        raise SystemExit(f"evaluate: {folder} holds no sub-folder with a scene.json; make it with "
                         "`evaluate.py generated` or the preparation script of the captures")
    rows = []
    for name in names:
        result = run_engine(args, os.path.join(folder, name, "scene.json"), patches)
        rows.append({"set": name, **{key: result[key] for key in (
            "context_views", "psnr_db", "ssim", "nearest_psnr_db", "nearest_ssim",
            "reconstruct_ms", "render_ms")}})
    means = {key: float(np.mean([row[key] for row in rows])) for key in rows[0] if key != "set"}
    return rows, means


def score(args):
    results = []
    points = [tuple(int(n) for n in p.split(",")) for p in args.patches] or [None]
    for folder in args.sets:
        label = os.path.basename(os.path.normpath(folder))
        names = sorted(os.listdir(folder))
        sweep = run_baselines(args, [os.path.join(folder, n) for n in names])
        for patches in points:
            rows, means = score_folder(args, folder, patches)
            results.append({"sets": label, "patches": patches, "rows": rows, "mean": means,
                            "sweep": sweep})
            text = f"{patches[0]},{patches[1]}" if patches else "auto"
            print(f"{label:8s} {text:6s} {len(rows):3d} sets  {means['psnr_db']:6.2f} dB "
                  f"{means['ssim']:.3f}   nearest {means['nearest_psnr_db']:6.2f} dB "
                  f"{means['nearest_ssim']:.3f}", end="")
            if sweep:
                mean = np.mean(list(sweep.values()), 0)
                print(f"   sweep {mean[0]:6.2f} dB {mean[1]:.3f}", end="")
            print(flush=True)
            if args.verbose:
                for row in rows:
                    print(f"    {row['set']:20s} {row['psnr_db']:6.2f} dB {row['ssim']:.3f}   "
                          f"nearest {row['nearest_psnr_db']:6.2f} dB {row['nearest_ssim']:.3f}")
    if args.out:
        with open(args.out, "w", encoding="utf-8") as file:
            json.dump({"model": os.path.basename(args.model), "results": results}, file, indent=1)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawTextHelpFormatter)
    verbs = parser.add_subparsers(dest="verb", required=True)
    make = verbs.add_parser("generated")
    make.add_argument("--out", required=True)
    make.add_argument("--scenes", type=int, default=64)
    make.add_argument("--library")
    rate = verbs.add_parser("score")
    rate.add_argument("--model", required=True)
    rate.add_argument("--sets", nargs="+", required=True)
    rate.add_argument("--patches", nargs="*", default=[],
                      help="p1,p2 ... (default: the engine's choice)")
    rate.add_argument("--out", help="all figures as JSON")
    rate.add_argument("--diorama", default=DIORAMA)
    rate.add_argument("--threads", type=int, default=0)
    rate.add_argument("--deblock", choices=("auto", "on", "off"), default="auto",
                      help="even out seams of patches (default: as the model's card says)")
    rate.add_argument("--baselines", help="baselines.py, for the plane sweep")
    rate.add_argument("--baselines-python", default="/usr/bin/python3")
    rate.add_argument("--verbose", action="store_true", help="a line for each set")
    args = parser.parse_args()
    if args.verb == "generated":
        write_generated(args.out, args.library, args.scenes)
    else:
        score(args)
    return 0


if __name__ == "__main__":
    sys.exit(main())
