#!/usr/bin/env python3
"""Train weights for the engine on generated scenes; on one or more GPUs, or on a CPU.

  train.py --recipe recipes/cpu.json --out RUN [--minutes M] [--init MODEL.safetensors]
  torchrun --nproc-per-node 8 train.py --recipe recipes/gpu.json --out RUN

A run that finds a checkpoint in RUN goes on from it. RUN/model.safetensors is the exported average.
"""
import argparse
import ctypes
import itertools
import json
import os
import signal
import sys
import time

import torch
import torch.distributed as dist

import checkpoint
import data
import fast
import losses
import model as dvsm
import optim
import report
import source


def arguments():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawTextHelpFormatter)
    add = parser.add_argument
    add("--recipe", required=True, help="JSON: model, optimiser, schedule, stages")
    add("--out", required=True, help="folder of the run")
    add("--library", default=None, help="libdio_sim.so (default: build/release/lib)")
    add("--photos", help="folder of photographs to print on things; `train/start photos` fetches some")
    add("--init", help="model file to start from when the run has no checkpoint")
    add("--minutes", type=float, default=1e9, help="stop after this many minutes of this launch")
    add("--steps", type=int, default=1 << 40, help="stop at this step")
    add("--decay", action="store_true",
        help="wsd: lower the rate to zero over this launch (--steps or --minutes, what ends first)")
    add("--seed", type=int, default=0)
    add("--threads", type=int, default=0, help="CPU threads of PyTorch (default: all)")
    add("--data-threads", type=int, default=1)
    add("--compile", action="store_true", help="torch.compile the blocks")
    add("--plain", action="store_true", help="PyTorch alone, even where the blocks in C would run")
    add("--gradient-checkpointing", action="store_true")
    add("--vgg", help="torchvision's VGG-19 state dict, for the perceptual loss")
    add("--report-minutes", type=float, default=4, help="held-out figure, curve, sheet, checkpoint")
    add("--checkpoint-mib", type=float, help="limit of a checkpoint; compressed to fit")
    return parser.parse_args()


class Place:
    """Where this process runs: device, rank, numbers format."""

    def __init__(self):
        self.ranks = int(os.environ.get("WORLD_SIZE", 1))
        self.rank = int(os.environ.get("RANK", 0))
        cuda = torch.cuda.is_available()
        self.device = torch.device("cpu")
        if cuda:
            self.device = torch.device("cuda", int(os.environ.get("LOCAL_RANK", 0)))
            torch.cuda.set_device(self.device)
            torch.backends.cuda.matmul.allow_tf32 = True
        if self.ranks > 1:
            dist.init_process_group("nccl" if cuda else "gloo")

    def autocast(self):
        return torch.autocast(self.device.type, dtype=torch.bfloat16)

    def mean(self, value):
        """Mean of a number over the processes."""
        if self.ranks == 1:
            return float(value)
        tensor = torch.as_tensor(float(value), device=self.device)
        dist.all_reduce(tensor)
        return tensor.item() / self.ranks

    def move(self, tensor):
        return tensor.to(self.device, non_blocking=True)


