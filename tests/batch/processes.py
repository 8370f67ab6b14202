"""Batches in processes of their own, which can be killed."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from ar_demo.cli.entry import batch_main


def fork_batch(manifest: Path, *options: str) -> int:
    """Starts ar-batch in a process of its own, which has all modules already; its process id."""
    pid = os.fork()
    if pid:
        return pid
    status = 70
    try:
        with open(os.devnull, "r+") as null:
            for descriptor in (0, 1, 2):
                os.dup2(null.fileno(), descriptor)
            sys.stdout = sys.stderr = null
            batch_main([str(manifest), "--quiet", *options])
    except SystemExit as end:
        status = int(end.code or 0)
    finally:
        os._exit(status)


def status_of(pid: int, seconds: float = 150) -> int:
    """The exit status of a batch that ends by itself."""
    until = time.monotonic() + seconds
    while (ended := os.waitpid(pid, os.WNOHANG))[0] == 0:
        if time.monotonic() > until:
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
            raise AssertionError("the batch does not end")
        time.sleep(0.02)
    return os.waitstatus_to_exitcode(ended[1])


def wait_until(so: Callable[[], bool], seconds: float = 60) -> None:
    until = time.monotonic() + seconds
    while not so():
        assert time.monotonic() < until
        time.sleep(0.02)


def children_of_the_batch(folder: Path) -> str:
    """Processes that still work on jobs of a folder, a moment after their batch ended."""
    for _ in range(50):
        found = subprocess.run(["pgrep", "-f", f"stand_in.py.*{folder}"], capture_output=True, text=True).stdout
        if not found:
            break
        time.sleep(0.1)
    return found
