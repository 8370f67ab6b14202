"""What trackers said on their runs through a video, as arrays of measurements by frame."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdn.imaging.arrays import Array
from hdn.imaging.homography import normalised
from hdn.state import STATES

from ..tracks import Track
from .joint import CORNERS, Measurements, move
from .protocol import Estimate
from .runs import Run


@dataclass(frozen=True)
class DoubtModel:
    """How much less is believed of damaged frames: what conceals damage is often the picture before, a motion ago.

    Attributes:
        variance_ratio: factor on the covariance.
        least_px: standard deviation of each coordinate beside that.
    """

    variance_ratio: float = 16.0
    least_px: float = 2.0


DOUBT = DoubtModel()


@dataclass
class Record:
    """All that was measured in n frames, on p ways through them; a way holds runs that do not overlap.

    Attributes:
        corners: (p, n, 8) px, NaN where nothing was measured. covariance: (p, n, 8, 8) px^2.
        linked: (p, n - 1) whether frames k and k + 1 are of one run, and neither is damaged: its error is its own.
        states: (p, n) index into `STATES`, -1 where the way does not come by. confidence: (p, n) 0..1.
        steps: (p, n - 1, 3, 3) pixels of frame k to those of the next, NaN where not measured.
        step_covariance: (p, n - 1, 8, 8) px^2 of the corners moved by them.
    """

    corners: Array
    covariance: Array
    linked: NDArray[np.bool_]
    states: NDArray[np.int_]
    confidence: Array
    steps: Array
    step_covariance: Array

    @classmethod
    def empty(cls, ways: int, n: int) -> "Record":
        """Of n frames in which nothing was measured."""
        return cls(
            np.full((ways, n, CORNERS), np.nan),
            np.full((ways, n, CORNERS, CORNERS), np.nan),
            np.zeros((ways, n - 1), bool),
            np.full((ways, n), -1),
            np.zeros((ways, n)),
            np.full((ways, n - 1, 3, 3), np.nan),
            np.full((ways, n - 1, CORNERS, CORNERS), np.nan),
        )

    @classmethod
    def of(cls, runs: Sequence[Run], n: int, old: Track | None = None) -> "Record":
        """Of runs through n frames, and of what an older track says of them."""
        ways = _ways(runs)
        record = cls.empty(len(ways) + (old is not None), n)
        for way, chosen in enumerate(ways):
            for run in chosen:
                record._put(way, run)
        if old is not None:
            record._put_track(len(ways), old)
        return record

    def part(self, start: int, stop: int, reference: dict[int, Array], clicked: dict[int, Array]) -> Measurements:
        """The measurements in the frames start to stop - 1, and corners (4, 2) that are known or clicked there."""
        between = slice(start, stop - 1)
        return Measurements(
            self.corners[:, start:stop],
            self.covariance[:, start:stop],
            self.linked[:, between],
            self.steps[:, between],
            self.step_covariance[:, between],
            *(
                {i - start: c.reshape(CORNERS) for i, c in given.items() if start <= i < stop}
                for given in (reference, clicked)
            ),
        )

    @property
    def measured(self) -> NDArray[np.bool_]:
        """(p, n) whether there are corners."""
        return np.asarray(np.isfinite(self.corners).all(-1))

    def _put(self, way: int, run: Run) -> None:
        for k, (index, estimate) in enumerate(zip(run.frames, run.estimates, strict=True)):
            self.states[way, index] = STATES.index(estimate.state)
            self.confidence[way, index] = estimate.confidence
            if _is_measured(estimate):
                self.corners[way, index] = estimate.corners.reshape(CORNERS)
                covariance = _covariance(estimate, estimate.deviation) + _covariance(None, run.template_deviation)
                self.covariance[way, index] = _doubted(covariance) if index in run.damaged else covariance
            step = getattr(estimate, "step", None)
            if k > 0:
                doubted = run.damaged.intersection((index, run.frames[k - 1]))
                self.linked[way, min(index, run.frames[k - 1])] = not doubted
                if step is not None:
                    covariance = _doubted(step.covariance) if doubted else step.covariance
                    self._put_step(way, index, step.homography, covariance, run.backward)

    def _put_step(self, way: int, index: int, homography: Array, covariance: Array, backward: bool) -> None:
        """A step to frame `index` from its neighbour."""
        k = index if backward else index - 1
        if backward:
            homography = normalised(np.asarray(np.linalg.inv(homography), np.float64))
            corners = self.corners[:, index][self.measured[:, index]]
            if not len(corners):
                return
            slope = move(homography[None], corners[:1])[1][0]
            covariance = slope @ covariance @ slope.T
        self.steps[way, k], self.step_covariance[way, k] = homography, covariance

    def _put_track(self, way: int, track: Track) -> None:
        known = track.known & np.isfinite(track.deviation)
        self.corners[way, known] = track.corners[known].reshape(-1, CORNERS)
        self.covariance[way, known] = np.square(track.deviation[known])[:, None, None] / 2 * np.eye(CORNERS)
        self.linked[way] = known[:-1] & known[1:]
        for cut in track.cuts:
            self.linked[way, cut - 1] = False
        self.states[way] = [STATES.index(state) for state in track.states]
        self.confidence[way] = track.confidence


def _doubted(covariance: Array) -> Array:
    """(8, 8) px^2 of what a damaged frame tells."""
    return np.asarray(DOUBT.variance_ratio * covariance + DOUBT.least_px**2 * np.eye(CORNERS))


def _ways(runs: Iterable[Run]) -> list[list[Run]]:
    """Runs put together to as few ways as hold them without overlapping."""
    ways: list[list[Run]] = []
    ends: list[int] = []
    for run in sorted((run for run in runs if run.estimates), key=lambda run: min(run.frames)):
        way = next((i for i, end in enumerate(ends) if end < min(run.frames)), len(ways))
        if way == len(ways):
            ways.append([])
            ends.append(-1)
        ways[way].append(run)
        ends[way] = max(run.frames)
    return ways


def _is_measured(estimate: Estimate) -> bool:
    """Whether the frame tells where the corners are: held ones may be no more than expected."""
    is_expected = estimate.state == "held" and getattr(estimate, "covariance", ()) is None
    return estimate.state != "lost" and bool(np.isfinite(estimate.deviation)) and not is_expected


def _covariance(estimate: object, deviation: float) -> Array:
    """(8, 8) px^2 of an estimate's corners; of a tracker that does not tell it, all coordinates alike."""
    told = getattr(estimate, "covariance", None)
    return np.eye(CORNERS) * deviation**2 / 2 if told is None else np.asarray(told)
