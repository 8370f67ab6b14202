"""What was seen of a picture, and where: in one frame, and over a stretch of them."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import cv2
import numpy as np

from hdn.imaging.arrays import Array
from hdn.imaging.quads import LIMITS, area, side


@dataclass(frozen=True)
class ChoiceModel:
    """Which sighting is tracked from."""

    max_inexact: float = 3.0  # its exactness to the best one's: others may be wrong altogether
    min_sharp: float = 0.9  # its sharpness to the sharpest of those


MODEL = ChoiceModel()


@dataclass(frozen=True, eq=False)
class Sighting:
    """A picture in one frame.

    Attributes:
        picture: its number among those that were looked for.
        index, time: of the frame; seconds from the video's first one.
        corners: (4, 2) of the whole picture, px, in its reading order; they may lie outside the frame.
        score: 0..1, the share of what the frame shows of it that agrees with the picture.
        deviation: standard deviation of the corners, px.
        matches: keypoints that agree.
        is_whole: whether it lies wholly inside the frame.
        sharpness: of what is seen of it, see `checking.Checked`.
    """

    picture: int
    index: int
    time: Fraction
    corners: Array
    score: float
    deviation: float
    matches: int
    is_whole: bool
    sharpness: float

    @property
    def surety(self) -> tuple[float, int]:
        """What tells the surer one of two sightings at one place."""
        return round(self.score, 1), self.matches

    @property
    def exactness(self) -> float:
        """Deviation as a share of its size: the less, the better it is to track it from there."""
        return self.deviation / side(self.corners)

    def summary(self) -> dict[str, Any]:
        """As JSON can hold it."""
        return {
            "frame": self.index,
            "time": round(float(self.time), 3),
            "corners": np.round(self.corners, 2).tolist(),
            "score": round(self.score, 3),
            "deviation": round(self.deviation, 2),
            "whole": self.is_whole,
        }


@dataclass
class Appearance:
    """A picture at one place, in one shot: its sightings, in the order of frames."""

    sightings: list[Sighting] = field(default_factory=list)

    @property
    def picture(self) -> int:
        return self.sightings[0].picture

    @property
    def first(self) -> Sighting:
        return self.sightings[0]

    @property
    def last(self) -> Sighting:
        return self.sightings[-1]

    @property
    def best(self) -> Sighting:
        """The one to track from, see `best_of`."""
        return best_of(self.sightings)


@dataclass
class Instance:
    """One copy of a picture: the appearances that may be of the same one, since no two of them overlap in time."""

    appearances: list[Appearance] = field(default_factory=list)

    @property
    def best(self) -> Sighting:
        """The one to track from, see `best_of`."""
        return best_of([one for each in self.appearances for one in each.sightings])

    def summary(self) -> dict[str, Any]:
        """As JSON can hold it: where it is seen best, and from when to when it is seen."""
        spans = [
            {
                "first": each.first.index,
                "last": each.last.index,
                "from": round(float(each.first.time), 3),
                "to": round(float(each.last.time), 3),
                "best": each.best.summary(),
            }
            for each in self.appearances
        ]
        return {"best": self.best.summary(), "seen": spans}


def best_of(sightings: Sequence[Sighting]) -> Sighting:
    """The one to track from: wholly inside the frame if there is such, sharp, and as exact as can be."""
    whole = [one for one in sightings if one.is_whole] or sightings
    exactest = min(one.exactness for one in whole)
    exact = [one for one in whole if one.exactness <= MODEL.max_inexact * exactest]
    sharpest = max(one.sharpness for one in exact)
    return min((one for one in exact if one.sharpness >= MODEL.min_sharp * sharpest), key=lambda one: one.exactness)


def instances(appearances: list[Appearance]) -> list[Instance]:
    """The copies of one picture that there have to be: as many as are seen at once."""
    found: list[Instance] = []
    for each in sorted(appearances, key=lambda one: one.first.index):
        free = (copy for copy in found if copy.appearances[-1].last.index < each.first.index)
        copy = next(free, None)
        if copy is None:
            found.append(copy := Instance())
        copy.appearances.append(each)
    return found


def overlap(a: Array, b: Array) -> float:
    """Area that two convex quads (4, 2) share, over that of both together, 0..1."""
    shared, _ = cv2.intersectConvexConvex(a.astype(np.float32), b.astype(np.float32))
    return float(shared / max(abs(area(a)) + abs(area(b)) - shared, 1e-9))


def is_whole(corners: Array, width: int, height: int) -> bool:
    """Whether a quad (4, 2) lies in a frame of width x height px, as a target of tracking has to."""
    beyond = LIMITS.max_outside_px
    return bool(((corners >= -beyond) & (corners <= np.array([width, height]) - 1 + beyond)).all())
