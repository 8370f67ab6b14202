"""What a tracker must be able to do, to be used for a surface in place of HDN's."""

import logging
from collections.abc import Callable
from typing import Protocol

from hdn import Observation, Tracker
from hdn.imaging.arrays import Array
from hdn.imaging.regions import EVERYWHERE, Region
from hdn.state import State

from ..options import TrackingOptions

log = logging.getLogger(__name__)


class Estimate(Protocol):
    """A tracker's answer for one frame; `hdn.Estimate` is one.

    One may also have `covariance`, (8, 8) px^2 of the corners x0, y0, x1, ..., in place of a deviation that is the same
    for all of them, and `step`, the motion measured since the frame seen before: its `homography` (3, 3), pixels of
    that frame to this one's, and the `covariance` (8, 8) px^2 of the corners moved by it; or None.
    """

    @property
    def corners(self) -> Array:
        """(4, 2) px, the best guess where the target is not seen."""

    @property
    def state(self) -> State:
        """'tracked', 'held' while the target is followed by little or nothing, or 'lost'."""

    @property
    def confidence(self) -> float:
        """0..1."""

    @property
    def deviation(self) -> float:
        """Standard deviation of the corners, px; infinite where they were not measured."""


class PlanarTracker(Protocol):
    """Follows one planar target. Frames are shared by the trackers of all surfaces: `frame.image` is RGB (H, W, 3)."""

    def init(self, frame: Observation, quad: Array, region: Region = EVERYWHERE) -> None:
        """Takes the target: its quad (4, 2), px, in the reference frame, and where on its plane to look.

        Raises:
            InputError: a quad or a region that cannot be tracked.
        """

    def place(self, homography: Array) -> None:
        """Goes on from a known pose: (3, 3), reference-frame pixels to those of the frame before the next."""

    def lose(self) -> None:
        """Counts the target as lost, as after a cut: the next frame is searched as a whole."""

    def track(self, frame: Observation) -> Estimate:
        """Finds the target in the next frame, which may be that of the pose it was placed at."""


MakeTracker = Callable[[], PlanarTracker]  # called once for each surface, and once more for a second pass


def hdn_trackers(options: TrackingOptions) -> MakeTracker:
    """HDN's trackers, which share one set of networks.

    Raises:
        InputError: weights missing or of another architecture, no such device.
    """
    engine = Tracker(options.weights, options.device).engine
    log.info("networks run on %s", engine.description)
    return lambda: Tracker(engine=engine)
