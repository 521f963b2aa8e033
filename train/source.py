"""The scene generator, built from drivers/sim, through ctypes: libdio_sim.so, or on a GPU
libdio_sim_cuda.so, which draws the same scenes into its memory."""
import ctypes
import os

import numpy as np
import torch

import photos as photo_files

REPOSITORY = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
LIBRARIES = os.path.join(REPOSITORY, "build", "release", "lib")
DEFAULT_LIBRARY = os.path.join(LIBRARIES, "libdio_sim.so")
CUDA_LIBRARY = os.path.join(LIBRARIES, "libdio_sim_cuda.so")


class Generator:
    """Random scenes; a call holds no lock of Python's, so threads run side by side."""

    def __init__(self, path):
        library = ctypes.CDLL(path)
        self.call = library.dio_sim_batch
        self.call.restype = ctypes.c_int
        self.call.argtypes = [ctypes.c_uint64] + 5 * [ctypes.c_uint32] + 3 * [ctypes.c_void_p]
        self.set_photos = library.dio_sim_photos_set
        self.set_photos.restype = ctypes.c_int
        self.set_photos.argtypes = [ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint32]

    def show_photos(self, pictures):
        """Print these on surfaces from now on: [N, side, side, 3] bytes, side a power of two."""
        pictures = np.ascontiguousarray(pictures, np.uint8)
        if self.set_photos(pictures.ctypes.data, pictures.shape[1], len(pictures)) != 0:
            raise MemoryError(f"dio_sim_photos_set: {pictures.shape}: no memory or a side that is "
                              "not a power of two")

    def batch(self, seed, scenes, views, size, options=0):
        """Pictures [B, V, h, w, 3] bytes, poses [B, V, 4, 4], intrinsics [B, V, 4]."""
        width, height = size
        pictures = np.empty((scenes, views, height, width, 3), np.uint8)
        poses = np.empty((scenes, views, 4, 4), np.float32)
        intrinsics = np.empty((scenes, views, 4), np.float32)
        status = self.call(seed, scenes, views, width, height, options, pictures.ctypes.data,
                           poses.ctypes.data, intrinsics.ctypes.data)
        if status != 0:
            raise MemoryError(f"dio_sim_batch: {scenes} scenes of {views} views {width}x{height}: "
                              "no memory or a size of 0; lower `tokens` in the recipe")
        return torch.from_numpy(pictures), torch.from_numpy(poses), torch.from_numpy(intrinsics)


class CudaGenerator(Generator):
    """The same, drawn by a GPU: pictures stay in its memory, cameras come to the CPU's."""

    BUILDERS = 2  # threads that build scenes for each call

    def __init__(self, path, device):
        super().__init__(path)
        library, self.device = ctypes.CDLL(path), device
        self.call = library.dio_sim_batch_cuda
        self.call.restype = ctypes.c_int
        self.call.argtypes = ([ctypes.c_int, ctypes.c_uint64] + 5 * [ctypes.c_uint32] +
                              3 * [ctypes.c_void_p] + [ctypes.c_uint32, ctypes.c_void_p])
        self.fault = library.dio_sim_cuda_fault
        self.fault.restype = ctypes.c_char_p

    def batch(self, seed, scenes, views, size, options=0):
        width, height = size
        pictures = torch.empty((scenes, views, height, width, 3), dtype=torch.uint8,
                               device=self.device)
        poses, intrinsics = torch.empty((scenes, views, 4, 4)), torch.empty((scenes, views, 4))
        # On the stream that the trainer uses: the allocator hands memory out in its order.
        stream = torch.cuda.current_stream(self.device).cuda_stream
        status = self.call(self.device.index or 0, seed, scenes, views, width, height, options,
                           pictures.data_ptr(), poses.data_ptr(), intrinsics.data_ptr(),
                           self.BUILDERS, stream)
        if status != 0:
            raise RuntimeError(f"dio_sim_batch_cuda: {scenes} scenes of {views} views "
                               f"{width}x{height}: {self.fault().decode()}; lower `tokens` in the "
                               "recipe, or draw on the CPU with --library "
                               f"{DEFAULT_LIBRARY}")
        return pictures, poses, intrinsics


def open_library(path=None, photos=None, device=None):
    """The generator; `photos` is a folder of photographs to print on things, or None. A CUDA device
    draws for itself where the library for it was built and no other is named."""
    if path is None and device is not None and device.type == "cuda" and \
            os.path.exists(CUDA_LIBRARY):
        generator = CudaGenerator(CUDA_LIBRARY, device)
    else:
        generator = open_cpu_library(path or DEFAULT_LIBRARY)
    if photos:
        generator.show_photos(photo_files.load(photos))
    return generator


def open_cpu_library(path):
    if not os.path.exists(path):
        raise SystemExit(f"train: {path} is not there; build it with: cmake --preset release && "
                         "cmake --build --preset release --target dio_sim_shared")
    return Generator(path)
