"""The process of one job: `ar-replace`, which ends with the one that started it, however that ends."""

import os
import signal
import sys
import time
from threading import Thread

from ..cli.entry import replace_main

PATIENCE_SECONDS = 5.0  # for cleaning up


def _end_with_parent() -> None:
    """Waits for the end of standard input, which the parent holds open for as long as it lives."""
    while os.read(0, 1):
        pass
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(PATIENCE_SECONDS)
    os.kill(os.getpid(), signal.SIGKILL)


def main() -> None:
    """Does what the command line says."""
    Thread(target=_end_with_parent, name="parent", daemon=True).start()
    replace_main(sys.argv[1:])


if __name__ == "__main__":
    main()
