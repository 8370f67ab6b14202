"""The 1 euro filter (Casiez, Roussel and Vogel, CHI 2012) on a quad: what live use has in place of smoothing.

A low-pass whose cutoff rises with speed: at rest, where jitter shows, it smooths; in motion, where lag shows, it
follows.
"""

from dataclasses import dataclass

import numpy as np

from hdn.imaging.arrays import Array

from .motion import MODES


@dataclass(frozen=True)
class OneEuroModel:
    """Cutoffs of the filter.

    Corners that go together at v px/s make 2 v in their mode. So they lag by v / (2 pi (rest_cutoff_hz + 2 slope v))
    px: never by more than 1 px, and from a speed of 1 px a frame on, at 30 frames a second, by less than a frame.

    Attributes:
        rest_cutoff_hz: at rest.
        slope: Hz that the cutoff rises by, per px/s of a mode.
        speed_cutoff_hz: of the low-pass on the speed.
    """

    rest_cutoff_hz: float = 1.0
    slope: float = 0.08
    speed_cutoff_hz: float = 1.0


MODEL = OneEuroModel()


class OneEuro:
    """Filters corners (4, 2), px, mode by mode: where they go together, how they spread, how they bend."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forgets the past, as after a loss."""
        self._time: float | None = None

    def __call__(self, corners: Array, time: float) -> Array:
        """The filtered corners (4, 2); time: seconds, later than that of the call before."""
        modes = MODES @ corners
        if self._time is None:
            self._time, self._modes, self._speed = time, modes, np.zeros_like(modes)
            return corners
        step, self._time = time - self._time, time
        self._speed += _share(MODEL.speed_cutoff_hz, step) * ((modes - self._modes) / step - self._speed)
        cutoff = MODEL.rest_cutoff_hz + MODEL.slope * np.linalg.norm(self._speed, axis=1, keepdims=True)
        self._modes = self._modes + _share(cutoff, step) * (modes - self._modes)
        return MODES.T @ self._modes


def _share(cutoff: float | Array, step: float) -> float | Array:
    """Of a new value in a first-order low-pass, cutoff in Hz, with steps in seconds."""
    return 1 / (1 + 1 / (2 * np.pi * cutoff * step))
