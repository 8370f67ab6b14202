"""Ways to make any sequence harder.

Every frame is treated, the first, from which a tracker learns, among them; but for `bar2` and `blur2`, which leave the
first as it is: a user chooses a reference frame in which the surface is seen. `start` is the opposite: the reference
frame is among the worst there are.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from ..imaging.arrays import Array, Image
from ..imaging.homography import from_corners, transform
from ..imaging.quads import square

DEGRADATIONS = {
    "blur": "25 px of horizontal motion blur",
    "start": "25 px of horizontal motion blur in the first quarter of the frames",
    "blur2": "motion blur along the target's own motion, up to 60 px",
    "dark": "gain 0.28, with noise of sigma 7",
    "small": "shrunk to 28 % and brought back to size",
    "skip": "every 4th frame only",
    "bar": "a grey bar slides over the target and hides up to 70 % of it",
    "bar2": "a chequered bar, two thirds as wide as the target and longer than it, slides across and back",
}


@dataclass(frozen=True)
class DegradationSettings:
    """How much harder DEGRADATIONS make a sequence."""

    blur_px: int = 25  # length of the motion blur
    start_share: float = 0.25  # of the frames that are blurred by `start`, the first ones
    blur2_frames: float = 10.0  # of the target's motion, by which it is blurred: hand-held clips then reach 15 to 60 px
    blur2_swing: float = 0.5  # share by which that varies
    blur2_period_frames: int = 40  # of the variation
    blur2_least_px: float = 8.0  # beside the motion's, for a target at rest, in a direction that turns
    blur2_most_px: float = 60.0
    blur2_turn_frames: int = 90  # of half a turn of that direction
    dark_gain: float = 0.28  # of the pixel values
    dark_noise_grey: float = 7.0  # standard deviation of the noise
    shrink: float = 0.28  # ratio of the small frame's sides to the frame's
    skip_frames: int = 4  # every so many-th is kept
    bar_share: float = 0.7  # of the target's width that the bar is wide
    bar_rgb: tuple[int, int, int] = (112, 108, 104)
    bar2_share: float = 2 / 3  # of the target's width that the bar is wide
    bar2_reach: float = 0.5  # of the target's height, by which the bar is longer at each end
    bar2_fields: int = 6  # across the bar

    # Of its bright and its dark fields, in two looks each so that the pattern does not repeat itself.
    bar2_rgb: tuple[tuple[tuple[int, int, int], ...], ...] = (
        ((250, 245, 235), (240, 200, 40)),
        ((16, 16, 20), (190, 30, 36)),
    )


SETTINGS = DegradationSettings()
BAR2_FIELD_TEXELS = 32  # side of a field in the picture of the bar


def degrade(frame: Image, kind: str, index: int, corners: Array) -> Image:
    """A frame made harder.

    Args:
        frame: RGB (H, W, 3); not changed.
        kind: a key of DEGRADATIONS; "skip" leaves the frame as it is, since it concerns which frames there are.
        index: the frame's in its clip; the seed of its noise.
        corners: (N, 4, 2) the target's in all of the clip's frames, px; they tell how it moves, and how far the bars
            have gone.
    """
    height, width = frame.shape[:2]
    progress = index / max(len(corners) - 1, 1)
    if kind == "blur" or (kind == "start" and index < SETTINGS.start_share * len(corners)):
        return np.asarray(cv2.blur(frame, (SETTINGS.blur_px, 1)), np.uint8)
    if kind == "blur2" and index > 0:
        return np.asarray(cv2.filter2D(frame, -1, line_kernel(blur_along_motion(index, corners))), np.uint8)
    if kind == "dark":
        noise = np.random.default_rng(index).normal(0, SETTINGS.dark_noise_grey, frame.shape)
        return np.clip(frame * SETTINGS.dark_gain + noise, 0, 255).astype(np.uint8)
    if kind == "small":
        small = cv2.resize(frame, None, fx=SETTINGS.shrink, fy=SETTINGS.shrink, interpolation=cv2.INTER_AREA)
        return np.asarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_CUBIC), np.uint8)
    if kind == "bar":
        return _behind_bar(frame, progress, corners[index])
    if kind == "bar2" and index > 0:
        return _behind_chequered_bar(frame, progress, corners[index])
    return frame


def blur_along_motion(index: int, corners: Array) -> Array:
    """The line (2,), px, along which `blur2` blurs a frame: the way of the target's middle during a long exposure.

    Args:
        corners: (N, 4, 2) the target's in all of the clip's frames, px.
    """
    near = corners[max(index - 1, 0) : index + 2].mean(1)
    motion = (near[-1] - near[0]) / max(len(near) - 1, 1)  # px a frame
    swing = SETTINGS.blur2_swing * np.sin(2 * np.pi * index / SETTINGS.blur2_period_frames)
    turn = np.pi * index / SETTINGS.blur2_turn_frames
    least = SETTINGS.blur2_least_px * np.array([np.cos(turn), np.sin(turn)])
    line = SETTINGS.blur2_frames * (1 + swing) * motion + np.copysign(1, motion @ least) * least
    return np.asarray(line * min(1.0, SETTINGS.blur2_most_px / np.linalg.norm(line)))


def line_kernel(line: Array) -> Array:
    """The kernel (2 r + 1, 2 r + 1) of motion blur along a straight line (2,), px; it sums up to 1."""
    reach = int(np.ceil(np.abs(line).max() / 2)) + 1
    steps = 8 * reach
    along = (np.arange(steps) + 0.5) / steps - 0.5
    points = along[:, None] * line + reach  # (steps, 2), each shared by the four pixels around it
    low = np.floor(points).astype(int)
    part = points - low
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1))
    for dx in (0, 1):
        for dy in (0, 1):
            weight = np.abs(1 - dx - part[:, 0]) * np.abs(1 - dy - part[:, 1])
            np.add.at(kernel, (low[:, 1] + dy, low[:, 0] + dx), weight)
    return kernel / steps


def _behind_bar(frame: Image, progress: float, corners: Array) -> Image:
    """The bar enters at the target's left and leaves at its right, a little higher than the target."""
    right = progress * (1 + SETTINGS.bar_share)
    left, right = max(right - SETTINGS.bar_share, 0.0), min(right, 1.0)
    bar = np.array([[left, -0.1], [right, -0.1], [right, 1.1], [left, 1.1]])
    outline = transform(from_corners(square(1) + 0.5, corners), bar)
    drawn = frame.copy()
    cv2.fillConvexPoly(drawn, np.round(outline * 16).astype(np.int32), SETTINGS.bar_rgb, cv2.LINE_AA, shift=4)
    return drawn


