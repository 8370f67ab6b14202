"""What a tracker says of itself, compared with the truth: states, confidence, deviation and visibility."""

from collections.abc import Sequence as Many
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..benchmark.metrics import Flags, roc_area
from ..imaging.arrays import Array


@dataclass(frozen=True)
class JudgingThresholds:
    """By which what a tracker says of itself is judged."""

    wrong_px: float = 10.0  # root mean square over the corners, beyond which a pose is wrong
    good_px: float = 5.0  # within which it is good
    well_seen_share: float = 0.7  # of the target that makes it wrong to call it lost
    whole_share: float = 0.98  # of the target from which all of it counts as back
    soon_frames: int = 3  # within which a target is to be found again


THRESHOLDS = JudgingThresholds()
CONFIDENCES = np.linspace(0, 1, 11)  # edges of bins
DEVIATIONS = np.array([0, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4, 12.8])  # px, edges of bins; the last is open


@dataclass(frozen=True)
class Answers:
    """What was said of the N frames of a clip but the first, and the truth.

    Attributes:
        group, event: of which clips it is.
        states: (N,) 'tracked', 'held' or 'lost'.
        confidences, deviations, visibility: (N,), (N,) px, (N, 8, 8), as an Estimate has them.
        errors: (N,) px, root mean square over the corners.
        seen, in_frame: (N, 8, 8) share of each of the target's cells that is seen, or lies in the frame.
    """

    group: str
    event: str
    states: NDArray[np.str_]
    confidences: Array
    deviations: Array
    visibility: Array
    errors: Array
    seen: Array
    in_frame: Array

    @property
    def tracked(self) -> Flags:
        return np.asarray(self.states == "tracked")

    @property
    def share(self) -> Array:
        """(N,) of the target that is seen; what lies outside the frame is not."""
        return np.asarray(self.seen.mean((1, 2)))

    @property
    def wrong(self) -> Flags:
        """(N,) where the pose is wrong, or nothing of the target is there to be seen."""
        return np.asarray((self.errors > THRESHOLDS.wrong_px) | (self.share == 0))


@dataclass(frozen=True)
class Bins:
    """Frames sorted into bins by what was said of them: how many, and the means of what was said and of the truth.

    Means are NaN in an empty bin.
    """

    counts: NDArray[np.int64]
    said: Array
    true: Array

    @property
    def error(self) -> float:
        """Mean difference of what was said and the truth, bins weighed by their counts: the expected calibration error
        (Naeini, Cooper and Hauskrecht, 2015)."""
        filled = self.counts > 0
        apart = np.abs(self.said - self.true)[filled]
        return float(apart @ self.counts[filled] / self.counts.sum()) if filled.any() else np.nan


def binned(said: Array, true: Array, edges: Array) -> Bins:
    """Frames in bins between edges (K + 1,); the outer ones take what lies beyond."""
    which = np.clip(np.digitize(said, edges) - 1, 0, len(edges) - 2)
    counts = np.bincount(which, minlength=len(edges) - 1)
    with np.errstate(invalid="ignore"):
        means = [np.bincount(which, values, len(edges) - 1) / counts for values in (said, true)]
    return Bins(counts, *means)


def recoveries(answers: Answers) -> list[float]:
    """Frames from each time when the whole target can be seen again, after none of it could, until it is tracked.

    A right pose in that very frame makes 0. Infinite where the target goes again, or the clip ends, before; a return in
    the clip's very last frames does not count.
    """
    found = answers.tracked & (answers.errors < THRESHOLDS.wrong_px)
    times, away, since = [], False, None
    for index, share in enumerate(answers.share):
        if share == 0:
            if since is not None:
                times.append(np.inf)
            away, since = True, None
        elif away and share >= THRESHOLDS.whole_share:
            away, since = False, index if index + THRESHOLDS.soon_frames < len(found) else None
        if since is not None and found[index]:
            times.append(float(index - since))
            since = None
    return [*times, np.inf] if since is not None else times


def figures(several: Many[Answers]) -> dict[str, float]:
    """The numbers of a table, of all frames of several clips; NaN where nothing was there to tell.

    Keys:
        frames: how many. tracked: share of them.
        false tracked: share of the tracked frames whose pose is wrong, or in which nothing of the target is seen.
        false lost: share of the frames with the target well seen that were said to be lost.
        returns: how often it came back. found soon: share of these within 3 frames. frames to find: median.
        cells: area under the ROC curve of the visibility of cells in the frame, where the pose is right.
        precision, recall: of cells taken to be seen, the same cells.
        confidence error: expected calibration error against the share of the target in the frame that is truly seen.
        within 2 deviations: share of the tracked frames.
    """
    tracked, wrong, lost, well_seen = (
        np.concatenate(flags)
        for flags in (
            [a.tracked for a in several],
            [a.wrong for a in several],
            [a.states == "lost" for a in several],
            [a.share >= THRESHOLDS.well_seen_share for a in several],
        )
    )
    times = np.array([time for a in several for time in recoveries(a)])
    said, true = cells(several)
    errors, deviations = (np.concatenate([getattr(a, n)[a.tracked] for a in several]) for n in ("errors", "deviations"))
    return {
        "frames": float(len(tracked)),
        "tracked": _mean(tracked),
        "false tracked": _mean(wrong[tracked]),
        "false lost": _mean(lost[well_seen]),
        "returns": float(len(times)),
        "found soon": _mean(times <= THRESHOLDS.soon_frames),
        "frames to find": float(np.median(times)) if len(times) else np.nan,
        "cells": roc_area(said, true),
        "precision": _mean(true[said > 0.5]),
        "recall": _mean(said[true] > 0.5),
        "confidence error": reliability(several).error,
        "within 2 deviations": _mean(errors <= 2 * deviations),
    }


def reliability(several: Many[Answers]) -> Bins:
    """Confidence against the share of the target in the frame that is truly seen: 0 where the pose is wrong."""
    said, true = [], []
    for a in several:
        inside = np.maximum(a.in_frame.sum((1, 2)), 1e-9)
        said.append(a.confidences)
        true.append(np.where(a.wrong, 0, a.seen.sum((1, 2)) / inside))
    return binned(np.concatenate(said), np.concatenate(true), CONFIDENCES)


def precision(several: Many[Answers]) -> Bins:
    """Confidence of tracked frames against the share of them within 5 px."""
    said, errors = (np.concatenate([getattr(a, n)[a.tracked] for a in several]) for n in ("confidences", "errors"))
    return binned(said, (errors <= THRESHOLDS.good_px).astype(float), CONFIDENCES)


def spread(several: Many[Answers]) -> Bins:
    """Deviation of tracked frames against the root of the mean square error, px."""
    said, errors = (np.concatenate([getattr(a, n)[a.tracked] for a in several]) for n in ("deviations", "errors"))
    squares = binned(said**2, errors**2, DEVIATIONS**2)
    return Bins(squares.counts, np.sqrt(squares.said), np.sqrt(squares.true))


def cells(several: Many[Answers]) -> tuple[Array, Flags]:
    """What was said of the cells in the frame, and whether they are seen, of all frames tracked with a right pose."""
    said, true = [], []
    for a in several:
        which = (a.tracked & ~a.wrong)[:, None, None] & (a.in_frame > 0.5)
        said.append(a.visibility[which])
        true.append(a.seen[which] > 0.5)
    return np.concatenate(said), np.concatenate(true)


def _mean(values: NDArray[np.bool_]) -> float:
    return float(values.mean()) if len(values) else np.nan
