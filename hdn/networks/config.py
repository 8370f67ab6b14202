"""What distinguishes the compact HDN from the paper's, in one place."""

import math
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Config:
    """Parts and sizes of the networks and windows.

    Sizes are pixels of the crops that the networks see; the windows they are cut from scale with the target.
    """

    name: str
    backbone: Literal["efficientnet-lite0", "resnet-50"]
    residual: Literal["matching", "resnet-34"]
    template_size: int = 127
    search_size: int = 255
    polar_size: int = 128  # a multiple of the stride, so that the angle axis is cyclic on the feature map too
    polar_radii: tuple[float, float] = (4.0, 63.5)  # px of the search crop, first and last column
    polar_shift: float = 0.0  # px taken off these radii
    polar_reach: int = 4  # cells searched to each side on the log-polar map: +-1.57 rad and +-0.69 of log-scale
    stride: int = 8
    channels: int = 64
    template_cells: int = 8  # central cells of the template's feature map that hold the target
    residual_size: int = 128
    residual_rectified: bool = True  # its crop shows the quad, or else a square as large as its box
    half: bool = True  # weights on disk, and computation on CUDA, in half precision
    context: float = 0.5  # margin around the target's box, as a share of its mean side

    @property
    def log_scale_per_pixel(self) -> float:
        """Log-scale that one column of the log-polar crop stands for."""
        return math.log(self.polar_radii[1] / self.polar_radii[0]) / (self.polar_size - 1)

    @property
    def radians_per_pixel(self) -> float:
        """Rotation that one row of the log-polar crop stands for."""
        return 2 * math.pi / self.polar_size


COMPACT = Config(
    "compact",
    backbone="efficientnet-lite0",
    residual="matching",
    search_size=175,  # reaches three quarters of the target's width, at less than half the cost of 255
)

PAPER = Config(
    "paper",
    backbone="resnet-50",
    residual="resnet-34",
    polar_size=127,
    polar_radii=(1.0, 63.5 ** (126 / 127)),
    polar_shift=1.0,
    polar_reach=6,
    channels=256,
    template_cells=7,
    residual_size=127,
    residual_rectified=False,
    # Its inputs and correlation sums are not normalised: variances and maps may overflow half precision.
    half=False,
)

MATTE_SIZE = 128  # px of the square crops that the matte network compares
MATTE_SURFACE = 0.8  # share of a crop's side that a surface takes where what is around it is looked at as well
LIGHT_SIZE = 32  # px of the square views that the light network looks at
LIGHT_SURFACE = 0.75  # share of a view's side that the surface takes

CONFIGS = {config.name: config for config in (COMPACT, PAPER)}
