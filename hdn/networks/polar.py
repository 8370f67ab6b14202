"""Rotation-scale equivariant warping: on a log-polar grid, rotation and scale about its centre become shifts."""

import numpy as np
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from .config import Config


def polar_points(config: Config) -> NDArray[np.float32]:
    """Sampling points (n, n, 2) of the log-polar crop, px from its centre (paper, eq. 5).

    Row j lies at angle 2 pi j / n; columns run from the inner to the outer of `polar_radii`, evenly in log-radius. The
    paper's grid starts at the centre and spends half its columns on the innermost 8 px; the compact one further out.
    """
    n = config.polar_size
    radius = np.geomspace(*config.polar_radii, n) - config.polar_shift
    angle = np.arange(n)[:, None] * config.radians_per_pixel
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], -1).astype(np.float32)


def polar_crop(crops: Tensor, centre: Tensor, points: Tensor) -> Tensor:
    """Log-polar crops (B, 3, n, n) of square crops (B, 3, m, m) about centre (B, 2), px from the crops' centres."""
    m = crops.shape[-1]
    grid = (points[None] + centre[:, None, None]) * (2 / m)
    return F.grid_sample(crops, grid, padding_mode="border", align_corners=False)
