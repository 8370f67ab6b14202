"""Smoothing of a whole track, forward and backward, so that it neither jitters nor lags.

A Kalman filter with constant velocity runs over the corners, and the Rauch-Tung-Striebel pass (1965) back over it. How
much it smooths is not guessed: motion and noise are those under which the track itself is most likely.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hdn.imaging.arrays import Array

from ..tracks import Track

MODES = np.array([[1, 1, 1, 1], [1, 1, -1, -1], [1, -1, -1, 1], [1, -1, 1, -1]]) / 2  # orthonormal, over the corners
STEP = np.array([[1.0, 1.0], [0.0, 1.0]])
NOISE_SHAPE = np.array([[1 / 3, 1 / 2], [1 / 2, 1.0]])  # covariance of white acceleration over one frame


@dataclass(frozen=True)
class SmoothingModel:
    """What is assumed of corners before a track is looked at.

    Attributes:
        ratios: of the acceleration's variance (px/frame^2)^2 to the noise's (px^2), that are tried: the first and the
            last power of ten, and how many.
        least_deviation_px: below which no corner is known.
        given_variance: of corners given by hand, where that of a usual measurement is 1.
        speed_variance: of the first frame's speed, (px/frame)^2 in units of a usual measurement's variance.
        fewest: measurements in a segment for it to be smoothed.
    """

    ratios: tuple[float, float, int] = (-4, 4, 13)
    least_deviation_px: float = 0.05
    given_variance: float = 1e-6
    speed_variance: float = 1e4
    fewest: int = 3


MODEL = SmoothingModel()


def smooth(track: Track, strength: float = 1.0, where: NDArray[np.bool_] | None = None) -> Track:
    """The track with its corners smoothed, never across a loss or a cut; given corners stay as they are.

    Corners count as they are certain. Frames that nothing was measured in are bridged by the motion around them; those
    at a segment's end keep its last pose.

    Args:
        strength: 0 leaves the track as it is; 1 smooths by the noise that it shows; more takes it for noisier.
        where: (N,) the frames to be smoothed, the rest being left alone; None takes all.
    """
    if strength == 0:
        return track
    corners = track.corners.copy()
    fixed = np.isfinite(track.deviation) & track.known
    variance = np.maximum(track.deviation, MODEL.least_deviation_px) ** 2
    variance /= np.median(variance[fixed]) if fixed.any() else 1
    given = {i: pose for i, pose in track.given.items() if i < len(track) and fixed[i]}
    variance[list(given)] = MODEL.given_variance
    wanted = np.array([state != "lost" for state in track.states])
    for start, stop in segments((wanted if where is None else wanted & where).tolist(), track.cuts):
        fixes = start + np.flatnonzero(fixed[start:stop])
        if len(fixes) < MODEL.fewest:
            continue
        first, last = fixes[0], fixes[-1] + 1
        corners[first:last] = _smooth_segment(corners[first:last], variance[first:last], strength)
        corners[start:first], corners[last:stop] = corners[first], corners[last - 1]
    for index, pose in given.items():
        if where is None or where[index]:
            corners[index] = pose
    return replace(track, corners=corners)


def segments(flags: list[bool], cuts: Sequence[int] = ()) -> list[tuple[int, int]]:
    """Runs (start, stop) of true flags; cuts: indices before which a run is cut in two."""
    edges = np.flatnonzero(np.diff([0, *map(int, flags), 0]))
    runs = [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return [pair for a, b in runs for pair in pairwise([a, *(c for c in cuts if a < c < b), b])]


def _smooth_segment(corners: Array, variance: Array, strength: float) -> Array:
    """Smooths (N, 4, 2) corners mode by mode: where they go together, how they spread, how they bend.

    A camera's shake moves some modes and not others, noise moves all alike. So the noise is what the calmest mode
    shows, and each mode is smoothed as far as that noise explains it.
    """
    modes = np.einsum("mc,ncx->nmx", MODES, corners)
    trials = [_filter(modes, variance, ratio) for ratio in np.logspace(*MODEL.ratios)]
    noise = min(float(max(trials, key=lambda t: t.likelihood(m)).noise(m)) for m in range(4))
    for m in range(4):
        best = max(trials, key=lambda t: t.likelihood(m, noise))
        modes[:, m] = _backward(_filter(modes[:, m : m + 1], variance, best.ratio / strength**2))[:, 0]
    return np.einsum("mc,nmx->ncx", MODES, modes)


@dataclass
class _Filtered:
    means: Array  # (N, 2, M, 2) position and velocity of each mode's x and y
    covariances: Array  # (N, 2, 2), common to all modes
    predicted: Array  # (N, 2, 2)
    ratio: float
    log_spread: float  # sum over the steps
    squares: Array  # (M,) sum over the steps of the scaled surprises
    count: int

    def noise(self, mode: int) -> float:
        """Variance of the measurement noise, px^2, that fits a mode best."""
        return max(float(self.squares[mode]) / (2 * max(self.count, 1)), 1e-8)

    def likelihood(self, mode: int, noise: float | None = None) -> float:
        """Log-likelihood of a mode, of a given noise or the one that fits best."""
        noise = noise or self.noise(mode)
        return -self.log_spread - self.count * float(np.log(noise)) - float(self.squares[mode]) / (2 * noise)


def _filter(values: Array, variance: Array, ratio: float) -> _Filtered:
    """Kalman filter over (N, M, 2) modes; infinite variance (N,) marks a missing measurement."""
    n = len(values)
    means, covariances, predicted = np.empty((n, 2, *values.shape[1:])), np.empty((n, 2, 2)), np.empty((n, 2, 2))
    mean = np.stack([values[0], np.zeros_like(values[0])])
    covariance = np.diag([variance[0], MODEL.speed_variance])
    log_spread, squares, count = 0.0, np.zeros(values.shape[1]), 0
    for k in range(n):
        if k:
            mean = np.stack([mean[0] + mean[1], mean[1]])
            covariance = STEP @ covariance @ STEP.T + ratio * NOISE_SHAPE
        predicted[k] = covariance
        if k and np.isfinite(variance[k]):
            spread = covariance[0, 0] + variance[k]
            gain = covariance[:, 0] / spread
            surprise = values[k] - mean[0]
            mean = mean + gain[:, None, None] * surprise
            covariance = covariance - np.outer(gain, covariance[0])
            if k > 1:  # the first step only sets the velocity
                log_spread += float(np.log(spread))
                squares += np.square(surprise).sum(1) / spread
                count += 1
        means[k], covariances[k] = mean, covariance
    return _Filtered(means, covariances, predicted, ratio, log_spread, squares, count)


def _backward(f: _Filtered) -> Array:
    """Rauch-Tung-Striebel: positions (N, M, 2) given all measurements."""
    smoothed = f.means[-1]
    positions = np.empty_like(f.means[:, 0])
    positions[-1] = smoothed[0]
    for k in range(len(f.means) - 2, -1, -1):
        gain = f.covariances[k] @ STEP.T @ np.linalg.inv(f.predicted[k + 1])
        predicted = np.stack([f.means[k, 0] + f.means[k, 1], f.means[k, 1]])
        smoothed = f.means[k] + np.einsum("ab,bmx->amx", gain, smoothed - predicted)
        positions[k] = smoothed[0]
    return positions
