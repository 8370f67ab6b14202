"""Finding a lost target anywhere in the frame, by keypoints."""

from dataclasses import dataclass

import cv2
import numpy as np

from .imaging.arrays import Array, Image
from .imaging.homography import normalised
from .imaging.observation import Observation, find_keypoints


@dataclass(frozen=True)
class RedetectionModel:
    """Constants of the search by keypoints."""

    max_keypoints: int = 1500  # of the target, the strongest
    max_distance_ratio: float = 0.8  # of the nearest descriptor to the second nearest (Lowe, 2004)
    min_inliers: int = 12  # matches that agree on a homography
    tolerance_px: float = 3.0  # of the frame, that a match may be off from it


MODEL = RedetectionModel()


class Redetector:
    """Keypoints of the target matched to a whole frame, with MAGSAC++ (Barath et al., 2020)."""

    def __init__(self, frame: Observation, quad: Array, usable: Image | None = None) -> None:
        """Args:
        frame: the reference frame.
        quad: (4, 2) the target in it, px.
        usable: (H, W) 255 where the reference frame may be looked at; None takes all of it.
        """
        points, descriptors = find_keypoints(frame.grey, MODEL.max_keypoints, within=quad)
        if usable is not None:
            x, y = np.clip(np.round(points), 0, np.array(frame.colour.size) - 1).astype(int).T
            points, descriptors = points[usable[y, x] > 0], descriptors[usable[y, x] > 0]
        self.points, self.descriptors = points, descriptors

    def find(self, frame: Observation) -> Array | None:
        """The homography (3, 3), reference frame to this one, that the matches agree on; None where they do not."""
        if len(self.points) < MODEL.min_inliers:
            return None
        points, descriptors = frame.keypoints
        if len(points) < MODEL.min_inliers:
            return None
        pairs = cv2.BFMatcher().knnMatch(self.descriptors, descriptors, k=2)
        good = [p[0] for p in pairs if len(p) == 2 and p[0].distance < MODEL.max_distance_ratio * p[1].distance]
        if len(good) < MODEL.min_inliers:
            return None
        source = self.points[[m.queryIdx for m in good]]
        target = points[[m.trainIdx for m in good]]
        homography, inliers = cv2.findHomography(source, target, cv2.USAC_MAGSAC, MODEL.tolerance_px)
        if homography is None or int(inliers.sum()) < MODEL.min_inliers:
            return None
        return normalised(homography)
