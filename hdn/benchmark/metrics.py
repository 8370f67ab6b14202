"""How well tracks follow the truth, as the paper and the POT benchmark define it, and what an editor of video asks for.

Everything is first measured frame by frame (`measure`), over the frames whose corners are known; the first frame, whose
corners the tracker was given, is dropped. `figures` and `curves` sum measures up, and there are two ways to do so for
a set of sequences: `mean_figures` takes each sequence's figures and averages those (every sequence weighs the same, as
in the paper and in the published toolkits), while `figures(pooled(...))` takes all frames as one sequence (every frame
weighs the same).

A frame without an answer fails at every threshold: its errors are infinite, its overlap is 0.
"""

from collections.abc import Sequence as Many
from dataclasses import dataclass, fields

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..imaging.arrays import Array
from ..imaging.homography import from_corners, transform
from ..imaging.quads import is_convex

Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

PRECISION_THRESHOLDS = np.arange(0, 51.0)  # px, of alignment and centroid error
HOMOGRAPHY_THRESHOLDS = np.arange(0, 201.0, 10)  # of homography discrepancy, as in the toolkits
OVERLAP_THRESHOLDS = np.linspace(0, 1, 21)
LENGTH_THRESHOLDS = np.arange(0, 501.0)  # frames


@dataclass(frozen=True)
class FailureLimits:
    """When a tracker has failed and when it is back; ours, for neither the paper nor POT's authors say."""

    failure_overlap: float = 0.2  # intersection over union at or under which a trajectory is broken
    fragment_frames: int = 10  # a shorter trajectory is a fragment
    recovered_px: float = 10.0  # alignment error at which a failure is over
    tracked_px: float = 10.0  # alignment error over which a frame ought not to be called tracked


LIMITS = FailureLimits()


@dataclass(frozen=True)
class Measures:
    """What was measured on one sequence, or on several pooled.

    Attributes:
        errors: (M,) alignment error of each known frame, px: root mean square distance over the four corners.
        discrepancies: (M,) homography discrepancy (POT, eq. 2).
        centroids: (M,) distance of the polygons' centroids, px.
        overlaps: (M,) intersection over union of the polygons.
        lengths: (R,) of the trajectories between failures, frames.
        jitter: (K,) second difference of the error from one known frame to the next, px, root mean square over corners.
        lost: (M,) 1 where the tracker said "lost" though the target was there to be seen, else 0.
        tracked: (M,) 1 where the tracker said "tracked", else 0.
        recoveries: (F,) frames from each failure until it was over, or until the end.
        seconds: (T,) that each call of the tracker took.
    """

    errors: Array
    discrepancies: Array
    centroids: Array
    overlaps: Array
    lengths: Array
    jitter: Array
    lost: Array
    tracked: Array
    recoveries: Array
    seconds: Array


def measure(truth: Array, corners: Array, states: Many[str], seconds: Array) -> Measures:
    """Compares a track with the truth.

    Args:
        truth: (N, 4, 2) px, NaN where unknown; its first row is what the tracker was given, or NaN.
        corners: (N, 4, 2) px, NaN where the tracker gave none; the first row is the quad that it was given.
        states: (N,) what the tracker said: "tracked", "held" or "lost".
        seconds: (N - 1,) that the tracker took for each frame but the first.

    Raises:
        InputError: no frame but the first has known corners.
    """
    known: Indices = np.flatnonzero(np.isfinite(truth).all((1, 2)))
    known = known[known > 0]
    if not len(known):
        raise InputError("no frame but the first has known corners: nothing can be measured")
    there, answer = truth[known], corners[known]
    answered: Flags = np.asarray(np.isfinite(answer).all((1, 2)))
    said = np.array(states)[known]
    triples = list(zip(there, answer, answered, strict=True))
    errors = np.where(answered, alignment_errors(there, answer), np.inf)
    apart = np.linalg.norm(centroids(there) - centroids(np.nan_to_num(answer)), axis=1)
    overlaps = np.array([overlap(t, c) if ok else 0.0 for t, c, ok in triples])
    return Measures(
        errors=errors,
        discrepancies=np.array([discrepancy(corners[0], t, c) if ok else np.inf for t, c, ok in triples]),
        centroids=np.where(answered, apart, np.inf),
        overlaps=overlaps,
        lengths=trajectory_lengths(known, overlaps),
        jitter=jitter(known, answer - there),
        lost=((said == "lost") | ~answered).astype(np.float64),
        tracked=((said == "tracked") & answered).astype(np.float64),
        recoveries=recoveries(known, overlaps, errors),
        seconds=seconds,
    )


