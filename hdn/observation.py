"""A frame as trackers look at it; what several targets need of it is made once."""

from functools import cached_property

import cv2
import numpy as np

from .homography import Array
from .sampling import Image, Pyramid

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
    def keypoints(self) -> tuple[Array, np.ndarray]:
        """SIFT (Lowe, 2004): points (N, 2), px of the frame, and descriptors (N, 128)."""
        level = 0
        while max(self.grey.size) / 2**level > LONGEST:
            level += 1
        image, factor = self.grey.level(level)
        keypoints, descriptors = cv2.SIFT_create(nfeatures=2000).detectAndCompute(image, None)
        points = np.array([k.pt for k in keypoints], np.float64).reshape(-1, 2)
        if descriptors is None:
            descriptors = np.empty((0, 128), np.float32)
        return (points + 0.5) * factor - 0.5, descriptors
