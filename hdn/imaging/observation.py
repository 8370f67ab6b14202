"""A frame as trackers look at it; what several targets need of it is made once."""

from functools import cached_property

import cv2
import numpy as np

from .arrays import Array, Image
from .pyramid import Pyramid

Keypoints = tuple[Array, np.ndarray]

LONGEST = 960  # px: keypoints of larger frames are found at half size, and again


class Observation:
    """An RGB frame (H, W, 3) with its pyramids and keypoints, each made when first asked for."""

    def __init__(self, image: Image) -> None:
        self.image = image
        self.colour = Pyramid(image)

    @cached_property
    def grey(self) -> Pyramid:
        return Pyramid(np.asarray(cv2.cvtColor(self.image, cv2.COLOR_RGB2GRAY), np.uint8))

    @cached_property
    def keypoints(self) -> Keypoints:
        """Of the whole frame."""
        return find_keypoints(self.grey, 3000)


def find_keypoints(frame: Pyramid, most: int, within: Array | None = None) -> Keypoints:
    """SIFT keypoints (Lowe, 2004) of a grey frame: points (N, 2), px, and descriptors (N, 128).

    Args: within: a quad (4, 2), px, outside of which nothing counts.
    """
    image, factor = frame.at_most(LONGEST)
    mask = None
    if within is not None:
        mask = np.zeros(image.shape, np.uint8)
        cv2.fillConvexPoly(mask, np.round((within + 0.5) / factor - 0.5).astype(np.int32), 255)
    # SIFT's threshold on contrast is absolute: what is dark is brightened first.
    bright = cv2.normalize(image, None, 0, 255, cv2.NORM_MINMAX)
    keypoints, descriptors = cv2.SIFT_create(nfeatures=most).detectAndCompute(bright, mask)
    points = np.array([k.pt for k in keypoints], np.float64).reshape(-1, 2)
    if descriptors is None:
        descriptors = np.empty((0, 128), np.float32)
    return (points + 0.5) * factor - 0.5, descriptors
