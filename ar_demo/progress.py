"""How far the work is: what is called after each frame, and a progress bar on stderr that can be."""

from collections.abc import Callable
from itertools import count

# Called after each frame with what is being done, frames done, frames in all if known, and the frame's state.
Progress = Callable[[str, int, int | None, str], None]


def silent(stage: str, done: int, total: int | None, state: str) -> None:
    """A progress callback that shows nothing."""


def counted(progress: Progress, stage: str, done: int, total: int | None) -> Callable[[str], None]:
    """To be called with each frame's state, counts the frames of a stage; done: how many are done already."""
    numbers = count(done + 1)
    return lambda state: progress(stage, next(numbers), total, state)


def renamed(progress: Progress, prefix: str) -> Progress:
    """The same callback, with a prefix to the names of the stages."""
    return lambda stage, done, total, state: progress(prefix + stage, done, total, state)
