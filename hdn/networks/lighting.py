"""How a plane was lit in its first view: told by what changes over the clip, and by what light looks like.

A pixel of many rectified views is dark for a while where a shadow goes over it, and bright where a lamp is mirrored;
what is printed stays. So a few quantiles over time tell most of it (Weiss, ICCV 2001, takes the median of gradients).
Light that never moves is told by its looks alone. Both a network has learnt from drawn clips; where it is unsure, it
says something between what may be.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..imaging.arrays import Array, Floats, Image
from ..imaging.homography import from_corners
from ..imaging.quads import square
from .config import LIGHT_SIZE, LIGHT_SURFACE
from .engine import Function

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)  # over time, of each pixel
LEVELS = (0.1, 0.5, 0.9)  # quantiles of the frames' brightness against the first one's
INPUTS = 3 + 4 * len(QUANTILES) + 2 + len(LEVELS)  # channels of `summary`
DARKEST = 0.02  # value that ratios are taken with at least
MAX_LEVEL = 3.0  # of the logarithm of brightness
BORDER = round(LIGHT_SIZE * (1 - LIGHT_SURFACE) / 2)  # px around the surface
INNER = slice(BORDER, LIGHT_SIZE - BORDER)


def summary(views: Floats, known: Floats) -> Floats:
    """What many views show, for the network: (B, INPUTS, n, n).

    The first view; each pixel's quantiles over all views, once they are all as bright as the first; these over the
    first view, in grey; how much of the time it is known; where the surface is; and how bright the views are.

    Args:
        views: (B, T, 3, n, n), values 0..1, the first one first.
        known: (B, T, 1, n, n), 0 or 1: where a view shows the plane.
    """
    b, t, _, n, _ = views.shape
    grey = views.mean(2, keepdims=True) + np.float32(DARKEST)
    ratio = np.where(known * known[:, :1] > 0, np.log(grey / grey[:, :1]), np.nan)[..., INNER, INNER]
    with np.errstate(all="ignore"):
        level = np.nan_to_num(_median(ratio.reshape(b, t, -1))).clip(-MAX_LEVEL, MAX_LEVEL).astype(np.float32)  # (B, T)
    alike = views * np.exp(-level)[:, :, None, None, None]
    count = known.sum(1)  # (B, 1, n, n)
    ordered = np.sort(np.where(known > 0, alike, np.float32(np.inf)), axis=1)  # (B, T, 3, n, n)
    first = views[:, 0]
    channels = [2 * first - 1]
    for quantile in QUANTILES:
        at = np.round(quantile * np.maximum(count - 1, 0)).astype(np.int64)[:, None].repeat(3, 2)  # (B, 1, 3, n, n)
        value = np.take_along_axis(ordered, at, 1)[:, 0]
        value = np.where(count > 0, value, first).clip(0, 4)
        grey_ratio = np.log((value.mean(1, keepdims=True) + DARKEST) / (first.mean(1, keepdims=True) + DARKEST))
        channels += [2 * value - 1, grey_ratio.clip(-MAX_LEVEL, MAX_LEVEL)]
    inner = np.zeros((b, 1, n, n), np.float32)
    inner[..., INNER, INNER] = 1
    channels += [count / t, inner]
    for quantile in LEVELS:
        channels.append(np.broadcast_to(np.quantile(level, quantile, axis=1)[:, None, None, None], (b, 1, n, n)))
    return np.concatenate(channels, 1).astype(np.float32)


def _median(values: Array) -> Array:
    """The median over the last axis, of what is a number; NaN for none. As np.nanmedian, many times as fast."""
    ordered = np.sort(values, -1)
    count = np.isfinite(values).sum(-1, keepdims=True)
    return np.asarray(np.take_along_axis(ordered, np.maximum(count - 1, 0) // 2, -1)[..., 0])


@dataclass(frozen=True)
class FirstLight:
    """The light on a plane's first view.

    Attributes:
        gain: (m, m) of the light, as a ratio to full light; what is printed is multiplied by it.
        glare: (m, m) light that is mirrored, 1 being white.
    """

    gain: Floats
    glare: Floats


class Lighting:
    """The network that tells how a first view is lit, whatever runs it; `loading.load_lighting` makes one."""

    def __init__(self, function: Function, description: str) -> None:
        """Args: description: what runs it, as the log says it."""
        self.function, self.description = function, description

    def __call__(self, views: Sequence[Image], known: Sequence[Image]) -> FirstLight:
        """The light in the first of some views.

        Args:
            views: (n, n, 3) RGB, rectified by `to_frame`; the first one first.
            known: (n, n), not 0 where a view shows the plane: within the frame, and not hidden.
        """
        stack = np.stack(views).transpose(0, 3, 1, 2).astype(np.float32)[None] / np.float32(255)
        mask = (np.stack(known) > 0).astype(np.float32)[None, :, None]
        log_gain, glare = self.function(summary(stack, mask))
        return FirstLight(np.exp(log_gain[0, 0, INNER, INNER]), glare[0, 0, INNER, INNER])


def to_frame(quad: Array) -> Array:
    """The homography (3, 3) from a view's pixels to those of a frame in which the surface has the corners (4, 2)."""
    return from_corners(square(LIGHT_SIZE - 2 * BORDER) + BORDER, quad)