class Run:
    """A run's state: weights, optimisers, average, step; and its folder."""

    def __init__(self, args, recipe, place, network=dvsm.Dvsm):
        self.args, self.recipe, self.place = args, recipe, place
        self.step, self.scenes, self.targets, self.cpu_seconds, self.seconds = 0, 0, 0, 0.0, 0.0
        self.decay_from = 0.0
        torch.manual_seed(args.seed)
        config = dvsm.Config(**recipe["model"])
        net = dvsm.load(args.init) if args.init else network(config)
        if net.config != config:
            raise SystemExit(f"train: {args.init} is {net.config}, the recipe says {config}")
        net.checkpointing = args.gradient_checkpointing
        self.net = net.to(place.device).train()
        if place.device.type == "cpu" and not args.plain:
            net.fast = fast.make_blocks(net)
        self.optimisers = optim.make_optimisers(net, recipe["optimiser"], recipe["lr"],
                                                recipe["weight_decay"])
        if net.fast:
            for optimiser in self.optimisers:
                optimiser.native = net.fast.library
        self.average = optim.Average(net, recipe["average_decay"])
        self.folder = os.path.join(args.out, "checkpoint")
        if os.path.exists(self.folder) or os.path.exists(f"{self.folder}.old"):
            self.resume()
        self.call = self.net
        if place.ranks > 1:
            ids = [place.device.index] if place.device.type == "cuda" else None
            self.call = torch.nn.parallel.DistributedDataParallel(self.net, device_ids=ids)

    def shapes(self):
        return {name: weight.shape for name, weight in self.net.named_parameters()}

    def state(self):
        """Everything a checkpoint holds, by group."""
        state = {"weights": {n: w.detach() for n, w in self.net.named_parameters()},
                 "average": self.average.weights}
        for optimiser in self.optimisers:
            for name, weight in self.net.named_parameters():
                for kind, tensor in optimiser.state.get(weight, {}).items():
                    state.setdefault(f"moments.{kind}", {})[name] = tensor
        return state

    def save(self):
        facts = {"step": self.step, "scenes": self.scenes, "targets": self.targets,
                 "seconds": self.seconds, "cpu_seconds": self.cpu_seconds, "seed": self.args.seed,
                 "average_count": self.average.count, "decay_from": self.decay_from,
                 "recipe": self.recipe}
        limit = self.args.checkpoint_mib and int(self.args.checkpoint_mib * 1024 * 1024)
        checkpoint.save(self.folder, self.state(), facts, limit)
        dvsm.save(os.path.join(self.args.out, "model.safetensors"), self.average.weights,
                  self.net.config)

    @torch.no_grad()
    def resume(self):
        state, facts, level = checkpoint.load(self.folder, self.shapes())
        weights = state.get("weights", state["average"])
        for name, weight in self.net.named_parameters():
            weight.copy_(weights[name])
            self.average.weights[name].copy_(state["average"][name])
            for optimiser in self.optimisers:
                if not any(weight is w for g in optimiser.param_groups for w in g["params"]):
                    continue
                kinds = [k for k in state if k.startswith("moments.") and name in state[k]]
                for kind in kinds:
                    moment = kind.removeprefix("moments.")
                    optimiser.state[weight][moment] = state[kind][name].to(weight.device)
        for key in ("step", "scenes", "targets", "seconds", "cpu_seconds", "decay_from"):
            setattr(self, key, facts[key])
        self.average.count = facts["average_count"]
        say(self.place, f"resumed at step {self.step} ({level} checkpoint)")

    def train_step(self, step, batch, loss_of, lr):
        """One step; (loss, mse, norm of the gradient) as tensors."""
        pictures, poses, intrinsics = (self.place.move(tensor)[:, step.order] for tensor in batch)
        pictures = data.as_float(pictures)
        for optimiser in self.optimisers:
            optimiser.zero_grad(set_to_none=True)
            for group in optimiser.param_groups:
                group["lr"] = lr
        with self.place.autocast():
            got = self.call(pictures[:, :step.context], poses, intrinsics, step.size, step.patches)
        loss, error = loss_of(got, pictures[:, step.context:])
        loss.backward()
        norm = torch.nn.utils.clip_grad_norm_(self.net.parameters(), self.recipe["clip"])
        if not torch.isfinite(norm):
            raise SystemExit(f"train: step {self.step}: the gradient is not finite; lower the rate "
                             "and resume from the last checkpoint")
        for optimiser in self.optimisers:
            optimiser.step()
        self.average.update(self.net)
        return loss.detach(), error, norm


class HeldOut:
    """Scenes never trained on, rendered with the averaged weights.

    Rendered eagerly: compiling the blocks again, without gradients, would cost more than it saves.
    """

    def __init__(self, generator, scenes=24, context=4, targets=4, size=(64, 64), patches=(8, 8)):
        self.context, self.size, self.patches = context, size, patches
        pictures, self.poses, self.intrinsics = generator.batch(data.HELD_OUT_SEED, scenes,
                                                                context + targets, size)
        self.pictures = data.as_float(pictures)

    @torch.no_grad()
    def measure(self, run, shown=6):
        """Mean PSNR, and rows for the sample sheet."""
        net = run.net.eval()
        kept = {n: w.detach().clone() for n, w in net.named_parameters()}
        for name, weight in net.named_parameters():
            weight.copy_(run.average.weights[name])
        figures, rows = [], []
        for i in range(0, len(self.pictures), 6):
            pictures, poses, intrinsics = (run.place.move(t[i:i + 6]) for t in
                                           (self.pictures, self.poses, self.intrinsics))
            near, want = pictures[:, :self.context], pictures[:, self.context:]
            with run.place.autocast(), torch.compiler.set_stance("force_eager"):
                got = net(near, poses, intrinsics, self.size, self.patches)
            got = got.float().clamp(0, 1)
            figures.append(-10 * torch.log10((got - want).square().mean((2, 3, 4))))
            rows += [tuple(t.cpu().numpy() for t in (near[j], got[j, :2], want[j, :2]))
                     for j in range(len(got))]
        for name, weight in net.named_parameters():
            weight.copy_(kept[name])
        net.train()
        return torch.cat(figures).mean().item(), rows[:shown]


def say(place, text):
    if place.rank == 0:
        print(text, flush=True)


