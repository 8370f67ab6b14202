"""One estimate of a surface's corners in all frames of a shot, from everything that was measured in it.

The unknowns are the corners x_k (8,) of each frame k: x0, y0, x1, y1, ..., px. Five kinds of terms hold them:

- *absolute*: a tracker's corners z_k with their covariance. Its errors e_k = z_k - x_k last: they are a first-order
  autoregression, whose likelihood is a sum of terms in e_k and of
- *relative* terms in e_k+1 - e_k. So the error that a hand or a shadow causes arises, and goes, where the uncertainty
  does, or where the corners leap.
- *steps*: x_k+1 = H_k(x_k), the motion measured from frame to frame; as sure as they prove where a tracker is.
- *motion*: the second difference of the corners, mode by mode, is as small as the clip shows (see `motion.py`), but for
  frames in which the measurements show more.
- *reference*: the quad, which says what the surface is and so is exact; *clicked*: corners in other frames, as well as
  a hand can set them. Where they are further from all else than a hand errs, the rest is wrong.

Absolute terms and steps may be wrong: each has the robust cost of Geman and McClure, and graduated non-convexity (Black
and Rangarajan, 1996; Yang et al., 2020) finds which are, by reweighted least squares. Several ways through a frame
share its picture and so their errors: together they weigh as much as one, in the proportions in which they agree with
all else. So do their steps.
"""

from collections.abc import Iterator, Set
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hdn.imaging.arrays import Array

from .blocks import solve_wide
from .motion import MODES, Motion, estimate_motion, in_corners, mode_variance

CORNERS = 8  # numbers per frame


@dataclass(frozen=True)
class JointModel:
    """Constants of the joint solution."""

    # Squared Mahalanobis distance from which a leap of the measurements counts as an error that arises there or ends.
    leap_limit: float = 50.0
    bend_limit: float = 10.0  # the like for a mode, of two numbers; as a mean of their squares
    # Standard deviation that is granted to corners before they count for less, and before they are told to be wrong:
    # what they are measured from is set by hand and no surer, and less is hardly seen.
    agreement_px: float = 0.5
    told_px: float = 1.5
    reference_px: float = 0.01  # standard deviation of the quad's coordinates, next to nothing
    clicked_px: float = 2.0  # standard deviation of a corner set by hand, of both its coordinates together
    # Distance of clicked corners from what was measured, root of the mean square, up to which the hand erred. Of errors
    # of 2 px and of a tracker's of some 30, which are rarer, the latter are likelier from 5 px on.
    slip_px: float = 5.0
    bridging: float = 1e-4  # factor on the motion's term in gaps, where it is to bridge them and no more
    least_px: float = 0.03  # standard deviation that each measured coordinate has at least: no tracker is surer
    # Squared Mahalanobis distance of eight numbers at which a term has lost three quarters of its weight: 99.9 % of
    # the right ones are below it. A step rests on the picture alone and on no memory, so it yields last.
    absolute_limit: float = 26.0
    step_limit: float = 1000.0
    step_test_frames: int = 16  # over which steps are put together, to see what they are worth
    cooling: float = 2.0  # factor from one round to the next by which the limits, wide at first, become narrower
    carried_weight: float = 1e-3  # of the other measurements where the steps lead
    last_rounds: int = 4  # with the limits as they are
    longest_memory: float = 0.97  # correlation of a tracker's errors in neighbouring frames, at most
    # The same where steps were measured, since little of the surface is seen: what errs there changes quickly.
    hard_memory: float = 0.6
    # Factor on the steps' covariance: neighbouring steps err alike, so that their errors add up faster than their sum.
    step_variance_ratio: float = 4.0
    unknown_px: float = 1e3  # standard deviation of corners that nothing else holds
    wrong_weight: float = 0.25  # of a robust term, 0..1, below which it counts as wrong


MODEL = JointModel()


