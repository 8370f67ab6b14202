"""Keypoints of a frame matched to those of pictures: where in the frame these may be."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from hdn.imaging.arrays import Array, Floats
from hdn.imaging.homography import normalised, transform
from hdn.imaging.observation import Observation, find_keypoints
from hdn.imaging.quads import area, is_convex

from .pictures import Picture, unit_descriptors


@dataclass(frozen=True)
class MatchModel:
    """Constants of the match of a frame with pictures."""

    most_keypoints: int = 2000  # of a frame, the strongest
    # Of many pictures, approximate neighbours tell those that may be in a frame (k-d trees; Muja and Lowe, 2009).
    most_likely: int = 6  # that are matched exactly
    voters: int = 1000  # keypoints of a frame that are asked for it, at most, evenly taken
    trees: int = 4
    checks: int = 16  # leaves that are looked at for a keypoint
    neighbours: int = (
        8  # of a keypoint; it votes for the picture of the nearest, if that is clearly nearer than the last
    )
    min_votes: int = 4
    min_likeness: float = 0.8  # product of two descriptors, for a match
    max_distance_ratio: float = 0.85  # of the nearest descriptor to the nearest one elsewhere in the same picture
    tolerance: float = 0.004  # of the frame's longer side, that a match may be off from a homography
    min_matches: int = 5  # that agree on one
    iterations: int = 5000  # of MAGSAC
    certainty: float = 0.999
    most_places: int = 12  # of a picture in a frame
    min_side_px: float = 16.0  # of the place's sides


MODEL = MatchModel()
KD_TREES = 1  # FLANN's number for them


class Place(NamedTuple):
    """Where a picture may be in a frame.

    Attributes:
        picture: its number.
        homography: (3, 3) the picture's pixels to the frame's.
        source, target: (N, 2) keypoints that agree on it, px of the picture and of the frame.
    """

    picture: int
    homography: Array
    source: Array
    target: Array


class Matcher:
    """Matches frames with pictures."""

    def __init__(self, pictures: Sequence[Picture]) -> None:
        self._pictures = pictures
        self._index = None
        if len(pictures) > MODEL.most_likely:
            self._owners = np.repeat(np.arange(len(pictures)), [len(picture.points) for picture in pictures])
            self._all = np.concatenate([picture.descriptors for picture in pictures])
            self._index = cv2.flann.Index(self._all, {"algorithm": KD_TREES, "trees": MODEL.trees})

    def places(self, frame: Observation, longest: int) -> Iterator[Place]:
        """Where pictures may be in a frame, whose keypoints are looked for with at most so many px on its longer side.

        Every keypoint of the frame is matched on its own, so that a picture may be there several times.
        """
        points, descriptors = find_keypoints(frame.grey, MODEL.most_keypoints, longest=longest)
        descriptors = unit_descriptors(descriptors)
        for number in self._likely(descriptors):
            picture = self._pictures[number]
            own, theirs = _matches(descriptors, picture)
            yield from self._agreed(number, picture.points[theirs], points[own], max(frame.colour.size))

    def _likely(self, descriptors: Floats) -> list[int]:
        """The numbers of the pictures that keypoints of a frame, with descriptors (K, 128), may be of."""
        if self._index is None or not len(descriptors):
            return [*range(len(self._pictures))]
        voters = descriptors[:: -(-len(descriptors) // MODEL.voters)].copy()  # in one piece, as FLANN wants them
        found, squared = self._index.knnSearch(voters, MODEL.neighbours, params={"checks": MODEL.checks})
        clear = squared[:, 0] < MODEL.max_distance_ratio**2 * squared[:, -1]
        votes = np.bincount(self._owners[found[clear, 0]], minlength=len(self._pictures))
        likely = np.argsort(-votes, kind="stable")[: MODEL.most_likely]
        return sorted(int(number) for number in likely if votes[number] >= MODEL.min_votes)

    def _agreed(self, number: int, source: Array, target: Array, frame_side: int) -> Iterator[Place]:
        """Places on which matches (M, 2) of a picture's pixels and the frame's agree."""
        picture = self._pictures[number]
        for _ in range(MODEL.most_places):
            if len(source) < MODEL.min_matches:
                return
            found, inliers = cv2.findHomography(
                source, target, cv2.USAC_MAGSAC, MODEL.tolerance * frame_side, None, MODEL.iterations, MODEL.certainty
            )
            agree = np.zeros(len(source), bool) if inliers is None else np.asarray(inliers, bool)[:, 0]
            # Neighbouring keypoints, and those of one place at several sizes, are one witness.
            if found is None or _places(source[agree]) < MODEL.min_matches:
                return
            homography = normalised(np.asarray(found, np.float64))
            if _is_plausible(homography, picture.quad):
                yield Place(number, homography, source[agree], target[agree])
                quad = transform(homography, picture.quad).astype(np.float32)
                agree |= np.array([cv2.pointPolygonTest(quad, tuple(map(float, at)), False) >= 0 for at in target])
            source, target = source[~agree], target[~agree]


def _matches(descriptors: Floats, picture: Picture) -> tuple[Array, Array]:
    """Indices of keypoints of a frame, with descriptors (K, 128), and of those of a picture that they match."""
    if not len(descriptors):
        return np.empty(0, int), np.empty(0, int)
    likeness = descriptors @ picture.descriptors.T
    best = likeness.max(1)
    alike = np.flatnonzero(best > MODEL.min_likeness)
    likeness, best = likeness[alike], best[alike]
    nearest = likeness.argmax(1)
    likeness[picture.same_place[nearest]] = -1
    elsewhere = likeness.max(1)
    good = np.sqrt(np.maximum(1 - best, 0)) < MODEL.max_distance_ratio * np.sqrt(np.maximum(1 - elsewhere, 1e-9))
    return alike[good], nearest[good]


def _places(points: Array) -> int:
    """How many of some points (N, 2) are at another place, to the px."""
    return len(np.unique(np.round(points), axis=0))


def _is_plausible(homography: Array, quad: Array) -> bool:
    """Whether a picture can be seen so: convex, not mirrored, not tiny."""
    corners = transform(homography, quad)
    depth = quad @ homography[2, :2] + homography[2, 2]
    if not np.isfinite(corners).all() or (depth <= 0).any() or not is_convex(corners) or area(corners) <= 0:
        return False
    sides = np.linalg.norm(np.roll(corners, -1, 0) - corners, axis=1)
    return bool(sides.min() >= MODEL.min_side_px)
