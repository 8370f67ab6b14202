"""What happens in a project, as it happens, to all pages that have it open."""

import asyncio
from threading import Lock
from typing import Any

from .errors import Refusal

Event = dict[str, Any]

MOST_LISTENERS = 16  # pages of one project
MOST_WAITING = 256  # events that a page has not taken yet; older ones are dropped


class Events:
    """Takes events from any thread, and hands them to queues of the server's."""

    def __init__(self) -> None:
        self._listeners: list[tuple[asyncio.AbstractEventLoop, asyncio.Queue[Event]]] = []
        self._lock = Lock()

    def listen(self) -> asyncio.Queue[Event]:
        """A queue that gets all events from now on; to be called on the loop that reads it.

        Raises:
            Refusal: there are too many.
        """
        queue: asyncio.Queue[Event] = asyncio.Queue(MOST_WAITING)
        with self._lock:
            if len(self._listeners) >= MOST_LISTENERS:
                raise Refusal(429, "this project is open in too many pages: close some")
            self._listeners.append((asyncio.get_running_loop(), queue))
        return queue

    def leave(self, queue: asyncio.Queue[Event]) -> None:
        """Ends that."""
        with self._lock:
            self._listeners = [(loop, other) for loop, other in self._listeners if other is not queue]

    def send(self, event: Event) -> None:
        """Tells all listeners."""
        with self._lock:
            listeners = list(self._listeners)
        for loop, queue in listeners:
            if not loop.is_closed():
                loop.call_soon_threadsafe(_put, queue, event)


def _put(queue: asyncio.Queue[Event], event: Event) -> None:
    if queue.full():
        queue.get_nowait()
    queue.put_nowait(event)
