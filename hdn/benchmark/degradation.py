"""Ways to make any sequence harder. Every frame is treated, the first, from which a tracker learns, among them."""

from dataclasses import dataclass

import cv2
import numpy as np

from ..imaging.arrays import Array, Image
from ..imaging.homography import from_corners, transform
from ..imaging.quads import square

DEGRADATIONS = {
    "blur": "25 px of horizontal motion blur",
    "dark": "gain 0.28, with noise of sigma 7",
    "small": "shrunk to 28 % and brought back to size",
    "skip": "every 4th frame only",
    "bar": "a grey bar slides over the target and hides up to 70 % of it",
}


@dataclass(frozen=True)
class DegradationSettings:
    """How much harder DEGRADATIONS make a sequence."""

    blur_px: int = 25  # length of the motion blur
    dark_gain: float = 0.28  # of the pixel values
    dark_noise_grey: float = 7.0  # standard deviation of the noise
    shrink: float = 0.28  # ratio of the small frame's sides to the frame's
    skip_frames: int = 4  # every so many-th is kept
    bar_share: float = 0.7  # of the target's width that the bar is wide
    bar_rgb: tuple[int, int, int] = (112, 108, 104)


SETTINGS = DegradationSettings()


def degrade(frame: Image, kind: str, index: int, progress: float, corners: Array) -> Image:
    """A frame made harder.

    Args:
        frame: RGB (H, W, 3); not changed.
        kind: a key of DEGRADATIONS; "skip" leaves the frame as it is, since it concerns which frames there are.
        index: the frame's, the seed of its noise.
        progress: 0 in the first frame, 1 in the last: how far the bar has gone.
        corners: (4, 2) the target's, px, or the last known.
    """
    height, width = frame.shape[:2]
    if kind == "blur":
        return np.asarray(cv2.blur(frame, (SETTINGS.blur_px, 1)), np.uint8)
    if kind == "dark":
        noise = np.random.default_rng(index).normal(0, SETTINGS.dark_noise_grey, frame.shape)
        return np.clip(frame * SETTINGS.dark_gain + noise, 0, 255).astype(np.uint8)
    if kind == "small":
        small = cv2.resize(frame, None, fx=SETTINGS.shrink, fy=SETTINGS.shrink, interpolation=cv2.INTER_AREA)
        return np.asarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_CUBIC), np.uint8)
    if kind == "bar":
        return _behind_bar(frame, progress, corners)
    return frame


def _behind_bar(frame: Image, progress: float, corners: Array) -> Image:
    """The bar enters at the target's left and leaves at its right, a little higher than the target."""
    right = progress * (1 + SETTINGS.bar_share)
    left, right = max(right - SETTINGS.bar_share, 0.0), min(right, 1.0)
    bar = np.array([[left, -0.1], [right, -0.1], [right, 1.1], [left, 1.1]])
    outline = transform(from_corners(square(1) + 0.5, corners), bar)
    drawn = frame.copy()
    cv2.fillConvexPoly(drawn, np.round(outline * 16).astype(np.int32), SETTINGS.bar_rgb, cv2.LINE_AA, shift=4)
    return drawn
