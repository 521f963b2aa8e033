"""The training loss: squared error plus 0.2 x a perceptual distance.

With a file of VGG-19 weights the distance is over its features. Without one (none is shipped: its
licence and size) it is built from the pictures themselves: absolute differences of gradients at
three scales, and 1 - SSIM. Both are scaled so that they stay below the squared error.
"""
import functools

import torch
import torch.nn as nn
import torch.nn.functional as F

PERCEPTUAL_WEIGHT = 0.2
BOX = 7
GRADIENT_SHARE, SSIM_SHARE = 0.1, 0.05
VGG_LAYERS = (64, 64, "M", 128, 128, "M", 256, 256, 256, 256, "M", 512, 512, 512, 512, "M", 512)
VGG_TAPS = {3: 1 / 2.6, 8: 1 / 4.8, 13: 1 / 3.7, 22: 1 / 5.6}


def gradients(got, want):
    """Mean absolute difference of horizontal and vertical gradients, three scales; [n,3,h,w]."""
    total, error = 0.0, got - want
    for scale in range(3):
        if scale:
            error = F.avg_pool2d(error, 2)
        total = total + (error[..., 1:] - error[..., :-1]).abs().mean()
        total = total + (error[..., 1:, :] - error[..., :-1, :]).abs().mean()
    return total / 3


@functools.lru_cache(maxsize=64)
def box_matrix(length):
    """[length - 6, length]: means of 7 in a row."""
    rows = torch.arange(length - BOX + 1)[:, None]
    columns = torch.arange(length)[None]
    return ((columns >= rows) & (columns < rows + BOX)).float() / BOX


def box_means(x):
    """Means over 7 x 7 boxes; [n,c,h,w]. As products they take a CPU half the time of pooling, with
    all of the loss around them; a GPU would take them in TF32, too coarse for variances."""
    if x.device.type != "cpu":
        return F.avg_pool2d(x, BOX, 1)
    return box_matrix(x.shape[-2]) @ x @ box_matrix(x.shape[-1]).T


def ssim(got, want):
    """Mean structural similarity of luma over 7 x 7 boxes; [n,3,h,w]."""
    luma = got.new_tensor([0.299, 0.587, 0.114]).view(1, 3, 1, 1)
    a, b = (got * luma).sum(1, keepdim=True), (want * luma).sum(1, keepdim=True)
    box = torch.cat([a, b, a * a, b * b, a * b], 1)
    mean_a, mean_b, aa, bb, ab = box_means(box).unbind(1)
    var_a, var_b, cov = aa - mean_a ** 2, bb - mean_b ** 2, ab - mean_a * mean_b
    top = (2 * mean_a * mean_b + 1e-4) * (2 * cov + 9e-4)
    return (top / ((mean_a ** 2 + mean_b ** 2 + 1e-4) * (var_a + var_b + 9e-4))).mean()


class Vgg(nn.Module):
    """Feature distance of VGG-19; `path` holds torchvision's state dict."""

    def __init__(self, path):
        super().__init__()
        layers, channels = [], 3
        for width in VGG_LAYERS:
            if width == "M":
                layers.append(nn.MaxPool2d(2))
                continue
            layers += [nn.Conv2d(channels, width, 3, padding=1), nn.ReLU()]
            channels = width
        self.features = nn.Sequential(*layers)
        state = torch.load(path, map_location="cpu", weights_only=True)
        wanted = self.features.state_dict()
        self.features.load_state_dict({key: state[f"features.{key}"] for key in wanted})
        self.requires_grad_(False)
        self.register_buffer("mean", torch.tensor([0.485, 0.456, 0.406]).view(1, 3, 1, 1))
        self.register_buffer("std", torch.tensor([0.229, 0.224, 0.225]).view(1, 3, 1, 1))

    def forward(self, got, want):
        a, b, total = (got - self.mean) / self.std, (want - self.mean) / self.std, 0.0
        for i, layer in enumerate(self.features):
            a, b = layer(a), layer(b)
            if i in VGG_TAPS:
                total = total + VGG_TAPS[i] * (a - b).abs().mean()
        return total / len(VGG_TAPS)


class Loss(nn.Module):
    def __init__(self, vgg_path=None):
        super().__init__()
        self.vgg = Vgg(vgg_path) if vgg_path else None

    def describe(self):
        return "mse + 0.2 vgg" if self.vgg else "mse + 0.2 (0.1 gradients + 0.05 (1 - ssim))"

    def forward(self, got, want):
        """Pictures [B, T, h, w, 3]; (loss, mean squared error)."""
        got, want = got.float(), want.float()
        error = F.mse_loss(got, want)
        a = got.flatten(0, 1).permute(0, 3, 1, 2)
        b = want.flatten(0, 1).permute(0, 3, 1, 2)
        if self.vgg:
            perceptual = self.vgg(a, b)
        else:
            perceptual = GRADIENT_SHARE * gradients(a, b) + SSIM_SHARE * (1 - ssim(a, b))
        return error + PERCEPTUAL_WEIGHT * perceptual, error.detach()
