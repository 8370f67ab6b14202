"""Crops sampled straight from a frame through a homography, with the frame's own pyramid against aliasing."""

import cv2
import numpy as np

from .arrays import Array, Image, Mask
from .homography import transform

MIN_HALVED_SIDE = 32  # px: a level whose shorter side is less is not halved again
MAX_REDUCTION = 2**16  # crops that look at more of the frame than this, px a pixel, are degenerate


class Pyramid:
    """A frame and its halvings, each made when first asked for."""

    def __init__(self, frame: Image) -> None:
        """Args: frame: RGB uint8 (H, W, 3), or grey (H, W)."""
        self.levels = [frame]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the frame, px."""
        return self.levels[0].shape[1], self.levels[0].shape[0]

    def level(self, index: int) -> tuple[Image, float]:
        """The frame halved `index` times, or as often as it can be, and the reduction reached: 1, 2, 4 ..."""
        while len(self.levels) <= index and min(self.levels[-1].shape[:2]) >= MIN_HALVED_SIDE:
            h, w = self.levels[-1].shape[:2]
            even = self.levels[-1][: h - h % 2, : w - w % 2]  # halves exactly, so that pixel centres stay known
            self.levels.append(np.asarray(cv2.resize(even, (w // 2, h // 2), interpolation=cv2.INTER_AREA), np.uint8))
        index = min(index, len(self.levels) - 1)
        return self.levels[index], 2.0**index

    def at_most(self, longest: int) -> tuple[Image, float]:
        """The largest level whose longer side is at most so many px, and its reduction."""
        return self.reduced(max(self.size) / longest)

    def reduced(self, ratio: float) -> tuple[Image, float]:
        """The largest level that is reduced by a ratio at least, as far as it can be, and the reduction reached."""
        return self.level(max(0, int(np.ceil(np.log2(max(ratio, 1))))))

    def shows(self, to_frame: Array, points: Array, margin: float = -0.5) -> Mask:
        """Which points (..., 2) of a plane lie in the frame, by a homography (3, 3) to it, and before the camera.

        Args:
            margin: px that a point has to be away from the centres of the frame's outermost pixels.
        """
        depth = points @ to_frame[2, :2] + to_frame[2, 2]
        at = transform(to_frame, points)
        is_inside = ((at >= margin) & (at <= np.array(self.size) - 1 - margin)).all(-1)
        return np.asarray((depth > 0) & is_inside)

    def crop(self, crop_to_frame: Array, width: int, height: int, fill: tuple[float, ...] | None = None) -> Image:
        """A crop (height, width, ...) whose pixels look into the frame through a homography.

        Args:
            crop_to_frame: (3, 3), crop pixels to frame pixels.
            fill: grey levels of what lies outside the frame; None repeats its border.
        """
        image, factor = self.level(_level_for(crop_to_frame, width, height))
        # The centre of pixel x of a level lies at factor (x + 0.5) - 0.5 of the frame.
        shift = 0.5 / factor - 0.5
        frame_to_level = np.array([[1 / factor, 0, shift], [0, 1 / factor, shift], [0, 0, 1.0]])
        border = cv2.BORDER_REPLICATE if fill is None else cv2.BORDER_CONSTANT
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        crop = cv2.warpPerspective(
            image, frame_to_level @ crop_to_frame, (width, height), flags=flags, borderMode=border,
            borderValue=fill or (0, 0, 0),
        )  # fmt: skip
        return np.asarray(crop, np.uint8)


def _level_for(crop_to_frame: Array, width: int, height: int) -> int:
    """Pyramid level whose pixels are about as large as the crop's, by the scale in the crop's middle."""
    _, _, w = crop_to_frame @ [(width - 1) / 2, (height - 1) / 2, 1.0]
    # The determinant of a homography's derivative: how much area grows there.
    ratio = float(np.sqrt(abs(np.linalg.det(crop_to_frame) / w**3))) if w else np.inf
    return round(np.log2(ratio)) if 1 < ratio < MAX_REDUCTION else 0
