"""Keypoints of a plane: of the target, and of what surrounds it on the same plane, matched to a frame.

They need no expectation of where the target is, and tell it by what little is left of it beside an occluder; with one,
they only have to be alike there.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ..alignment.refinement import Refiner
from ..imaging.arrays import Array, Floats, Image, Mask
from ..imaging.homography import normalised, transform
from ..imaging.observation import SEARCH, Keypoints, Observation, find_keypoints
from ..imaging.photometry import MAD_TO_DEVIATION
from ..imaging.quads import side
from .plane_map import PlaneMap


@dataclass(frozen=True)
class KeypointModel:
    """Constants of the match of keypoints."""

    max_of_target: int = 1500  # the strongest
    max_around: int = 1000
    proved: float = 0.5  # how surely a cell around the target moves with it, for its keypoints to count
    max_box_side_px: int = 480  # of what is looked at about an expected pose: more is looked at reduced
    box_margin: float = 0.25  # of the expected target's size, around it
    max_distance_ratio: float = 0.8  # of the nearest descriptor to the second nearest (Lowe, 2004)
    min_inliers: int = 12  # matches that agree on a homography
    tolerance_px: float = 3.0  # of the frame, that a match may be off from it
    least_error_px: float = 1.5  # standard deviation of a match, at least: some of those that agree do so by chance
    alike: float = 250.0  # distance of descriptors, about 512 long, that nine true matches in ten stay below
    apart_px: float = 10.0  # of the reference frame: a point has several descriptors, which are no others
    weak_prior: float = 1e-4  # px^-2 of the standard crop: information that stands for nothing known
    # Standard deviation that errors which matches share add to the eight parameters of a pose, px at the edge of the
    # standard crop.
    shared_deviation_px: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.5, 0.5)


MODEL = KeypointModel()
SHARED_COVARIANCE = np.diag(np.square(MODEL.shared_deviation_px))


class KeypointPose(NamedTuple):
    """Where matched keypoints have a target.

    Attributes:
        homography: (3, 3) reference frame to this one.
        covariance: (8, 8) of it, as `Alignment` tells it.
        matches: that agree on it.
        distinct: those of them that nothing else in the reference frame looks like; 0 about an expected pose, where it
            is not asked.
    """

    homography: Array
    covariance: Array
    matches: int
    distinct: int


class PlaneKeypoints:
    """SIFT keypoints (Lowe, 2004) of one target's plane, matched with MAGSAC++ (Barath et al., 2020)."""

    def __init__(self, frame: Observation, quad: Array, plane: PlaneMap, usable: Image | None = None) -> None:
        """Args:
        frame: the reference frame.
        quad: (4, 2) the target in it, px.
        plane: the target's map, which tells what around the target lies on its plane.
        usable: (H, W) 255 where the reference frame may be looked at; None takes all of it.
        """
        self._reference = frame.grey
        self._quad, self._plane, self._known = quad, plane, plane.texture.known.copy()
        points, descriptors = _usable(find_keypoints(frame.grey, MODEL.max_of_target, within=quad), usable)
        self._points, self._descriptors = [points], [descriptors]
        self._cells = [np.full(len(points), -1)]  # flat index of a keypoint's cell of the map; -1 in the target
        points, descriptors = _usable(find_keypoints(frame.grey, MODEL.max_around, within=plane.corners), usable)
        outside = np.array([cv2.pointPolygonTest(quad.astype(np.float32), tuple(p), False) < 0 for p in points], bool)
        self._add(points[outside], descriptors[outside])

    def take(self) -> None:
        """Takes the keypoints of what the map has grown by."""
        texture = self._plane.texture
        new = np.where(texture.known & ~self._known, 255, 0).astype(np.uint8)
        self._known = texture.known.copy()
        points, descriptors = _usable(find_keypoints(Observation(texture.picture).grey, MODEL.max_around), new)
        self._add(transform(self._plane.level.to_template, points), descriptors)

    def find(
        self, frame: Observation, refiner: Refiner, near: tuple[Array, float] | None = None
    ) -> KeypointPose | None:
        """The pose that matches to a frame agree on; None where they do not.

        Args:
            refiner: the target's, in whose pixels the covariance is told.
            near: a pose (3, 3), reference frame to this one, and how far, px, a match may be from where that has it;
                None looks at the whole frame.
        """
        counts = np.flatnonzero(self._counting)
        source, own = np.concatenate(self._points)[counts], np.concatenate(self._descriptors)[counts]
        if len(source) < MODEL.min_inliers:
            return None
        points, descriptors = frame.keypoints if near is None else self._about(frame, *near)
        if len(points) < MODEL.min_inliers:
            return None
        pairs = _matches(own, descriptors)
        source, target, counts = source[pairs[:, 0]], points[pairs[:, 1]], counts[pairs[:, 0]]
        if near is not None:
            is_near = np.linalg.norm(transform(near[0], source) - target, axis=1) < near[1]
            source, target, counts = source[is_near], target[is_near], counts[is_near]
        if len(source) < MODEL.min_inliers:
            return None
        homography, inliers = cv2.findHomography(source, target, cv2.USAC_MAGSAC, MODEL.tolerance_px)
        if homography is None or np.count_nonzero(inliers) < MODEL.min_inliers:
            return None
        pose, agree = normalised(np.asarray(homography, np.float64)), np.asarray(inliers, bool)[:, 0]
        covariance = covariance_of_matches(refiner, pose, source[agree], target[agree])
        distinct = self._count_distinct(counts[agree]) if near is None else 0
        return KeypointPose(pose, covariance, int(np.count_nonzero(agree)), distinct)

    def _add(self, points: Array, descriptors: Floats) -> None:
        """Adds keypoints (N, 2) around the target, px of the reference frame."""
        level, n = self._plane.level, self._plane.level.cells
        at = (transform(np.asarray(level.from_template, np.float64), points) + 0.5) * n / [level.width, level.height]
        column, row = np.clip(at.astype(int), 0, n - 1).T
        self._points.append(points)
        self._descriptors.append(descriptors)
        self._cells.append(row * n + column)

    @property
    def _counting(self) -> Mask:
        """Which keypoints (N,) lie on the target's plane, as far as that is known."""
        cells = np.concatenate(self._cells)
        return np.asarray((cells < 0) | (self._plane.coplanar.ravel()[cells] > MODEL.proved))

    def _count_distinct(self, indices: NDArray[np.int_]) -> int:
        """How many of some keypoints are distinct; of those that the map has grown by none is."""
        return int(np.count_nonzero(self._distinct[indices[indices < len(self._distinct)]]))

    @cached_property
    def _distinct(self) -> Mask:
        """Which of the reference frame's keypoints (N,), which are the first, look like nothing else in it."""
        points, own = np.concatenate(self._points[:2]), np.concatenate(self._descriptors[:2])
        others, descriptors = find_keypoints(self._reference, SEARCH.max_in_frame)
        own_index, other_index = np.nonzero(_square_distances(own, descriptors) < MODEL.alike**2)
        is_apart = np.linalg.norm(points[own_index] - others[other_index], axis=1) > MODEL.apart_px
        distinct = np.ones(len(points), bool)
        distinct[own_index[is_apart]] = False
        return distinct

    def _about(self, frame: Observation, expected: Array, reach: float) -> Keypoints:
        """The keypoints of a frame about an expected pose (3, 3), and so many px beyond."""
        corners = transform(expected, self._quad)
        margin = MODEL.box_margin * side(corners) + reach
        (left, top), (right, bottom) = corners.min(0) - margin, corners.max(0) + margin
        box = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
        return find_keypoints(frame.grey, MODEL.max_of_target, within=box, longest=MODEL.max_box_side_px)


