"""Rotation-scale equivariant warping: on a log-polar grid, rotation and scale about its centre become shifts."""

import numpy as np

from ..imaging.arrays import Floats
from .config import Config


def polar_points(config: Config) -> Floats:
    """Sampling points (n, n, 2) of the log-polar crop, px from its centre (paper, eq. 5).

    Row j lies at angle 2 pi j / n; columns run from the inner to the outer of `polar_radii`, evenly in log-radius. The
    paper's grid starts at the centre and spends half its columns on the innermost 8 px; the compact one further out.
    """
    n = config.polar_size
    radius = np.geomspace(*config.polar_radii, n) - config.polar_shift
    angle = np.arange(n)[:, None] * config.radians_per_pixel
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], -1).astype(np.float32)
