"""How far the work is: what is called after each frame, and a progress bar on stderr that can be."""

import sys
from collections.abc import Callable
from itertools import count

from tqdm import tqdm

from .closing import Closing

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


class Bar(Closing):
    """Called as a `Progress`; one bar per stage, with frames per second. Nothing where stderr is no terminal."""

    def __init__(self, quiet: bool) -> None:
        self.off = quiet or not sys.stderr.isatty()
        self.stage = ""
        self.bar: tqdm[None] | None = None

    def __call__(self, stage: str, done: int, total: int | None, state: str) -> None:
        if self.off:
            return
        if self.bar is None or stage != self.stage:
            self.close()
            self.stage, self.bar = stage, tqdm(total=total, desc=stage, unit=" frames", file=sys.stderr)
        self.bar.set_postfix_str(state, refresh=False)
        self.bar.update(done - self.bar.n)

    def close(self) -> None:
        if self.bar is not None:
            self.bar.close()
            self.bar = None
