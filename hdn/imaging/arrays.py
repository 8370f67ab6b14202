"""The kinds of arrays that pass between modules; shapes are said where they are used."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]  # points, quads, homographies, covariances
Picture = NDArray[Any]  # (H, W, 3) RGB or (H, W, 4) RGBA in full scale: uint8, or uint16 where 8 bits are too few
Image = NDArray[np.uint8]  # (H, W, 3) RGB, or (H, W) grey
Floats = NDArray[np.float32]  # images to calculate with, and what networks take and give
Grey = NDArray[np.float32]  # (h, w), grey levels
Mask = NDArray[np.bool_]