@dataclass(frozen=True)
class Measurements:
    """What was measured in the n frames of a shot, on p ways through it; NaN where nothing was.

    Attributes:
        corners: (p, n, 8) px. covariance: (p, n, 8, 8) px^2.
        linked: (p, n - 1) whether a way has frames k and k + 1 from one run of a tracker.
        steps: (p, n - 1, 3, 3) pixels of frame k to those of frame k + 1. step_covariance: (p, n - 1, 8, 8) px^2, of
            the corners moved by them.
        reference: corners (8,) that are known, by frame. clicked: corners (8,) set by hand, by frame.
    """

    corners: Array
    covariance: Array
    linked: NDArray[np.bool_]
    steps: Array
    step_covariance: Array
    reference: dict[int, Array]
    clicked: dict[int, Array]


@dataclass(frozen=True)
class Solution:
    """The corners of n frames.

    Attributes:
        corners: (n, 8) px. covariance: (n, 8, 8) px^2.
        weight: (p, n) 0..1 of each measurement: how well it agrees with all else; 0 where there is none.
    """

    corners: Array
    covariance: Array
    weight: Array


class _System:
    """The normal equations of n frames, in blocks of one frame that reach two frames further."""

    def __init__(self, n: int) -> None:
        self.own, self.after, self.second = (np.zeros((n, CORNERS, CORNERS)) for _ in range(3))
        self.right = np.zeros((n, CORNERS))

    def solve(self) -> tuple[Array, Array]:
        """By how much the corners (n, 8) are to be moved, and their covariances (n, 8, 8)."""
        found = solve_wide(self.own, self.after, self.second, self.right[..., None])
        return found.mean[..., 0], found.covariance

    def response(self, frame: int, information: float) -> Array:
        """(n,) how far the corners move with those of a frame that are held by so much information, 1 for as far."""
        right = np.zeros_like(self.right)
        right[frame] = information
        return np.asarray(solve_wide(self.own, self.after, self.second, right[..., None]).mean[..., 0].mean(1))


