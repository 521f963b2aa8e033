"""Cameras, rays and resampling exactly as MODEL.md states them (sections 1 to 3)."""
import functools

import numpy as np
import torch
import torch.nn.functional as F


def normalise_poses(poses, context):
    """Bring a rig into the model's frame (section 2), from the first `context` cameras.

    poses [B, V, 4, 4] world_from_camera; returns rotations [B, V, 3, 3] and centres [B, V, 3].
    """
    rotation, centre = poses[..., :3, :3], poses[..., :3, 3]
    origin = centre[:, :context].mean(1, keepdim=True)
    mean_z = rotation[:, :context, :, 2].mean(1)
    mean_y = rotation[:, :context, :, 1].mean(1)
    z = F.normalize(mean_z, dim=-1)
    x = torch.linalg.cross(mean_y, z)
    # Axes that cancel out (a full ring of level cameras) say nothing: take the first camera's.
    shortest = 1e-6 * mean_y.norm(dim=-1).clamp_min(1e-6)
    bad = (mean_z.norm(dim=-1) < 1e-6) | (x.norm(dim=-1) < shortest)
    x = F.normalize(x, dim=-1)
    axes = torch.stack([x, torch.linalg.cross(z, x), z], 1)
    axes = torch.where(bad[:, None, None], rotation[:, 0].transpose(1, 2), axes)
    moved = torch.einsum("bij,bvj->bvi", axes, centre - origin)
    reach = moved[:, :context].abs().amax((1, 2))
    scale = torch.where(reach <= 1e-9, torch.ones_like(reach), 1 / (1.35 * reach.clamp_min(1e-30)))
    return torch.einsum("bij,bvjk->bvik", axes, rotation), moved * scale[:, None, None]


def token_grid(width, height, patch):
    """(gw, gh): tokens across and down for a picture and a stage patch; halves round up."""
    return max(1, (2 * width + patch) // (2 * patch)), max(1, (2 * height + patch) // (2 * patch))


def ray_map(rotation, centre, intrinsics, size, map_size):
    """Plücker rays (o x d, d) of each pixel of the map: [B, V, map_h, map_w, 6].

    intrinsics [B, V, 4] (fx, fy, cx, cy) belong to a picture of `size` (w, h); the rays are
    evaluated at `map_size` (w, h) with scaled intrinsics, never resampled.
    """
    (width, height), (map_w, map_h) = size, map_size
    sx, sy = map_w / width, map_h / height
    fx, fy = intrinsics[..., 0] * sx, intrinsics[..., 1] * sy
    cx, cy = (intrinsics[..., 2] + 0.5) * sx - 0.5, (intrinsics[..., 3] + 0.5) * sy - 0.5
    u = torch.arange(map_w, dtype=rotation.dtype, device=rotation.device)
    v = torch.arange(map_h, dtype=rotation.dtype, device=rotation.device)
    x = ((u - cx[..., None]) / fx[..., None])[..., None, :, None]
    y = ((v - cy[..., None]) / fy[..., None])[..., :, None, None]
    r = rotation[..., None, None, :, :]
    direction = F.normalize(r[..., 0] * x + r[..., 1] * y + r[..., 2], dim=-1)
    origin = centre[..., None, None, :].expand_as(direction)
    return torch.cat([torch.linalg.cross(origin, direction), direction], -1)


@functools.lru_cache(maxsize=256)
def _axis_weights(source, target):
    """[target, source] resampling weights of one axis: box to shrink, bilinear to grow."""
    weights = np.zeros((target, source))
    ratio = source / target
    for i in range(target):
        if target < source:
            low, high = i * ratio, (i + 1) * ratio
            for j in range(int(low), min(source, int(np.ceil(high)))):
                weights[i, j] = (min(j + 1, high) - max(j, low)) / ratio
        else:
            at = (i + 0.5) * ratio - 0.5
            low = int(np.floor(at))
            weights[i, min(max(low, 0), source - 1)] += 1 - (at - low)
            weights[i, min(max(low + 1, 0), source - 1)] += at - low
    return torch.from_numpy(weights)


def resample(picture, map_size):
    """Resample pictures [..., h, w, c] to `map_size` (w, h) (section 1)."""
    height, width = picture.shape[-3:-1]
    if (width, height) == tuple(map_size):
        return picture
    to_w = _axis_weights(width, map_size[0]).to(picture)
    to_h = _axis_weights(height, map_size[1]).to(picture)
    return torch.einsum("yh,xw,...hwc->...yxc", to_h, to_w, picture)


def cut(maps, patch):
    """[..., h, w, c] -> tokens [..., n, patch * patch * c], flattened (row, column, channel)."""
    *lead, height, width, channels = maps.shape
    tokens = maps.reshape(*lead, height // patch, patch, width // patch, patch, channels)
    return tokens.transpose(-4, -3).reshape(*lead, -1, patch * patch * channels)


def join(tokens, grid, patch):
    """The inverse of cut() for a grid (gw, gh)."""
    *lead, _, values = tokens.shape
    maps = tokens.reshape(*lead, grid[1], grid[0], patch, patch, values // (patch * patch))
    return maps.transpose(-4, -3).reshape(*lead, grid[1] * patch, grid[0] * patch, -1)
