"""What a tracker says of a frame, and how surely the corners have to be known for it."""

from dataclasses import dataclass
from typing import Literal, TypeVar, get_args

import numpy as np

from .imaging.arrays import Array

State = Literal["tracked", "held", "lost"]
STATES: tuple[State, ...] = get_args(State)
Sizes = TypeVar("Sizes", float, Array)


@dataclass(frozen=True)
class StateBounds:
    """Standard deviations of the corners up to which a pose may be called so, px.

    Methods take a target's size, the root of its area, or several (n,), px; and the longer side of its frames, px.
    """

    # Known, for a target of its size: px, or as a share of that size, whichever is more. With what `evidence.is_shown`
    # asks for, it drops one good pose in forty of the drawn clips of `hdn-analyse states`, seeds 1 and 21, and more
    # than half of the wrong ones.
    known_px: float = 1.0
    known_ratio: float = 0.025
    # Sharp, so that an error is hardly seen: px, or as a share of the frame's longer side, whichever is more.
    sharp_px: float = 2.0
    sharp_ratio: float = 3 / 1280
    # Held: px, or as a share of the frame's longer side or of the target's size, whichever is more.
    held_px: float = 8.0
    held_ratio: float = 8 / 1280
    held_size_ratio: float = 0.05

    def known(self, size: Sizes) -> Array:
        """For a target that was found; 'tracked' asks for `sharp` as well."""
        return np.maximum(self.known_px, self.known_ratio * np.asarray(size))

    def sharp(self, frame_side: float) -> float:
        """For a pose that is known to be called 'tracked'."""
        return max(self.sharp_px, self.sharp_ratio * frame_side)

    def held(self, size: Sizes, frame_side: float) -> Array:
        """For a pose to be called 'held'."""
        return np.maximum(max(self.held_px, self.held_ratio * frame_side), self.held_size_ratio * np.asarray(size))


BOUNDS = StateBounds()
