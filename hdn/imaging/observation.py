"""A frame as trackers look at it: pyramids and keypoints, made once for all targets in it."""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from .arrays import Array, Floats, Image
from .pyramid import Pyramid

Keypoints = tuple[Array, Floats]
"""Points (N, 2), px, and their descriptors (N, 128)."""


@dataclass(frozen=True)
class KeypointSearch:
    """Constants of the search for keypoints."""

    max_side_px: int = 960  # keypoints of larger frames are found at half size, a quarter ...
    margin_px: int = 16  # around the box that keypoints are looked for in: descriptors see what lies beside them
    min_side_px: int = 16  # of that box in the frame: less of it has none
    max_in_frame: int = 3000  # of the strongest, over a whole frame


SEARCH = KeypointSearch()
MAX_CORNER = 30_000  # px: OpenCV draws polygons by small whole numbers


class Observation:
    """An RGB frame (H, W, 3) with its pyramids and keypoints, each made when first asked for."""

    def __init__(self, image: Image) -> None:
        self.image = image
        self.colour = Pyramid(image)

    @cached_property
    def grey(self) -> Pyramid:
        """The pyramid of the grey frame."""
        return Pyramid(np.asarray(cv2.cvtColor(self.image, cv2.COLOR_RGB2GRAY), np.uint8))

    @cached_property
    def keypoints(self) -> Keypoints:
        """The keypoints of the whole frame."""
        return find_keypoints(self.grey, SEARCH.max_in_frame)


def find_keypoints(
    frame: Pyramid, most: int, within: Array | None = None, longest: int = SEARCH.max_side_px
) -> Keypoints:
    """SIFT keypoints (Lowe, 2004) of a grey frame.

    Args:
        frame: grey pyramid.
        most: how many are kept, of the strongest.
        within: a quad (4, 2), px; keypoints outside it are left out.
        longest: px, of the frame or of the quad's bounding box; larger ones are looked at at half size, a quarter ...

    Returns:
        Points (N, 2), px of the frame, and descriptors (N, 128).
    """
    low, high = np.zeros(2), np.array(frame.size) - 1.0
    if within is not None:
        low = np.clip(np.floor(within.min(0)) - SEARCH.margin_px, 0, high)
        high = np.clip(np.ceil(within.max(0)) + SEARCH.margin_px, low, high)
    image, factor = frame.reduced(float((high - low).max()) / longest)
    left, top = np.floor(low / factor).astype(int)
    right, bottom = np.ceil(high / factor).astype(int) + 1
    image, mask = image[top:bottom, left:right], None
    if within is not None:
        mask = np.zeros(image.shape, np.uint8)
        corners = np.round((within + 0.5) / factor - 0.5 - [left, top])
        cv2.fillConvexPoly(mask, np.clip(corners, -MAX_CORNER, MAX_CORNER).astype(np.int32), 255)
    if min(image.shape) < SEARCH.min_side_px:
        return np.empty((0, 2)), np.empty((0, 128), np.float32)
    # SIFT's threshold on contrast is absolute: dark frames are brightened first.
    bright = cv2.normalize(image, None, 0, 255, cv2.NORM_MINMAX)
    keypoints, descriptors = cv2.SIFT_create(nfeatures=most).detectAndCompute(bright, mask)
    points = np.array([k.pt for k in keypoints], np.float64).reshape(-1, 2) + np.array([left, top])
    if descriptors is None:
        descriptors = np.empty((0, 128), np.float32)
    return (points + 0.5) * factor - 0.5, descriptors
