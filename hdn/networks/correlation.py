"""What the correlation branches of both configurations share."""

import torch
import torch.nn.functional as F
from torch import Tensor, nn


def adapt(channels: int) -> nn.Sequential:
    """The convolution before the correlation; without padding, it takes a cell off each side."""
    return nn.Sequential(nn.Conv2d(channels, channels, 3, bias=False), nn.BatchNorm2d(channels), nn.ReLU())


def correlate(template: Tensor, search: Tensor) -> Tensor:
    """Depth-wise cross-correlation: (B, C, h, w) over (B, C, H, W) gives (B, C, H - h + 1, W - w + 1)."""
    b, c, h, w = template.shape
    x = search.reshape(1, b * c, *search.shape[2:])
    y = F.conv2d(x, template.reshape(b * c, 1, h, w), groups=b * c)
    return y.reshape(b, c, *y.shape[2:])


def centre(maps: Tensor, cells: int) -> Tensor:
    """The central cells x cells of maps (B, C, n, n)."""
    start = (maps.shape[-1] - cells) // 2
    return maps[:, :, start : start + cells, start : start + cells]


def pad_polar(maps: Tensor, reach: int) -> Tensor:
    """Log-polar maps, padded circularly along the angle (rows) and by replication along the log-radius (columns)."""
    maps = torch.cat([maps[:, :, -reach:], maps, maps[:, :, :reach]], 2)
    return F.pad(maps, (reach, reach, 0, 0), mode="replicate")
