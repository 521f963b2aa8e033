"""Optimisers over one list of weights, learning-rate schedule, and the average of weights."""
import math

import torch


def split_weights(model):
    """(matrices inside the blocks, other matrices, vectors)."""
    inner, outer, vectors = [], [], []
    for name, weight in model.named_parameters():
        if not weight.requires_grad:
            continue
        if weight.dim() < 2:
            vectors.append(weight)
        else:
            (inner if "blocks." in name else outer).append(weight)
    return inner, outer, vectors


def orthogonalise(matrices, steps=5):
    """Nearest semi-orthogonal matrices [n, rows, cols] by a quintic Newton-Schulz iteration."""
    x = matrices.bfloat16()
    tall = x.shape[-2] > x.shape[-1]
    x = x.mT if tall else x
    x = x / (x.float().norm(dim=(-2, -1), keepdim=True).to(x.dtype) + 1e-7)
    for _ in range(steps):
        gram = x @ x.mT
        x = 3.4445 * x + (-4.7750 * gram + 2.0315 * gram @ gram) @ x
    return x.mT if tall else x


class Muon(torch.optim.Optimizer):
    """Momentum whose step is orthogonalised (Jordan 2024), scaled to the size of AdamW's step.

    The rows of a fused projection are several matrices: `parts` weight -> how many.
    """

    def __init__(self, weights, lr, weight_decay, momentum=0.95, parts=None):
        super().__init__(weights, {"lr": lr, "weight_decay": weight_decay, "momentum": momentum})
        self.parts = parts or {}
        self.native = None  # fast.Library, where the processor has it

    def momentum(self, weight):
        state = self.state[weight]
        if "exp_avg" not in state:
            state["exp_avg"] = torch.zeros_like(weight)
        return state["exp_avg"]

    @torch.no_grad()
    def step(self, closure=None):
        for group in self.param_groups:
            if self.native:
                self.native.muon_step([(weight, weight.grad.contiguous(), self.momentum(weight),
                                        self.parts.get(weight, 1)) for weight in group["params"]],
                                      group)
                continue
            shapes = {}
            for weight in group["params"]:
                momentum = self.momentum(weight).lerp_(weight.grad, 1 - group["momentum"])
                update = weight.grad.lerp(momentum, group["momentum"])
                pieces = update.chunk(self.parts.get(weight, 1))
                shapes.setdefault(pieces[0].shape, []).append((weight, pieces))
            for shape, entries in shapes.items():
                stack = torch.stack([piece for _, pieces in entries for piece in pieces])
                steps = orthogonalise(stack).float() * (0.2 * math.sqrt(max(shape)))
                at = 0
                for weight, pieces in entries:
                    step = steps[at:at + len(pieces)].flatten(0, 1)
                    weight.mul_(1 - group["lr"] * group["weight_decay"])
                    weight.sub_(step.view_as(weight), alpha=group["lr"])
                    at += len(pieces)


def make_optimisers(model, kind, lr, weight_decay):
    """AdamW for everything, or Muon for the blocks' matrices and AdamW for the rest."""
    inner, outer, vectors = split_weights(model)
    fused = {"fused": True, "betas": (0.9, 0.95), "eps": 1e-8}
    if kind == "adamw":
        groups = [{"params": inner + outer, "weight_decay": weight_decay},
                  {"params": vectors, "weight_decay": 0.0}]
        return [torch.optim.AdamW(groups, lr=lr, **fused)]
    if kind != "muon":
        raise ValueError(f"optimiser {kind!r}: 'adamw' or 'muon'")
    parts = {weight: 3 for name, weight in model.named_parameters() if name.endswith("qkv.weight")}
    groups = [{"params": outer, "weight_decay": weight_decay},
              {"params": vectors, "weight_decay": 0.0}]
    return [Muon(inner, lr, weight_decay, parts=parts), torch.optim.AdamW(groups, lr=lr, **fused)]


def learning_rate(recipe, step, decay):
    """Peak x warm-up x shape. `decay` in [0, 1] is how far the last part has come (wsd only).

    wsd: constant, then 1 - sqrt(progress): a run without an end that can be closed at any time.
    cosine: over `total_steps`, warm-up included.
    """
    peak, warm = recipe["lr"], min(1.0, (step + 1) / max(1, recipe["warmup_steps"]))
    if recipe["schedule"] == "cosine":
        progress = min(1.0, step / recipe["total_steps"])
        return peak * warm * 0.5 * (1 + math.cos(math.pi * progress))
    return peak * warm * (1 - math.sqrt(min(1.0, max(0.0, decay))))


class Average:
    """Exponential moving average of the weights; young averages forget faster."""

    def __init__(self, model, decay):
        self.decay, self.count = decay, 0
        self.weights = {n: w.detach().clone() for n, w in model.named_parameters()}

    @torch.no_grad()
    def update(self, model):
        self.count += 1
        decay = min(self.decay, (1 + self.count) / (10 + self.count))
        names, weights = zip(*model.named_parameters())
        torch._foreach_lerp_([self.weights[n] for n in names], list(weights), 1 - decay)
