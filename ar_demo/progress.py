"""How far the work is: an event after each frame, for a progress bar, a log or a window."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import count

from hdn.imaging.arrays import Array, Picture
from hdn.state import STATES, State


@dataclass(frozen=True)
class Progress:
    """One frame is done.

    Attributes:
        stage: what is being done, as 'track' or 'render'.
        done, total: frames done in this stage, and in all; None where that is not known.
        states: of the surfaces in this frame, in their order; None for one that is not looked at now.
        preview: the frame, RGB (H, W, 3), uint8, in SDR; with the ads where they are drawn already. Not to be written
            to, and only valid during the call: copy what is kept.
        frame: its index; None where that is not known.
        corners: of the surfaces, as they were measured just now, (4, 2) px; None for one that is not looked at now.
    """

    stage: str
    done: int
    total: int | None = None
    states: tuple[State | None, ...] = ()
    preview: Picture | None = None
    frame: int | None = None
    corners: tuple[Array | None, ...] = ()

    @property
    def state(self) -> State | None:
        """The worst state of the surfaces."""
        return next((state for state in reversed(STATES) if state in self.states), None)

    @property
    def surface(self) -> int | None:
        """Which surface, from 0, is in the worst state."""
        return None if self.state is None else self.states.index(self.state)


Listener = Callable[[Progress], None]


class Timings:
    """A listener that measures how long each stage takes, and tells another one.

    Attributes:
        seconds: wall time by stage, in the order in which they began.
    """

    def __init__(self, listener: Listener) -> None:
        self.seconds: dict[str, float] = {}
        self._listener, self._last = listener, time.perf_counter()

    def __call__(self, event: Progress) -> None:
        self.take(event.stage)
        self._listener(event)

    def take(self, stage: str) -> None:
        """What has passed since the last event was of this stage."""
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._last
        self._last = now

    @property
    def told(self) -> dict[str, str]:
        """In words, and in all."""
        in_all = {"in all": sum(self.seconds.values())}
        return {stage: f"{seconds:.1f} s" for stage, seconds in (self.seconds | in_all).items()}


def silent(event: Progress) -> None:
    """A listener that shows nothing."""


class Stage:
    """Counts the frames of a stage, and tells a listener of each."""

    def __init__(self, listener: Listener, name: str, done: int, total: int | None) -> None:
        """Args: done: frames that are done already."""
        self._listener, self._name, self._total, self._numbers = listener, name, total, count(done + 1)

    def __call__(
        self,
        states: tuple[State | None, ...] = (),
        preview: Picture | None = None,
        frame: int | None = None,
        corners: tuple[Array | None, ...] = (),
    ) -> None:
        self._listener(Progress(self._name, next(self._numbers), self._total, states, preview, frame, corners))
