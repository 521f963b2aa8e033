"""The work that `diorama bench --save` leaves, as arrays that every peer starts from."""
import json
import struct
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "golden"))
import oracle

# Tensors of half a block in the order in which a block file holds them.
HALF = ("{0}_norm", "{0}.qkv", "{0}.q_norm", "{0}.k_norm", "{0}.out", "{0}_mlp_norm", "{0}_mlp.up",
        "{0}_mlp.down")


@dataclass
class Work:
    """Patches of the context and of one target; the peers begin behind ray maps and pictures."""
    config: oracle.Config
    weights: dict  # name without ".weight" -> float32
    context_ray: np.ndarray  # [views, tokens, 6 q q]
    context_rgb: np.ndarray  # [views, tokens, 3 q q], 2 rgb - 1
    target_ray: np.ndarray  # [1, tokens, 6 q q]
    target: oracle.View

    @property
    def views(self):
        return len(self.context_ray)

    @property
    def tokens(self):
        return self.target_ray.shape[1]

    def picture(self, numbers):
        """What the last product gave, [tokens, 3 q q], as a picture."""
        numbers = np.asarray(numbers, np.float64).reshape(self.tokens, -1)
        rgb = 1 / (1 + np.exp(-numbers)) if self.config.rgb_out == "sigmoid" else 0.5 + 0.5 * numbers
        side = self.config.patch
        grid = (self.target.width // side, self.target.height // side)
        return oracle.put_patches_back(rgb, *grid, side)


def read_tensors(path):
    """(config, tensors) of a model file of F32 numbers."""
    with open(path, "rb") as file:
        size, = struct.unpack("<Q", file.read(8))
        header = json.loads(file.read(size))
        body = np.frombuffer(file.read(), np.uint8)
    stated = json.loads(header.pop("__metadata__")["config"])
    names = oracle.Config.__dataclass_fields__
    config = oracle.Config(**{key: value for key, value in stated.items() if key in names})
    tensors = {}
    for name, entry in header.items():
        if entry["dtype"] != "F32":
            raise SystemExit(f"{path}: tensor {name} is {entry['dtype']}, only F32 is compared")
        first, last = entry["data_offsets"]
        numbers = body[first:last].view("<f4").reshape(entry["shape"])
        tensors[name.removesuffix(".weight")] = numbers
    return config, tensors


def read_view(frame, shared, folder):
    import png
    camera = frame.get("camera", shared)
    rgb = png.read(folder / frame["file"]) / 255 if "file" in frame else None
    return oracle.View(width=camera["width"], height=camera["height"], fx=camera["fx"],
                       fy=camera["fy"], cx=camera["cx"], cy=camera["cy"],
                       world_from_camera=np.array(frame["world_from_camera"]).reshape(4, 4), rgb=rgb)


def read(model, scene):
    """The work of a model file and a scene.json, at the model's own patch."""
    scene = Path(scene)
    config, weights = read_tensors(model)
    text = json.loads(scene.read_text())
    views = [(frame.get("role", "context"), read_view(frame, text.get("camera"), scene.parent))
             for frame in text["frames"]]
    context = [view for role, view in views if role == "context"]
    target = next(view for role, view in views if role == "target")
    side = config.patch
    for view in (*context, target):
        if view.width % side or view.height % side:
            raise SystemExit(f"{scene}: {view.width}x{view.height} is no whole number of patches")
    frame = oracle.normalise_rig(context)

    def rays(view):
        pixels = oracle.ray_map(view, frame, view.width, view.height)
        return oracle.cut_into_patches(pixels, side).astype(np.float32)

    def colours(view):
        return oracle.cut_into_patches(2 * view.rgb - 1, side).astype(np.float32)

    return Work(config, weights, np.stack([rays(view) for view in context]),
                np.stack([colours(view) for view in context]), rays(target)[None], target)


def write_block(work, path):
    """Everything as one run of numbers, for peers written in C: see block.h."""
    config = work.config
    with open(path, "wb") as file:
        file.write(struct.pack("<7If", config.dim, config.heads, config.layers, config.patch,
                               config.mlp_ratio, work.views, work.tokens, config.norm_eps))
        arrays = [work.context_ray, work.context_rgb, work.target_ray,
                  *(work.weights[name] for name in ("patch_ray", "patch_rgb", "embed_norm"))]
        for layer in range(config.layers):
            for half in ("intra", "cross"):
                arrays += [work.weights[f"blocks.{layer}." + name.format(half)] for name in HALF]
        arrays += [work.weights["final_norm"], work.weights["to_rgb"]]
        for array in arrays:
            file.write(np.ascontiguousarray(array, "<f4").tobytes())