class Shot:
    """The joint solution of one shot.

    Example:
        solution = Shot(measurements).solve()
    """

    def __init__(self, measured: Measurements, model: JointModel = MODEL) -> None:
        self.measured, self.model = measured, model
        self.motion: Motion = estimate_motion(measured.corners, measured.covariance)
        self.memory = float(np.clip(1 - self.motion.noise, 0.01, model.longest_memory))
        self._prepare()

    def solve(self, strength: float = 1.0) -> Solution:
        """Args:
        strength: of the motion's term, a factor on how sure it is; 0 leaves it to frames without a good measurement.
            What is told of the corners' certainty does not depend on it.
        """
        x = self._settled()
        firm = {k for k, c in self.measured.clicked.items() if np.square(x[k] - c).sum() / 4 > self.model.slip_px**2}
        if firm:
            x = self._settled(firm)
        weights = self._weights(self._distances(x), 1.0)
        system = self._assemble(x, weights, self._usual, firm)
        change, covariance = system.solve()
        for k in firm:  # which err like all that is clicked, and with them what hangs on them
            share = system.response(k, 1 / self.model.reference_px**2)
            covariance += np.square(share)[:, None, None] * self.model.clicked_px**2 / 2 * np.eye(CORNERS)
        found = Solution(x + change, covariance, self._told(x + change))
        if strength == 1 or self.n < 3:
            return found
        seen = _any(found.weight > self.model.wrong_weight)
        around = seen[:-2] & seen[1:-1] & seen[2:]
        smoothing = np.where(around, strength**2, max(strength**2, self.model.bridging))
        return replace(found, corners=x + self._assemble(x, weights, smoothing, firm).solve()[0])

    def _settled(self, firm: Set[int] = frozenset()) -> Array:
        """The corners (n, 8) by all that proves right; firm: frames whose clicked corners are taken for exact.

        Where something contradicts it, most of the measurements may err alike, as those that follow what has moved in
        front. So each way is started from as well, and the steps are, and what all contradicts least is right.
        """
        start = self._start()
        x = start + self._assemble(start, self._weights(self._distances(start), np.inf), self._usual, firm).solve()[0]
        squares = self._distances(x)
        hottest = max(float(squares[i].max(initial=0)) / limit for i, limit in zip((0, 2), self._limits, strict=True))
        x = self._cooled(x, firm, int(np.ceil(np.log(max(hottest, 1)) / np.log(self.model.cooling))))
        disbelieved = self.seen & (self._told(x) < self.model.wrong_weight)
        torn = self._robust(self._distances(x)[2], self.model.step_limit) < self.model.wrong_weight
        if not disbelieved.any() and not torn.any():
            return x
        along = [np.where(seen[:, None], z, x) for z, seen in zip(self.z, self.seen, strict=True)]
        settled = [x, *(self._cooled(start, firm) for start in (self._carried(x, firm), *along))]
        return min(settled, key=lambda x: self._contradiction(x, firm))

    def _carried(self, x: Array, firm: Set[int]) -> Array:
        """Corners (n, 8) by the steps, as far as there are any, on which the measurements only lie loosely."""
        absolute, relative, steps = self._weights(self._distances(x), np.inf)
        loosely = absolute * self.model.carried_weight, relative * self.model.carried_weight, steps
        return np.asarray(x + self._assemble(x, loosely, self._usual, firm).solve()[0])

    def _cooled(self, x: Array, firm: Set[int], rounds: int = 0) -> Array:
        """Corners x (n, 8) after as many rounds with ever narrower limits, and some with the limits as they are."""
        squares = self._distances(x)
        for heat in [*self.model.cooling ** np.arange(rounds, 0, -1), *[1.0] * self.model.last_rounds]:
            x = x + self._assemble(x, self._weights(squares, heat), self._usual, firm).solve()[0]
            squares = self._distances(x)
        return x

    def _given(self, firm: Set[int]) -> Iterator[tuple[int, Array, float]]:
        """Corners (8,) that are known or clicked, by frame, and the information on each coordinate, 1 / px^2."""
        for k, corners in self.measured.reference.items():
            yield k, corners, 1 / self.model.reference_px**2
        for k, corners in self.measured.clicked.items():
            yield k, corners, 1 / self.model.reference_px**2 if k in firm else 2 / self.model.clicked_px**2

    def _contradiction(self, x: Array, firm: Set[int]) -> float:
        """Of corners x (n, 8) with all that is given, measured on the way that fits best in each frame, and the motion.

        The sum of squared Mahalanobis distances, those of robust terms no larger than their limits.
        """
        absolute, relative, steps = (
            np.where(information[..., 0, 0] > 0, square, np.inf)
            for square, information in zip(
                self._distances(x), (self.agreement, self.change_information, self.step_information), strict=True
            )
        )
        told = [
            _saturated(absolute, self.model.absolute_limit).min(0),
            relative.min(0),
            _saturated(steps, self.model.step_limit).min(0),
            _square(np.diff(x, 2, axis=0), self.motion_information),
            np.array([np.square(corners - x[k]).sum() * information for k, corners, information in self._given(firm)]),
        ]
        return sum(float(np.where(np.isfinite(square), square, 0.0).sum()) for square in told)

    def _told(self, x: Array) -> Array:
        """(p, n) how well each measurement agrees with corners (n, 8)."""
        granted = self.measured.covariance + self.model.told_px**2 * np.eye(CORNERS)
        return self._robust(_square(self.z - x, _inverse(granted, self.seen)), self.model.absolute_limit) * self.seen

    @property
    def n(self) -> int:
        return self.measured.corners.shape[1]

    @property
    def _usual(self) -> Array:
        """The motion's weight (n - 2,) where nothing else is asked for."""
        return np.ones(self.n - 2)

    @property
    def _limits(self) -> tuple[float, float]:
        return self.model.absolute_limit, self.model.step_limit

    def _prepare(self) -> None:
        """Information matrices of all terms, 0 where there is no measurement."""
        z, model = self.measured.corners, self.model
        self.seen: NDArray[np.bool_] = np.asarray(np.isfinite(z).all(-1))
        variance = self.measured.covariance * max(self.motion.noise, 1.0) + model.least_px**2 * np.eye(CORNERS)
        self.information = _inverse(variance, self.seen)
        self.agreement = _inverse(variance + model.agreement_px**2 * np.eye(CORNERS), self.seen)
        stepped = np.asarray(np.isfinite(self.measured.step_covariance).all((2, 3)))
        # An autoregression's terms in e_k: all there is for a lone frame, less for one with a neighbour or with two.
        linked = self.measured.linked & self.seen[:, :-1] & self.seen[:, 1:]
        p = np.where(stepped, min(self.memory, model.hard_memory), self.memory)
        explained = linked * (p / (1 + p))
        self.share = 1 - np.pad(explained, ((0, 0), (0, 1))) - np.pad(explained, ((0, 0), (1, 0)))
        self.steps = np.where(stepped[..., None, None], self.measured.steps, np.eye(3))
        step_variance = _or_zero(self.measured.step_covariance) + model.least_px**2 * np.eye(CORNERS)
        step_variance *= model.step_variance_ratio * self._step_scale(stepped, step_variance, variance)
        self.step_information = _inverse(step_variance, stepped)
        # And those in e_k+1 - e_k. Where the uncertainty changes, the error may change as much; and where the corners
        # leap, by as much as they do.
        deviation = np.sqrt(np.trace(np.where(self.seen[..., None, None], variance, 0), axis1=2, axis2=3) / CORNERS)
        growth = np.square(np.diff(deviation, axis=1))[..., None, None] * np.eye(CORNERS)
        spread = (variance[:, :-1] + variance[:, 1:]) / 2 * ((1 - p**2) / p)[..., None, None] + growth
        self.change = np.where(linked[..., None], np.diff(z, axis=1), 0.0)
        self.change_information = _inverse(spread + self._leaps(linked, stepped, spread, step_variance), linked)
        self.z = np.where(self.seen[..., None], z, 0.0)
        self.motion_information = self._motion_information(linked, variance)

    def _step_scale(self, stepped: NDArray[np.bool_], step_variance: Array, variance: Array) -> float:
        """Factor, at least 1, on the steps' covariance: by how much a row of them errs where the corners are known.

        Steps that follow something else than the surface err alike from frame to frame, which shows after several.
        """
        z, n = self.measured.corners, self.n
        if not stepped.any():
            return 1.0
        spread = np.where(
            self.seen, np.trace(np.where(self.seen[..., None, None], variance, 0), axis1=2, axis2=3), np.inf
        )
        frames = np.arange(n)
        corners, error = z[spread.argmin(0), frames], spread.min(0)
        each = np.where(stepped, np.trace(step_variance, axis1=2, axis2=3), np.inf)
        steps, each = self.steps[each.argmin(0), frames[:-1]], each.min(0)  # the surest to each frame
        carried, grown, scales = np.nan_to_num(corners[:-1]), np.zeros(n - 1), [1.0]
        usable = np.isfinite(error[:-1])
        for length in range(1, min(self.model.step_test_frames, n - 1) + 1):
            count = n - length
            carried = move(steps[length - 1 :], carried[:count])[0]
            grown = grown[:count] + each[length - 1 :]
            usable = usable[:count] & np.isfinite(each[length - 1 :])
            chosen = usable & np.isfinite(error[length:])
            if chosen.sum() >= self.model.step_test_frames:
                known = (error[:count] + error[length:])[chosen] * (1 - self.memory**length)
                off = np.square(carried - corners[length:]).sum(-1)[chosen]
                scales.append(float(np.median((off - known) / grown[chosen])))
        return max(scales)

    def _leaps(
        self, linked: NDArray[np.bool_], stepped: NDArray[np.bool_], spread: Array, step_variance: Array
    ) -> Array:
        """(p, n - 1, 8, 8) px^2, what a measurement's change from a frame to the next may be wrong by, for all to see.

        It is compared with the step, or where there is none with the changes before and after, the more alike counting:
        so a leap shows, and not where motion sets in.
        """
        z, change = self.measured.corners, self.change
        moved = move(self.steps, np.where(np.isfinite(z), z, 0.0)[:, :-1])[0] if stepped.any() else z[:, :-1]
        unlike_step = np.where((linked & stepped)[..., None], z[:, 1:] - moved, 0.0)
        bend = np.where((linked[:, :-1] & linked[:, 1:])[..., None], np.diff(change, axis=1), 0.0)
        before, after = np.pad(bend, ((0, 0), (1, 0), (0, 0))), np.pad(bend, ((0, 0), (0, 1), (0, 0)))
        is_before = np.square(before).sum(-1) < np.square(after).sum(-1)
        unlike_motion = np.where(is_before[..., None], before, after)
        excess = np.where(stepped[..., None], unlike_step, unlike_motion)
        expected = np.where(stepped[..., None, None], step_variance, in_corners(self.motion.variance))
        square = _square(excess, _inverse(spread + expected, linked))
        return (square > self.model.leap_limit)[..., None, None] * (
            np.square(excess).mean(-1)[..., None, None] * np.eye(CORNERS)
        )

    def _motion_information(self, linked: NDArray[np.bool_], variance: Array) -> Array:
        """(n - 2, 8, 8) of the second difference; a mode that bends more in all measurements is expected to."""
        usual, known = self.motion.variance, linked[:, :-1] & linked[:, 1:]
        bend = np.where(known[..., None], np.diff(self.change, axis=1), 0.0)
        square = np.square(np.einsum("mc,pncx->pnmx", MODES, bend.reshape(*bend.shape[:2], 4, 2))).mean(-1)
        jitter = mode_variance(variance[:, :-2] + 4 * variance[:, 1:-1] + variance[:, 2:]).mean(-1)
        jitter = np.where(known[..., None], jitter * min(self.motion.noise, 1.0), np.inf)
        is_less = square <= self.model.bend_limit * (usual + jitter)
        least = np.where(known[..., None], square, np.inf).min(0)
        return in_corners(1 / (usual + np.where(_any(known)[:, None] & ~_any(is_less & known[..., None]), least, 0.0)))

    def _start(self) -> Array:
        """(n, 8) corners to begin with: the measurements weighed by their certainty, in gaps between them."""
        certainty = self.seen / np.maximum(np.trace(self.measured.covariance, axis1=2, axis2=3), 1e-6)
        certainty = np.where(self.seen, certainty, 0.0)
        x = np.einsum("pn,pnc->nc", certainty, self.z) / np.maximum(certainty.sum(0), 1e-30)[:, None]
        known = certainty.sum(0) > 0
        for k, corners in (self.measured.clicked | self.measured.reference).items():
            x[k], known[k] = corners, True
        frames = np.arange(self.n)
        return np.stack([np.interp(frames, frames[known], x[known, c]) for c in range(CORNERS)], 1)

    def _distances(self, x: Array) -> tuple[Array, Array, Array]:
        """Squared Mahalanobis distances of the absolute, relative and step terms."""
        error = self.z - x
        change = self.change - np.diff(x, axis=0)
        moved, _ = move(self.steps, x[:-1])
        return (
            _square(error, self.agreement),
            _square(change, self.change_information),
            _square(x[1:] - moved, self.step_information),
        )

    def _robust(self, square: Array, limit: float, heat: float = 1.0) -> Array:
        return np.square(1 / (1 + square / (limit * heat)))

    def _weights(self, squares: tuple[Array, Array, Array], heat: float) -> tuple[Array, Array, Array]:
        absolute, steps = (
            self._robust(square, limit, heat)
            for square, limit in zip((squares[0], squares[2]), self._limits, strict=True)
        )
        absolute *= _proportions(squares[0], self.agreement, heat)
        steps *= _proportions(squares[2], self.step_information, heat)
        return absolute, _proportions(squares[1], self.change_information, heat), steps

    def _assemble(
        self, x: Array, weights: tuple[Array, Array, Array], smoothing: Array, firm: Set[int] = frozenset()
    ) -> _System:
        """The normal equations; all terms are linearised about the corners x (n, 8). See `_settled` for firm."""
        system, n = _System(self.n), self.n
        absolute, relative, steps = weights

        held = (absolute * self.share)[..., None, None] * self.information
        system.own += held.sum(0) + np.eye(CORNERS) / self.model.unknown_px**2
        system.right += _times(held, self.z - x).sum(0)
        for k, corners, information in self._given(firm):
            system.own[k] += np.eye(CORNERS) * information
            system.right[k] += (corners - x[k]) * information

        held = relative[..., None, None] * self.change_information
        told = _times(held, self.change - np.diff(x, axis=0)).sum(0)
        held = held.sum(0)
        system.own[:-1] += held
        system.own[1:] += held
        system.after[: n - 1] -= held
        system.right[:-1] -= told
        system.right[1:] += told

        moved, slope = move(self.steps, x[:-1])
        held = steps[..., None, None] * self.step_information
        told = _times(held, moved - x[1:])
        back = np.swapaxes(slope, -1, -2)
        system.own[:-1] += (back @ held @ slope).sum(0)
        system.own[1:] += held.sum(0)
        system.after[: n - 1] -= (back @ held).sum(0)
        system.right[:-1] -= _times(back, told).sum(0)
        system.right[1:] += told.sum(0)

        held = smoothing[:, None, None] * self.motion_information
        told = _times(held, -np.diff(x, 2, axis=0))
        for shift, factor in enumerate((1, -2, 1)):
            system.own[shift : n - 2 + shift] += factor**2 * held
            system.right[shift : n - 2 + shift] += factor * told
        system.after[: n - 2] -= 2 * held
        system.after[1 : n - 1] -= 2 * held
        system.second[: n - 2] += held
        return system


