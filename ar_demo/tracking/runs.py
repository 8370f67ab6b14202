"""What is tracked between known poses.

Known are the corners in the reference frame and in the keyframes; a frame that tracking found after a gap is known as
well. From a known pose a `Run` goes forward or backward, as far as the next one.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise

from hdn.imaging.arrays import Array

from .protocol import Estimate


@dataclass
class Run:
    """A way from a known pose through the frames on one side of it.

    Attributes:
        anchor: index of the frame with the known pose; pose: its corners (4, 2) there.
        stop: the last frame, below the anchor where the run goes backward; None is the video's last.
        fills: whether it only looks for fixes in a gap: once lost, it is over.
        template_deviation: px, standard deviation of the corners of the picture that the tracker compares with; 0 for
            that which the user gave.
        estimates: the tracker's, of the anchor's own frame first.
        damaged: the frames among these whose picture may be wrong, since the file is damaged there.
    """

    anchor: int
    pose: Array
    stop: int | None
    fills: bool = False
    template_deviation: float = 0.0
    estimates: list[Estimate] = field(default_factory=list)
    damaged: set[int] = field(default_factory=set)

    @property
    def backward(self) -> bool:
        return self.stop is not None and self.stop < self.anchor

    @property
    def frames(self) -> range:
        """Indices of the frames that there are estimates of, in the order of the run."""
        step = -1 if self.backward else 1
        return range(self.anchor, self.anchor + step * len(self.estimates), step)

    def add(self, estimate: Estimate, damaged: bool = False) -> bool:
        """Takes the next frame's estimate, and whether its picture may be wrong; whether the run goes on."""
        self.estimates.append(estimate)
        if damaged:
            self.damaged.add(self.frames[-1])
        return self.frames[-1] != self.stop and not (self.fills and estimate.state == "lost")


def forward_runs(known: dict[int, Array]) -> list[Run]:
    """From each known pose to the next, and from the last to the video's end."""
    anchors = sorted(known)
    return [Run(a, known[a], b) for a, b in zip(anchors, [*anchors[1:], None], strict=True)]


def backward_runs(known: dict[int, Array], first: int = 0) -> list[Run]:
    """From each known pose to the one before, and from the first to frame `first`, the video's beginning."""
    anchors = sorted(known)
    runs = [Run(b, known[b], a) for a, b in pairwise(anchors)]
    return runs if anchors[0] <= first else [Run(anchors[0], known[anchors[0]], first), *runs]


def gap_runs(fixes: dict[int, Array], first: int, last: int, backward: bool) -> list[Run]:
    """Runs over the frames without a fix between two with one, of those from `first` to `last`."""
    pairs = [(a, b) for a, b in pairwise(sorted(k for k in fixes if first <= k <= last)) if b > a + 1]
    return [Run(b, fixes[b], a, fills=True) if backward else Run(a, fixes[a], b, fills=True) for a, b in pairs]


def check_runs(index: int, pose: Array, given: Iterable[int], first: int, last: int) -> list[Run]:
    """Runs from a fix backward and forward to the given frames beside it, or to the first and the last frame."""
    before = max((k for k in given if k < index), default=first)
    after = min((k for k in given if k > index), default=last)
    return [Run(index, pose, stop, fills=True) for stop in (before, after) if stop != index]


def fixes_of(runs: Iterable[Run], given: dict[int, Array]) -> dict[int, Array]:
    """Corners (4, 2) by frame: those given, and where a tracker was sure the surest ones."""
    best: dict[int, Estimate] = {}
    for run in runs:
        for index, estimate in zip(run.frames, run.estimates, strict=True):
            if estimate.state == "tracked" and (index not in best or estimate.deviation < best[index].deviation):
                best[index] = estimate
    return {index: estimate.corners for index, estimate in best.items()} | given
