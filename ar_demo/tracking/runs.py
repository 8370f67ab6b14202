"""What is tracked between known poses, and how what was seen from both ends becomes one track.

Known are the corners in the reference frame and in the keyframes; a frame that tracking found after a gap is known as
well. From a known pose a `Run` goes forward or backward, as far as the next one.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hdn.imaging.arrays import Array
from hdn.imaging.quads import area
from hdn.state import STATES, State

from ..tracks import Source, Track
from .protocol import Estimate


@dataclass(frozen=True)
class JoinModel:
    """How what was tracked on several ways becomes one track.

    Attributes:
        settle_frames: over which a correction fades where no other known pose follows.
        agreement: distance of two ways to a frame, as a share of the target's size, up to which they agree.
        uncertain: deviation, as a share of the target's size, that a good view stays well below.
        uncertain_frames: share of the frames that may be uncertain before a second pass is worth it.
        surer: ratio of deviations below which a pose replaces another; at less gain, changing over does more harm.
    """

    settle_frames: int = 30
    agreement: float = 0.03
    uncertain: float = 0.005
    uncertain_frames: float = 0.05
    surer: float = 0.5


MODEL = JoinModel()
UNKNOWN: Array = np.full((4, 2), np.nan)


@dataclass
class Run:
    """A way from a known pose through the frames on one side of it.

    Attributes:
        anchor: index of the frame with the known pose; pose: its corners (4, 2) there.
        stop: the last frame, below the anchor where the run goes backward; None is the video's last.
        end: corners (4, 2) known in the last frame, None where they are not.
        fills: whether it only looks for fixes in a gap: once lost, it is over.
        estimates: the tracker's, of the anchor's own frame first.
    """

    anchor: int
    pose: Array
    stop: int | None
    end: Array | None = None
    fills: bool = False
    estimates: list[Estimate] = field(default_factory=list)

    @property
    def backward(self) -> bool:
        return self.stop is not None and self.stop < self.anchor

    @property
    def frames(self) -> range:
        """Indices of the frames that there are estimates of, in the order of the run."""
        step = -1 if self.backward else 1
        return range(self.anchor, self.anchor + step * len(self.estimates), step)

    def add(self, estimate: Estimate) -> bool:
        """Takes the next frame's estimate; whether the run goes on."""
        self.estimates.append(estimate)
        return self.frames[-1] != self.stop and not (self.fills and estimate.state == "lost")

    def corrected(self) -> Array:
        """(n, 4, 2) what the tracker said, moved so that it meets the known poses at the ends.

        What it was off by at an end is spread linearly over the frames between; from a lone end it fades.
        """
        n = len(self.estimates)
        said = np.array([e.corners for e in self.estimates])
        way = np.arange(n)[:, None, None] / (
            MODEL.settle_frames if self.stop is None or self.end is None else len(self)
        )
        out = said.copy()
        if self.estimates[0].state == "tracked":
            out += np.maximum(1 - way, 0) * (self.pose - said[0])
        if self.end is not None and self.frames[-1] == self.stop and self.estimates[-1].state == "tracked":
            out += way * (self.end - said[-1])
        return out

    def __len__(self) -> int:
        """Frames from the anchor to the last one."""
        return abs((self.anchor if self.stop is None else self.stop) - self.anchor)


def forward_runs(known: dict[int, Array]) -> list[Run]:
    """From each known pose to the next, and from the last to the video's end."""
    anchors = sorted(known)
    stops = [*anchors[1:], None]
    return [Run(a, known[a], b, None if b is None else known[b]) for a, b in zip(anchors, stops, strict=True)]


def backward_runs(known: dict[int, Array]) -> list[Run]:
    """From each known pose to the one before, and from the first to the video's beginning."""
    anchors = sorted(known)
    runs = [Run(b, known[b], a, known[a]) for a, b in pairwise(anchors)]
    return runs if anchors[0] == 0 else [Run(anchors[0], known[anchors[0]], 0), *runs]


def gap_runs(track: Track, first: int, last: int, backward: bool) -> list[Run]:
    """Runs over the frames without a fix between two with one, of those from `first` to `last`."""
    fixes = first + np.flatnonzero(_tracked(track.states[first : last + 1]))
    pairs = [(int(a), int(b)) for a, b in pairwise(fixes) if b > a + 1]
    c = track.corners
    return [Run(b, c[b], a, c[a], fills=True) if backward else Run(a, c[a], b, c[b], fills=True) for a, b in pairs]


