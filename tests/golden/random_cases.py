"""Random models and scenes: `diorama render --raw` against the oracle beside this file.

usage: random_cases.py DIORAMA [--reference PROGRAM] [--cases N] [--seed S] [--keep DIR]

A case is all drawn from its seed: sizes of the model, weights and their type, cameras, pictures,
patch sides. Exit 0 when all agree, 1 when one does not, 77 when numpy or cv2 is missing.
"""
import argparse
import json
import os
import struct
import subprocess
import sys
import tempfile

try:
    import cv2
    import numpy as np
except ImportError as missing:
    print(f"skipped: {missing}: install python3-numpy and python3-opencv")
    sys.exit(77)

import oracle

# Largest absolute difference of a float32 implementation (MODEL.md, section 9).
TOLERANCE = 1e-5

# The same of tests/bench/reference64, which works in double as the oracle does.
REFERENCE_TOLERANCE = 1e-12

TIERS = ("scalar", "sse2", "avx2", "avx512", "neon")

# Cameras that come in pairs, and how the second is turned in the axes of the first: so that the z
# axes cancel out, or that the mean of the y axes is the mean of the z axes.
PAIRS = {
    "back to back": [[-1, 0, 0], [0, 1, 0], [0, 0, -1]],
    "crossed": [[-1, 0, 0], [0, 0, 1], [0, 1, 0]],
}
RIGS = ("scattered", "scattered", "scattered", "one place", *PAIRS)


class Mismatch(Exception):
    pass


# Drawing a case

