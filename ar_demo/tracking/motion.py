"""How a surface moves in a clip, and how its measurements jitter: what a track itself shows of both.

Corners are taken apart into modes: where they go together, how they spread, how they bend. A camera's shake moves some
modes and not others, noise moves all alike: so the two are told apart by maximum likelihood.
"""

from dataclasses import dataclass

import numpy as np

from hdn.imaging.arrays import Array

from .blocks import solve_wide

MODES = np.array([[1, 1, 1, 1], [1, 1, -1, -1], [1, -1, -1, 1], [1, -1, 1, -1]]) / 2  # orthonormal, over the corners


@dataclass(frozen=True)
class MotionModel:
    """Constants of the estimate."""

    # Ratios of a second difference's variance to a measurement's that are tried: the first and the last power of ten,
    # and how many. The last is motion that nothing is smoothed in, the first a camera on a tripod.
    ratios: tuple[float, float, int] = (-8, 6, 15)
    freedom: float = 4.0  # degrees of freedom of Student's t, by which a few wrong measurements do not matter
    rounds: int = 8  # of the fixed point by which the scale of that is found
    least_noise: float = 0.03  # variance of the noise, in units of that which the measurements claim
    least_px: float = 0.03  # standard deviation of a measurement, at least
    stillest_px: float = 1e-3  # standard deviation of a mode's second difference, at least
    fewest: int = 8  # measurements from which anything is estimated
    unknown_px: float = 10.0  # standard deviation of the second difference, where too few were measured


MODEL = MotionModel()


@dataclass(frozen=True)
class Motion:
    """Attributes:
    variance: (4,) of each mode's second difference, px^2 per frame^4.
    noise: variance by which the measurements jitter, in units of the variance that they claim.
    """

    variance: Array
    noise: float


def mode_variance(covariance: Array) -> Array:
    """(..., 4, 2) of each mode's x and y, by the covariance (..., 8, 8) of x0, y0, x1, ..."""
    axes = np.kron(MODES, np.eye(2))
    return np.asarray(((axes @ covariance) * axes).sum(-1)).reshape(*covariance.shape[:-2], 4, 2)


def in_corners(variance: Array) -> Array:
    """The covariance (..., 8, 8) of x0, y0, x1, ... whose modes have these variances (..., 4)."""
    return np.asarray(np.kron((MODES.T * variance[..., None, :]) @ MODES, np.eye(2)), np.float64)


def estimate_motion(corners: Array, covariance: Array, model: MotionModel = MODEL) -> Motion:
    """The motion and the noise under which the measurements are most likely.

    Noise is in proportion to what is claimed for each mode's x and y: where little of a surface is seen, some
    directions are known far worse than others, and would pass for the noise of all. A measurement that the others do
    not foretell at all (leave-one-out, at the motion that foretells them best) counts for little, by the weights of
    Student's t.

    Args:
        corners: (p, n, 8) px on p ways through n frames, NaN where nothing was measured.
        covariance: (p, n, 8, 8) px^2.
    """
    claimed = np.where(np.isfinite(corners[..., 0]), np.trace(covariance, axis1=2, axis2=3), np.inf)
    best, frames = np.argmin(claimed, 0), np.arange(corners.shape[1])
    seen = np.isfinite(claimed[best, frames])
    if seen.sum() < model.fewest:
        return Motion(np.full(4, model.unknown_px**2), 1.0)
    variance = np.maximum(mode_variance(covariance[best, frames][seen]), model.least_px**2)  # (s, 4, 2)
    typical, ratios = float(np.median(variance)), np.logspace(*model.ratios)
    values, weight = np.zeros((len(frames), 4, 2)), np.zeros((len(frames), 4, 2))
    values[seen] = np.einsum("mc,ncx->nmx", MODES, corners[best, frames][seen].reshape(-1, 4, 2))
    weight[seen] = typical / variance

    fits = _Fits(values, weight, ratios)
    weight[seen] *= fits.trust(model)[..., None]
    fits = _Fits(values, weight, ratios)
    noises = np.maximum(np.unique(fits.noise), model.least_noise * typical)
    noise = max(noises, key=lambda value: float(fits.likelihood(value).max(0).sum()))
    ratio = ratios[fits.likelihood(noise).argmax(0)]
    return Motion(np.maximum(ratio * noise, model.stillest_px**2), float(noise / typical))


class _Fits:
    """Modes smoothed by each of several ratios.

    Attributes:
        noise: (r, 4) variance of the noise, px^2, that fits each ratio and mode best.
    """

    def __init__(self, values: Array, weight: Array, ratios: Array) -> None:
        """Args:
        values: (n, 4, 2). weight: (n, 4, 2) inverse variance of each, in units of the noise's; 0 where there is none.
        ratios: (r,) of the second difference's variance to the noise's.
        """
        n, r = len(values), len(ratios)
        own, after, second = np.zeros((n, r, 4, 2)), np.zeros((n, r, 4, 2)), np.zeros((n, r, 4, 2))
        stiffness = (1 / ratios)[:, None, None]
        own += weight[:, None]
        for shift, factor in enumerate((1, 4, 1)):
            own[shift : n - 2 + shift] += factor * stiffness
        after[: n - 2] -= 2 * stiffness
        after[1 : n - 1] -= 2 * stiffness
        second[: n - 2] += stiffness
        weighed = np.broadcast_to((weight * values)[:, None, ..., None, None], (n, r, 4, 2, 1, 1))
        own, after, second = (blocks[..., None, None] for blocks in (own, after, second))
        found = solve_wide(own, after, second, weighed)

        seen = weight[:, 0, 0] > 0
        self.weight = weight[seen, None]  # (s, 1, 4, 2)
        self.errors = (values[:, None] - found.mean[..., 0, 0])[seen]  # (s, r, 4, 2)
        self.left = np.clip(1 - found.covariance[seen, ..., 0, 0] * self.weight, 1e-9, 1)  # (s, r, 4, 2)
        self.squares = ((weight * values)[seen, None] * self.errors).sum((0, 3))  # (r, 4)
        self.log_spread = found.log_determinant.mean(-1) + (n - 2) * np.log(ratios)[:, None]
        self.count = int(seen.sum()) - 2  # two values set where the motion begins and how fast
        self.noise = self.squares / (2 * self.count)

    def likelihood(self, noise: float) -> Array:
        """(r, 4) its logarithm, for a variance of the noise, px^2."""
        return -self.log_spread - self.count * np.log(noise) - self.squares / (2 * noise)

    def trust(self, model: MotionModel) -> Array:
        """(s, 4) 0..1, how well each value is foretold by all others, by the ratio that does so best."""
        square = (np.square(self.errors) * self.weight / self.left).sum(-1)  # of the leave-one-out errors, (s, r, 4)
        scale = np.median(square, axis=0) / 2
        nu = model.freedom
        for _ in range(model.rounds):
            scale = ((nu + 2) / (nu + square / np.maximum(scale, 1e-12)) * square).mean(0) / 2
        scale = np.maximum(scale, 1e-12)
        log = np.log(scale / (self.weight * self.left).prod(-1) ** 0.5) + (nu / 2 + 1) * np.log1p(square / (nu * scale))
        best = log.sum(0).argmin(0)[None, None]
        chosen = np.take_along_axis(square / scale, best, 1)[:, 0]
        return np.asarray((nu + 2) / (nu + chosen))
