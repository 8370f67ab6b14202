"""The track that everything measured in a video amounts to."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from hdn.imaging.arrays import Array
from hdn.state import STATES

from ..tracks import Source, Track
from .joint import MODEL as JOINT
from .joint import Shot
from .measurements import Record
from .runs import Run
from .segments import segments
from .states import is_suspicion, judged, suspicions

TRACKED = STATES.index("tracked")
HELD = STATES.index("held")


@dataclass(frozen=True)
class PieceModel:
    """Which frames are solved for together.

    Attributes:
        longest_gap: frames without any measurement, up to which those around are taken for one piece.
        uncertain: deviation, as a share of the surface's size, that a good view stays well below.
        uncertain_frames: share of the frames that may be uncertain before a second pass is worth it.
        common: ratio of a deviation that all frames share to the median of theirs, which leave it out, up to which a
            second pass is worth it.
    """

    longest_gap: int = 30
    uncertain: float = 0.005
    uncertain_frames: float = 0.05
    common: float = 1.5


MODEL = PieceModel()


def blank(
    source: Source,
    start: int,
    quad: Array,
    times: list[Fraction],
    keyframes: dict[int, Array],
    span: tuple[int, int] | None = None,
) -> Track:
    """A track of which nothing is known but the reference frame and the keyframes."""
    n = len(times)
    track = Track(source, start, quad, times, np.full((n, 4, 2), np.nan), ["lost"] * n, np.zeros(n), np.full(n, np.inf))
    track.keyframes, track.span = keyframes, span
    _fix(track)
    return track


def solve(
    track: Track,
    runs: Sequence[Run],
    strength: float,
    anew: NDArray[np.bool_] | None = None,
) -> None:
    """Fills a track with the joint solution of runs, and adds what had better be checked to its warnings.

    Args:
        track: its quad, keyframes and cuts are known.
        strength: of the motion's smoothness, see `Shot.solve`.
        anew: (N,) frames to be filled, the rest staying as it is, and counting as measured; None for all, in which what
            the track says counts for nothing.
    """
    n = len(track)
    record = Record.of(runs, max(n, 2), None if anew is None else track)
    wanted = np.ones(n, bool) if anew is None else anew
    corners, deviation = np.full((n, 4, 2), np.nan), np.full(n, np.inf)
    weight = np.zeros_like(record.confidence)
    between = np.zeros(n, bool)  # whether there are measurements on both sides, in the same piece
    for start, stop in _pieces(track, record, n):
        found = Shot(record.part(start, stop, {track.reference_frame: track.quad}, track.keyframes)).solve(strength)
        corners[start:stop] = found.corners.reshape(-1, 4, 2)
        deviation[start:stop] = np.sqrt(np.trace(found.covariance, axis1=1, axis2=2) / 4)
        weight[:, start:stop] = found.weight
        known = np.flatnonzero(_known(track, record, n)[start:stop])
        between[start + known[0] : start + known[-1] + 1] = True

    believed = weight > JOINT.wrong_weight
    agrees = np.asarray((believed & (record.states == TRACKED)).any(0)[:n])
    followed = between | ((record.states == TRACKED) | (record.states == HELD)).any(0)[:n]
    solved = np.asarray(np.isfinite(corners).all((1, 2)))
    states = judged(
        np.where(solved[:, None, None], corners, 0.0),
        deviation,
        agrees & solved,
        followed & solved,
        max(track.source.width, track.source.height),
    )
    best = np.where(believed, record.confidence, 0).max(0, initial=0)[:n]
    confidence = np.where(best > 0, best, record.confidence.max(0, initial=0)[:n])
    for i in np.flatnonzero(wanted):
        is_lost = states[i] == "lost"
        track.states[i] = states[i]
        track.corners[i] = np.nan if is_lost else corners[i]
        track.deviation[i], track.confidence[i] = (np.inf, 0.0) if is_lost else (deviation[i], confidence[i])
    track.used = dict(track.keyframes)
    _fix(track)
    disagrees = ((record.states == TRACKED) & record.measured).any(0)[:n] & ~agrees
    kept = [warning for warning in track.warnings if not is_suspicion(warning)]
    outside: set[int] = {*range(n)} - {*range(n)[track.inside]}  # which is no reason to wonder
    track.warnings = kept + suspicions(
        ["tracked" if i in outside else s for i, s in enumerate(track.states)], disagrees
    )


def is_uncertain(track: Track) -> bool:
    """Whether more than a few frames are not tracked, or less surely than a good view of the target allows."""
    size = np.sqrt(np.abs(_areas(track.corners)))
    sure = np.array([state == "tracked" for state in track.states]) & (track.deviation <= MODEL.uncertain * size)
    return bool((~sure)[track.inside].mean() > MODEL.uncertain_frames)


def may_gain(track: Track, common: float) -> bool:
    """Whether a pass whose corners have a standard deviation in common, px, can be surer than the track."""
    return bool(common < MODEL.common * np.median(track.deviation))


def _known(track: Track, record: Record, n: int) -> NDArray[np.bool_]:
    """(n,) whether anything was measured in a frame, or its corners are given."""
    known = np.asarray(record.measured.any(0))[:n]
    known[[i for i in track.given if i < n]] = True
    return known


def _pieces(track: Track, record: Record, n: int) -> list[tuple[int, int]]:
    """Stretches (start, stop) that are solved for, each on its own: none goes over a cut, or over a long loss."""
    stepped = np.asarray(np.isfinite(record.steps[:, : n - 1]).all((2, 3)).any(0))
    near = np.zeros(n, bool)
    known = _known(track, record, n)
    reached = known.copy()
    reached[1:] |= stepped
    reached[:-1] |= stepped
    half = MODEL.longest_gap // 2
    for i in np.flatnonzero(reached):
        near[max(i - half, 0) : i + half + 1] = True
    return [(a, b) for a, b in segments(near.tolist(), track.cuts) if known[a:b].any() and b - a > 2]


def _fix(track: Track) -> None:
    """Sets the quad, which is exact, and the keyframes that nothing else is known of: there the surface is not lost."""
    for index, corners in track.keyframes.items():
        if track.states[index] == "lost":
            track.corners[index], track.states[index], track.deviation[index] = corners, "held", JOINT.clicked_px
    i = track.reference_frame
    track.corners[i], track.states[i], track.confidence[i], track.deviation[i] = track.quad, "tracked", 1.0, 0.0


def _areas(corners: Array) -> Array:
    """(n,) signed areas of quads (n, 4, 2)."""
    x, y = corners[..., 0], corners[..., 1]
    return np.asarray((x * np.roll(y, -1, 1) - y * np.roll(x, -1, 1)).sum(1) / 2)
