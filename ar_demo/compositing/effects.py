"""Effects that need no ad: the surface itself, pixelated, blurred or outlined."""

from dataclasses import dataclass

import cv2
import numpy as np

from hdn.imaging.arrays import Array
from hdn.imaging.homography import from_corners
from hdn.imaging.quads import outline

from ..choices import Effect
from .layer import Frame, Layer, as_box


@dataclass(frozen=True)
class EffectModel:
    """How the effects look."""

    cell: float = 14.0  # px of the frame, about: side of the mosaic's cells
    longest: int = 256  # px of the rectified surface's longer side, at most
    blur: float = 1 / 14  # standard deviation of the blur, as a share of the surface's longer side
    colour: tuple[int, int, int] = (0, 230, 118)  # of the outline, RGB
    width: int = 2  # px of the frame: of the outline


MODEL = EffectModel()


def texture(effect: Effect, frame: Frame, quad: Array) -> Frame:
    """What to lay on the surface in place of an ad: RGB (h, w, 3), made from the frame (H, W, 3) inside the quad."""
    sides = np.linalg.norm(np.roll(quad, -1, 0) - quad, axis=1)
    width, height = max(sides[0], sides[2]), max(sides[1], sides[3])
    scale = min(1.0, MODEL.longest / max(width, height))
    size = max(2, round(width * scale)), max(2, round(height * scale))
    crop = rectify(frame, quad, *size)
    if effect == "blur":
        return np.asarray(cv2.GaussianBlur(crop, (0, 0), max(size) * MODEL.blur))
    cells = max(2, round(width / MODEL.cell)), max(2, round(height / MODEL.cell))
    coarse = cv2.resize(crop, cells, interpolation=cv2.INTER_AREA)
    # Blown up so that the compositor's filtering leaves the cells square.
    return np.asarray(cv2.resize(coarse, None, fx=8, fy=8, interpolation=cv2.INTER_NEAREST))


def rectify(frame: Frame, quad: Array, width: int, height: int) -> Frame:
    """The surface seen from the front, (height, width, 3)."""
    crop_to_frame = from_corners(outline(width, height), quad)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(
        cv2.warpPerspective(frame, crop_to_frame, (width, height), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    )


def outlined(quad: Array, frame_size: tuple[int, int]) -> Layer | None:
    """The quad's outline, anti-aliased, in a frame (width, height); None where nothing of it is seen."""
    margin = MODEL.width + 2
    low = np.clip(np.floor(quad.min(0)) - margin, 0, frame_size).astype(int)
    high = np.clip(np.ceil(quad.max(0)) + margin + 1, 0, frame_size).astype(int)
    if (high <= low).any():
        return None
    alpha = np.zeros((high - low)[::-1], np.uint8)
    points = np.round((quad - low) * 16).astype(np.int32)
    cv2.polylines(alpha, [points], True, 255, MODEL.width, cv2.LINE_AA, shift=4)
    colour = alpha[..., None] * (np.array(MODEL.colour, np.float32) / 255)
    return Layer(as_box(*low.tolist(), *high.tolist()), np.dstack((np.rint(colour).astype(np.uint8), alpha)))
