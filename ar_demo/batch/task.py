"""A job on its way to a process: what is sent to a thread, or to a worker on another machine."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hdn.commandline import BAD_INPUT, FAILED

from ..errors import InputError, RunError
from ..media.claims import reason_of
from ..media.download import is_url
from .options import command
from .process import Outcome, run
from .staging import Place, Staged, staged


@dataclass(frozen=True)
class Task:
    """One attempt at a job.

    Attributes:
        values: options of `ar-replace` by their names.
        outputs: what it writes, the first one first, beside which its log lies.
        attempt: from 1; the first one begins the log anew.
        time_limit, memory_limit: seconds and bytes; None for none.
        track: file of the batch that one of the options names: a track that is used, or made.
        content: of the track that is used, where its file may not be at hand.
    """

    values: dict[str, Any]
    outputs: tuple[str, ...]
    attempt: int = 1
    time_limit: float | None = None
    memory_limit: int | None = None
    track: Path | None = None
    content: bytes | None = None


def log_of(name: str) -> str:
    """The log of a job, beside its output."""
    return f"{name}.log"


def result_of(name: str) -> str:
    """What a job says of itself when it is done, as JSON, beside its output."""
    return f"{name}.json"


def execute(
    task: Task, place: Place, stopped: Callable[[], bool] = lambda: False, kept_open: Sequence[int] = ()
) -> Outcome:
    """Does a job, in a process; see `run`."""
    values = dict(task.values)
    own = next((n for n in ("track", "save_track") if place.makes_aside and values.get(n) == str(task.track)), None)
    if own is not None:
        del values[own]
    try:
        with staged(values, place) as here:
            track = here.folder / "track.json"
            if own is not None:
                here.values[own] = str(track)
            if task.content is not None:
                track.write_bytes(task.content)
            outcome = _run(task, here, place, stopped, kept_open)
            here.publish(stopped)
            made = track.read_bytes() if own == "save_track" and track.exists() else None
            result = {n: here.told(said) if isinstance(said, str) else said for n, said in outcome.result.items()}
            return replace(outcome, result=result, message=here.told(outcome.message), track=made)
    except InputError as error:
        return Outcome(BAD_INPUT, message=str(error))
    except RunError as error:
        return Outcome(FAILED, message=str(error))
    except OSError as error:
        return Outcome(FAILED, message=f"cannot write beside {task.outputs[0]}: {reason_of(error)}")


def _run(task: Task, here: Staged, place: Place, stopped: Callable[[], bool], kept_open: Sequence[int]) -> Outcome:
    name = log_of(task.outputs[0])
    if place.makes_aside or is_url(name):
        log = Path(here.aside(name))
    else:
        for output in task.outputs:
            if not is_url(output):
                Path(output).parent.mkdir(parents=True, exist_ok=True)
        log = Path(name)
        if task.attempt == 1:
            log.unlink(missing_ok=True)
    return run(command(here.values), log, task.time_limit, task.memory_limit, stopped, kept_open)
