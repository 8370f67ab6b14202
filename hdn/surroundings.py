"""The motion of what surrounds a target, by which its pose is carried on while it is hidden."""

from dataclasses import dataclass

import cv2
import numpy as np

from .imaging.arrays import Array, Image
from .imaging.homography import normalised, transform
from .imaging.pyramid import Pyramid
from .imaging.quads import is_convex


@dataclass(frozen=True)
class SurroundingsModel:
    """Constants of the surroundings' motion; lengths are px of the level of the frame that points are followed in."""

    max_side_px: int = 640  # of that level
    ring_inner: float = 1.08  # inner edge of the ring around the target, as a multiple of its quad about its centre
    ring_outer: float = 3.5  # its outer edge
    max_points: int = 300  # corners that are followed
    min_quality: float = 0.01  # of a corner, relative to the best one
    min_distance_px: float = 5  # between corners
    flow_window_px: int = 15  # side of the window that is followed
    flow_levels: int = 4  # of the pyramid, beside the image itself
    max_backward_px: float = 1.0  # that a point followed forth and back may be off
    tolerance_px: float = 1.5  # that a point may be off from the motion
    min_inliers: int = 20  # points that must agree
    min_inlier_share: float = 0.4  # of the points that were followed


MODEL = SurroundingsModel()
MAX_COORDINATE = 2**14  # px: OpenCV's polygons take no larger ones


def surrounding_motion(before: Pyramid, after: Pyramid, corners: Array) -> Array | None:
    """The affine motion (3, 3), pixels of one grey frame to those of the next, that the target's surroundings follow.

    Pyramidal Lucas-Kanade (Bouguet, 2001) of points in a ring around the target, checked backward, and MAGSAC++.

    Args:
        before, after: grey pyramids of the two frames.
        corners: (4, 2) the target in the frame before, px.

    Returns:
        None where too few points agree: nothing is seen there, or it does not move as one.
    """
    (source, factor), (target, _) = before.at_most(MODEL.max_side_px), after.at_most(MODEL.max_side_px)
    ring = _ring(source.shape[:2], (corners + 0.5) / factor - 0.5)
    points = cv2.goodFeaturesToTrack(source, MODEL.max_points, MODEL.min_quality, MODEL.min_distance_px, mask=ring)
    if points is None or len(points) < MODEL.min_inliers:
        return None
    flow = {"winSize": (MODEL.flow_window_px, MODEL.flow_window_px), "maxLevel": MODEL.flow_levels}
    there, found, _ = cv2.calcOpticalFlowPyrLK(source, target, points, None, **flow)
    back, returned, _ = cv2.calcOpticalFlowPyrLK(target, source, there, None, **flow)
    is_back = np.linalg.norm(back - points, axis=-1).ravel() < MODEL.max_backward_px
    good = is_back & (found.ravel() == 1) & (returned.ravel() == 1)
    if good.sum() < MODEL.min_inliers:
        return None
    # From one frame to the next perspective hardly changes; a homography would make much of little noise.
    affine, inliers = cv2.estimateAffine2D(
        points[good], there[good], method=cv2.USAC_MAGSAC, ransacReprojThreshold=MODEL.tolerance_px
    )
    if affine is None or inliers.sum() < max(MODEL.min_inliers, MODEL.min_inlier_share * good.sum()):
        return None
    to_level = np.array([[1 / factor, 0, 0.5 / factor - 0.5], [0, 1 / factor, 0.5 / factor - 0.5], [0, 0, 1.0]])
    motion = normalised(np.linalg.inv(to_level) @ np.vstack([affine, [0.0, 0, 1]]) @ to_level)
    return motion if is_convex(transform(motion, corners)) else None


def _ring(shape: tuple[int, int], corners: Array) -> Image:
    """Mask (h, w), 255 in a ring around a quad (4, 2), 0 elsewhere, on the quad's own edge too."""
    mask = np.zeros(shape, np.uint8)
    centre = corners.mean(0)
    for scale, value in ((MODEL.ring_outer, 255), (MODEL.ring_inner, 0)):
        outline = np.clip(np.round(centre + (corners - centre) * scale), -MAX_COORDINATE, MAX_COORDINATE)
        cv2.fillConvexPoly(mask, outline.astype(np.int32), value)
    return mask
