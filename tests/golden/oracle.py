"""MODEL.md once more, in float64 numpy, section by section: what the engine is compared with.

Written for reading, not for speed: no step is fused, and no code is shared with the engine or the
trainer.
"""
import math
from dataclasses import dataclass

import numpy as np


@dataclass
class Config:
    """The `config` of a model file (section 6)."""
    dim: int
    heads: int
    layers: int
    patch: int
    mlp_ratio: int
    norm_eps: float
    rgb_out: str


@dataclass
class View:
    """One viewpoint: pinhole intrinsics, pose, and for a context view its picture."""
    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    world_from_camera: np.ndarray
    rgb: np.ndarray = None  # [height, width, 3] in [0, 1]


def render(config, weights, context, targets, patch_recon, patch_render):
    """A picture [height, width, 3] of every target, not clamped.

    weights  name of a tensor (section 6) -> float64 array
    """
    model = Model(config, weights)
    frame = normalise_rig(context)
    cache = model.reconstruct([model.context_tokens(view, frame, patch_recon) for view in context])
    return [model.picture(view, model.render(model.target_tokens(view, frame, patch_render), cache),
                          patch_render) for view in targets]


# Section 1: resampling

def resample(picture, width, height):
    """To width x height, one axis after the other."""
    rows = resampling_matrix(picture.shape[0], height)
    columns = resampling_matrix(picture.shape[1], width)
    return columns @ np.tensordot(rows, picture, axes=1)


def resampling_matrix(old, new):
    """[new, old]: each row holds the weights of the old samples in one new sample."""
    matrix = np.zeros((new, old))
    for i in range(new):
        if new < old:
            start, end = i * old / new, (i + 1) * old / new
            for j in range(old):
                overlap = min(end, j + 1) - max(start, j)
                matrix[i, j] = max(0.0, overlap) * new / old
        else:
            position = (i + 0.5) * old / new - 0.5
            left = math.floor(position)
            fraction = position - left
            matrix[i, max(left, 0)] += 1 - fraction
            matrix[i, min(left + 1, old - 1)] += fraction
    return matrix


# Section 2: pose normalisation

@dataclass
class RigFrame:
    """The similarity that brings a rig into the model's frame: c -> scale * axes (c - origin)."""
    axes: np.ndarray
    origin: np.ndarray
    scale: float


def unit(vector):
    return vector / np.linalg.norm(vector)


def normalise_rig(context):
    poses = np.array([view.world_from_camera for view in context])
    centres = poses[:, :3, 3]
    mean_y = poses[:, :3, 1].mean(axis=0)
    mean_z = poses[:, :3, 2].mean(axis=0)
    origin = centres.mean(axis=0)

    if np.linalg.norm(mean_z) < 1e-6 or np.linalg.norm(np.cross(mean_y, unit(mean_z))) < 1e-6:
        axes = poses[0, :3, :3].T
    else:
        z = unit(mean_z)
        x = unit(np.cross(mean_y, z))
        axes = np.array([x, np.cross(z, x), z])

    extent = np.abs((centres - origin) @ axes.T).max()
    return RigFrame(axes, origin, 1 / (1.35 * extent) if extent > 1e-9 else 1.0)


# Section 3: maps and patches

def token_grid(view, patch):
    """(across, down): tokens of a view at a stage's patch side; halves round up."""
    return (max(1, math.floor(view.width / patch + 0.5)),
            max(1, math.floor(view.height / patch + 0.5)))


def ray_map(view, frame, width, height):
    """[height, width, 6]: (o cross d, d) through the centre of each pixel of the map."""
    scale_x, scale_y = width / view.width, height / view.height
    fx, fy = view.fx * scale_x, view.fy * scale_y
    cx = (view.cx + 0.5) * scale_x - 0.5
    cy = (view.cy + 0.5) * scale_y - 0.5

    rotation = frame.axes @ view.world_from_camera[:3, :3]
    centre = frame.scale * frame.axes @ (view.world_from_camera[:3, 3] - frame.origin)

    u, v = np.meshgrid(np.arange(width), np.arange(height))
    in_camera = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones((height, width))], axis=-1)
    direction = in_camera @ rotation.T
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    moment = np.cross(np.broadcast_to(centre, direction.shape), direction)
    return np.concatenate([moment, direction], axis=-1)


def cut_into_patches(pixels, side):
    """[height, width, channels] -> [tokens, side * side * channels], channel fastest."""
    height, width, channels = pixels.shape
    down, across = height // side, width // side
    blocks = pixels.reshape(down, side, across, side, channels).transpose(0, 2, 1, 3, 4)
    return blocks.reshape(down * across, side * side * channels)


