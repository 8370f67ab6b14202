"""One job as a process of its own: started without a shell, watched, and ended where it goes beyond its limits."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, Literal

import psutil

from hdn.commandline import BAD_INPUT, FAILED

from ..errors import NotFound
from ..units import in_words
from ..verdict import EXIT_STATUS

LOOK_SECONDS = 0.1  # between two looks at a process
PATIENCE_SECONDS = 10.0  # that a process has to clean up in, before it is killed
LAST_BYTES = 64 << 10  # of a log, in which its last error is looked for

# -P: what lies in the current folder is not to be imported.
PROGRAM = (sys.executable, "-P", "-m", "ar_demo.batch.child")

Ended = Literal["", "time", "memory", "stopped"]


@dataclass(frozen=True)
class Outcome:
    """How a job went.

    Attributes:
        status: exit status of the process; -N where signal N ended it.
        ended: by what we ended it, if so.
        seconds: wall time. peak_bytes: the most memory that was seen.
        result: what it printed as JSON.
        message: what went wrong, in one sentence.
        track: content of the batch's own track, where that was made aside.
    """

    status: int
    ended: Ended = ""
    seconds: float = 0.0
    peak_bytes: int = 0
    result: dict[str, Any] = field(default_factory=dict)
    message: str = ""
    track: bytes | None = None

    @property
    def is_done(self) -> bool:
        """Whether the output is there, whatever the verdict on its track."""
        return self.status in EXIT_STATUS.values() and not self.ended

    @property
    def may_be_tried_again(self) -> bool:
        """Whether it failed while working: by exit status 1, or by a crash that is not of our making."""
        return not self.ended and (self.status == FAILED or self.status < 0)

    @property
    def is_wrong_input(self) -> bool:
        """Whether trying again is of no use: it was refused, or a picture that it looks for is not seen."""
        return not self.ended and self.status in (BAD_INPUT, NotFound.exit_status)


def run(
    arguments: Sequence[str],
    log: Path,
    time_limit: float | None,
    memory_limit: int | None,
    stopped: Callable[[], bool],
    kept_open: Sequence[int] = (),
) -> Outcome:
    """Runs `ar-replace` to its end.

    Args:
        arguments: of the command line.
        log: file that its standard error is added to.
        time_limit: seconds after which it is asked to end; memory_limit: bytes beyond which it is killed.
        stopped: whether it shall end early.
        kept_open: descriptors that it holds open, so that their locks are held while it lives.
    """
    started = time.monotonic()
    words = [*PROGRAM, *arguments, "--json"]
    with log.open("ab") as errors, TemporaryFile() as output:
        begin = errors.tell()
        process = subprocess.Popen(
            words, stdin=subprocess.PIPE, stdout=output, stderr=errors, pass_fds=kept_open, start_new_session=True
        )
        try:
            ended, peak = _watch(process, started, time_limit, memory_limit, stopped)
        finally:
            _end(process)
            assert process.stdin is not None
            process.stdin.close()
        output.seek(0)
        result = _parsed(output.read())
    status = process.returncode
    said = {
        "time": f"it took longer than {time_limit:g} s" if time_limit else "",
        "memory": f"it took more than {in_words(memory_limit or 0)} of memory",
        "stopped": "it was stopped",
        "": "" if status in EXIT_STATUS.values() else _error(log, begin, status),
    }[ended]
    return Outcome(status, ended, time.monotonic() - started, peak, result, said)


def _watch(
    process: "subprocess.Popen[bytes]",
    started: float,
    time_limit: float | None,
    memory_limit: int | None,
    stopped: Callable[[], bool],
) -> tuple[Ended, int]:
    """Waits for its end: what we ended it for, and the most memory that it took."""
    peak = 0
    while True:
        with suppress(subprocess.TimeoutExpired):
            process.wait(LOOK_SECONDS)
            return "", peak
        with suppress(psutil.Error):
            peak = max(peak, psutil.Process(process.pid).memory_info().rss)
        if memory_limit is not None and peak > memory_limit:
            process.kill()
            return "memory", peak
        if stopped():
            return "stopped", peak
        if time_limit is not None and time.monotonic() - started > time_limit:
            return "time", peak


def _end(process: "subprocess.Popen[bytes]") -> None:
    """Ends it, if it is not over."""
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(PATIENCE_SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
    process.wait()


def _parsed(printed: bytes) -> dict[str, Any]:
    """The last line of what was printed, where that is an object."""
    with suppress(ValueError):
        content = json.loads(printed.strip().rpartition(b"\n")[2] or b"{}")
        if isinstance(content, dict):
            return content
    return {}


def _error(log: Path, begin: int, status: int) -> str:
    """Why it failed: the last error that it logged."""
    with log.open("rb") as file:
        file.seek(max(begin, os.fstat(file.fileno()).st_size - LAST_BYTES))
        lines = file.read().decode(errors="replace").splitlines()
    for line in reversed(lines):
        if line.startswith("error: "):
            return line.removeprefix("error: ")
    return (
        f"signal {-status} ended it" if status < 0 else next((line for line in lines[::-1] if line), f"status {status}")
    )
