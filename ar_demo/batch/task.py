"""A job on its way to a process: what is sent to a thread, or to a worker on another machine."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..media.claims import reason_of
from .options import command
from .process import Outcome, run


@dataclass(frozen=True)
class Task:
    """One attempt at a job.

    Attributes:
        values: options of `ar-replace` by their names.
        name: its first output, beside which its log lies.
        attempt: from 1; the first one begins the log anew.
        time_limit, memory_limit: seconds and bytes; None for none.
    """

    values: dict[str, Any]
    name: str
    attempt: int = 1
    time_limit: float | None = None
    memory_limit: int | None = None


def log_of(name: str) -> str:
    """The log of a job, beside its output."""
    return f"{name}.log"


def result_of(name: str) -> str:
    """What a job says of itself when it is done, as JSON, beside its output."""
    return f"{name}.json"


def execute(task: Task, stopped: Callable[[], bool] = lambda: False, kept_open: Sequence[int] = ()) -> Outcome:
    """Does a job, in a process; see `run`."""
    try:
        Path(task.name).parent.mkdir(parents=True, exist_ok=True)
        log = Path(log_of(task.name))
        if task.attempt == 1:
            log.unlink(missing_ok=True)
        return run(command(task.values), log, task.time_limit, task.memory_limit, stopped, kept_open)
    except OSError as error:
        return Outcome(1, message=f"cannot write beside {task.name}: {reason_of(error)}")
