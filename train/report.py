"""What a run shows of itself: a JSONL log, a picture of the loss curve, a sheet of samples."""
import json
import math

import numpy as np
from PIL import Image, ImageDraw


def read_log(path):
    """The rows of a JSONL log; a last line cut short by a crash is left out."""
    rows = []
    with open(path, encoding="utf-8") as file:
        for line in file:
            try:
                rows.append(json.loads(line))
            except json.JSONDecodeError:
                break
    return rows


def psnr(error):
    return -10 * math.log10(max(error, 1e-12))


def curve(rows, path, size=(900, 420)):
    """PSNR of training (grey, smoothed) and of held-out scenes (black) over steps."""
    picture = Image.new("RGB", size, "white")
    draw = ImageDraw.Draw(picture)
    train = [(r["step"], psnr(r["mse"])) for r in rows if "mse" in r]
    held = [(r["step"], r["held_out_psnr"]) for r in rows if "held_out_psnr" in r]
    if len(train) < 2:
        return
    smooth, mean = [], train[0][1]
    for step, value in train:
        mean = 0.9 * mean + 0.1 * value
        smooth.append((step, mean))
    values = [v for _, v in smooth + held]
    low, high = math.floor(min(values) * 2) / 2, math.ceil(max(values) * 2) / 2 + 1e-9
    first, last = train[0][0], max(train[-1][0], train[0][0] + 1)
    left, top, right, bottom = 60, 20, size[0] - 20, size[1] - 40

    def place(point):
        return (left + (right - left) * (point[0] - first) / (last - first),
                bottom - (bottom - top) * (point[1] - low) / (high - low))

    for i in range(int(round((high - low) * 2)) + 1):
        value = low + i / 2
        y = place((first, value))[1]
        draw.line([(left, y), (right, y)], fill=(225, 225, 225))
        draw.text((8, y - 6), f"{value:.1f} dB", fill="black")
    for i in range(6):
        step = first + (last - first) * i / 5
        draw.text((place((step, low))[0] - 12, bottom + 8), f"{step:.0f}", fill="black")
    draw.text(((left + right) / 2 - 12, size[1] - 16), "step", fill="black")
    draw.line([place(p) for p in smooth], fill=(150, 150, 150), width=1)
    if len(held) > 1:
        draw.line([place(p) for p in held], fill="black", width=2)
    for point in held:
        x, y = place(point)
        draw.ellipse([x - 2, y - 2, x + 2, y + 2], fill="black")
    picture.save(path)


def to_bytes(pictures):
    return (np.clip(np.asarray(pictures, np.float32), 0, 1) * 255 + 0.5).astype(np.uint8)


def sheet(rows, path, height=96):
    """Rows of equal make-up: [context pictures | gap | rendered, true | rendered, true ...].

    rows: list of (context [V,h,w,3], rendered [T,h,w,3], true [T,h,w,3]) arrays in [0, 1].
    """
    lines = []
    for context, rendered, true in rows:
        cells = [to_bytes(p) for p in context] + [None]
        for got, want in zip(rendered, true):
            cells += [to_bytes(got), to_bytes(want), None]
        tiles = []
        for cell in cells[:-1]:
            if cell is None:
                tiles.append(np.full((height, 8, 3), 255, np.uint8))
                continue
            width = max(1, round(cell.shape[1] * height / cell.shape[0]))
            tile = Image.fromarray(cell).resize((width, height), Image.BICUBIC)
            tiles.append(np.pad(np.asarray(tile), ((1, 1), (1, 1), (0, 0)), constant_values=255)
                         [1:height + 1])
        lines.append(np.concatenate(tiles, 1))
    width = max(line.shape[1] for line in lines)
    lines = [np.pad(line, ((0, 4), (0, width - line.shape[1]), (0, 0)), constant_values=255)
             for line in lines]
    Image.fromarray(np.concatenate(lines)).save(path)