def lay(track: Track, run: Run) -> None:
    """Puts a run into a track, but for the known poses at its ends.

    Where both have a fix and agree they are blended, each the more the nearer its end is; where they do not, the more
    confident stays. A fix replaces what is held, what is held is blended by its certainty, and replaces what is lost.
    """
    inner = slice(1, None if run.end is None else len(run))
    frames = np.array(run.frames[inner], int)
    corners = run.corrected()[inner]
    confidence, deviation = np.array([(e.confidence, e.deviation) for e in run.estimates[inner]]).reshape(-1, 2).T
    states = [e.state for e in run.estimates[inner]]
    share = 1 - np.arange(1, len(frames) + 1) / max(len(run), 1)
    here = track.corners[frames]
    size = np.sqrt([abs(area(c)) for c in corners])
    distance = np.sqrt(np.square(corners - here).sum(-1).mean(-1))
    ours, theirs = _tracked(states), _tracked([track.states[i] for i in frames])

    weight = np.where(distance <= MODEL.agreement * size, share, confidence > track.confidence[frames])
    weight = np.where(ours & theirs, weight, ours)
    for k, i in enumerate(frames):
        if ours[k]:
            blend(track, i, corners[k], confidence[k], deviation[k], float(weight[k]) if theirs[k] else 1.0)
            track.states[i] = "tracked"
        elif states[k] == "held" and track.states[i] == "held":
            blend(track, i, corners[k], confidence[k], deviation[k], _certainty(deviation[k], track.deviation[i]))
        elif states[k] == "held" and track.states[i] == "lost" and not run.fills:
            blend(track, i, corners[k], confidence[k], deviation[k], 1.0)
            track.states[i] = "held"


def join(track: Track, other: Track) -> None:
    """Puts another track of the same frames into one, where it knows more, or the same much more certainly."""
    for i, (ours, theirs) in enumerate(zip(track.states, other.states, strict=True)):
        better = STATES.index(theirs) < STATES.index(ours)
        if better or (theirs == ours != "lost" and other.deviation[i] < MODEL.surer * track.deviation[i]):
            blend(track, i, other.corners[i], other.confidence[i], other.deviation[i], 1.0)
            track.states[i] = theirs


def is_uncertain(track: Track) -> bool:
    """Whether more than a few frames are not tracked, or less surely than a good view of the target allows."""
    size = np.sqrt([abs(area(corners)) for corners in track.corners])
    return bool((~_tracked(track.states) | (track.deviation > MODEL.uncertain * size)).mean() > MODEL.uncertain_frames)


def blend(track: Track, i: int, corners: Array, confidence: float, deviation: float, weight: float) -> None:
    """Puts a pose into frame i of a track, in the place of the one there, or mixed with it where weight is under 1."""
    for values, new in ((track.corners, corners), (track.confidence, confidence), (track.deviation, deviation)):
        values[i] = new if weight == 1 else values[i] if weight == 0 else (1 - weight) * values[i] + weight * new


def _certainty(ours: float, theirs: float) -> float:
    """Weight of a pose against another by their deviations, px, either of which may be infinite."""
    if not np.isfinite(ours):
        return 0.0
    return 1.0 if not np.isfinite(theirs) else float(theirs**2 / max(ours**2 + theirs**2, 1e-12))


def blank(source: Source, start: int, quad: Array, times: list[Fraction], keyframes: dict[int, Array]) -> Track:
    """A track of which nothing is known but the reference frame and the keyframes."""
    n = len(times)
    track = Track(
        source, start, quad, times, np.repeat(UNKNOWN[None], n, 0), ["lost"] * n, np.zeros(n), np.full(n, np.inf)
    )
    track.keyframes = keyframes
    fix(track, track.given)
    return track


def fix(track: Track, poses: dict[int, Array]) -> None:
    """Sets known poses, which are exact."""
    for index, corners in poses.items():
        blend(track, index, corners, 1.0, 0.0, 1.0)
        track.states[index] = "tracked"


def clear(track: Track, frames: Iterable[int]) -> None:
    """Forgets what is known of some frames."""
    for i in frames:
        blend(track, i, UNKNOWN, 0.0, np.inf, 1.0)
        track.states[i] = "lost"


def bridge(track: Track, frames: range) -> None:
    """Leads held corners that were not measured straight between those around them, never across a loss or cut."""
    measured = frames.start + np.flatnonzero(np.isfinite(track.deviation[list(frames)]))
    for a, b in pairwise(measured):
        held = all(track.states[i] == "held" for i in range(a + 1, b))
        if b > a + 1 and held and not any(a < cut <= b for cut in track.cuts):
            way = (np.arange(1, b - a) / (b - a))[:, None, None]
            track.corners[a + 1 : b] = (1 - way) * track.corners[a] + way * track.corners[b]


def _tracked(states: Sequence[State]) -> NDArray[np.bool_]:
    return np.array([state == "tracked" for state in states], bool)
