"""How quickly a video's frames are had while somebody scrubs, and what memory that takes.

    python -m ar_demo.studio.benchmark street.mp4 --scrub 72000

scrubs as far as somebody does in an hour at 20 frames a second. Where other programs run, processor time tells more
than time.
"""

import argparse
import random
import resource
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace as changed
from pathlib import Path

import numpy as np

from hdn import Observation
from hdn.alignment.rectangles import find_rectangles
from hdn.alignment.snapping import snap
from hdn.imaging.arrays import Image

from ..media.reader import VideoReader
from .frames import MODEL, Frames

HEIGHT = 720  # px, of a page on a usual screen
STEPS = 120  # frames asked for in each way of scrubbing
JUMPS = 12  # into what is not kept yet
SWEEP = 200  # frames that are scrubbed through in one direction
NEVER = 1e9  # s


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints a line for each way of scrubbing, before and once all frames are kept, and for what is asked of one."""
    parser = argparse.ArgumentParser("python -m ar_demo.studio.benchmark", description=main.__doc__)
    parser.add_argument("video", type=Path)
    parser.add_argument(
        "--scrub", type=int, default=1000, metavar="FRAMES", help="scrub to and fro through so many frames at the end"
    )
    said = parser.parse_args(arguments)
    with VideoReader(said.video) as reader:
        count, middle = len(reader.times), len(reader.times) // 2
        print(f"{said.video}: {reader.info.width}x{reader.info.height}, {count} frames")
        ways = {
            "forward": [*range(middle, count)][:STEPS],
            "backward": [*range(middle, -1, -1)][:STEPS],
            "jumps": random.Random(0).sample(range(count), min(JUMPS, count)),
        }
        for name, indices in ways.items():
            with Frames(reader, count, changed(MODEL, idle_seconds=NEVER)) as frames:
                _jump(f"{name}, nothing kept", frames, indices)
        with Frames(reader, count) as frames:
            began, used = time.perf_counter(), time.process_time()
            while not frames.is_filled:
                time.sleep(0.05)
            took, used = time.perf_counter() - began, time.process_time() - used
            print(f"keeping all: {took:.1f} s, {1000 * used / count:.1f} ms of processor time a frame")
            for name, indices in ways.items():
                _measure(f"{name}, all kept", lambda i: frames.picture(i, HEIGHT), indices)
            few = ways["jumps"]
            _measure("likely rectangles", lambda i: find_rectangles(Observation(frames.view(i))), few)
            _measure("snapping", lambda i: _snapped(frames.view(i)), few)
            _tell_memory("so far")
            scrubbed = _to_and_fro(count, said.scrub)
            _measure(f"scrubbing through {said.scrub} frames", lambda i: frames.near(i, HEIGHT, None), [*scrubbed])
    _tell_memory("in all")


def _jump(name: str, frames: Frames, indices: Sequence[int]) -> None:
    """Asks for frames as the page does: again and again, until their own pictures come."""
    answers, waits, used = [], [], time.process_time()
    for index in indices:
        began, shown, near = time.perf_counter(), -1, None
        while shown != index:
            asked = time.perf_counter()
            shown, picture = frames.near(index, HEIGHT, near)
            near = shown if picture is not None else near
            answers.append(1000 * (time.perf_counter() - asked))
        waits.append(1000 * (time.perf_counter() - began))
    used = 1000 * (time.process_time() - used) / len(indices)
    print(f"{_told(name, used, waits)}; an answer at most {max(answers):.0f} ms")


def _measure(name: str, ask: Callable[[int], object], indices: Sequence[int]) -> None:
    waits, used = [], time.process_time()
    for index in indices:
        asked = time.perf_counter()
        ask(index)
        waits.append(1000 * (time.perf_counter() - asked))
    print(_told(name, 1000 * (time.process_time() - used) / max(1, len(indices)), waits or [0.0]))


def _told(name: str, used: float, waits: Sequence[float]) -> str:
    return (
        f"{name}: {used:.1f} ms of processor time a frame, median {statistics.median(waits):.0f} ms, "
        f"most {max(waits):.0f} ms"
    )


def _tell_memory(when: str) -> None:
    print(f"memory {when}: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB at most")


def _snapped(image: Image) -> object:
    """Corners in the middle, where they would snap to."""
    height, width = image.shape[:2]
    quad = [(width * x, height * y) for x, y in ((0.3, 0.3), (0.7, 0.3), (0.7, 0.7), (0.3, 0.7))]
    return snap(Observation(image), np.array(quad))


def _to_and_fro(count: int, steps: int) -> Iterator[int]:
    """So many frames, in sweeps from random places."""
    chance, left = random.Random(1), steps
    while left:
        begin, direction = chance.randrange(count), chance.choice((1, -1))
        for i in range(min(SWEEP, left)):
            yield (begin + direction * i) % count
        left -= min(SWEEP, left)


if __name__ == "__main__":
    main()
