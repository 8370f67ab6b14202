"""The similarity component: translation by correlation, then rotation and scale by correlation on a log-polar warp.

Paper: "Similarity Component", eqs. 4 and 5. Each branch has one correlation of template and search features that feeds
one head for both the score map and the offset map.
"""

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from ..imaging.arrays import Floats
from .backbone import OUTPUT_CHANNELS, Backbone
from .config import Config
from .correlation import adapt, correlate, pad_polar
from .paper import LevelBranch
from .resnet import ResNet50

GROUPS = 8  # of channels, whose cosines are summed up apart


@dataclass(frozen=True)
class PoseBank:
    """Poses in which the translation branch looks for the target, each time all: they span the paper's ranges."""

    rotations: tuple[float, ...] = (-0.6, -0.3, 0.0, 0.3, 0.6)  # rad
    scales: tuple[float, ...] = (0.8, 1.0, 1.25)  # ratio to the template's size


POSES = PoseBank()


class Neck(nn.Module):
    """Feature maps of both stages to one map of `channels` at stride 8."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.fine = nn.Conv2d(OUTPUT_CHANNELS[0], channels, 3, 2, 1, bias=False)  # stage 2 has stride 4
        self.coarse = nn.Conv2d(OUTPUT_CHANNELS[1], channels, 1, bias=False)
        self.norm = nn.BatchNorm2d(channels)

    def forward(self, maps: tuple[Tensor, ...]) -> Tensor:
        fine, coarse = maps
        return F.relu(self.norm(self.fine(fine) + self.coarse(coarse)))


class TranslationBranch(nn.Module):
    """Where the target's centre is, however the target has turned and grown.

    A kernel cut from the template fits a turned or scaled target badly, and its peak drifts. So the template's map is
    resampled to a bank of kernels, one for each of a few poses; all are correlated with the search map, and each place
    keeps what its best pose says. The bank is made once a target: a frame pays for the correlation alone.
    """

    def __init__(self, config: Config) -> None:
        super().__init__()
        channels = config.channels
        self.grid: Tensor
        self.register_buffer("grid", torch.from_numpy(pose_grid(config)), persistent=False)
        self.neck = Neck(channels)
        self.adapt_template = _describe(channels)
        self.adapt_search = _describe(channels)
        self.sharpness = nn.Parameter(torch.tensor(2.0))  # log of what multiplies the cosines
        self.each = nn.Sequential(nn.Conv2d(GROUPS, 32, 1), nn.ReLU(), nn.Conv2d(32, 32, 1))  # of each pose
        self.head = _head(32, channels, 3)

    def encode_template(self, maps: tuple[Tensor, ...]) -> Tensor:
        """Backbone maps of the template crop to kernels of unit descriptors: (B, poses, C, 6, 6)."""
        x = self.neck(maps)  # (B, C, 16, 16)
        poses, n = self.grid.shape[:2]
        grid = self.grid.reshape(1, poses * n, n, 2).expand(x.shape[0], -1, -1, -1)
        x = F.grid_sample(x, grid, padding_mode="border", align_corners=False)
        x = x.unflatten(2, (poses, n)).transpose(1, 2).flatten(0, 1)
        return F.normalize(self.adapt_template(x), dim=1).unflatten(0, (-1, poses))

    def encode_search(self, maps: tuple[Tensor, ...]) -> Tensor:
        """Backbone maps to the unit descriptors that the kernels slide over: (B, C, n - 2, n - 2)."""
        return F.normalize(self.adapt_search(self.neck(maps)), dim=1)

    def forward(self, template: Tensor, search: Tensor) -> tuple[Tensor, Tensor]:
        """Encoded template and search to score logits (B, 2, n, n) and offsets (B, 2, n, n) in cells."""
        b, poses, channels, h, w = template.shape
        share = channels // GROUPS
        kernels = template.unflatten(2, (GROUPS, share)).transpose(1, 2).reshape(-1, share, h, w)
        x = F.conv2d(search.reshape(1, b * channels, *search.shape[2:]), kernels, groups=b * GROUPS)
        x = x.reshape(b, GROUPS, poses, *x.shape[2:]).transpose(1, 2).flatten(0, 1)
        x = self.each(x * (self.sharpness.exp() / (h * w)))
        y = self.head(x.unflatten(0, (b, poses)).amax(1))
        return y[:, :2], y[:, 2:]


class PolarBranch(nn.Module):
    """Rotation and log-scale: shifts of the log-polar crop."""

    def __init__(self, config: Config) -> None:
        super().__init__()
        channels = config.channels
        self.reach = config.polar_reach
        self.neck = Neck(channels)
        self.adapt_template = adapt(channels)
        self.adapt_search = adapt(channels)
        self.head = _head(channels, channels, 1)

    def encode_template(self, maps: tuple[Tensor, ...]) -> Tensor:
        """Backbone maps of the template's log-polar crop to the correlation kernel, (B, C, 14, 14)."""
        return self.adapt_template(self.neck(maps))

    def encode_search(self, maps: tuple[Tensor, ...]) -> Tensor:
        """Backbone maps of the search's log-polar crop to what the kernel slides over, (B, C, 22, 22)."""
        return self.adapt_search(pad_polar(self.neck(maps), self.reach))

    def forward(self, template: Tensor, search: Tensor) -> tuple[Tensor, Tensor]:
        """Encoded template and search to score logits (B, 2, n, n) and offsets (B, 2, n, n) in cells."""
        h, w = template.shape[2:]
        y = self.head(correlate(template, search) / (h * w))
        return y[:, :2], y[:, 2:]


