"""8-bit RGB pictures from PNG files, with nothing but the standard library and numpy."""
import struct
import zlib

import numpy as np


def chunks(data):
    at = 8
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at:at + 8])
        yield kind, data[at + 8:at + 8 + size]
        at += 12 + size


def paeth(left, above, corner):
    estimate = left + above - corner
    distances = [abs(estimate - value) for value in (left, above, corner)]
    return (left, above, corner)[distances.index(min(distances))]


def undo(kind, line, above):
    """A line as it was before its filter; three bytes a pixel."""
    out = bytearray(line)
    for i, byte in enumerate(line):
        left = out[i - 3] if i >= 3 else 0
        corner = above[i - 3] if i >= 3 else 0
        out[i] = (byte + (0, left, above[i], (left + above[i]) // 2,
                          paeth(left, above[i], corner))[kind]) & 255
    return out


def read(path):
    """[height, width, 3] bytes."""
    data = open(path, "rb").read()
    parts = list(chunks(data))
    width, height, depth, colour, _, _, interlace = struct.unpack(">IIBBBBB", parts[0][1])
    if (depth, colour, interlace) != (8, 2, 0):
        raise SystemExit(f"{path}: is no plain RGB picture of 8 bits")
    raw = zlib.decompress(b"".join(body for kind, body in parts if kind == b"IDAT"))
    pitch, above, lines = 3 * width, bytes(3 * width), []
    for y in range(height):
        at = y * (pitch + 1)
        above = undo(raw[at], raw[at + 1:at + 1 + pitch], above)
        lines.append(above)
    return np.frombuffer(b"".join(lines), np.uint8).reshape(height, width, 3)
