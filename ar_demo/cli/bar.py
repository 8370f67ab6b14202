"""A progress bar on stderr."""

import sys
from contextlib import AbstractContextManager
from typing import Any

from tqdm import tqdm

from ..progress import Progress


class Bar(AbstractContextManager["Bar"]):
    """Listens to progress: one bar for each stage, with frames per second. Nothing where stderr is no terminal."""

    def __init__(self, quiet: bool) -> None:
        self.off = quiet or not sys.stderr.isatty()
        self.stage = ""
        self.bar: tqdm[None] | None = None

    def __call__(self, event: Progress) -> None:
        if self.off:
            return
        if self.bar is None or event.stage != self.stage:
            self._close()
            self.stage = event.stage
            self.bar = tqdm(total=event.total, desc=event.stage, unit=" frames", file=sys.stderr)
        self.bar.set_postfix_str(event.state or "", refresh=False)
        self.bar.update(event.done - self.bar.n)

    def __exit__(self, *error: Any) -> None:
        self._close()

    def _close(self) -> None:
        if self.bar is not None:
            self.bar.close()
            self.bar = None
