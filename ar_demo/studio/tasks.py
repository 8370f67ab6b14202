"""Work that takes its time, in a thread of its own: it tells how far it is, and can be stopped."""

import logging
import secrets
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from threading import Lock
from typing import Any, Literal

import numpy as np

from ..errors import InputError, RunError, Stopped
from ..progress import Progress
from ..session import Session
from .errors import Refusal, on_page
from .events import Event

log = logging.getLogger(__name__)

Kind = Literal["find", "track", "render"]
EVENT_SECONDS = 0.1  # between two of progress
ADVICE = {
    "find": "give another picture, or mark the corners by hand",
    "track": "mark the surface in another frame, or give another part of the video",
    "render": "change the name or the options here, and render again",
}


@dataclass
class Task:
    """Looking for a surface, tracking or rendering; see the page's `task`.

    Attributes:
        found: where a surface was found by its picture, each copy of it: `quad`, `start`, `keyframes`.
        output: id of the file that was written.
        surfaces: numbers of those that are tracked now.
    """

    kind: Kind
    id: str = field(default_factory=lambda: secrets.token_urlsafe(6))
    state: Literal["running", "done", "stopped", "failed"] = "running"
    stage: str = ""
    done: int = 0
    total: int | None = None
    error: str | None = None
    warnings: list[str] = field(default_factory=list)
    output: str | None = None
    found: list[dict[str, Any]] = field(default_factory=list)
    surfaces: list[int] = field(default_factory=list)
    is_asked_to_stop: bool = False

    @property
    def content(self) -> dict[str, Any]:
        """As JSON can hold it."""
        names = ("id", "kind", "state", "stage", "done", "total", "error", "warnings", "output", "found")
        return {name: getattr(self, name) for name in names}


class Tasks:
    """The tasks of a project, of which one runs at a time.

    Attributes:
        last: the one that runs, or ran last; None where there was none.
    """

    def __init__(self, session: Session, send: Callable[[Event], None], pause: Callable[[bool], None]) -> None:
        """Args:
        send: takes what there is to tell.
        pause: called as one begins and ends: whether there is work for the processor.
        """
        self.last: Task | None = None
        self._session, self._send, self._pause = session, send, pause
        self._thread = ThreadPoolExecutor(1, "task")
        self._lock = Lock()
        self._told = 0.0

    @property
    def is_running(self) -> bool:
        return self.last is not None and self.last.state == "running"

    def begin(self, kind: Kind, work: Callable[[Task], None]) -> Task:
        """Begins a task.

        Raises:
            Refusal: another one runs.
        """
        with self._lock:
            if self.is_running:
                raise Refusal(409, "there is work under way: wait for it, or stop it")
            task = self.last = Task(kind, stage=kind)
        self._thread.submit(self._run, task, work)
        return task

    def stop(self) -> Task:
        """Asks the task that runs to stop.

        Raises:
            Refusal: none runs.
        """
        with self._lock:
            if self.last is None or not self.is_running:
                raise Refusal(409, "there is nothing to stop")
            self.last.is_asked_to_stop = True
            self._session.stop()
            return self.last

    def wait(self) -> None:
        """Waits for the task that runs, if one does."""
        self._thread.submit(lambda: None).result()

    def close(self) -> None:
        """Stops what is under way, and waits for it."""
        if self.is_running:
            self.stop()
        self._thread.shutdown()

    def _run(self, task: Task, work: Callable[[Task], None]) -> None:
        self._pause(True)
        self._session.listen = lambda event: self._listen(task, event)
        self._send({"type": "task", **task.content})
        try:
            self._do(task, work)
            ended: tuple[Literal["done", "stopped", "failed"], str | None] = "done", None
        except Stopped:
            ended = "stopped", None
        except (InputError, RunError, OSError, Refusal) as error:
            ended = "failed", on_page(str(error), ADVICE[task.kind])
        except Exception as error:  # ours to mend, but the page has to go on
            log.debug("unexpected", exc_info=True)
            ended = (
                "failed",
                f"{type(error).__name__}: {error}; this should not happen: please report it".replace("\n", " "),
            )
        self._pause(False)
        with self._lock:
            task.error, task.state = ended[1], ended[0]
        self._send({"type": "task", **task.content})

    def _do(self, task: Task, work: Callable[[Task], None]) -> None:
        while True:
            try:
                work(task)
                return
            except Stopped:
                # A request that came after the last frame of the work before this was not heeded there.
                if task.is_asked_to_stop:
                    raise

    def _listen(self, task: Task, event: Progress) -> None:
        task.stage, task.done, task.total = event.stage, event.done, event.total
        now = time.monotonic()
        if now - self._told >= EVENT_SECONDS:
            self._told = now
            self._send({"type": "task", **task.content})
            for pose in _poses(task, event):
                self._send(pose)


def _poses(task: Task, event: Progress) -> Iterator[Event]:
    """Where surfaces were just found."""
    if event.frame is None or len(event.corners) != len(task.surfaces):  # a second look at some of them
        return
    for surface, state, corners in zip(task.surfaces, event.states, event.corners, strict=True):
        if state is not None:
            known = corners is not None and np.isfinite(corners).all()
            found = {"corners": np.round(corners, 2).tolist()} if known and corners is not None else {}
            yield {"type": "pose", "surface": surface, "frame": event.frame, "state": state, **found}