def _usable(keypoints: Keypoints, usable: Image | None) -> Keypoints:
    """The keypoints where a frame may be looked at, (H, W) 255."""
    if usable is None:
        return keypoints
    points, descriptors = keypoints
    x, y = np.clip(np.round(points), 0, np.array(usable.shape[::-1]) - 1).astype(int).T
    return points[usable[y, x] > 0], descriptors[usable[y, x] > 0]


def _matches(own: Floats, other: Floats) -> NDArray[np.int_]:
    """Pairs (M, 2) of indices of descriptors (N, 128) and (K, 128): the nearest ones, where clearly nearer than all."""
    square = _square_distances(own, other)
    first, second = np.sqrt(np.maximum(np.partition(square, 1, axis=1)[:, :2], 0)).T
    good = first < MODEL.max_distance_ratio * second
    return np.stack([np.flatnonzero(good), square[good].argmin(1)], 1)


def _square_distances(own: Floats, other: Floats) -> Floats:
    """Between descriptors (N, 128) and (K, 128): (N, K)."""
    return np.asarray(np.square(own).sum(1)[:, None] + np.square(other).sum(1) - 2 * own @ other.T, np.float32)


def covariance_of_matches(refiner: Refiner, homography: Array, source: Array, target: Array) -> Array:
    """Covariance (8, 8) of a pose (3, 3) by its matches (N, 2), px of template and frame, as `Alignment` tells it."""
    error = target - transform(homography, source)
    deviation = max(MODEL.least_error_px, MAD_TO_DEVIATION * float(np.median(np.abs(error))))
    information = refiner.information(homography, source, deviation**2) + MODEL.weak_prior * np.eye(8)
    return np.asarray(np.linalg.inv(information) + SHARED_COVARIANCE)
