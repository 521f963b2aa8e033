"""The network's blocks in C (train/blocks), for processors with AVX-512: one autograd
function over all of them. What the C code cannot do - other devices, other head sizes - stays with
PyTorch."""
import ctypes
import os

import torch

import source

# In the order of preference.
BUILDS = [os.path.join(source.LIBRARIES, f"libdio_blocks_{name}.so")
          for name in ("amx", "avx512_bf16", "avx512")]


class MuonWeight(ctypes.Structure):
    """struct dio_muon_weight"""
    _fields_ = [(name, ctypes.c_void_p) for name in ("weight", "momentum", "gradient")] + \
        [(name, ctypes.c_int) for name in ("rows", "cols", "parts")]


class Library:
    """The functions of blocks.h and muon.h."""

    def __init__(self, path):
        self.path, library = path, ctypes.CDLL(path)
        self.supported = library.dio_blocks_supported
        self.create, self.destroy = library.dio_blocks_create, library.dio_blocks_destroy
        self.forward, self.backward = library.dio_blocks_forward, library.dio_blocks_backward
        pointer, number = ctypes.c_void_p, ctypes.c_int
        self.create.restype, self.create.argtypes = pointer, 3 * [number] + [ctypes.c_float, number,
                                                                         ctypes.c_uint]
        self.destroy.restype, self.destroy.argtypes = None, [pointer]
        self.forward.argtypes = [pointer, pointer] + 5 * [number] + 3 * [pointer]
        self.backward.argtypes = 5 * [pointer]
        self.muon = library.dio_muon_step
        self.muon.argtypes = [pointer, number] + 3 * [ctypes.c_float] + [number]

    def muon_step(self, entries, group):
        """Muon over (weight, gradient, momentum, parts) with a group's rates."""
        rows = (MuonWeight * len(entries))(*(
            MuonWeight(weight.data_ptr(), momentum.data_ptr(), gradient.data_ptr(),
                       weight.shape[0] // parts, weight.shape[1], parts)
            for weight, gradient, momentum, parts in entries))
        if self.muon(rows, len(entries), group["lr"], group["weight_decay"], group["momentum"],
                     torch.get_num_threads()) != 0:
            raise MemoryError("dio_muon_step: no memory or no threads")


def addresses(tensors):
    return (ctypes.c_void_p * len(tensors))(*(tensor.data_ptr() for tensor in tensors))


class Blocks:
    """All blocks of a network of one shape; holds what the backward pass of the last call needs."""

    def __init__(self, library, config, threads, options=0):
        self.library, self.handle, self.calls = library, None, 0
        self.handle = library.create(config.dim, config.heads, config.layers, config.norm_eps,
                                     threads, options)
        if not self.handle:
            raise MemoryError("dio_blocks_create: no memory")

    def __del__(self):
        if self.handle:
            self.library.destroy(self.handle)

    def __call__(self, context, targets, weights):
        """Tokens [B, V, n, D] of given and [B, T, m, D] of asked views -> [B, T, m, D]."""
        return Function.apply(self, context, targets, *weights)


class Function(torch.autograd.Function):
    @staticmethod
    def forward(ctx, blocks, context, targets, *weights):
        context, targets = context.float().contiguous(), targets.float().contiguous()
        weights = [weight.contiguous() for weight in weights]
        y = torch.empty_like(targets)
        (scenes, views, near), (asked, far) = context.shape[:3], targets.shape[1:3]
        if blocks.library.forward(blocks.handle, addresses(weights), scenes, views, near, asked,
                                  far, context.data_ptr(), targets.data_ptr(), y.data_ptr()) != 0:
            raise MemoryError("dio_blocks_forward: no memory or no threads")
        blocks.calls += 1
        ctx.blocks, ctx.call, ctx.weights = blocks, blocks.calls, weights
        ctx.shapes = context.shape, targets.shape
        return y

    @staticmethod
    def backward(ctx, dy):
        if ctx.call != ctx.blocks.calls:
            raise RuntimeError("the blocks went forward again: only the last call can go back")
        dy = dy.float().contiguous()
        near, far = (torch.empty(shape) for shape in ctx.shapes)
        gradients = [torch.empty_like(weight) for weight in ctx.weights]
        if ctx.blocks.library.backward(ctx.blocks.handle, dy.data_ptr(), near.data_ptr(),
                                       far.data_ptr(), addresses(gradients)) != 0:
            raise MemoryError("dio_blocks_backward: no threads")
        return None, near, far, *gradients


def libraries():
    """Those that are built and that this processor runs, the best first."""
    built = (Library(build) for build in BUILDS if os.path.exists(build))
    return (library for library in built if library.supported())


def open_library():
    """The best library, or None where none is built that this processor runs."""
    return next(libraries(), None)


def make_blocks(net, library=None):
    """Blocks for a network, of the best library or the one given, or None where PyTorch has to do:
    there is no library, or the network has another shape."""
    config, library = net.config, library or open_library()
    if not library or config.dim != 64 * config.heads or config.mlp_ratio != 4:
        return None
    return Blocks(library, config, torch.get_num_threads(), net.fast_options)
