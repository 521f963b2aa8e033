"""PyTorch: the fused operations it offers for a CPU, without compilation.

usage: contend_torch.py MODEL SCENE PRECISION THREADS
"""
import sys

import torch
import torch.nn.functional as F

import forward
import serve
import work


class Operations:
    def __init__(self, job, dtype):
        self.config, self.views, self.dtype = job.config, job.views, dtype
        self.weights = {name: torch.from_numpy(numbers.copy()).to(dtype)
                        for name, numbers in forward.split_cross(job.weights).items()}

    def linear(self, name, x):
        return F.linear(x, self.weights[name])

    def norm(self, name, x):
        return F.layer_norm(x, x.shape[-1:], self.weights[name], None, self.config.norm_eps)

    def head_norm(self, name, x):
        parts = x.unflatten(-1, (self.config.heads, -1))
        return F.rms_norm(parts, parts.shape[-1:], self.weights[name],
                          self.config.norm_eps).flatten(-2)

    def attention(self, query, key, value):
        query, key, value = (x.unflatten(-1, (self.config.heads, -1)).transpose(1, 2)
                             for x in (query, key, value))
        return F.scaled_dot_product_attention(query, key, value).transpose(1, 2).flatten(2)

    def join_views(self, x):
        return x.flatten(0, 1)[None]

    def part_views(self, x):
        return x.unflatten(1, (self.views, -1))[0]

    @staticmethod
    def split(x, count):
        return x.chunk(count, -1)

    gelu = staticmethod(F.gelu)
    add = staticmethod(torch.add)


@torch.inference_mode()
def main():
    model, scene, precision, threads = sys.argv[1:]
    torch.set_num_threads(int(threads))
    dtype = {"f32": torch.float32, "bf16": torch.bfloat16}[precision]
    job = work.read(model, scene)
    ops = Operations(job, dtype)
    ray, rgb, target = (torch.from_numpy(array).to(dtype)
                        for array in (job.context_ray, job.context_rgb, job.target_ray))
    cache = []

    def reconstruct():
        cache[:] = forward.reconstruct(ops, job.config.layers, ray, rgb)

    def render():
        numbers = forward.render(ops, target, cache)
        return lambda: numbers.float().numpy()

    serve.serve(f"PyTorch {torch.__version__}", reconstruct, render)


if __name__ == "__main__":
    main()
