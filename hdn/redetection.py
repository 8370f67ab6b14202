"""Finding a lost target anywhere in the frame, by keypoints."""

import cv2

from .imaging.arrays import Array
from .imaging.homography import normalised
from .imaging.observation import Observation, find_keypoints

MIN_INLIERS = 12
TOLERANCE = 3.0  # px


class Redetector:
    """Keypoints of the target matched to a whole frame, with MAGSAC++ (Barath et al., 2020)."""

    def __init__(self, frame: Observation, quad: Array) -> None:
        """Args: frame: the reference frame; quad: (4, 2) the target in it, px."""
        self.points, self.descriptors = find_keypoints(frame.grey, 1500, within=quad)

    def find(self, frame: Observation) -> Array | None:
        """The homography (3, 3), reference frame to this one, that the matches agree on; None where they do not."""
        if len(self.points) < MIN_INLIERS:
            return None
        points, descriptors = frame.keypoints
        if len(points) < MIN_INLIERS:
            return None
        pairs = cv2.BFMatcher().knnMatch(self.descriptors, descriptors, k=2)
        good = [p[0] for p in pairs if len(p) == 2 and p[0].distance < 0.8 * p[1].distance]
        if len(good) < MIN_INLIERS:
            return None
        source = self.points[[m.queryIdx for m in good]]
        target = points[[m.trainIdx for m in good]]
        homography, inliers = cv2.findHomography(source, target, cv2.USAC_MAGSAC, TOLERANCE)
        if homography is None or int(inliers.sum()) < MIN_INLIERS:
            return None
        return normalised(homography)
