"""For `dask worker --preload`, which copies it: jobs are done by the program that STAND_IN names."""

import os
import shutil
import sys
import time
from typing import BinaryIO

from ar_demo.batch import process

process.PROGRAM = (sys.executable, "-I", "-S", os.environ["STAND_IN"])


def copy(source: BinaryIO, target: BinaryIO, length: int = 0) -> None:
    """What says that it is slow takes a second."""
    content = source.read()
    target.write(content[:1000])
    target.flush()
    time.sleep(content.startswith(b"slow"))
    target.write(content[1000:])


shutil.copyfileobj = copy  # type: ignore[assignment]