class SimilarityNetwork(nn.Module):
    """Backbone and both branches. Crops are RGB (B, 3, n, n), 0..255."""

    def __init__(self, config: Config) -> None:
        super().__init__()
        self.config = config
        compact = config.backbone == "efficientnet-lite0"
        self.backbone: Any = Backbone() if compact else ResNet50()
        self.translation: Any = TranslationBranch(config) if compact else LevelBranch(config, polar=False)
        self.polar: Any = PolarBranch(config) if compact else LevelBranch(config, polar=True)

    def encode_template(self, maps: tuple[Tensor, ...]) -> Tensor:
        """Backbone maps of the template crop to translation's correlation kernel."""
        return self.translation.encode_template(maps)

    def encode_search(self, maps: tuple[Tensor, ...]) -> Tensor:
        """Backbone maps of the search crop to what that kernel slides over."""
        return self.translation.encode_search(maps)

    def encode_polar_template(self, maps: tuple[Tensor, ...]) -> Tensor:
        """Backbone maps of the template's log-polar crop to the log-polar branch's kernel."""
        return self.polar.encode_template(maps)

    def encode_polar_search(self, maps: tuple[Tensor, ...]) -> Tensor:
        """Backbone maps of the search's log-polar crop to what that kernel slides over."""
        return self.polar.encode_search(maps)


def pose_grid(config: Config) -> Floats:
    """Where each pose's kernel takes its cells from: (poses, n, n, 2), -1..1 of the template's map.

    A target turned by R and grown by s about its centre shows at p what the template has at R^-1 p / s.
    """
    n, cells = config.template_cells, -(-config.template_size // config.stride)
    centre = (config.template_size - 1) / 2 / config.stride  # cell i is on pixel i * stride
    r = np.arange(n) + (cells - n) / 2 - centre
    x, y = np.meshgrid(r, r)
    rotation, scale = np.array([*product(POSES.rotations, POSES.scales)]).T[:, :, None, None]
    c, s = np.cos(rotation) / scale, np.sin(rotation) / scale
    places = np.stack([c * x + s * y, c * y - s * x], -1) + centre
    return np.asarray((places + 0.5) * (2 / cells) - 1, np.float32)


def _describe(channels: int) -> nn.Sequential:
    """Without padding, it takes a cell off each side."""
    return nn.Sequential(nn.Conv2d(channels, channels, 3, bias=False), nn.BatchNorm2d(channels))


def _head(inputs: int, channels: int, kernel: int) -> nn.Sequential:
    """From what a correlation gave to score logits and offsets, two maps each."""
    return nn.Sequential(
        nn.Conv2d(inputs, channels, kernel, padding=kernel // 2, bias=False),
        nn.BatchNorm2d(channels),
        nn.ReLU(),
        nn.Conv2d(channels, channels, 3, padding=1, bias=False),
        nn.BatchNorm2d(channels),
        nn.ReLU(),
        nn.Conv2d(channels, 4, 1),
    )
