"""Jobs from the first to the last: what is done already is skipped, what fails is tried again, all is written down."""

import json
import logging
import re
from collections import defaultdict, deque
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, Protocol

from hdn.commandline import DONE, FAILED

from ..errors import InputError, RunError
from ..media.claims import write_whole
from ..media.download import is_url
from ..verdict import EXIT_STATUS
from .identity import OF_A_TRACK, identity, stamp, track_key
from .jobs import Job
from .options import command
from .process import Outcome
from .staging import put_content
from .state import State
from .task import Task, log_of, result_of

log = logging.getLogger(__name__)

Ending = Literal["done", "kept", "doubtful", "wrong", "failed"]
ENDINGS: tuple[Ending, ...] = ("failed", "wrong", "doubtful", "done", "kept")  # worst first


@dataclass(frozen=True)
class Ceilings:
    """What holds for all jobs of a batch, whatever the manifest says; None for none.

    Attributes:
        time_limit, memory_limit: seconds and bytes that a job may take at most.
        max_frames, max_pixels: that its videos and ads may have at most.
    """

    time_limit: float | None = None
    memory_limit: int | None = None
    max_frames: int | None = None
    max_pixels: int | None = None

    def bounded(self, job: Job) -> Job:
        """The job with the limits that it may have."""
        most = {name: _least(job.values.get(name), getattr(self, name)) for name in ("max_frames", "max_pixels")}
        return replace(
            job,
            values=dict(job.values) | {name: value for name, value in most.items() if value is not None},
            time_limit=_least(job.time_limit, self.time_limit),
            memory_limit=_least(job.memory_limit, self.memory_limit),
        )


@dataclass(frozen=True)
class Done:
    """How a job ended.

    Attributes:
        ending: done now, kept from an earlier run, either with a verdict on its track that --strict does not let pass,
            refused as wrong, or failed.
        attempts, seconds: of it; result: what `ar-replace --json` printed; message: what went wrong.
    """

    job: Job
    ending: Ending
    attempts: int
    seconds: float
    result: dict[str, Any]
    message: str = ""

    @property
    def is_good(self) -> bool:
        """Whether the output is there, and to be believed."""
        return self.ending in ("done", "kept")

    @property
    def has_output(self) -> bool:
        """Whether the output is there."""
        return self.is_good or self.ending == "doubtful"


class Gone(RunError):
    """A pool cannot be reached any more: the batch ends, and can go on another time."""


class Pool(Protocol):
    """Where tasks are done."""

    @property
    def capacity(self) -> int:
        """How many tasks it can have at a time without one waiting for long."""

    def submit(self, task: Task) -> "Future[Outcome]":
        """Takes a task. A future that has an error means that its worker was lost, or, by `Gone`, all of them."""


@dataclass
class _Begun:
    job: Job
    identity: str
    track: str | None
    attempt: int = 1
    seconds: float = 0.0
    arguments: list[str] = field(default_factory=list)


