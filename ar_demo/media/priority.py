"""Threads stay at the priority that they have.

SVT-AV1, run by root, gives the thread that opens it real-time priority, which all threads and processes that it begins
then inherit: they would take a processor from everything else on the machine.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def priority_kept() -> Iterator[None]:
    """Gives the calling thread its scheduling back at the end, where the system lets one ask for it."""
    if not hasattr(os, "sched_getscheduler"):  # no Linux
        yield
        return
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        yield
    finally:
        if os.sched_getscheduler(0) != policy:
            os.sched_setscheduler(0, policy, parameters)
