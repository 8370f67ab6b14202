"""Decoding ahead and encoding behind: threads with bounded queues on both sides of the work.

    with ahead(reader.frames()) as frames, VideoWriter(...) as writer, behind(writer.write) as write:
        for frame in frames:
            write(work(frame.image), frame.time, frame.duration)

PyAV lets go of Python's lock while it decodes, converts and encodes, so that the three go on at the same time.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from queue import SimpleQueue
from threading import Event, Semaphore, Thread
from typing import ParamSpec, TypeVar

log = logging.getLogger(__name__)

T = TypeVar("T")
P = ParamSpec("P")

QUEUE_DEPTH = (
    3  # items that wait between two threads: evens out their paces, and is little memory (a 4K frame has 25 MB)
)


class _End:
    """The last thing in a queue, with what ended the iteration where that was an error."""

    def __init__(self, error: BaseException | None = None) -> None:
        self.error = error


@contextmanager
def ahead(items: Iterable[T], depth: int = QUEUE_DEPTH) -> Iterator[Iterator[T]]:
    """Runs an iterator in a thread of its own, up to `depth` items ahead of whoever takes them.

    What the iterator raises is raised, the same object, where the item would have come. Leaving the context, at the
    end, early or by an exception, stops the thread after the item that it is at and waits for that; the iterator
    belongs to the context and is closed by the thread. Nothing comes out of it after that.

    Args:
        items: what to iterate over; its code runs in the thread.
        depth: items that may wait; one more is with the taker.

    Yields:
        An iterator over the same items in the same order, for one thread.
    """
    free = Semaphore(depth)
    ready: SimpleQueue[T | _End] = SimpleQueue()
    stopped = Event()

    def produce() -> None:
        end = _End()
        try:
            iterator = iter(items)
            try:
                while free.acquire() and not stopped.is_set():
                    try:
                        item = next(iterator)
                    except StopIteration:
                        break
                    ready.put(item)
                    del item  # which would live on here while the queue is full
            finally:
                close = getattr(iterator, "close", None)
                if close is not None:
                    close()
        except BaseException as error:
            end.error = error
        ready.put(end)

    def take() -> Iterator[T]:
        while not stopped.is_set():
            item = ready.get()
            if isinstance(item, _End):
                if item.error is not None:
                    raise item.error
                return
            free.release()
            yield item
            del item

    thread = Thread(target=produce, name="ahead", daemon=True)
    thread.start()
    try:
        yield take()
    finally:
        stopped.set()
        free.release()
        thread.join()


@contextmanager
def behind(function: Callable[P, object], depth: int = QUEUE_DEPTH) -> Iterator[Callable[P, None]]:
    """Runs calls of a function in a thread of its own, in their order, up to `depth` calls behind whoever makes them.

    What the function raises ends the work: the same object is raised at the next call, or when the context ends.
    Leaving the context normally waits for all calls; leaving it by an exception waits for the one that runs and
    drops the rest.

    Args:
        function: what to call. What a call is given (an image, say) must not be changed by the caller any more.
        depth: calls that may wait; one more runs.

    Yields:
        What to call in the function's place; it returns nothing, and waits where `depth` calls wait already.
    """
    free = Semaphore(depth)
    calls: SimpleQueue[Callable[[], object] | None] = SimpleQueue()
    stopped = Event()
    failed: list[BaseException] = []  # at most one

    def run() -> None:
        while (call := calls.get()) is not None:
            free.release()
            if not stopped.is_set():
                try:
                    call()
                except BaseException as error:
                    failed.append(error)
                    stopped.set()
            del call

    def later(*args: P.args, **kwargs: P.kwargs) -> None:
        free.acquire()
        if failed:
            free.release()
            raise failed[0]
        calls.put(partial(function, *args, **kwargs))

    thread = Thread(target=run, name="behind", daemon=True)
    thread.start()
    try:
        yield later
    except BaseException as error:
        stopped.set()
        if failed and failed[0] is not error:
            log.warning("besides, writing failed: %s", failed[0])
        raise
    finally:
        calls.put(None)
        thread.join()
    if failed:
        raise failed[0]
