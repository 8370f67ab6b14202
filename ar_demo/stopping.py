"""Ending of work that is under way, from any thread."""

from collections.abc import Generator, Iterable, Iterator
from threading import Event
from typing import TypeVar

from .errors import Stopped

T = TypeVar("T")

Steps = Generator[None, None, T]  # work that comes to a halt after each frame, and then goes on where it was


class StopSignal:
    """Set by whichever thread; loops look at it before each frame. What it has stopped may be begun again."""

    def __init__(self) -> None:
        self.event = Event()

    def set(self) -> None:
        self.event.set()

    def watch(self, items: Iterable[T]) -> Iterator[T]:
        """The items, until the signal is set.

        Raises:
            Stopped: it is; it counts as heeded then.
        """
        for item in items:
            self._heed()
            yield item

    def drive(self, steps: Steps[T]) -> T:
        """Does work in steps, and gives what it gives; when it is stopped, its other steps can still be done.

        Raises:
            Stopped: see `watch`.
        """
        while True:
            self._heed()
            try:
                next(steps)
            except StopIteration as end:
                return end.value

    def _heed(self) -> None:
        if self.event.is_set():
            self.event.clear()
            raise Stopped("stopped before it was done: nothing was written")
