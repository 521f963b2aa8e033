"""The network of MODEL.md: a decoder-only view synthesis model with one set of weights."""
import dataclasses
import json
import math

import torch
import torch.nn as nn
import torch.nn.functional as F
from torch.utils.checkpoint import checkpoint

import geometry
import safetensors_io


@dataclasses.dataclass
class Config:
    """What the file's `config` states; names are the file's."""
    dim: int = 256
    heads: int = 4
    layers: int = 6
    patch: int = 8
    mlp_ratio: int = 4
    norm_eps: float = 1e-6
    rgb_out: str = "linear"
    pose_norm: str = "gs-lrm"
    prior: object = None

    def to_json(self):
        return json.dumps(dataclasses.asdict(self))

    @staticmethod
    def from_json(text):
        values = json.loads(text)
        known = {field.name for field in dataclasses.fields(Config)}
        config = Config(**{key: value for key, value in values.items() if key in known})
        if config.prior is not None or config.pose_norm != "gs-lrm":
            raise ValueError(f"config: prior {config.prior!r}, pose_norm {config.pose_norm!r}: "
                             "this trainer makes models without a prior and with gs-lrm poses")
        return config


class Norm(nn.Module):
    """LayerNorm with a weight and no bias."""

    def __init__(self, dim, eps):
        super().__init__()
        self.weight, self.eps = nn.Parameter(torch.ones(dim)), eps

    def forward(self, x):
        return F.layer_norm(x, x.shape[-1:], self.weight.to(x.dtype), None, self.eps)


class HeadNorm(nn.Module):
    """RMS normalisation of each head's query or key (QK-norm)."""

    def __init__(self, dim, eps):
        super().__init__()
        self.weight, self.eps = nn.Parameter(torch.ones(dim)), eps

    def forward(self, x):
        scale = torch.rsqrt(x.float().square().mean(-1, keepdim=True) + self.eps) \
            if x.dtype in (torch.float16, torch.bfloat16) \
            else torch.rsqrt(x.square().mean(-1, keepdim=True) + self.eps)
        return (x * scale * self.weight).to(x.dtype)


def attention(q, k, v):
    """Softmax attention; [batch, heads, tokens, D/h] each.

    The fused kernel is right on a GPU. On a CPU its backward pass runs at a fifth of the speed of
    the plain bfloat16 products (64 tokens, 64 wide, AVX512-BF16), whose scores are small there.
    """
    if q.dtype == torch.bfloat16 and q.device.type == "cpu":
        with torch.autocast("cpu", enabled=False):
            scores = torch.matmul(q * q.shape[-1] ** -0.5, k.transpose(-1, -2))
            return torch.matmul(torch.softmax(scores, -1), v)
    return F.scaled_dot_product_attention(q, k, v)