def pooled(measures: Many[Measures]) -> Measures:
    """All frames of several sequences as if they were one."""
    return Measures(*(np.concatenate([getattr(m, f.name) for m in measures]) for f in fields(Measures)))


def figures(m: Measures) -> dict[str, float]:
    """The numbers of a table; NaN for one that nothing was there to tell (no failure to recover from, for instance).

    Keys:
        avg Prec: mean of the precision curve over 0..50 px. P<=2 .. P<=20: share of frames within so many px.
        avg HSR: mean of the homography success curve over 0..200. avg CP: mean centroid precision over 0..50 px.
        avg SR: mean share of frames with an overlap above 0..1.
        fragments: share of trajectories shorter than 10 frames (in a sequence shorter than that, all are).
        median error: px. jitter: median, px. lost wrongly: share of frames.
        tracked wrongly: share of the frames said to be tracked that err by more than LIMITS.tracked_px.
        frames to recover: mean. ms: mean time a frame.
    """
    return {
        "avg Prec": float(within(m.errors, PRECISION_THRESHOLDS).mean()),
        **{f"P<={t}": float(within(m.errors, np.array([t]))[0]) for t in (2, 5, 10, 20)},
        "avg HSR": float(within(m.discrepancies, HOMOGRAPHY_THRESHOLDS).mean()),
        "avg CP": float(within(m.centroids, PRECISION_THRESHOLDS).mean()),
        "avg SR": float(above(m.overlaps, OVERLAP_THRESHOLDS).mean()),
        "fragments": float((m.lengths < LIMITS.fragment_frames).mean()),
        "median error": float(np.median(m.errors)),
        "jitter": float(np.median(m.jitter)) if len(m.jitter) else np.nan,
        "lost wrongly": float(m.lost.mean()),
        "tracked wrongly": _mean((m.errors[m.tracked > 0] > LIMITS.tracked_px).astype(float).tolist()),
        "frames to recover": float(m.recoveries.mean()) if len(m.recoveries) else np.nan,
        "ms": 1000 * float(m.seconds.mean()) if len(m.seconds) else np.nan,
    }


def mean_figures(measures: Many[Measures]) -> dict[str, float]:
    """Figures of each sequence, averaged over the sequences that have them."""
    rows = [figures(m) for m in measures]
    return {key: _mean([row[key] for row in rows]) for key in rows[0]}


def curves(measures: Many[Measures]) -> dict[str, Array]:
    """Curves of each sequence, averaged: "precision", "homography", "centroid", "overlap" and "length".

    Each goes with the thresholds of its name above; "length" is the share of trajectories at most so long.
    """
    return {
        "precision": np.mean([within(m.errors, PRECISION_THRESHOLDS) for m in measures], 0),
        "homography": np.mean([within(m.discrepancies, HOMOGRAPHY_THRESHOLDS) for m in measures], 0),
        "centroid": np.mean([within(m.centroids, PRECISION_THRESHOLDS) for m in measures], 0),
        "overlap": np.mean([above(m.overlaps, OVERLAP_THRESHOLDS) for m in measures], 0),
        "length": np.mean([within(m.lengths, LENGTH_THRESHOLDS) for m in measures], 0),
    }


def within(values: Array, thresholds: Array) -> Array:
    """Share of the values (M,) at or under each threshold (T,)."""
    return (values[:, None] <= thresholds).mean(0)


def above(values: Array, thresholds: Array) -> Array:
    """Share of the values (M,) over each threshold (T,)."""
    return (values[:, None] > thresholds).mean(0)


def alignment_errors(truth: Array, corners: Array) -> Array:
    """Root mean square distance over the four corners (POT, eq. 1), (M,) px, for quads (M, 4, 2)."""
    return np.sqrt(np.square(corners - truth).sum(2).mean(1))


