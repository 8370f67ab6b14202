"""Effects that need no ad: the surface itself, pixelated, blurred or outlined."""

import cv2
import numpy as np
from numpy.typing import NDArray

from hdn.imaging.arrays import Array
from hdn.imaging.homography import from_corners
from hdn.imaging.quads import square

from ..choices import Effect

Image = NDArray[np.uint8]

MOSAIC_CELL = 14  # px of the frame, about
LONGEST = 256  # px of the rectified surface
OUTLINE = (0, 230, 118)


def texture(effect: Effect, frame: Image, quad: Array) -> Image:
    """What to lay on the surface in place of an ad: RGB (h, w, 3), made from the frame (H, W, 3) inside the quad."""
    sides = np.linalg.norm(np.roll(quad, -1, 0) - quad, axis=1)
    width, height = max(sides[0], sides[2]), max(sides[1], sides[3])
    scale = min(1.0, LONGEST / max(width, height))
    size = max(2, round(width * scale)), max(2, round(height * scale))
    crop = rectify(frame, quad, *size)
    if effect == "blur":
        return np.asarray(cv2.GaussianBlur(crop, (0, 0), max(size) / 14), np.uint8)
    cells = max(2, round(width / MOSAIC_CELL)), max(2, round(height / MOSAIC_CELL))
    coarse = cv2.resize(crop, cells, interpolation=cv2.INTER_AREA)
    # Blown up so that the compositor's filtering leaves the cells square.
    return np.asarray(cv2.resize(coarse, None, fx=8, fy=8, interpolation=cv2.INTER_NEAREST), np.uint8)


def rectify(frame: Image, quad: Array, width: int, height: int) -> Image:
    """The surface seen from the front, (height, width, 3)."""
    outline = square(1.0) * [width, height] + [(width - 1) / 2, (height - 1) / 2]
    crop_to_frame = from_corners(outline, quad)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(
        cv2.warpPerspective(frame, crop_to_frame, (width, height), flags=flags, borderMode=cv2.BORDER_REPLICATE),
        np.uint8,
    )


def draw_outline(frame: Image, quad: Array, opacity: float) -> None:
    """Draws the quad's outline onto the frame (H, W, 3), in place, anti-aliased."""
    h, w = frame.shape[:2]
    low = np.clip(np.floor(quad.min(0)) - 4, 0, [w, h]).astype(int)
    high = np.clip(np.ceil(quad.max(0)) + 5, 0, [w, h]).astype(int)
    if (high <= low).any():
        return
    box = frame[low[1] : high[1], low[0] : high[0]]
    drawn = np.ascontiguousarray(box)
    points = np.round((quad - low) * 16).astype(np.int32)
    cv2.polylines(drawn, [points], True, OUTLINE, 2, cv2.LINE_AA, shift=4)
    cv2.addWeighted(drawn, opacity, box, 1 - opacity, 0, dst=drawn)
    box[:] = drawn
