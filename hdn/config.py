"""Sizes of the networks and windows, in one place."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Config:
    """What distinguishes one HDN from another.

    Sizes are pixels of the crops that the networks see; the windows they are cut from scale with the target.
    """

    name: str
    template_size: int = 127
    search_size: int = 255
    polar_size: int = 128  # a multiple of the stride, so that the angle axis is cyclic on the feature map too
    polar_radii: tuple[float, float] = (4.0, 63.5)  # px of the search crop, first and last column
    polar_reach: int = 4  # cells searched to each side on the log-polar map: +-1.57 rad and +-0.69 of log-scale
    stride: int = 8
    channels: int = 96
    template_cells: int = 8  # central cells of the template's feature map that hold the target
    residual_size: int = 128
    residual_channels: tuple[int, ...] = (32, 64, 96, 128)
    context: float = 0.5  # margin around the target's box, as a share of its mean side

    @property
    def log_scale_per_pixel(self) -> float:
        """Log-scale that one column of the log-polar crop stands for."""
        return math.log(self.polar_radii[1] / self.polar_radii[0]) / (self.polar_size - 1)

    @property
    def radians_per_pixel(self) -> float:
        """Rotation that one row of the log-polar crop stands for."""
        return 2 * math.pi / self.polar_size


COMPACT = Config("compact")
