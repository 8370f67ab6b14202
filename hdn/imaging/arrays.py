"""The kinds of arrays that pass between modules; shapes are said where they are used."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]  # points, quads, homographies, covariances
Picture = NDArray[
    Any
]  # (h, w, 3) RGB or (h, w, 4) RGBA, straight alpha: uint8 0..255, uint16 0..65535, or float32 0..1
Image = NDArray[np.uint8]  # (H, W, 3) RGB, or (H, W) grey
Floats = NDArray[np.float32]  # images to calculate with, and what networks take and give
Grey = NDArray[np.float32]  # (h, w), grey levels
Mask = NDArray[np.bool_]
Box = tuple[slice, slice]  # rows and columns of a picture
