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

from hdn.homography import Array, area
from hdn.tracker import Estimate, State

from .trackfile import Source, Track

SETTLE = 30  # frames over which a correction fades where no other known pose follows
AGREE = 0.03  # of the target's size, up to which two ways to a frame agree
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
        way = np.arange(n)[:, None, None] / (SETTLE if self.stop is None or self.end is None else len(self))
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
    confident stays. A fix replaces what is held, and what is held what is lost.
    """
    inner = slice(1, None if run.end is None else len(run))
    frames = np.array(run.frames[inner], int)
    corners, confidence = run.corrected()[inner], np.array([e.confidence for e in run.estimates[inner]])
    states = [e.state for e in run.estimates[inner]]
    share = 1 - np.arange(1, len(frames) + 1) / max(len(run), 1)
    here = track.corners[frames]
    size = np.sqrt([abs(area(c)) for c in corners])
    distance = np.sqrt(np.square(corners - here).sum(-1).mean(-1))
    ours, theirs = _tracked(states), _tracked([track.states[i] for i in frames])

    weight = np.where(distance <= AGREE * size, share, confidence > track.confidence[frames])
    weight = np.where(ours & theirs, weight, ours)
    for k, i in enumerate(frames):
        if ours[k]:
            w = float(weight[k])
            track.corners[i] = corners[k] if w == 1 or not theirs[k] else (1 - w) * here[k] + w * corners[k]
            track.confidence[i] = confidence[k] if not theirs[k] else (1 - w) * track.confidence[i] + w * confidence[k]
            track.states[i] = "tracked"
        elif states[k] == "held" and track.states[i] == "lost" and not run.fills:
            track.corners[i], track.confidence[i], track.states[i] = corners[k], confidence[k], "held"


def blank(source: Source, start: int, quad: Array, times: list[Fraction], keyframes: dict[int, Array]) -> Track:
    """A track of which nothing is known but the reference frame and the keyframes."""
    n = len(times)
    track = Track(source, start, quad, times, np.repeat(UNKNOWN[None], n, 0), ["lost"] * n, np.zeros(n))
    track.keyframes = keyframes
    fix(track, track.given)
    return track


def fix(track: Track, poses: dict[int, Array]) -> None:
    """Sets known poses, which are exact."""
    for index, corners in poses.items():
        track.corners[index], track.states[index], track.confidence[index] = corners, "tracked", 1.0


def clear(track: Track, frames: Iterable[int]) -> None:
    """Forgets what is known of some frames."""
    for i in frames:
        track.corners[i], track.states[i], track.confidence[i] = UNKNOWN, "lost", 0.0


def bridge(track: Track, frames: range) -> None:
    """Leads held corners straight from the fix before them to the one after, where there is no loss or cut between."""
    fixes = frames.start + np.flatnonzero(_tracked([track.states[i] for i in frames]))
    for a, b in pairwise(fixes):
        held = all(track.states[i] == "held" for i in range(a + 1, b))
        if b > a + 1 and held and not any(a < cut <= b for cut in track.cuts):
            way = (np.arange(1, b - a) / (b - a))[:, None, None]
            track.corners[a + 1 : b] = (1 - way) * track.corners[a] + way * track.corners[b]


def _tracked(states: Sequence[State]) -> NDArray[np.bool_]:
    return np.array([state == "tracked" for state in states], bool)
