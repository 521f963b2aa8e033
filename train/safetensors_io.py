"""Safetensors files, read and written by hand: 8 bytes of length, a JSON header, raw tensors.

The format is small enough that a dependency would cost more than it gives. BF16 has no NumPy
type, so tensors cross this boundary as torch tensors.
"""
import json
import os

import numpy as np
import torch

DTYPES = {
    "F64": torch.float64, "F32": torch.float32, "F16": torch.float16, "BF16": torch.bfloat16,
    "I64": torch.int64, "I32": torch.int32, "I16": torch.int16, "I8": torch.int8, "U8": torch.uint8,
}
NAMES = {dtype: name for name, dtype in DTYPES.items()}


def to_bytes(tensor):
    """Raw little-endian bytes of a tensor."""
    flat = tensor.detach().cpu().contiguous().reshape(-1)
    return flat.view(torch.uint8).numpy().tobytes() if flat.numel() else b""


def pack(tensors, metadata=None):
    """The bytes of a safetensors file: `tensors` name -> tensor, `metadata` name -> text."""
    header, blobs, offset = {}, [], 0
    if metadata:
        header["__metadata__"] = {key: str(value) for key, value in metadata.items()}
    for name, tensor in tensors.items():
        blob = to_bytes(tensor)
        header[name] = {"dtype": NAMES[tensor.dtype], "shape": list(tensor.shape),
                        "data_offsets": [offset, offset + len(blob)]}
        blobs.append(blob)
        offset += len(blob)
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    return len(text).to_bytes(8, "little") + text + b"".join(blobs)


def unpack(data, name="safetensors data"):
    """(tensors, metadata) of a file's bytes; ValueError names the fault."""
    if len(data) < 8:
        raise ValueError(f"{name}: {len(data)} bytes are too few for a safetensors file")
    size = int.from_bytes(data[:8], "little")
    if size > len(data) - 8:
        raise ValueError(f"{name}: header of {size} bytes runs past the end; is it cut short?")
    header = json.loads(data[8:8 + size])
    metadata = header.pop("__metadata__", {})
    body = memoryview(data)[8 + size:]
    tensors = {}
    for key, entry in header.items():
        begin, end = entry["data_offsets"]
        dtype = DTYPES.get(entry["dtype"])
        if dtype is None or not 0 <= begin <= end <= len(body):
            raise ValueError(f"{name}: tensor {key}: type {entry['dtype']} or offsets are wrong")
        raw = torch.from_numpy(np.frombuffer(body[begin:end], np.uint8).copy())
        tensors[key] = raw.view(dtype).reshape(entry["shape"])
    return tensors, metadata


def save(path, tensors, metadata=None):
    """Write beside `path`, sync, rename: a crash leaves the old file or the new one."""
    part = f"{path}.part"
    with open(part, "wb") as file:
        file.write(pack(tensors, metadata))
        file.flush()
        os.fsync(file.fileno())
    os.replace(part, path)


def load(path):
    """(tensors, metadata) of the file at `path`."""
    with open(path, "rb") as file:
        return unpack(file.read(), str(path))