def _behind_chequered_bar(frame: Image, progress: float, corners: Array) -> Image:
    """The bar's middle goes evenly from the target's left edge to its right one and back.

    It is a parallelogram on the frame, along the target's mean sides: on the target's plane it could reach the horizon.
    """
    top_left, top_right, bottom_right, bottom_left = corners
    across = (top_right - top_left + bottom_right - bottom_left) / 2
    down = (bottom_left - top_left + bottom_right - top_right) / 2
    middle = corners.mean(0) + (0.5 - abs(2 * progress - 1)) * across
    size = SETTINGS.bar2_share * across, (1 + 2 * SETTINGS.bar2_reach) * down
    columns = SETTINGS.bar2_fields
    rows = max(1, round(columns * float(np.linalg.norm(size[1]) / np.linalg.norm(size[0]))))
    look = np.random.default_rng(0).integers(0, 2, (rows, columns))
    dark = np.indices((rows, columns)).sum(0) % 2
    pattern = np.array(SETTINGS.bar2_rgb, np.uint8)[dark, look]  # (rows, columns, 3)
    pattern = pattern.repeat(BAR2_FIELD_TEXELS, 0).repeat(BAR2_FIELD_TEXELS, 1)
    right, bottom = size[0] / pattern.shape[1], size[1] / pattern.shape[0]  # px of the frame, of a texel
    origin = middle - (size[0] + size[1]) / 2 + (right + bottom) / 2
    to_frame, drawn = np.stack([right, bottom, origin], 1), frame.copy()
    shape = frame.shape[1], frame.shape[0]
    cv2.warpAffine(pattern, to_frame, shape, drawn, cv2.INTER_LINEAR, cv2.BORDER_TRANSPARENT)
    return drawn
