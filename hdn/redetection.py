"""Finding a lost target anywhere in the frame, by keypoints."""

import cv2
import numpy as np

from .homography import Array, normalised
from .sampling import Pyramid

LONGEST = 960  # px: larger frames are searched at half size, and again
MIN_INLIERS = 12


class Redetector:
    """SIFT keypoints of the target (Lowe, 2004), matched to a whole frame with MAGSAC++ (Barath et al., 2020)."""

    def __init__(self, frame: Pyramid, quad: Array) -> None:
        """Args: frame: grey pyramid of the reference frame; quad: (4, 2) the target in it, px."""
        self.sift = cv2.SIFT_create(nfeatures=1500)
        image, factor = _working_size(frame)
        mask = np.zeros(image.shape, np.uint8)
        cv2.fillConvexPoly(mask, np.round(quad / factor).astype(np.int32), 255)
        self.keypoints, self.descriptors = self._detect(image, factor, mask)

    def _detect(self, image: np.ndarray, factor: float, mask: np.ndarray | None = None) -> tuple[Array, np.ndarray]:
        keypoints, descriptors = self.sift.detectAndCompute(image, mask)
        points = np.array([k.pt for k in keypoints], np.float64).reshape(-1, 2)
        return (points + 0.5) * factor - 0.5, descriptors

    def find(self, frame: Pyramid) -> Array | None:
        """The homography (3, 3), reference frame to this one, that the matches agree on; None where they do not."""
        if len(self.keypoints) < MIN_INLIERS:
            return None
        image, factor = _working_size(frame)
        points, descriptors = self._detect(image, factor)
        if len(points) < MIN_INLIERS:
            return None
        pairs = cv2.BFMatcher().knnMatch(self.descriptors, descriptors, k=2)
        good = [p[0] for p in pairs if len(p) == 2 and p[0].distance < 0.8 * p[1].distance]
        if len(good) < MIN_INLIERS:
            return None
        source = self.keypoints[[m.queryIdx for m in good]]
        target = points[[m.trainIdx for m in good]]
        homography, inliers = cv2.findHomography(source, target, cv2.USAC_MAGSAC, 3.0 * factor)
        if homography is None or int(inliers.sum()) < MIN_INLIERS:
            return None
        return normalised(homography)


def _working_size(frame: Pyramid) -> tuple[np.ndarray, float]:
    """The largest level of the pyramid that is at most LONGEST px, and its reduction."""
    level = 0
    while max(frame.size) / 2**level > LONGEST:
        level += 1
    return frame.level(level)
