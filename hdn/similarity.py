"""The similarity component: translation by correlation, then rotation and scale by correlation on a log-polar warp.

Paper: "Similarity Component", eqs. 4 and 5. Each branch has one correlation of template and search features that feeds
one head for both the score map and the offset map.
"""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from .backbone import CHANNELS, Backbone
from .config import Config


class Neck(nn.Module):
    """Feature maps of four stages to one map of `channels` at stride 8."""

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


def _adapt(channels: int) -> nn.Sequential:
    return nn.Sequential(nn.Conv2d(channels, channels, 3, bias=False), nn.BatchNorm2d(channels), nn.ReLU())


def correlate(template: Tensor, search: Tensor) -> Tensor:
    """Depth-wise cross-correlation: (B, C, h, w) over (B, C, H, W) gives (B, C, H - h + 1, W - w + 1)."""
    b, c, h, w = template.shape
    x = search.reshape(1, b * c, *search.shape[2:])
    y = F.conv2d(x, template.reshape(b * c, 1, h, w), groups=b * c)
    return y.reshape(b, c, *y.shape[2:]) / (h * w)


class Branch(nn.Module):
    """One correlation branch; `encode_*` go before it, once for the template and once a frame; `head` after it."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.neck = Neck(channels)
        self.adapt_template = _adapt(channels)
        self.adapt_search = _adapt(channels)
        self.head = nn.Sequential(
            nn.Conv2d(channels, channels, 1, bias=False),
            nn.BatchNorm2d(channels),
            nn.ReLU(),
            nn.Conv2d(channels, channels, 3, padding=1, bias=False),
            nn.BatchNorm2d(channels),
            nn.ReLU(),
            nn.Conv2d(channels, 4, 1),
        )

    def forward(self, template: Tensor, search: Tensor) -> tuple[Tensor, Tensor]:
        """Encoded template and search to score logits (B, 2, n, n) and offsets (B, 2, n, n) in cells."""
        y = self.head(correlate(template, search))
        return y[:, :2], y[:, 2:]


class SimilarityNetwork(nn.Module):
    """Backbone and both branches. Crops are RGB (B, 3, n, n), 0..255."""

    def __init__(self, config: Config) -> None:
        super().__init__()
        self.config = config
        self.backbone = Backbone()
        self.translation = Branch(config.channels)
        self.polar = Branch(config.channels)

    def encode_template(self, maps: tuple[Tensor, ...]) -> Tensor:
        """Backbone maps of the template crop to the correlation kernel: (B, C, 6, 6)."""
        x = self.translation.neck(maps)  # (B, C, 16, 16)
        n = self.config.template_cells
        start = (x.shape[-1] - n) // 2
        return self.translation.adapt_template(x[:, :, start : start + n, start : start + n])

    def encode_search(self, maps: tuple[Tensor, ...]) -> Tensor:
        """Backbone maps of the search crop to what the kernel slides over: (B, C, 30, 30)."""
        return self.translation.adapt_search(self.translation.neck(maps))

    def encode_polar_template(self, maps: tuple[Tensor, ...]) -> Tensor:
        """Backbone maps of the template's log-polar crop: (B, C, 14, 14)."""
        return self.polar.adapt_template(self.polar.neck(maps))

    def encode_polar_search(self, maps: tuple[Tensor, ...]) -> Tensor:
        """Backbone maps of the search's log-polar crop: (B, C, 22, 22).

        Padded circularly along the angle (rows) and by replication along the log-radius (columns).
        """
        x = self.polar.neck(maps)  # (B, C, 16, 16)
        reach = self.config.polar_reach
        x = torch.cat([x[:, :, -reach:], x, x[:, :, :reach]], 2)
        return self.polar.adapt_search(F.pad(x, (reach, reach, 0, 0), mode="replicate"))
