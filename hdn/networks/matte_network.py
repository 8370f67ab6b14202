"""The matte network as a PyTorch module, and its way into weights files and out of them.

A U-Net (Ronneberger et al., MICCAI 2015) of residual blocks. What stays the same in both crops is the surface, what
varies smoothly is light, what is neither is in front.
"""

from itertools import pairwise
from pathlib import Path

import torch
import torch.nn.functional as F
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from ..errors import InputError
from .weights import MATTE, architecture

WIDTHS = (24, 32, 48, 64, 64)  # channels at strides 2, 4, 8, 16, 32
FINE = 12  # channels at stride 1, where the outline is drawn
NOISE = 6.0  # grey levels that standard deviations are taken to have at least: without texture there is noise
INPUTS = 25  # channels of `compared`


class MatteNetwork(nn.Module):
    """Crops of a multiple of 32 px to logits of how probably each pixel shows the surface."""

    def __init__(self) -> None:
        super().__init__()
        steps = list(pairwise(WIDTHS))
        self.stem = conv(INPUTS, WIDTHS[0], 4, 2)
        self.encode = nn.ModuleList([Residual(width) for width in WIDTHS])
        self.shrink = nn.ModuleList([conv(fine, coarse, 3, 2) for fine, coarse in steps])
        self.join = nn.ModuleList([conv(fine + coarse, fine, 1) for fine, coarse in steps])
        self.decode = nn.ModuleList([Residual(fine) for fine, _ in steps])
        self.enlarge = nn.Conv2d(WIDTHS[0], FINE, 1)
        self.draw = nn.Sequential(conv(INPUTS + FINE, FINE, 3), nn.Conv2d(FINE, 1, 3, padding=1))

    def forward(self, frame: Tensor, template: Tensor, valid: Tensor, around: Tensor) -> Tensor:
        """Logits (B, 1, n, n) of rectified RGB crops (B, 3, n, n), 0..255.

        Args:
            valid: (B, 1, n, n), 0 or 1: where both are known.
            around: (B, 1, n, n), 0 or 1: beyond that, where the frame is: what is in front mostly comes from there.
        """
        inputs = compared(frame, template, valid, around)
        x, skipped = self.stem(inputs), []  # (B, 24, n / 2, n / 2)
        for block, shrink in zip(self.encode, self.shrink, strict=False):
            x = block(x)
            skipped.append(x)
            x = shrink(x)
        x = self.encode[-1](x)  # (B, 64, n / 32, n / 32)
        for block, join, skip in zip(self.decode[::-1], self.join[::-1], skipped[::-1], strict=True):
            x = block(join(torch.cat([F.interpolate(x, scale_factor=2.0), skip], 1)))
        x = F.interpolate(self.enlarge(x), scale_factor=2.0, mode="bilinear", align_corners=False)
        return self.draw(torch.cat([inputs, x], 1))


def compared(frame: Tensor, template: Tensor, valid: Tensor, around: Tensor) -> Tensor:
    """What the network looks at, (B, 25, n, n): the crops and their difference as they are, and free of light.

    Each is there once in grey levels, once standardised over the crop, which a change of exposure leaves as it is, and
    in grey standardised over a window about each pixel, which shadows leave as they are; the frame also around them.
    """
    raw = torch.cat([frame - 128, template - 128, (frame - template).abs()], 1) / 64
    one, other = _standardised(frame, valid), _standardised(template, valid)
    grey = torch.cat([frame.mean(1, keepdim=True), template.mean(1, keepdim=True)], 1)
    channels = [raw, valid, one, other, (one - other).abs(), _locally_standardised(grey, valid)]
    return torch.cat([torch.cat(channels, 1) * valid, around, one * around], 1)


def _standardised(crops: Tensor, valid: Tensor) -> Tensor:
    """Crops (B, 3, n, n) with the mean of what is valid at zero and its deviation at one."""
    count = valid.sum((2, 3), keepdim=True).clamp_min(1)
    centred = crops - (crops * valid).sum((2, 3), keepdim=True) / count
    spread = ((centred.square() * valid).sum((2, 3), keepdim=True) / count).sqrt()
    return centred / (spread + NOISE)


def _locally_standardised(crops: Tensor, valid: Tensor) -> Tensor:
    """The same by the mean and deviation of what is valid of a 16 px square about each pixel."""
    count = _window(valid).clamp_min(1e-3)
    mean = _window(crops * valid) / count
    spread = (_window(crops.square() * valid) / count - mean.square()).clamp_min(0).sqrt()
    return (crops - mean) / (spread + NOISE)


def _window(maps: Tensor) -> Tensor:
    """The mean over 16 px squares about each pixel, by way of every fourth."""
    coarse = F.avg_pool2d(maps, 16, 4, 6, count_include_pad=False)
    return F.interpolate(coarse, scale_factor=4.0, mode="bilinear", align_corners=False)


class OfCrops(nn.Module):
    """The network as it is run: crops as they are kept, uint8 (1, n, n, 3), to the probability (1, n, n)."""

    def __init__(self, network: MatteNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, frame: Tensor, template: Tensor, valid: Tensor, around: Tensor) -> tuple[Tensor]:
        """Args: valid, around: uint8 (1, n, n), not 0 for true; what is returned is 0 where nothing is valid."""
        known, beside = ((mask > 0).float().unsqueeze(1) for mask in (valid, around))
        crops = (crop.permute(0, 3, 1, 2).float() for crop in (frame, template))
        return ((self.network(*crops, known, beside).sigmoid() * known).squeeze(1),)


def save(network: nn.Module, path: Path, notes: dict[str, str]) -> None:
    """Writes the weights in half precision, with the notes (where they come from)."""
    tensors = {n: v.half().contiguous() if v.is_floating_point() else v for n, v in network.state_dict().items()}
    save_file(tensors, path, {"config": MATTE, **notes})


def load(path: Path) -> MatteNetwork:
    """Reads weights; the network comes in evaluation mode, single precision.

    Raises:
        InputError: no such file, not a safetensors file, or weights of another architecture.
    """
    architecture(path, [MATTE])
    network = MatteNetwork()
    tensors = {n: v.float() if v.is_floating_point() else v for n, v in load_file(path).items()}
    try:
        network.load_state_dict(tensors)
    except RuntimeError as error:
        raise InputError(f"{path} does not fit the matte network of this version: make it anew") from error
    return network.eval().requires_grad_(False)


class Residual(nn.Module):
    """Two convolutions beside a shortcut (He et al., CVPR 2016)."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first = conv(width, width, 3)
        self.second = nn.Sequential(nn.Conv2d(width, width, 3, padding=1, bias=False), nn.BatchNorm2d(width))

    def forward(self, x: Tensor) -> Tensor:
        return F.relu(x + self.second(self.first(x)))


def conv(inputs: int, outputs: int, kernel: int, stride: int = 1) -> nn.Sequential:
    padding = (kernel - 1) // 2
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, kernel, stride, padding, bias=False), nn.BatchNorm2d(outputs), nn.ReLU(inplace=True)
    )
