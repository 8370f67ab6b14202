"""How quickly a video's frames are had while somebody scrubs, and what memory that takes.

    python -m ar_demo.studio.benchmark street.mp4

Processor time tells more than time where other programs run.
"""

import random
import resource
import statistics
import sys
import time
from collections.abc import Sequence
from dataclasses import replace as changed
from pathlib import Path

from ..media.reader import VideoReader
from .frames import MODEL, Frames

HEIGHT = 720  # px, of a page on a usual screen
STEPS = 120  # frames asked for in each way of scrubbing
JUMPS = 12  # into what is not kept yet
NEVER = 1e9  # s


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints a line for each way of scrubbing: before, and once all frames are kept."""
    [video] = sys.argv[1:] if arguments is None else arguments
    with VideoReader(Path(video)) as reader:
        count, middle = len(reader.times), len(reader.times) // 2
        print(f"{video}: {reader.info.width}x{reader.info.height}, {count} frames")
        ways = {
            "forward": [*range(middle, count)][:STEPS],
            "backward": [*range(middle, -1, -1)][:STEPS],
            "jumps": random.Random(0).sample(range(count), min(JUMPS, count)),
        }
        for name, indices in ways.items():
            with Frames(reader, count, changed(MODEL, idle_seconds=NEVER)) as frames:
                _measure(f"{name}, nothing kept", frames, indices)
        with Frames(reader, count) as frames:
            began, used = time.perf_counter(), time.process_time()
            while not frames.is_filled:
                time.sleep(0.05)
            took, used = time.perf_counter() - began, time.process_time() - used
            print(f"keeping all: {took:.1f} s, {1000 * used / count:.1f} ms of processor time a frame")
            for name, indices in ways.items():
                _measure(f"{name}, all kept", frames, indices)
    print(f"memory: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB at most")


def _measure(name: str, frames: Frames, indices: Sequence[int]) -> None:
    waits, used = [], time.process_time()
    for index in indices:
        asked = time.perf_counter()
        frames.picture(index, HEIGHT)
        waits.append(1000 * (time.perf_counter() - asked))
    used = 1000 * (time.process_time() - used) / len(indices)
    print(
        f"{name}: {used:.1f} ms of processor time a frame, median {statistics.median(waits):.0f} ms, "
        f"most {max(waits):.0f} ms"
    )


if __name__ == "__main__":
    main()