class Attention(nn.Module):
    def __init__(self, config):
        super().__init__()
        self.heads = config.heads
        self.qkv = nn.Linear(config.dim, 3 * config.dim, bias=False)
        self.q_norm = HeadNorm(config.dim // config.heads, config.norm_eps)
        self.k_norm = HeadNorm(config.dim // config.heads, config.norm_eps)
        self.out = nn.Linear(config.dim, config.dim, bias=False)

    def split(self, x):
        """[batch, tokens, D] -> [batch, heads, tokens, D/h]."""
        return x.unflatten(-1, (self.heads, -1)).transpose(1, 2)

    def keys_values(self, x):
        dim = x.shape[-1]
        k, v = F.linear(x, self.qkv.weight[dim:]).chunk(2, -1)
        return self.k_norm(self.split(k)), self.split(v)

    def attend(self, q, k, v):
        return self.out(attention(q, k, v).transpose(1, 2).flatten(2))

    def forward(self, x):
        """Self-attention; also the keys and values, for the cache."""
        q, k, v = self.qkv(x).chunk(3, -1)
        k, v = self.k_norm(self.split(k)), self.split(v)
        return self.attend(self.q_norm(self.split(q)), k, v), k, v

    def lookup(self, x, k, v):
        """Attention of x to a given cache."""
        q = self.q_norm(self.split(F.linear(x, self.qkv.weight[:x.shape[-1]])))
        return self.attend(q, k, v)


class Mlp(nn.Module):
    def __init__(self, config):
        super().__init__()
        self.up = nn.Linear(config.dim, config.mlp_ratio * config.dim, bias=False)
        self.down = nn.Linear(config.mlp_ratio * config.dim, config.dim, bias=False)

    def forward(self, x):
        return self.down(F.gelu(self.up(x)))


class Block(nn.Module):
    def __init__(self, config):
        super().__init__()
        for stage in ("intra", "cross"):
            self.add_module(f"{stage}_norm", Norm(config.dim, config.norm_eps))
            self.add_module(stage, Attention(config))
            self.add_module(f"{stage}_mlp_norm", Norm(config.dim, config.norm_eps))
            self.add_module(f"{stage}_mlp", Mlp(config))

    def within(self, x):
        """The intra-view half; x [batch, views, tokens, D]."""
        flat = x.flatten(0, 1)
        flat = flat + self.intra(self.intra_norm(flat))[0]
        flat = flat + self.intra_mlp(self.intra_mlp_norm(flat))
        return flat.view_as(x)

    def reconstruct(self, x, last):
        """Pass the context tokens; (x, k, v). After the last block only k and v matter."""
        x = self.within(x)
        flat = x.flatten(1, 2)
        if last:
            return (x, *self.cross.keys_values(self.cross_norm(flat)))
        y, k, v = self.cross(self.cross_norm(flat))
        flat = flat + y
        flat = flat + self.cross_mlp(self.cross_mlp_norm(flat))
        return flat.view_as(x), k, v

    def render(self, x, k, v):
        """Pass target tokens, every view for itself; all views of a scene share its cache."""
        x = self.within(x)
        flat = x.flatten(1, 2)
        flat = flat + self.cross.lookup(self.cross_norm(flat), k, v)
        flat = flat + self.cross_mlp(self.cross_mlp_norm(flat))
        return flat.view_as(x)


class Dvsm(nn.Module):
    """Posed pictures in, other viewpoints out."""

    fast_options = 0  # of blocks/blocks.h

    def __init__(self, config):
        super().__init__()
        self.config = config
        self.checkpointing = False
        self.fast = None  # fast.Blocks, where the processor has them
        area = config.patch * config.patch
        self.patch_ray = nn.Linear(6 * area, config.dim, bias=False)
        self.patch_rgb = nn.Linear(3 * area, config.dim, bias=False)
        self.embed_norm = Norm(config.dim, config.norm_eps)
        self.blocks = nn.ModuleList(Block(config) for _ in range(config.layers))
        self.final_norm = Norm(config.dim, config.norm_eps)
        self.to_rgb = nn.Linear(config.dim, 3 * area, bias=False)
        self.initialise()

    @torch.no_grad()
    def initialise(self):
        """N(0, 0.02); projections that add to the residual stream shrink with depth."""
        for name, weight in self.named_parameters():
            if weight.dim() == 2:
                shrink = name.endswith(("out.weight", "down.weight"))
                std = 0.02 / math.sqrt(4 * self.config.layers) if shrink else 0.02
                nn.init.normal_(weight, std=std)

    def run(self, function, *arguments):
        """Call a block, keeping only its inputs for the backward pass when asked to."""
        if self.checkpointing and self.training and torch.is_grad_enabled():
            return checkpoint(function, *arguments, use_reentrant=False)
        return function(*arguments)

    def rays(self, cameras, size, patch):
        """Ray tokens [B, V, n, D] before the norm, and the token grid."""
        rotation, centre, intrinsics = cameras
        grid = geometry.token_grid(*size, patch)
        map_size = (grid[0] * self.config.patch, grid[1] * self.config.patch)
        with torch.autocast(rotation.device.type, enabled=False):
            maps = geometry.ray_map(rotation, centre, intrinsics, size, map_size)
        return self.patch_ray(geometry.cut(maps, self.config.patch)), grid, map_size

    def embed(self, pictures, cameras, patch):
        """Context pictures [B, V, h, w, 3] in [0, 1] -> tokens [B, V, n, D]."""
        size = (pictures.shape[-2], pictures.shape[-3])
        x, _, map_size = self.rays(cameras, size, patch)
        colour = geometry.cut(2 * geometry.resample(pictures, map_size) - 1, self.config.patch)
        return self.embed_norm(x + self.patch_rgb(colour))

    def reconstruct(self, pictures, cameras, patch):
        """Context pictures [B, V, h, w, 3] in [0, 1] -> the cache, a list of (k, v) a block."""
        x, cache = self.embed(pictures, cameras, patch), []
        for i, block in enumerate(self.blocks):
            x, k, v = self.run(block.reconstruct, x, i == len(self.blocks) - 1)
            cache.append((k, v))
        return cache

    def render(self, cache, cameras, size, patch):
        """Viewpoints -> pictures [B, T, h, w, 3], unclamped."""
        x, grid, _ = self.rays(cameras, size, patch)
        x = self.embed_norm(x)
        for block, (k, v) in zip(self.blocks, cache):
            x = self.run(block.render, x, k, v)
        return self.picture(x, grid, size)

    def block_weights(self):
        return list(self.blocks.parameters())

    def render_fast(self, pictures, near, far, size, patches):
        """Both stages at once, the blocks in C."""
        rays, grid, _ = self.rays(far, size, patches[1])
        x = self.fast(self.embed(pictures, near, patches[0]), self.embed_norm(rays),
                      self.block_weights())
        return self.picture(x, grid, size)

    def picture(self, x, grid, size):
        """Tokens behind the blocks -> pictures [B, T, h, w, 3], unclamped."""
        y = self.to_rgb(self.final_norm(x))
        y = y.float() if y.dtype in (torch.float16, torch.bfloat16) else y
        rgb = torch.sigmoid(y) if self.config.rgb_out == "sigmoid" else 0.5 + 0.5 * y
        return geometry.resample(geometry.join(rgb, grid, self.config.patch), size)

    def forward(self, pictures, poses, intrinsics, target_size, patches):
        """Render the cameras that have no picture: poses [B, V + T, 4, 4], pictures [B, V, ...].

        intrinsics [B, V + T, 4]: context ones belong to the pictures' size, target ones to
        `target_size` (w, h); patches (p1, p2) are the stage patches.
        """
        context = pictures.shape[1]
        with torch.autocast(poses.device.type, enabled=False):
            rotation, centre = geometry.normalise_poses(poses, context)
        near = (rotation[:, :context], centre[:, :context], intrinsics[:, :context])
        far = (rotation[:, context:], centre[:, context:], intrinsics[:, context:])
        if self.fast:
            return self.render_fast(pictures, near, far, target_size, patches)
        cache = self.reconstruct(pictures, near, patches[0])
        return self.render(cache, far, target_size, patches[1])


def compile_blocks():
    """Fuse each block's small operations; one compilation serves all layers and batch sizes."""
    Block.reconstruct = torch.compile(Block.reconstruct, dynamic=True)
    Block.render = torch.compile(Block.render, dynamic=True)


def save(path, weights, config, dtype=torch.bfloat16):
    """Export weights (name -> tensor) as a model file."""
    tensors = {name: weights[name].to(dtype) for name in expected_shapes(config)}
    for name, tensor in tensors.items():
        if not torch.isfinite(tensor).all():
            raise ValueError(f"{path}: tensor {name} holds a non-finite number; nothing written")
    metadata = {"format": "dvsm", "version": "1", "config": config.to_json()}
    safetensors_io.save(path, tensors, metadata)


def expected_shapes(config):
    """name -> shape of every tensor of a model file."""
    with torch.device("meta"):
        return {name: tuple(weight.shape) for name, weight in Dvsm(config).named_parameters()}


def load(path, dtype=torch.float32):
    """A model from a model file; ValueError names the tensor and the fault."""
    tensors, metadata = safetensors_io.load(path)
    if metadata.get("format") != "dvsm":
        raise ValueError(f"{path}: format is {metadata.get('format')!r}, not 'dvsm'")
    config = Config.from_json(metadata["config"])
    for name, shape in expected_shapes(config).items():
        if name not in tensors:
            raise ValueError(f"{path}: tensor {name} is missing")
        if tuple(tensors[name].shape) != shape:
            raise ValueError(f"{path}: tensor {name} is {list(tensors[name].shape)}, "
                             f"not {list(shape)}")
    model = Dvsm(config).to(dtype)
    model.load_state_dict({name: tensors[name].to(dtype) for name in expected_shapes(config)})
    return model
