"""The scene generator: libdio_sim.so, built from drivers/sim, through ctypes."""
import ctypes
import os

import numpy as np
import torch

import photos as photo_files

REPOSITORY = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
DEFAULT_LIBRARY = os.path.join(REPOSITORY, "build", "release", "lib", "libdio_sim.so")


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


def open_library(path=None, photos=None):
    """The generator; `photos` is a folder of photographs to print on things, or None."""
    path = path or DEFAULT_LIBRARY
    if not os.path.exists(path):
        raise SystemExit(f"train: {path} is not there; build it with: cmake --preset release && "
                         "cmake --build --preset release --target dio_sim_shared")
    generator = Generator(path)
    if photos:
        generator.show_photos(photo_files.load(photos))
    return generator
