"""Going through a video once, forward or backward, with the trackers of several surfaces."""

from collections.abc import Callable, Iterable, Sequence

from hdn import Observation
from hdn.imaging.arrays import Array, Picture
from hdn.imaging.homography import from_corners
from hdn.state import State

from ..media.reader import Frame
from ..stopping import Steps
from .cuts import CutDetector
from .protocol import PlanarTracker
from .runs import Run

Show = Callable[[tuple[State | None, ...], Picture, int, tuple[Array | None, ...]], None]


class Follower:
    """A surface's tracker on its runs, which come one after the other in one direction."""

    def __init__(self, tracker: PlanarTracker, quad: Array, runs: Iterable[Run]) -> None:
        """Args:
        tracker: it has its target. quad: (4, 2) the target in the reference frame, px.
        runs: in any order.
        """
        self.tracker, self.quad = tracker, quad
        self.runs = sorted(runs, key=lambda run: -run.anchor if run.backward else run.anchor)
        self._current: Run | None = None
        self._next = 0

    def is_active(self, index: int) -> bool:
        """Whether a run goes through this frame, or begins there."""
        return self._current is not None or self._begins(index)

    def see(self, index: int, frame: Observation, cut: bool, damaged: bool = False) -> None:
        """Takes the next frame.

        Args:
            cut: whether it is of another shot than the one before.
            damaged: whether its picture may be wrong: it is tracked, and counts for less.
        """
        if self._current is not None:
            if cut:
                self.tracker.lose()
            if not self._current.add(self.tracker.track(frame), damaged):
                self._current = None
        if self._begins(index):
            run = self.runs[self._next]
            self._next += 1
            self.tracker.place(from_corners(self.quad, run.pose))
            self._current = run if run.add(self.tracker.track(frame), damaged) else None

    @property
    def state(self) -> State | None:
        """Of the frame just seen, None outside all runs."""
        return None if self._current is None else self._current.estimates[-1].state

    @property
    def corners(self) -> Array | None:
        """(4, 2) px in the frame just seen, as measured; None outside all runs."""
        return None if self._current is None else self._current.estimates[-1].corners

    def _begins(self, index: int) -> bool:
        return self._next < len(self.runs) and self.runs[self._next].anchor == index


def sweep(frames: Iterable[Frame], followers: Sequence[Follower], cuts: set[int], show: Show) -> Steps[int]:
    """Shows frames to all followers; each is decoded and prepared once.

    Args:
        cuts: those found are added, by the frame that they begin with.
        show: called after each frame with the surfaces' states, the frame, its index, and the surfaces' corners.

    Returns:
        Index of the frame after the latest that was seen.
    """
    detector = CutDetector()
    last = end = -1
    for frame in frames:
        active = [follower for follower in followers if follower.is_active(frame.index)]
        if active:
            seen = Observation(frame.image)
            # What a damaged file shows is now and then like nothing before it.
            cut = not frame.damaged and detector.is_cut(frame.index, seen.grey)
            if cut:
                cuts.add(max(frame.index, last))
            for follower in active:
                follower.see(frame.index, seen, cut, frame.damaged)
        last, end = frame.index, max(end, frame.index)
        now = [follower if follower in active else None for follower in followers]
        states = tuple(None if follower is None else follower.state for follower in now)
        show(
            states, frame.image, frame.index, tuple(None if follower is None else follower.corners for follower in now)
        )
        yield
    return end + 1


def backward_stretches(runs: Iterable[Run]) -> list[tuple[int, int]]:
    """Stretches of frames (first, last), the last one first, that backward runs go through."""
    found: list[tuple[int, int]] = []
    for run in sorted(runs, key=lambda run: -run.anchor):
        low, high = run.stop or 0, run.anchor
        if found and high >= found[-1][0]:
            found[-1] = min(low, found[-1][0]), found[-1][1]
        else:
            found.append((low, high))
    return found
