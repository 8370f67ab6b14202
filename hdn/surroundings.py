"""The motion of what surrounds a target, for carrying its pose on while it is hidden."""

import cv2
import numpy as np

from .imaging.arrays import Array
from .imaging.homography import normalised, transform
from .imaging.pyramid import Pyramid
from .imaging.quads import is_convex

LONGEST = 640  # px of the frame that points are followed in
POINTS, MIN_INLIERS, MIN_SHARE = 300, 20, 0.4  # points followed; those that must agree, and their share
BACKWARD = 1.0  # px of that frame, that a point followed forth and back may be off
TOLERANCE = 1.5
NEAR, FAR = 1.08, 3.5  # the ring around the target, as multiples of its quad about its centre


def surrounding_motion(before: Pyramid, after: Pyramid, corners: Array) -> Array | None:
    """The affine motion (3, 3), pixels of one grey frame to those of the next, that the target's surroundings follow.

    Pyramidal Lucas-Kanade (Bouguet, 2001) of points in a ring around the target, checked backward, and MAGSAC++.

    Args:
        corners: (4, 2) the target in the frame before, px.

    Returns:
        None where too few points agree: nothing is seen there, or it does not move as one.
    """
    (source, factor), (target, _) = before.at_most(LONGEST), after.at_most(LONGEST)
    points = cv2.goodFeaturesToTrack(
        source, POINTS, 0.01, 5, mask=_ring(source.shape[:2], (corners + 0.5) / factor - 0.5)
    )
    if points is None or len(points) < MIN_INLIERS:
        return None
    window = {"winSize": (15, 15), "maxLevel": 4}
    there, found, _ = cv2.calcOpticalFlowPyrLK(source, target, points, None, **window)
    back, returned, _ = cv2.calcOpticalFlowPyrLK(target, source, there, None, **window)
    good = (np.linalg.norm(back - points, axis=-1).ravel() < BACKWARD) & (found.ravel() == 1) & (returned.ravel() == 1)
    if good.sum() < MIN_INLIERS:
        return None
    # From one frame to the next perspective hardly changes; a homography would make much of little noise.
    affine, inliers = cv2.estimateAffine2D(
        points[good], there[good], method=cv2.USAC_MAGSAC, ransacReprojThreshold=TOLERANCE
    )
    if affine is None or inliers.sum() < max(MIN_INLIERS, MIN_SHARE * good.sum()):
        return None
    to_level = np.array([[1 / factor, 0, 0.5 / factor - 0.5], [0, 1 / factor, 0.5 / factor - 0.5], [0, 0, 1.0]])
    motion = normalised(np.linalg.inv(to_level) @ np.vstack([affine, [0.0, 0, 1]]) @ to_level)
    return motion if is_convex(transform(motion, corners)) else None


def _ring(shape: tuple[int, int], corners: Array) -> np.ndarray:
    """Mask of what lies around a quad, but not on it or on its edge."""
    mask = np.zeros(shape, np.uint8)
    centre = corners.mean(0)
    for scale, value in ((FAR, 255), (NEAR, 0)):
        outline = np.clip(np.round(centre + (corners - centre) * scale), -(2**14), 2**14)
        cv2.fillConvexPoly(mask, outline.astype(np.int32), value)
    return mask
