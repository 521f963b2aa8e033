"""Prepared view sets (scene.json beside its pictures) as tensors."""
import json
import os

import numpy as np
import torch
from PIL import Image


def read_picture(path):
    return np.asarray(Image.open(path).convert("RGB"), np.float32) / 255


def load(folder):
    """A scene.json: dict of name, and context / target with pictures, poses, intrinsics, files.

    Pictures of one role must share one size, as eval's prepare step makes them.
    """
    with open(os.path.join(folder, "scene.json"), encoding="utf-8") as file:
        scene = json.load(file)
    roles = {"context": [], "target": []}
    for frame in scene["frames"]:
        roles[frame.get("role", "context")].append(frame)
    out = {"name": scene.get("name", os.path.basename(os.path.normpath(folder)))}
    for role, frames in roles.items():
        if not frames:
            raise ValueError(f"{folder}/scene.json: no {role} frame")
        pictures = [read_picture(os.path.join(folder, f["file"])) if f.get("file") else None
                    for f in frames]
        cameras = [f.get("camera", scene["camera"]) for f in frames]
        out[role] = {
            "pictures": torch.from_numpy(np.stack(pictures)) if pictures[0] is not None else None,
            "poses": torch.tensor([f["world_from_camera"] for f in frames],
                                  dtype=torch.float64).reshape(-1, 4, 4),
            "intrinsics": torch.tensor([[c["fx"], c["fy"], c["cx"], c["cy"]] for c in cameras],
                                       dtype=torch.float64),
            "size": (cameras[0]["width"], cameras[0]["height"]),
            "files": [f.get("file") for f in frames],
        }
    return out