def move(homographies: Array, corners: Array) -> tuple[Array, Array]:
    """Corners (..., 8) moved by homographies (..., 3, 3), and the derivative (..., 8, 8)."""
    homographies = homographies[..., None, :, :]  # the same for each corner
    xy = corners.reshape(*corners.shape[:-1], 4, 2)
    h = (homographies[..., :2] @ xy[..., None])[..., 0] + homographies[..., 2]
    w = h[..., 2:]
    to = h[..., :2] / w
    slope = (homographies[..., :2, :2] - to[..., None] * homographies[..., 2:, :2]) / w[..., None]
    full = np.zeros((*to.shape[:-2], 4, 2, 4, 2))
    for c in range(4):
        full[..., c, :, c, :] = slope[..., c, :, :]
    moved = to.reshape(*to.shape[:-2], CORNERS)
    return moved, full.reshape(*moved.shape, CORNERS)


def _saturated(square: Array, limit: float) -> Array:
    """Geman and McClure's cost of squared distances, at most the limit."""
    return np.asarray(limit * np.divide(square, limit + square, out=np.ones_like(square), where=np.isfinite(square)))


def _any(flags: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether any way says so."""
    return np.asarray(flags.any(0))


def _or_zero(values: Array) -> Array:
    return np.where(np.isfinite(values), values, 0.0)


def _inverse(covariance: Array, known: NDArray[np.bool_]) -> Array:
    """Of matrices (..., 8, 8); 0 where they are not known."""
    inverse = np.linalg.inv(np.where(known[..., None, None], covariance, np.eye(CORNERS)))
    return np.where(known[..., None, None], inverse, 0.0)


def _square(error: Array, information: Array) -> Array:
    return np.asarray((error * _times(information, error)).sum(-1))


def _times(matrix: Array, vector: Array) -> Array:
    """Products of stacked matrices (..., 8, 8) and vectors (..., 8)."""
    return (matrix @ vector[..., None])[..., 0]


def _proportions(square: Array, information: Array, heat: float) -> Array:
    """(p, n) shares of alternatives, sum 1 in each frame: by their likelihood, the more alike the greater the heat."""
    known = information[..., 0, 0] > 0
    volume = np.linalg.slogdet(np.where(known[..., None, None], information, np.eye(CORNERS)))[1]
    log = np.where(known, (volume - square) / (2 * heat), -np.inf)
    top = log.max(0, initial=-1e300)
    likelihood = np.exp(log - top)
    return likelihood / np.maximum(likelihood.sum(0), 1e-30)