class Case:
    """One drawn model and scene: write() lays the files out, check() compares one target."""

    def __init__(self, seed):
        self.random = np.random.default_rng(seed)
        self.seed = seed
        self.config = self.draw_config()
        self.type = str(self.random.choice(["F32", "F16", "BF16"]))
        self.patch_recon = int(self.random.choice([3, 4, 7, 8, 16]))
        self.patch_render = int(self.random.choice([4, 5, 8, 13]))
        self.rig = str(self.random.choice(RIGS))
        self.stored = {name: self.draw_tensor(shape, mean, spread)
                       for name, shape, mean, spread in tensors_of(self.config)}
        count = 2 * self.random.integers(1, 3) if self.rig in PAIRS else self.random.integers(1, 6)
        self.context = [self.draw_view(has_picture=True) for _ in range(count)]
        self.place_rig()
        self.targets = [self.draw_view(has_picture=False) for _ in range(2)]
        weights = {name: values for name, (values, _) in self.stored.items()}
        self.expected = oracle.render(self.config, weights, self.context, self.targets,
                                      self.patch_recon, self.patch_render)

    def __str__(self):
        views = ", ".join(f"{v.width}x{v.height}" for v in self.context)
        targets = ", ".join(f"{v.width}x{v.height}" for v in self.targets)
        return (f"seed {self.seed}: {self.config}, weights {self.type}, rig {self.rig}, "
                f"context {views} in patches of {self.patch_recon}, "
                f"targets {targets} in patches of {self.patch_render}")

    def draw_config(self):
        pick = self.random.choice
        heads = int(pick([1, 2, 3, 5]))
        # Head sizes on, beside and far from the multiples that vector code likes.
        return oracle.Config(dim=heads * int(pick([8, 12, 20, 24, 33, 64])), heads=heads,
                             layers=int(pick([1, 2, 3])), patch=int(pick([4, 5, 6, 7, 8])),
                             mlp_ratio=int(pick([1, 2, 3, 4])),
                             norm_eps=float(pick([1e-6, 1e-5, 1e-3])),
                             rgb_out=str(pick(["linear", "sigmoid"])))

    def draw_tensor(self, shape, mean, spread):
        """(values that the file's type holds exactly, their bytes)."""
        values = (mean + spread * self.random.standard_normal(shape)).astype("<f4")
        if self.type == "F16":
            values = values.astype("<f2")
            return values.astype(np.float64), values.tobytes()
        if self.type == "BF16":
            upper = (values.view("<u4") >> 16).astype("<u2")
            widened = (upper.astype("<u4") << 16).view("<f4")
            return widened.astype(np.float64), upper.tobytes()
        return values.astype(np.float64), values.tobytes()

    def draw_view(self, has_picture):
        random = self.random
        width, height = (int(side) for side in random.integers(5, 60, size=2))
        pose = np.eye(4)
        pose[:3, :3] = cv2.Rodrigues(0.5 * random.standard_normal(3))[0]
        pose[:3, 3] = [100, -50, 7] + 3 * random.standard_normal(3)
        # The engine's pictures are floats.
        rgb = (np.float32(random.integers(0, 256, (height, width, 3))) / np.float32(255)
               if has_picture else None)
        return oracle.View(width=width, height=height,
                           fx=width * random.uniform(0.6, 1.5),
                           fy=width * random.uniform(0.6, 1.5),
                           cx=width / 2 + random.uniform(-3, 3),
                           cy=height / 2 + random.uniform(-3, 3),
                           world_from_camera=pose, rgb=rgb)

    def place_rig(self):
        """The rigs for which pose normalisation has rules of their own."""
        if self.rig in PAIRS:
            for one, other in zip(self.context[::2], self.context[1::2]):
                other.world_from_camera[:3, :3] = one.world_from_camera[:3, :3] @ PAIRS[self.rig]
        if self.rig == "one place":
            for view in self.context:
                view.world_from_camera[:3, 3] = self.context[0].world_from_camera[:3, 3]

    # Files

    def write(self, folder):
        os.makedirs(os.path.join(folder, "images"), exist_ok=True)
        write_model(os.path.join(folder, "model.safetensors"), self.config, self.type,
                    self.stored, self.random)
        for i, view in enumerate(self.context):
            pixels = np.round(view.rgb * 255).astype(np.uint8)
            if not cv2.imwrite(os.path.join(folder, "images", f"{i}.png"), pixels[:, :, ::-1]):
                raise OSError(f"{folder}: cannot write a picture")
        # One scene a target: the raw output wants all pictures of one size.
        for i, target in enumerate(self.targets):
            frames = [scene_frame(view, f"images/{j}.png") for j, view in enumerate(self.context)]
            frames.append(scene_frame(target, None))
            scene = {"name": f"case {self.seed}", "camera": frames[0]["camera"], "frames": frames}
            with open(os.path.join(folder, f"target{i}.json"), "w") as file:
                json.dump(scene, file)

    # Comparing

    def run(self, folder, target, raw, *command):
        """Run a renderer on one target; the bytes of the array that it leaves in `raw`."""
        command = [*command, "--model", os.path.join(folder, "model.safetensors"),
                   "--scene", os.path.join(folder, f"target{target}.json"),
                   "--patch-recon", str(self.patch_recon),
                   "--patch-render", str(self.patch_render)]
        if os.path.exists(raw):
            os.remove(raw)
        run = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        if run.returncode != 0:
            raise Mismatch(f"exit {run.returncode} of {' '.join(command)}\n{run.stderr.strip()}")
        with open(raw, "rb") as file:
            return file.read()

    def render(self, diorama, folder, target, *options):
        """The bytes of frames.npy."""
        out = os.path.join(folder, "out")
        return self.run(folder, target, os.path.join(out, "frames.npy"), diorama, "render",
                        "--out", out, "--raw", *options)

    def compare(self, what, raw, target, tolerance):
        """Compare the array of one target; returns the largest difference."""
        got = np.load(raw)
        wanted = self.expected[target][np.newaxis]
        if got.shape != wanted.shape:
            raise Mismatch(f"{what}: shape {got.shape}, {wanted.shape} is expected")
        difference = float(np.abs(got - wanted).max())
        if not difference <= tolerance:  # this way round a NaN fails too
            raise Mismatch(f"{what}: off by {difference:.2g}, {tolerance:g} is allowed")
        return difference

    def check(self, diorama, folder, target, *options):
        """Render and compare one target; returns the largest difference."""
        self.render(diorama, folder, target, *options)
        return self.compare(" ".join([f"target {target}", *options]),
                            os.path.join(folder, "out", "frames.npy"), target, TOLERANCE)

    def check_reference(self, reference, folder):
        """The same of the reference in double; returns the largest difference of all targets."""
        raw = os.path.join(folder, "reference.npy")
        worst = 0.0
        for target in range(len(self.targets)):
            self.run(folder, target, raw, reference, "--out", raw)
            worst = max(worst, self.compare(f"reference, target {target}", raw, target,
                                            REFERENCE_TOLERANCE))
        return worst


