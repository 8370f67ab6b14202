"""A progress bar on stderr."""

import sys

from tqdm import tqdm

from ..closing import Closing


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