class Journal:
    """The run's log, curve, sheet and checkpoints; silent on all processes but the first."""

    def __init__(self, run, held_out):
        self.run, self.held_out, self.file = run, held_out, None
        self.reported = time.monotonic()
        os.makedirs(run.args.out, exist_ok=True)
        if held_out:
            self.file = open(os.path.join(run.args.out, "log.jsonl"), "a", encoding="utf-8")

    def write(self, row):
        if self.file:
            self.file.write(json.dumps(row) + "\n")
            self.file.flush()

    def report(self):
        """Held-out figure, curve, sheet and checkpoint."""
        if not self.held_out:
            return
        run = self.run
        figure, rows = self.held_out.measure(run)
        minutes = run.cpu_seconds / 60
        self.write({"step": run.step, "seconds": round(run.seconds, 1),
                    "cpu_minutes": round(minutes, 2), "scenes": run.scenes, "targets": run.targets,
                    "held_out_psnr": round(figure, 3)})
        report.curve(report.read_log(self.file.name), os.path.join(run.args.out, "curve.png"))
        report.sheet(rows, os.path.join(run.args.out, "samples.png"))
        run.save()
        say(run.place, f"step {run.step}  held-out {figure:.2f} dB  {run.scenes} scenes  "
                       f"{minutes:.1f} CPU min")
        self.reported = time.monotonic()

    def report_when_due(self):
        if time.monotonic() - self.reported > self.run.args.report_minutes * 60:
            self.report()


class Clock:
    """Wall and processor time of a launch, and when it has to end."""

    def __init__(self, run):
        self.run, self.args, self.first = run, run.args, run.step
        self.decay_from, self.stop = run.decay_from, []
        self.start = self.wall = time.monotonic()
        self.cpu = time.process_time()
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: self.stop.append(True))

    def elapsed(self):
        return time.monotonic() - self.start

    def ended(self):
        """Steps or minutes are over, or a signal came, on any process."""
        late = self.elapsed() > self.args.minutes * 60 or self.run.step >= self.args.steps
        return self.run.place.mean(bool(self.stop) or late) > 0

    def decay(self):
        """How far the closing part of a run has come, in [0, 1]; by steps or by time."""
        if not self.args.decay:
            return self.decay_from
        share = max((self.run.step - self.first) / max(1, self.args.steps - self.first),
                    self.elapsed() / 60 / self.args.minutes)
        return self.decay_from + (1 - self.decay_from) * min(1.0, share)

    def tick(self):
        """Add the time since the last tick to the run's."""
        wall, cpu = time.monotonic(), time.process_time()
        self.run.seconds += wall - self.wall
        self.run.cpu_seconds += cpu - self.cpu
        self.wall, self.cpu = wall, cpu


def keep_memory():
    """Have glibc keep what a step frees: fresh pages cost a CPU as much as the sums on them."""
    trim_threshold, top_pad, mmap_threshold, arena_max = -1, -2, -3, -8
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except AttributeError:  # another C library
        return
    for parameter, value in ((mmap_threshold, 32 << 20), (trim_threshold, (1 << 31) - 1),
                             (top_pad, 256 << 20), (arena_max, 1)):
        mallopt(parameter, value)


def loop(args, recipe, place, run, generator):
    loss_of = losses.Loss(args.vgg).to(place.device)
    weights = sum(weight.numel() for weight in run.net.parameters())
    say(place, f"{weights / 1e6:.1f} M weights on {place.device} x {place.ranks}; "
               f"loss {loss_of.describe()}; optimiser {recipe['optimiser']}; "
               f"blocks in {'C' if run.net.fast else 'PyTorch'}")
    journal = Journal(run, HeldOut(generator) if place.rank == 0 else None)
    if run.step == 0:
        journal.report()
    steps = (data.plan(recipe, args.seed, n, place.rank, place.ranks)
             for n in itertools.count(run.step))
    loader = data.Loader(generator, steps, args.data_threads, pin=place.device.type == "cuda")
    clock = Clock(run)
    while not clock.ended():
        run.decay_from = clock.decay()
        step, batch = loader.get()
        lr = optim.learning_rate(recipe, run.step, run.decay_from)
        loss, error, norm = run.train_step(step, batch, loss_of, lr)
        run.step += 1
        run.scenes += step.scenes() * place.ranks
        run.targets += step.scenes() * step.targets() * place.ranks
        clock.tick()
        if run.step % 10 == 0:
            journal.write({"step": run.step, "seconds": round(run.seconds, 1), "lr": lr,
                           "loss": round(loss.item(), 6), "mse": round(error.item(), 6),
                           "norm": round(norm.item(), 4), "context": step.context,
                           "size": step.size, "patches": step.patches, "scenes": run.scenes,
                           "wait": round(loader.waited / clock.elapsed(), 4)})
        journal.report_when_due()
    loader.close()
    journal.report()
    say(place, f"stopped at step {run.step}; waited for data "
               f"{100 * loader.waited / max(1e-9, clock.elapsed()):.1f} % of the time")


def main():
    args = arguments()
    keep_memory()
    recipe = data.load_recipe(args.recipe)
    if args.threads:
        torch.set_num_threads(args.threads)
    if args.compile:
        args.plain = True
        dvsm.compile_blocks()
    place = Place()
    run = Run(args, recipe, place)
    loop(args, recipe, place, run, source.open_library(args.library, args.photos, place.device))
    if place.ranks > 1:
        dist.destroy_process_group()
    return 0


if __name__ == "__main__":
    sys.exit(main())
