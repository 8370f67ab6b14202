"""The similarity component: translation by correlation, then rotation and scale by correlation on a log-polar warp.

Paper: "Similarity Component", eqs. 4 and 5. Each branch has one correlation of template and search features that feeds
one head for both the score map and the offset map.
"""

from typing import Any

import torch.nn.functional as F
from torch import Tensor, nn

from .backbone import CHANNELS, Backbone
from .config import Config
from .correlation import adapt, centre, correlate, pad_polar
from .paper import LevelBranch
from .resnet import ResNet50


class Neck(nn.Module):
    """Feature maps of three stages to one map of `channels` at stride 8."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.fine = nn.Conv2d(CHANNELS[0], channels, 3, 2, 1, bias=False)  # stage 2 has stride 4
        self.coarse = nn.ModuleList(nn.Conv2d(c, channels, 1, bias=False) for c in CHANNELS[1:])
        self.norm = nn.BatchNorm2d(channels)

    def forward(self, maps: tuple[Tensor, ...]) -> Tensor:
        x = self.fine(maps[0])
        for conv, features in zip(self.coarse, maps[1:], strict=True):
            x = x + conv(features)
        return F.relu(self.norm(x))


class Branch(nn.Module):
    """One correlation branch; `encode_*` go before it, once for the template and once a frame; `head` after it."""

    def __init__(self, config: Config, polar: bool) -> None:
        super().__init__()
        channels = config.channels
        self.cells = None if polar else config.template_cells
        self.reach = config.polar_reach if polar else 0
        self.neck = Neck(channels)
        self.adapt_template = adapt(channels)
        self.adapt_search = adapt(channels)
        self.head = nn.Sequential(
            nn.Conv2d(channels, channels, 1, bias=False),
            nn.BatchNorm2d(channels),
            nn.ReLU(),
            nn.Conv2d(channels, channels, 3, padding=1, bias=False),
            nn.BatchNorm2d(channels),
            nn.ReLU(),
            nn.Conv2d(channels, 4, 1),
        )

    def encode_template(self, maps: tuple[Tensor, ...]) -> Tensor:
        """Backbone maps to the correlation kernel: (B, C, 6, 6) of translation, (B, C, 14, 14) of log-polar."""
        x = self.neck(maps)  # (B, C, 16, 16)
        return self.adapt_template(centre(x, self.cells) if self.cells else x)

    def encode_search(self, maps: tuple[Tensor, ...]) -> Tensor:
        """Backbone maps to what the kernel slides over: (B, C, n - 2, n - 2), of log-polar (B, C, 22, 22)."""
        x = self.neck(maps)
        return self.adapt_search(pad_polar(x, self.reach) if self.reach else x)

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
        branch = Branch if compact else LevelBranch
        self.backbone: Any = Backbone() if compact else ResNet50()
        self.translation = branch(config, polar=False)
        self.polar = branch(config, polar=True)

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
