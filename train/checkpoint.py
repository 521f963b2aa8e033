"""Checkpoints: the whole state of a run as one safetensors file cut into pieces.

Three levels. `exact` keeps every number. `compact` fits small stores: weights to 24 bits, their
average as an 8-bit difference, optimiser state in 8 bits a block of 256 (6 bytes a weight instead
of 16). `weights` is the average alone. save() takes the richest level under the given limit.
"""
import hashlib
import json
import os
import shutil

import torch

import safetensors_io

PIECE_BYTES = 15 * 1024 * 1024
BLOCK = 256


def quantise(tensor, signed_root):
    """8 bits a number with one scale a block; roots keep small second moments apart from zero."""
    flat = tensor.float().reshape(-1)
    flat = torch.cat([flat, flat.new_zeros(-len(flat) % BLOCK)]).view(-1, BLOCK)
    root = flat.sign() * flat.abs().sqrt() if signed_root else flat
    scale = root.abs().amax(1).clamp_min(1e-30)
    return (root / scale[:, None] * 127).round().to(torch.int8), scale


def dequantise(values, scale, shape, signed_root):
    root = values.float() / 127 * scale[:, None]
    flat = root.sign() * root.square() if signed_root else root
    count = torch.Size(shape).numel()
    return flat.reshape(-1)[:count].reshape(shape)


def shorten(tensor):
    """float32 -> its upper 24 bits, rounded, as bytes [n, 3]."""
    bits = tensor.detach().float().contiguous().view(torch.int32).reshape(-1).to(torch.int64)
    bits = (((bits & 0xffffffff) + 0x80) >> 8).clamp(max=0xffffff)
    return torch.stack([bits & 0xff, bits >> 8 & 0xff, bits >> 16], 1).to(torch.uint8)


def lengthen(data, shape):
    wide = data.to(torch.int64)
    bits = (wide[:, 0] << 8 | wide[:, 1] << 16 | wide[:, 2] << 24)
    bits = torch.where(bits >= 2 ** 31, bits - 2 ** 32, bits)
    return bits.to(torch.int32).view(torch.float32).reshape(shape)


def encode(state, level):
    """State of groups weights / average / moments.* -> tensors of a file."""
    out = {}
    for group, tensors in state.items():
        for name, tensor in tensors.items():
            key = f"{group}/{name}"
            if level == "weights":
                if group == "average":
                    out[key] = tensor.bfloat16()
            elif level == "exact" or tensor.dim() < 2:
                out[key] = tensor
            elif group == "weights":
                out[f"{key}#24"] = shorten(tensor)
            else:
                rest = tensor - state["weights"][name] if group == "average" else tensor
                out[f"{key}#8"], out[f"{key}#scale"] = quantise(rest, group == "moments.exp_avg_sq")
    return out


def decode(tensors, shapes):
    """The inverse of encode(); `shapes` name -> shape of every weight."""
    state = {}
    for key, tensor in tensors.items():
        path, _, code = key.partition("#")
        group, _, name = path.partition("/")
        target = state.setdefault(group, {})
        if not code:
            target[name] = tensor.float() if tensor.is_floating_point() else tensor
        elif code == "24":
            target[name] = lengthen(tensor, shapes[name])
        elif code == "8":
            target[name] = dequantise(tensor, tensors[f"{path}#scale"], shapes[name],
                                      group == "moments.exp_avg_sq")
            if group == "average":
                target[name] += lengthen(tensors[f"weights/{name}#24"], shapes[name])
    return state


def save(folder, state, facts, limit_bytes=None):
    """Write a checkpoint folder; the old one stays till the new one is whole. Returns the level."""
    for level in ("exact", "compact", "weights"):
        data = safetensors_io.pack(encode(state, level), {"facts": json.dumps(facts)})
        if limit_bytes is None or len(data) <= limit_bytes:
            break
    else:
        raise ValueError(f"checkpoint {folder}: even the weights alone need {len(data)} bytes, "
                         f"limit {limit_bytes}: raise --checkpoint-mib")
    part, old = f"{folder}.part", f"{folder}.old"
    shutil.rmtree(part, ignore_errors=True)
    os.makedirs(part)
    pieces = [data[i:i + PIECE_BYTES] for i in range(0, len(data), PIECE_BYTES)]
    for i, piece in enumerate(pieces):
        with open(os.path.join(part, f"piece-{i:03d}.bin"), "wb") as file:
            file.write(piece)
    manifest = {"level": level, "bytes": len(data), "pieces": len(pieces),
                "sha256": hashlib.sha256(data).hexdigest()}
    with open(os.path.join(part, "manifest.json"), "w", encoding="utf-8") as file:
        json.dump(manifest, file, indent=1)
    os.sync()
    shutil.rmtree(old, ignore_errors=True)
    if os.path.exists(folder):
        os.rename(folder, old)
    os.rename(part, folder)
    shutil.rmtree(old, ignore_errors=True)
    return level


def load(folder, shapes):
    """(state, facts, level); falls back to the previous checkpoint when a save was cut short."""
    if not os.path.exists(folder) and os.path.exists(f"{folder}.old"):
        folder = f"{folder}.old"
    with open(os.path.join(folder, "manifest.json"), encoding="utf-8") as file:
        manifest = json.load(file)
    data = b""
    for i in range(manifest["pieces"]):
        with open(os.path.join(folder, f"piece-{i:03d}.bin"), "rb") as file:
            data += file.read()
    if hashlib.sha256(data).hexdigest() != manifest["sha256"]:
        raise ValueError(f"checkpoint {folder}: checksum differs from the manifest's; "
                         "a piece is damaged, take another copy")
    tensors, metadata = safetensors_io.unpack(data, folder)
    return decode(tensors, shapes), json.loads(metadata["facts"]), manifest["level"]
