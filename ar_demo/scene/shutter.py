"""Motion blur from the motion: a shutter that is open for a share of each frame draws everything along its way."""

from dataclasses import dataclass

import numpy as np

from hdn.imaging.arrays import Array


@dataclass(frozen=True)
class ShutterModel:
    """How the share of a frame that the shutter is open is told from streaks; lengths are px of the crop."""

    min_motion_px: float = 2.5  # from frame to frame, under which a streak is not told from other blur
    max_share: float = 1.1  # more than that is another blur
    min_share: float = 0.1  # less is taken for none
    remembered: int = 60  # frames


MODEL = ShutterModel()


class Shutter:
    """The share of each frame, 0..1, that a clip's shutter is open; it learns with every frame that moves fast."""

    def __init__(self, degrees: float | None = None) -> None:
        """Args: degrees: of 360, where it is known."""
        self._given = None if degrees is None else degrees / 360
        self._shares: list[float] = []

    @property
    def share(self) -> float:
        """As far as it is known: the median of what was seen; 0 where nothing was."""
        if self._given is not None:
            return self._given
        if not self._shares:
            return 0.0
        share = float(np.median(self._shares))
        return share if share >= MODEL.min_share else 0.0

    def can_learn(self, motion: Array) -> bool:
        """Whether a motion (2,), px from one frame to the next, leaves a streak that tells anything new."""
        return self._given is None and bool(np.linalg.norm(motion) >= MODEL.min_motion_px)

    def learn(self, blur: Array, motion: Array) -> None:
        """Takes a frame into account.

        Args:
            blur: (2, 2) px^2, by which it is blurrier than the reference frame, in all.
            motion: (2,) px from one frame to the next.
        """
        if not self.can_learn(motion):
            return
        length = float(np.linalg.norm(motion))
        along, across = motion / length, np.array([-motion[1], motion[0]]) / length
        # A streak of length L has the variance L^2 / 12 along itself; what is there across as well is want of focus.
        streak = max(float(along @ blur @ along - across @ blur @ across), 0.0)
        self._shares.append(min(np.sqrt(12 * streak) / length, MODEL.max_share))
        del self._shares[: -MODEL.remembered]
