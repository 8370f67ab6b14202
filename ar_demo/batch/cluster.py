"""Tasks done by the workers of a Dask cluster that is there: on a LAN, under SLURM, on Kubernetes.

A worker runs one job for each of its threads, as a process of its own. Outputs are made aside, in the worker's folder,
and put in their places when they are complete: a job that runs twice, since a worker or the scheduler was thought to be
lost, writes the same twice.
"""

import logging
import secrets
import time
from concurrent.futures import Future
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Lock, Thread
from typing import Any

from distributed import CancelledError, Client, Status, get_worker

from hdn.commandline import BAD_INPUT

from ..errors import InputError, RunError
from .process import Outcome
from .running import Gone
from .staging import Place
from .task import Task, execute

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ClusterModel:
    """How patient a batch is with its cluster."""

    connect_seconds: float = 10.0  # for one try
    gone_seconds: float = 600.0  # that a scheduler may be gone
    pause_seconds: float = 1.0  # between two tries
    look_seconds: float = 5.0  # between two looks at how many workers there are
    ahead: int = 2  # tasks for each thread of the workers that the scheduler has at a time
    fewest: int = 4  # tasks that it has at least


MODEL = ClusterModel()


@dataclass(eq=False)
class _Sent:
    task: Task
    future: "Future[Outcome]"
    handle: Any = None


class ClusterPool(AbstractContextManager["ClusterPool"]):
    """A cluster as a pool. A context manager; leaving it ends what is under way."""

    def __init__(self, address: str, resources: dict[str, float], place: Place) -> None:
        """Args: address: of the scheduler, or the file that it wrote; resources: of a worker that each job takes.

        Raises:
            RunError: the scheduler cannot be reached.
        """
        self._address, self._resources, self._place = address, resources, place
        self._client = self._connect()
        self._queue: SimpleQueue[_Sent | None] = SimpleQueue()
        self._sent: set[_Sent] = set()
        self._lock = Lock()
        self._closing = False
        self._capacity, self._looked = MODEL.fewest, -MODEL.look_seconds
        self._sender = Thread(target=self._send_all, name="cluster", daemon=True)
        self._sender.start()

    @property
    def capacity(self) -> int:
        """See `Pool`."""
        if time.monotonic() - self._looked > MODEL.look_seconds:
            self._looked = time.monotonic()
            with suppress(Exception):  # the scheduler is gone: what was known holds until it is back
                threads = sum(self._client.nthreads().values())
                if not threads:
                    log.info("the cluster %s has no workers: waiting for some", self._address)
                self._capacity = max(MODEL.fewest, MODEL.ahead * threads)
        return self._capacity

    def submit(self, task: Task) -> "Future[Outcome]":
        """See `Pool`."""
        future: Future[Outcome] = Future()
        if task.track is not None and task.values.get("track") == str(task.track):
            task = replace(task, content=task.track.read_bytes())
        self._queue.put(_Sent(task, future))
        return future

    def __exit__(self, *error: object) -> None:
        self._closing = True
        self._queue.put(None)
        self._sender.join(MODEL.connect_seconds)
        with suppress(Exception):
            self._client.cancel([sent.handle for sent in list(self._sent)], force=True)
        with suppress(Exception):
            self._client.close(timeout=MODEL.connect_seconds)

    def _send_all(self) -> None:
        """Sends what is submitted, and what a scheduler that was restarted has forgotten."""
        while True:
            try:
                sent = self._queue.get(timeout=MODEL.pause_seconds)
            except Empty:
                if self._client.status == "closed":  # which tells nothing to who waits for its tasks
                    for sent in list(self._sent):
                        if self._is_mine(sent, sent.handle):
                            self._queue.put(sent)
                continue
            if sent is None:
                return
            try:
                self._send(sent)
            except Exception as error:
                sent.future.set_exception(error)

    def _send(self, sent: _Sent) -> None:
        until = time.monotonic() + MODEL.gone_seconds
        while self._client.status == "closed" and not self._closing:
            try:
                self._client = self._connect()
            except RunError as error:
                if time.monotonic() > until:
                    raise Gone(f"{error}; the same command goes on with what is left") from error
                time.sleep(MODEL.pause_seconds)
        handle = self._client.submit(
            work,
            sent.task,
            self._place,
            version("ar-replace"),
            key=f"ar-batch-{secrets.token_hex(8)}",
            pure=False,
            resources=self._resources or None,
        )
        with self._lock:
            sent.handle = handle
            self._sent.add(sent)
        handle.add_done_callback(partial(self._take, sent))

    def _is_mine(self, sent: _Sent, handle: Any) -> bool:
        """Whether a task is still at the cluster by this handle; from now on it is not."""
        with self._lock:
            if handle is None or handle is not sent.handle:
                return False
            sent.handle = None
            self._sent.discard(sent)
            return True

    def _take(self, sent: _Sent, handle: Any) -> None:
        """Takes what came of a task; what was cancelled, by a scheduler that is gone, is sent anew."""
        if self._closing or not self._is_mine(sent, handle):
            return
        try:
            outcome = handle.result(timeout=MODEL.connect_seconds)
        except (CancelledError, TimeoutError, OSError):
            log.info("the scheduler %s has lost a job, or is gone: it is sent anew", self._address)
            self._queue.put(sent)
        except Exception as error:
            sent.future.set_exception(error)
        else:
            sent.future.set_result(outcome)

    def _connect(self) -> Client:
        where = {"scheduler_file": self._address} if Path(self._address).is_file() else {"address": self._address}
        try:
            return Client(**where, timeout=MODEL.connect_seconds, set_as_default=False, name="ar-batch")
        except (OSError, ValueError, TimeoutError) as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise RunError(f"cannot reach the scheduler {self._address} ({reason}): see --scheduler") from error


def work(task: Task, place: Place, expected: str) -> Outcome:
    """Does a task in a worker; the process ends where the task is cancelled, or the worker closes."""
    if version("ar-replace") != expected:
        mine = version("ar-replace")
        return Outcome(BAD_INPUT, message=f"a worker has version {mine}, and the batch {expected}: install the same")
    worker = get_worker()
    key = worker.get_current_task()

    def stopped() -> bool:
        state = worker.state.tasks.get(key)
        closing = worker.status in (Status.closing, Status.closed, Status.failed)
        return closing or state is None or state.state == "cancelled"

    return execute(task, replace(place, scratch=Path(worker.local_directory)), stopped)


def parse_resources(text: str) -> dict[str, float]:
    """Reads 'GPU=1' or 'GPU=1,MEMORY=4e9'.

    Raises:
        InputError: it is something else.
    """
    found = {}
    for pair in filter(None, text.split(",")):
        name, _, amount = pair.partition("=")
        try:
            found[name.strip()] = float(amount)
        except ValueError as error:
            raise InputError(f"'{pair}' is no resource: give it as in GPU=1") from error
    return found
