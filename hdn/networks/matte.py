"""The matte: which pixels of a rectified frame show the surface, and which something in front of it."""

import numpy as np

from ..imaging.arrays import Floats, Image
from .config import MATTE_SIZE
from .engine import Function


class Matte:
    """The matte network on single crops, whatever runs it; `loading.load_matte` makes one.

    Example:
        matte = load_matte()
        seen = matte(frame_crop, template_crop)  # (128, 128)
    """

    size = MATTE_SIZE  # px of its crops

    def __init__(self, function: Function, description: str) -> None:
        """Args: description: what runs it, as the log says it."""
        self.function, self.description = function, description

    def __call__(
        self, frame: Image, template: Image, valid: Image | None = None, around: Image | None = None
    ) -> Floats:
        """How probably each pixel shows the surface, and not something in front: (n, n) of 0 to 1.

        Args:
            frame, template: (n, n, 3) RGB crops, rectified alike: of the frame, and of the surface as it is known.
                They may differ in light and blur, and lie a few px beside each other.
            valid: (n, n), not 0 where both are known: within the frame, and seen before. None: everywhere. Where they
                are not, what they show does not matter, and the result is 0.
            around: (n, n), not 0 where beyond that the frame is known, which tells what comes in from there. None:
                nowhere.

        Raises:
            ValueError: a crop is not n = 128 px large.
        """
        n = self.size
        known = np.full((n, n), 255, np.uint8) if valid is None else valid
        beside = np.zeros((n, n), np.uint8) if around is None else around
        for crop, shape in ((frame, (n, n, 3)), (template, (n, n, 3)), (known, (n, n)), (beside, (n, n))):
            if crop.shape != shape or crop.dtype != np.uint8:
                raise ValueError(f"a crop for the matte is {crop.dtype} {crop.shape}: make it uint8 {shape}")
        return self.function(*(np.ascontiguousarray(crop)[None] for crop in (frame, template, known, beside)))[0][0]
