"""The engine beside its peers: the same weights, inputs and threads, taken in turn in one sitting.

usage: compare.py --work DIR --bin DIR [--rounds N] [--threads N] [--avx2] [--json FILE]

DIR is what `diorama bench --save` left, with v4_p8.npy of reference64 in it. The peers begin with
ray maps and colours cut into patches and end with the patches of the picture; the engine does that
too. Each round runs every contender once (reconstruct, then render three times), the next round
begins with another one, so that what disturbs the machine disturbs all alike.

--avx2: what all would do on a processor without AVX-512. ONNX Runtime cannot be held back: its rows
are those of the whole processor.
"""
import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

import work

HERE = Path(__file__).resolve().parent
RENDERS = 3
PAUSE_S = 0.02  # until the threads of the one before have gone to sleep
AVX2 = {"ATEN_CPU_CAPABILITY": "avx2", "MKL_ENABLE_INSTRUCTIONS": "AVX2",
        "DNNL_MAX_CPU_ISA": "AVX2", "ONEDNN_MAX_CPU_ISA": "AVX2"}


class Contender:
    def __init__(self, name, precision, note, command, options):
        self.name, self.precision, self.note = name, precision, note
        environment = dict(os.environ, OMP_NUM_THREADS=str(options.threads),
                           PYTHONDONTWRITEBYTECODE="1", **(AVX2 if options.avx2 else {}))
        self.process = subprocess.Popen([str(part) for part in command], text=True,
                                        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                        stderr=subprocess.PIPE, env=environment)
        self.times = {"reconstruct": [], "render": []}
        self.about = self.process.stdout.readline().strip()

    def is_there(self):
        return self.about != ""

    def why_not(self):
        lines = self.process.stderr.read().strip().splitlines()
        return lines[-1] if lines else "says nothing"

    def ask(self, line):
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline().strip()
        if not answer:
            raise SystemExit(f"compare: {self.name} {self.precision}: {self.why_not()}")
        return answer

    def run(self, stage, counted=True):
        milliseconds = int(self.ask(stage)) * 1e-6
        if counted:
            self.times[stage].append(milliseconds)

    def median(self, stage):
        return statistics.median(self.times[stage])

    def spread(self, stage):
        """Half the distance of the quartiles over the median."""
        low, _, high = statistics.quantiles(self.times[stage], n=4, method="inclusive")
        return 0.5 * (high - low) / self.median(stage)

    def fetch(self, folder):
        path = folder / f"{self.name}-{self.precision}.npy".replace(" ", "-")
        self.ask(f"output {path}")
        return np.load(path)

    def close(self):
        self.process.stdin.close()
        self.process.wait()


def start(options):
    model, scene = options.work / "model.safetensors", options.work / "v4" / "scene.json"
    block = options.work / "block.f32"
    job = work.read(model, scene)
    work.write_block(job, block)
    threads = options.threads
    engine, onednn = options.bin / "contend_engine", options.bin / "contend_onednn"
    onnx = [sys.executable, HERE / "contend_onnx.py", model, scene]
    torch = [sys.executable, HERE / "contend_torch.py", model, scene]
    mixed, whole = "products int8 dynamic, the rest f32", "with AVX-512" if options.avx2 else ""
    listed = [
        *(("Diorama", precision, "", [engine, model, scene, precision, threads]
           + ["avx2"] * options.avx2) for precision in ("f32", "bf16", "fixed")),
        ("ONNX Runtime", "f32", whole, [*onnx, "f32", threads]),
        ("ONNX Runtime", "int8", "; ".join(filter(None, (mixed, whole))), [*onnx, "int8", threads]),
        ("PyTorch", "f32", "eager", [*torch, "f32", threads]),
        ("PyTorch", "bf16", "eager", [*torch, "bf16", threads]),
        ("oneDNN", "f32", "primitives", [onednn, block, "f32", threads]),
        ("oneDNN", "bf16", "primitives", [onednn, block, "bf16", threads]),
        ("oneDNN", "int8", mixed, [onednn, block, "int8", threads]),
    ]
    contenders = []
    for name, precision, note, command in listed:
        if not Path(command[0]).exists():
            print(f"compare: left out: {name} {precision}: it is not built", file=sys.stderr)
            continue
        made = Contender(name, precision, note, command, options)
        if made.is_there():
            contenders.append(made)
        else:
            print(f"compare: left out: {name} {precision}: {made.why_not()}", file=sys.stderr)
            made.close()
    return job, contenders


def play(contenders, rounds):
    for contender in contenders:
        for stage in ("reconstruct", "render", "render"):
            contender.run(stage, counted=False)
    for number in range(rounds):
        shift = number % len(contenders)
        for contender in contenders[shift:] + contenders[:shift]:
            time.sleep(PAUSE_S)
            contender.run("reconstruct")
            for _ in range(RENDERS):
                contender.run("render")


def judge(contender, job, reference, folder):
    """Root mean square and largest difference from float64, 1 = white."""
    numbers = contender.fetch(folder)
    ours = contender.name == "Diorama"
    picture = numbers.reshape(reference.shape) if ours else job.picture(numbers)
    difference = picture - reference
    return float(np.sqrt(np.mean(difference ** 2))), float(np.abs(difference).max())


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--bin", type=Path, required=True)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--threads", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--avx2", action="store_true")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()

    reference = np.load(options.work / "v4_p8.npy")[0]
    job, contenders = start(options)
    play(contenders, options.rounds)

    best = {stage: min((c.median(stage) for c in contenders if c.name == "Diorama"), default=1)
            for stage in ("reconstruct", "render")}
    print(f"D {job.config.dim}, {job.config.heads} heads, {job.config.layers} blocks, {job.views} "
          f"views of {job.tokens} tokens, {options.threads} threads; medians of {options.rounds} "
          f"rounds, one sitting\n")
    print(f"{'contender':<28} {'precision':<9} {'reconstruct ms':>14} {'+-%':>5} {'times':>6}  "
          f"{'render ms':>9} {'+-%':>5} {'times':>6}  {'rms err':>8} {'max err':>8}  note")
    results = []
    for c in contenders:
        rms, largest = judge(c, job, reference, options.work)
        print(f"{c.about:<28} {c.precision:<9} {c.median('reconstruct'):14.1f} "
              f"{100 * c.spread('reconstruct'):5.1f} "
              f"{c.median('reconstruct') / best['reconstruct']:6.2f}  "
              f"{c.median('render'):9.2f} {100 * c.spread('render'):5.1f} "
              f"{c.median('render') / best['render']:6.2f}  {rms:8.2e} {largest:8.2e}  {c.note}")
        results.append({"contender": c.about, "precision": c.precision, "note": c.note,
                        "reconstruct_ms": c.times["reconstruct"], "render_ms": c.times["render"],
                        "rms_error": rms, "largest_error": largest})
        c.close()
    print("\ntimes: how many times as long as the engine's fastest; errors: from float64, 1 = white")
    if options.json:
        options.json.write_text(json.dumps({"threads": options.threads, "views": job.views,
                                            "tokens": job.tokens, "contenders": results}, indent=1))


if __name__ == "__main__":
    main()
