"""Going through a video, forward or backward, with trackers of several surfaces at once."""

from collections.abc import Callable, Iterable, Iterator, Sequence

from hdn import Observation, Tracker
from hdn.better_template import TemplateBuilder
from hdn.imaging.homography import from_corners
from hdn.tracker import State

from ..media.reader import Frame
from .cuts import CutDetector
from .runs import Run


class Walker:
    """A surface's tracker on its runs, which follow each other in one direction."""

    def __init__(self, tracker: Tracker, runs: Iterable[Run], builder: TemplateBuilder | None = None) -> None:
        """Args: tracker: it has its target; runs: in any order; builder: is offered all views, None keeps none."""
        self.tracker, self.builder = tracker, builder
        self.runs = sorted(runs, key=lambda run: -run.anchor if run.backward else run.anchor)
        self._now: Run | None = None
        self._next = 0

    def active(self, index: int) -> bool:
        """Whether a run goes through this frame, or begins there."""
        return self._now is not None or self._begins(index)

    def see(self, index: int, frame: Observation, cut: bool) -> None:
        """Takes the next frame; cut: whether it is of another shot than the one before."""
        if self._now is not None:
            if cut:
                self.tracker.lose()
            estimate = self.tracker.track(frame)
            if self.builder is not None:
                self.builder.offer(index, frame, estimate)
            if not self._now.add(estimate):
                self._now = None
        if self._begins(index):
            run = self.runs[self._next]
            self._next += 1
            self.tracker.place(from_corners(self.tracker.quad, run.pose))
            self._now = run if run.add(self.tracker.track(frame)) else None

    @property
    def state(self) -> State | None:
        """Of the frame just seen, None outside all runs."""
        return self._now.estimates[-1].state if self._now else None

    def _begins(self, index: int) -> bool:
        return self._next < len(self.runs) and self.runs[self._next].anchor == index


def walk(frames: Iterator[Frame], walkers: Sequence[Walker], cuts: set[int], show: Callable[[str], None]) -> None:
    """Shows frames to all walkers, decoded and prepared once; adds the cuts found, by the frame that they begin with.

    Args: show: called after each frame with the worst state in it.
    """
    detector = CutDetector()
    last = -1
    for frame in frames:
        awake = [walker for walker in walkers if walker.active(frame.index)]
        if awake:
            seen = Observation(frame.image)
            cut = detector.is_cut(frame.index, seen.grey)
            if cut:
                cuts.add(max(frame.index, last))
            for walker in awake:
                walker.see(frame.index, seen, cut)
        last = frame.index
        states = [walker.state for walker in awake]
        show(next((s for s in ("lost", "held", "tracked") if s in states), ""))


def clusters(runs: Iterable[Run]) -> list[tuple[int, int]]:
    """Stretches of frames (first, last), the last one first, that backward runs go through."""
    found: list[tuple[int, int]] = []
    for run in sorted(runs, key=lambda run: -run.anchor):
        low, high = run.stop or 0, run.anchor
        if found and high >= found[-1][0]:
            found[-1] = min(low, found[-1][0]), found[-1][1]
        else:
            found.append((low, high))
    return found