class Batch:
    """Does jobs in a pool, each once."""

    def __init__(self, state: State, pool: Pool, retries: int) -> None:
        """Args: retries: how often a job is tried again that failed while working, where it does not say."""
        self._state, self._pool, self._retries = state, pool, retries
        self._running: dict[Future[Outcome], _Begun] = {}
        self._making: set[str] = set()  # tracks that are being made
        self._parked: dict[str, list[Job]] = defaultdict(list)  # jobs that wait for one
        self._total = 0
        self.done: list[Done] = []

    def run(self, jobs: Sequence[Job]) -> list[Done]:
        """Does all that are not done; how each ended, in the order of the manifest.

        Raises:
            RunError: the state cannot be written; `Gone`.
        """
        ready, self._total = deque(jobs), len(jobs)
        while ready or self._running:
            while ready and len(self._running) < self._pool.capacity:
                self._begin(ready.popleft())
            if not self._running:
                continue
            finished, _ = wait(self._running, return_when=FIRST_COMPLETED)
            for future in finished:
                begun = self._running.pop(future)
                self._take(begun, _outcome(future))
                if begun.track is not None and begun.track not in self._making:
                    ready.extendleft(reversed(self._parked.pop(begun.track, [])))
        return sorted(self.done, key=lambda done: done.job.number)

    def _begin(self, job: Job) -> None:
        """Begins a job, unless it is done already, must wait for a track, or cannot be."""
        try:
            mine, track = identity(job, self._state), track_key(job, self._state)
            kept = self._state.finished(mine)
            if kept is not None and all(stamp(output) == kept[3].get(output) for output in job.outputs.values()):
                self._tell(_judged(Done(job, "kept", kept[0], kept[1], kept[2])))
                return
            if track in self._making:
                assert track is not None
                self._parked[track].append(job)
                return
            self._check_free(job)
        except InputError as error:
            self._tell(Done(job, "wrong", 0, 0.0, {}, str(error)))
            return
        except RunError as error:
            self._tell(Done(job, "failed", 0, 0.0, {}, str(error)))
            return
        self._state.begin(mine, job.name, _files(job))
        if track is not None and not self._track(track).exists():
            self._making.add(track)
        self._submit(_Begun(job, mine, track))

    def _check_free(self, job: Job) -> None:
        """Raises InputError where an output is there already that no job of this batch made."""
        if job.values.get("overwrite"):
            return
        outputs = set(job.outputs.values())
        track = job.values.get("save_track")
        if track is not None and self._state.stamp(track) is None:
            for path in _numbered(track):
                raise InputError(f"{path} exists already and is not of this batch: move it away, or say overwrite")
        for path in _files(job):
            now, made = stamp(path), self._state.stamp(path)
            if now and (made is None or (path in outputs and made not in ("", now))):
                raise InputError(f"{path} exists already and is not of this batch: move it away, or say overwrite")

    def _submit(self, begun: _Begun) -> None:
        job = begun.job
        values = dict(job.values) | {"overwrite": True}
        file = None if begun.track is None else self._track(begun.track)
        if file is not None:
            values.pop("save_track", None)
            if file.exists():
                values = {name: value for name, value in values.items() if name not in OF_A_TRACK}
            values["track" if file.exists() else "save_track"] = str(file)
        begun.arguments = command(values)
        task = Task(values, tuple(job.outputs.values()), begun.attempt, job.time_limit, job.memory_limit, file)
        self._running[self._pool.submit(task)] = begun

    def _take(self, begun: _Begun, outcome: Outcome) -> None:
        """Takes note of how an attempt ended."""
        begun.seconds += outcome.seconds
        job = begun.job
        if begun.track is not None and outcome.track is not None:
            write_whole(self._track(begun.track), outcome.track)
        retries = self._retries if job.retries is None else job.retries
        if outcome.may_be_tried_again and begun.attempt <= retries:
            log.info("%s: %s: trying again", job.name, outcome.message)
            begun.attempt += 1
            self._submit(begun)
            return
        if begun.track is not None:
            self._making.discard(begun.track)
        message = outcome.message
        if outcome.is_done:
            try:
                self._keep(begun, outcome)
                self._tell(_judged(Done(job, "done", begun.attempt, begun.seconds, outcome.result)))
                return
            except (InputError, RunError, OSError) as error:
                message = str(error)
        self._state.failed(begun.identity, begun.attempt, begun.seconds, message, _stamps(job))
        ending: Ending = "wrong" if outcome.is_wrong_input else "failed"
        self._tell(Done(job, ending, begun.attempt, begun.seconds, outcome.result, message))

    def _keep(self, begun: _Begun, outcome: Outcome) -> None:
        """Writes the rest of what a job that is done writes, and that it is done."""
        job = begun.job
        if begun.track is not None and "save_track" in job.values:
            put_content(self._track(begun.track).read_bytes(), job.values["save_track"])
        report = {
            "identity": begun.identity,
            "command": ["ar-replace", *begun.arguments],
            "attempts": begun.attempt,
            "seconds": round(begun.seconds, 3),
            "peak_bytes": outcome.peak_bytes,
            "result": outcome.result,
        }
        put_content((json.dumps(report, indent=2) + "\n").encode(), result_of(job.name))
        stamps = {path: stamp(path) for path in _files(job)}
        self._state.done(begun.identity, begun.attempt, begun.seconds, outcome.result, stamps)

    def _track(self, key: str) -> Path:
        return self._state.tracks / f"{key}.json"

    def _tell(self, done: Done) -> None:
        self.done.append(done)
        said = {"done": f"done, {done.seconds:.1f} s", "kept": "done before"}.get(done.ending, done.message)
        log.info("%d of %d: %s: %s", len(self.done), self._total, done.job.name, said)


def _judged(done: Done) -> Done:
    """A job that is done, or doubtful where its --strict says so of the verdict on its track."""
    verdict = done.result.get("verdict", {})
    if not done.job.values.get("strict") or EXIT_STATUS.get(verdict.get("status"), DONE) == DONE:
        return done
    return replace(done, ending="doubtful", message="; ".join(map(str, verdict.get("reasons", []))))


def _files(job: Job) -> list[str]:
    """All that a job writes, with its log and its result."""
    return [*job.outputs.values(), log_of(job.name), result_of(job.name)]


def _stamps(job: Job) -> dict[str, str]:
    """Of what lies under the names of a job's files; of those that cannot be reached '', as of those that are not."""
    stamps = {}
    for path in _files(job):
        try:
            stamps[path] = stamp(path)
        except (InputError, RunError):
            stamps[path] = ""
    return stamps


def _numbered(track: str) -> list[str]:
    """The tracks of several surfaces that there are already where a job says NAME.json: NAME.1.json and so on."""
    name = Path(track)
    if is_url(track) or not name.parent.is_dir():
        return []
    pattern = re.compile(rf"{re.escape(name.stem)}\.\d+{re.escape(name.suffix)}")
    return [str(file) for file in name.parent.iterdir() if pattern.fullmatch(file.name)]


def _least(*limits: Any) -> Any:
    """The least of the limits that there are; None for none."""
    return min((limit for limit in limits if limit is not None), default=None)


def _outcome(future: "Future[Outcome]") -> Outcome:
    """What came of a task; a worker that was lost counts as a failure while working.

    Raises:
        Gone: all of them were.
    """
    try:
        return future.result()
    except Gone:
        raise
    except (CancelledError, Exception) as error:
        return Outcome(FAILED, message=f"its worker was lost ({str(error) or type(error).__name__})")