def put_patches_back(tokens, across, down, side):
    """The reverse of cut_into_patches."""
    channels = tokens.shape[1] // (side * side)
    blocks = tokens.reshape(down, across, side, side, channels).transpose(0, 2, 1, 3, 4)
    return blocks.reshape(down * side, across * side, channels)


# Sections 3 to 5: the network

def gelu(x):
    return 0.5 * x * (1 + np.vectorize(math.erf)(x / math.sqrt(2)))


def softmax(scores):
    powers = np.exp(scores - scores.max(axis=-1, keepdims=True))
    return powers / powers.sum(axis=-1, keepdims=True)


class Model:
    def __init__(self, config, weights):
        self.config = config
        self.weights = weights

    def linear(self, name, x):
        return x @ self.weights[name + ".weight"].T

    def layer_norm(self, name, x):
        centred = x - x.mean(axis=-1, keepdims=True)
        variance = (centred ** 2).mean(axis=-1, keepdims=True)
        return centred / np.sqrt(variance + self.config.norm_eps) * self.weights[name + ".weight"]

    def rms_norm(self, name, x):
        square = (x ** 2).mean(axis=-1, keepdims=True)
        return x / np.sqrt(square + self.config.norm_eps) * self.weights[name + ".weight"]

    # Section 3

    def rays(self, view, frame, patch):
        side = self.config.patch
        across, down = token_grid(view, patch)
        pixels = ray_map(view, frame, across * side, down * side)
        return self.linear("patch_ray", cut_into_patches(pixels, side))

    def context_tokens(self, view, frame, patch):
        side = self.config.patch
        across, down = token_grid(view, patch)
        rgb = cut_into_patches(resample(view.rgb, across * side, down * side), side)
        colours = self.linear("patch_rgb", 2 * rgb - 1)
        return self.layer_norm("embed_norm", self.rays(view, frame, patch) + colours)

    def target_tokens(self, view, frame, patch):
        return self.layer_norm("embed_norm", self.rays(view, frame, patch))

    # Section 4

    def query_key_value(self, name, x):
        """Each [heads, tokens, dim / heads]; query and key after QK-norm."""
        heads = self.config.heads
        query, key, value = (part.reshape(len(x), heads, -1).transpose(1, 0, 2)
                             for part in np.split(self.linear(name + ".qkv", x), 3, axis=1))
        return (self.rms_norm(name + ".q_norm", query), self.rms_norm(name + ".k_norm", key), value)

    def attention(self, name, query, key, value):
        scores = query @ key.transpose(0, 2, 1) / math.sqrt(query.shape[-1])
        mixed = softmax(scores) @ value
        tokens = mixed.transpose(1, 0, 2).reshape(query.shape[1], self.config.dim)
        return self.linear(name + ".out", tokens)

    def intra_attention(self, block, x):
        name = block + ".intra"
        query, key, value = self.query_key_value(name, self.layer_norm(name + "_norm", x))
        return x + self.attention(name, query, key, value)

    def mlp(self, name, x):
        hidden = gelu(self.linear(name + "_mlp.up", self.layer_norm(name + "_mlp_norm", x)))
        return x + self.linear(name + "_mlp.down", hidden)

    def reconstruct(self, views):
        """Tokens of the context views -> the KV-cache: (key, value) of each block's cross layer."""
        cache = []
        for i in range(self.config.layers):
            block = f"blocks.{i}"
            views = [self.mlp(block + ".intra", self.intra_attention(block, x)) for x in views]

            name = block + ".cross"
            x = np.concatenate(views)
            query, key, value = self.query_key_value(name, self.layer_norm(name + "_norm", x))
            cache.append((key, value))
            x = self.mlp(name, x + self.attention(name, query, key, value))
            views = np.split(x, np.cumsum([len(view) for view in views])[:-1])
        return cache

    def render(self, x, cache):
        """Tokens of one target view after the last block."""
        for i, (key, value) in enumerate(cache):
            block = f"blocks.{i}"
            x = self.mlp(block + ".intra", self.intra_attention(block, x))

            name = block + ".cross"
            query, _, _ = self.query_key_value(name, self.layer_norm(name + "_norm", x))
            x = self.mlp(name, x + self.attention(name, query, key, value))
        return x

    # Section 5

    def picture(self, view, x, patch):
        y = self.linear("to_rgb", self.layer_norm("final_norm", x))
        rgb = 1 / (1 + np.exp(-y)) if self.config.rgb_out == "sigmoid" else 0.5 + 0.5 * y
        pixels = put_patches_back(rgb, *token_grid(view, patch), self.config.patch)
        return resample(pixels, view.width, view.height)