def tensors_of(config):
    """(name, shape, mean, spread) of every tensor of a model file (MODEL.md, section 6)."""
    dim, pixels = config.dim, config.patch ** 2
    head, hidden = dim // config.heads, config.dim * config.mlp_ratio
    yield "patch_ray.weight", (dim, 6 * pixels), 0, 0.08
    yield "patch_rgb.weight", (dim, 3 * pixels), 0, 0.08
    yield "embed_norm.weight", (dim,), 1, 0.08
    for i in range(config.layers):
        for kind in ("intra", "cross"):
            name = f"blocks.{i}.{kind}"
            yield name + "_norm.weight", (dim,), 1, 0.08
            yield name + ".qkv.weight", (3 * dim, dim), 0, 0.9 / dim ** 0.5
            yield name + ".q_norm.weight", (head,), 1, 0.08
            # Above one, so that the softmax is far from a plain mean.
            yield name + ".k_norm.weight", (head,), 1.5, 0.08
            yield name + ".out.weight", (dim, dim), 0, 0.08
            yield name + "_mlp_norm.weight", (dim,), 1, 0.08
            yield name + "_mlp.up.weight", (hidden, dim), 0, 0.08
            yield name + "_mlp.down.weight", (dim, hidden), 0, 0.08
    yield "final_norm.weight", (dim,), 1, 0.08
    yield "to_rgb.weight", (3 * pixels, dim), 0, 0.08


def write_model(path, config, type_name, stored, random):
    """Safetensors; the tensors stand in the file in no particular order."""
    text = json.dumps({**vars(config), "pose_norm": "gs-lrm", "prior": None})
    header = {"__metadata__": {"format": "dvsm", "version": "1", "config": text}}
    data = b""
    for name in random.permutation(list(stored)):
        values, encoded = stored[name]
        header[str(name)] = {"dtype": type_name, "shape": list(values.shape),
                             "data_offsets": [len(data), len(data) + len(encoded)]}
        data += encoded
    encoded_header = json.dumps(header).encode()
    with open(path, "wb") as file:
        file.write(struct.pack("<Q", len(encoded_header)) + encoded_header + data)


def scene_frame(view, picture):
    camera = {"width": view.width, "height": view.height, "fx": view.fx, "fy": view.fy,
              "cx": view.cx, "cy": view.cy, "dist": [0, 0, 0, 0, 0]}
    frame = {"world_from_camera": view.world_from_camera.ravel().tolist(), "camera": camera,
             "role": "context" if picture else "target"}
    if picture:
        frame["file"] = picture
    return frame


# The checks

def check_threads(case, diorama, folder):
    one = case.render(diorama, folder, 0, "--threads", "1")
    three = case.render(diorama, folder, 0, "--threads", "3")
    if one != three:
        raise Mismatch("the numbers depend on the number of threads (1 and 3)")
    print("1 and 3 threads: the same bytes")


def check_tiers(case, diorama, folder):
    for tier in TIERS:
        try:
            difference = case.check(diorama, folder, 0, "--cpu", tier)
        except Mismatch as mismatch:
            # Every processor has the scalar tier; of the others it says which it lacks.
            if tier == "scalar" or "this CPU has no such tier" not in str(mismatch):
                raise
            print(f"--cpu {tier}: not on this processor")
            continue
        print(f"--cpu {tier}: off by {difference:.1e}")


def run_case(seed, arguments, folder, *further):
    """True when the case drawn from `seed` agrees."""
    case = Case(seed)
    case.write(folder)
    try:
        worst = max(case.check(arguments.diorama, folder, i) for i in range(len(case.targets)))
        print(f"seed {seed}: off by {worst:.1e}")
        if arguments.reference:
            print(f"  the reference by {case.check_reference(arguments.reference, folder):.1e}")
        for check in further:
            check(case, arguments.diorama, folder)
    except Mismatch as mismatch:
        print(f"FAILED {case}\n  {mismatch}\n  again: {sys.argv[0]} {arguments.diorama} "
              f"--seed {seed} --cases 1 --keep DIR")
        return False
    return True


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("diorama", help="the program under test")
    parser.add_argument("--reference", help="tests/bench/reference64, compared as well")
    parser.add_argument("--cases", type=int, default=16)
    parser.add_argument("--seed", type=int, default=1, help="of the first case")
    parser.add_argument("--keep", metavar="DIR", help="leave the cases' files here")
    arguments = parser.parse_args()
    failed = 0
    with tempfile.TemporaryDirectory(prefix="dio-random-") as temporary:
        for i in range(arguments.cases):
            seed = arguments.seed + i
            folder = os.path.join(arguments.keep or temporary, f"case{seed}")
            further = (check_threads, check_tiers) if i == 0 else ()
            failed += not run_case(seed, arguments, folder, *further)
    print(f"{arguments.cases - failed} of {arguments.cases} random cases agree")
    return 1 if failed or arguments.cases < 1 else 0


if __name__ == "__main__":
    sys.exit(main())