def discrepancy(quad: Array, truth: Array, corners: Array) -> float:
    """Homography discrepancy (POT, eq. 2): how far H_truth . H_tracked^-1 moves the corners (+-1, +-1), on average.

    Both map the first frame's pixels, where the quad is, to this frame's; infinite where a quad is degenerate.
    """
    unit = np.array([[-1.0, -1], [1, -1], [-1, 1], [1, 1]])
    try:
        tracked_to_truth = from_corners(quad, truth) @ np.linalg.inv(from_corners(quad, corners))
    except (ValueError, np.linalg.LinAlgError):
        return np.inf
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = float(np.linalg.norm(transform(tracked_to_truth, unit) - unit, axis=1).mean())
    return distance if np.isfinite(distance) else np.inf


def centroids(quads: Array) -> Array:
    """Centres of area of polygons (M, 4, 2), (M, 2); of a polygon without area, the mean of its corners."""
    mean = quads.mean(1, keepdims=True)
    p = quads - mean
    q = np.roll(p, -1, 1)
    cross = p[..., 0] * q[..., 1] - q[..., 0] * p[..., 1]  # (M, 4), twice the area of each triangle
    area = cross.sum(1)
    flat = np.abs(area) < 1e-9
    offset = ((p + q) * cross[..., None]).sum(1) / np.where(flat, 1, 3 * area)[:, None]
    return mean[:, 0] + np.where(flat[:, None], 0, offset)


def overlap(a: Array, b: Array) -> float:
    """Intersection over union of two quads (4, 2); 0 where one crosses itself or bends inward."""
    if not (is_convex(a) and is_convex(b)):
        return 0.0
    origin = a.mean(0)  # OpenCV's polygons are in single precision
    first, second = (a - origin).astype(np.float32), (b - origin).astype(np.float32)
    common = float(cv2.intersectConvexConvex(first, second)[0])
    union = float(cv2.contourArea(first)) + float(cv2.contourArea(second)) - common
    return min(max(common / union, 0.0), 1.0)


def trajectory_lengths(known: Indices, overlaps: Array) -> Array:
    """Lengths in frames of the stretches without a failure (see LIMITS), the first from the given frame 0 on.

    As in the authors' code, each failed frame ends a trajectory, one of length 0 where the frame before failed too.
    Unlike there, the last stretch counts also where it does not span the whole sequence.

    Args:
        known: (M,) indices of the frames with known corners; those between them count in the lengths.
        overlaps: (M,)
    """
    lengths = []
    start: int | None = 0
    last = 0
    for index, value in zip(known.tolist(), overlaps, strict=True):
        if value > LIMITS.failure_overlap:
            start = index if start is None else start
            last = index
        else:
            lengths.append(0 if start is None else last - start + 1)
            start = None
    if start is not None:
        lengths.append(last - start + 1)
    return np.array(lengths, float)


def jitter(known: Indices, offsets: Array) -> Array:
    """Second differences of the corners' errors (M, 4, 2) over three known frames at equal distances, (K,) px.

    Root mean square over the corners; frames without an answer (NaN) are left out.
    """
    second = offsets[2:] - 2 * offsets[1:-1] + offsets[:-2]
    even = np.diff(known)[1:] == np.diff(known)[:-1]
    size = np.sqrt(np.square(second).sum(2).mean(1))
    return size[even & np.isfinite(size)]


def recoveries(known: Indices, overlaps: Array, errors: Array) -> Array:
    """Frames from each failure to the first known frame in which it is over (see LIMITS), (F,).

    One that is never made good lasts until after the last known frame.
    """
    durations = []
    failed: int | None = None
    for index, value, error in zip(known.tolist(), overlaps, errors, strict=True):
        if failed is None and value <= LIMITS.failure_overlap:
            failed = index
        elif failed is not None and error <= LIMITS.recovered_px:
            durations.append(index - failed)
            failed = None
    if failed is not None:
        durations.append(int(known[-1]) + 1 - failed)
    return np.array(durations, float)


def roc_area(scores: Array, positive: Flags) -> float:
    """Area under the ROC curve: how often a positive (N,) scores above one that is not; ties count half.

    NaN where either kind is missing.
    """
    values, inverse = np.unique(scores, return_inverse=True)
    yes, no = (np.bincount(inverse[which], minlength=len(values)) for which in (positive, ~positive))
    pairs = float(yes.sum()) * float(no.sum())
    return float(yes @ (np.cumsum(no) - no / 2)) / pairs if pairs else np.nan


def _mean(values: list[float]) -> float:
    told = [v for v in values if not np.isnan(v)]
    return float(np.mean(told)) if told else np.nan
