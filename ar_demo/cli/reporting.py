"""What the command lines tell: the log, the summary, and warnings, each of these once."""

import logging
import sys
from collections.abc import Mapping, Sequence

from hdn.commandline import DONE, FAILED

from ..results import Result
from ..tracking.states import is_suspicion
from ..verdict import Verdict
from ..words import counted


class Log(logging.StreamHandler):  # type: ignore[type-arg]
    """Writes the log to stderr, each message once.

    Attributes:
        told: the messages that it wrote.
    """

    def __init__(self) -> None:
        super().__init__()
        self.setFormatter(logging.Formatter("%(levelname)s: %(message)s"))
        self.told: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        if record.getMessage() in self.told:
            return
        self.told.add(record.getMessage())
        super().emit(record)


def set_up_logging(quiet: bool) -> Log:
    """The log of ours, on stderr; where it is to be quiet, of errors alone."""
    log = Log()
    for name in ("ar_demo", "hdn"):
        logger = logging.getLogger(name)
        logger.handlers[:] = [log]
        logger.setLevel(logging.ERROR if quiet else logging.INFO)
    return log


def print_summary(result: Result) -> None:
    """One line, and one more for each of several surfaces."""
    dropped = "" if result.dropped is None else f", {result.dropped} dropped ({result.at_start} at the start)"
    states = in_words(result.states) if len(result.surfaces) == 1 else counted(len(result.surfaces), "surface")
    print(
        f"{', '.join(map(str, result.outputs))}: {counted(result.frames, 'frame')} ({states}), "
        f"{result.fps:.1f} frames/s{dropped}, {result.compositor}"
    )
    if result.verdict is not None:
        print(f"verdict: {result.verdict}")
    if (late := result.latency) is not None:
        print(f"latency: {late.p50:.0f} ms (median), {late.p95:.0f} ms (95 %), {late.p99:.0f} ms (99 %)")
    for number, surface in enumerate(result.surfaces if len(result.surfaces) > 1 else [], 1):
        print(f"  surface {number}, {surface['ad'] or 'no ad'}: {in_words(surface['states'])}")


def warn(warnings: Sequence[str], log: Log, strict: bool, verdict: Verdict | None = None) -> int:
    """Writes the warnings that the log has not written yet to stderr; the exit status.

    Of stretches of a track that are worth a look, the verdict tells whether they matter.
    """
    for warning in dict.fromkeys(warnings):
        if warning not in log.told:
            print(f"warning: {warning}", file=sys.stderr)
    if not strict:
        return DONE
    if verdict is not None and verdict.status != "pass":
        return verdict.exit_status
    return FAILED if any(verdict is None or not is_suspicion(warning) for warning in warnings) else DONE


def in_words(states: Mapping[str, int]) -> str:
    """As in '20 tracked, 3 held, 1 lost'."""
    return ", ".join(f"{count} {state}" for state, count in states.items())
