"""Where a command's processor time goes, by stage: `python -m ar_demo.evaluation.stages OUT.json ar-track ...`.

The command runs in this process, and a thread looks every few milliseconds at what each other thread is doing: the
processor time that it took since the last look counts for that. Nothing of it is in the code that is measured. Threads
that are not Python's, those of codecs and networks, are told by what is left of the process's time. Linux alone lets a
thread's processor time be seen by another.
"""

import json
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from types import FrameType

from ..cli.entry import replace_main, track_main
from ..errors import InputError

INTERVAL = 0.002  # s between two looks

# What a module's time counts for; the first that holds counts, from the innermost call outward. Modules that serve
# several stages are not named: their time is their callers'.
STAGES = {
    "importlib": "start",
    "ar_demo/media/color": "convert",
    "ar_demo/media/planes": "convert",
    "ar_demo/media/transparency": "convert",
    "ar_demo/media/writer": "encode",
    "ar_demo/media/ad": "draw",
    "ar_demo/media/threads": "threads",
    "ar_demo/media": "decode",
    "hdn/networks/matte": "matte",
    "hdn/plane/occlusion": "matte",
    "ar_demo/scene/occlusion": "matte",
    "hdn/networks/loading": "start",
    "hdn/networks/engine": "HDN's stages",
    "hdn/proposal": "HDN's stages",
    "hdn/imaging/pyramid": "pyramids and crops",
    "hdn/imaging/observation": "pyramids and crops",
    "hdn/alignment/refinement": "refinement",
    "hdn/alignment/lucas_kanade": "refinement",
    "hdn/alignment/border": "refinement",
    "hdn/plane/picture": "plane's picture",
    "hdn/plane": "plane",
    "hdn/tracker": "tracker, other",
    "hdn/localisation": "tracker, other",
    "hdn/target": "tracker, other",
    "ar_demo/tracking/joint": "joint solution",
    "ar_demo/tracking/solution": "joint solution",
    "ar_demo/tracking/measurements": "joint solution",
    "ar_demo/tracking/motion": "joint solution",
    "ar_demo/tracking/states": "joint solution",
    "ar_demo/tracking/cuts": "cuts",
    "ar_demo/scene/grain": "grain",
    "ar_demo/scene/softness": "softness",
    "ar_demo/scene/shading": "light",
    "ar_demo/scene": "light",
    "ar_demo/compositing": "draw",
    "ar_demo/rendering": "draw",
}
OTHER = "other"
TASKS = Path("/proc/self/task")
NATIVE = "threads of codecs and networks"
COMMANDS = {"ar-track": track_main, "ar-replace": replace_main}


class Sampler:
    """Counts the processor time of this process's threads by stage, from `start` to `stop`.

    Attributes:
        seconds: processor time by stage.
        where: the same by stage and line of code, for whoever looks closer.
    """

    def __init__(self, interval: float = INTERVAL) -> None:
        """Raises InputError where the system does not show a thread's processor time."""
        if not TASKS.is_dir():
            raise InputError("stages are told on Linux alone: leave --stages out")
        self.seconds: dict[str, float] = defaultdict(float)
        self.where: dict[tuple[str, str], float] = defaultdict(float)
        self._interval = interval
        self._last: dict[int | None, float] = {}
        self._own = 0.0  # s that the sampler itself took
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run, name="sampler", daemon=True)

    def start(self) -> None:
        self._begun = time.process_time()
        self._last = {thread.native_id: _processor_time(thread) for thread in threading.enumerate()}
        self._thread.start()

    def stop(self) -> None:
        """Ends, and tells what threads took that are not Python's."""
        self._done.set()
        self._thread.join()
        own = sum(self.seconds.values()) + self._own
        self.seconds[NATIVE] = max(0.0, time.process_time() - self._begun - own)

    def _run(self) -> None:
        while not self._done.wait(self._interval):
            frames = sys._current_frames()
            for thread in threading.enumerate():
                if thread is not self._thread and thread.ident in frames:
                    self._count(thread, frames[thread.ident])
            del frames
            self._own = time.thread_time()

    def _count(self, thread: threading.Thread, frame: FrameType) -> None:
        spent = _processor_time(thread)
        delta = spent - self._last.get(thread.native_id, 0.0)
        if delta > 0:
            self._last[thread.native_id] = spent
            stage, line = stage_of(frame)
            self.seconds[stage] += delta
            self.where[stage, line] += delta


def _processor_time(thread: threading.Thread) -> float:
    """Seconds of a thread; 0 for one that has just ended, whose clock must not be asked for."""
    try:
        return int((TASKS / str(thread.native_id) / "schedstat").read_text().split()[0]) * 1e-9
    except OSError:
        return 0.0


def stage_of(frame: FrameType | None) -> tuple[str, str]:
    """The stage that a stack is in, and the line of the innermost module that tells it."""
    while frame is not None:
        name = frame.f_code.co_filename.replace("\\", "/").removesuffix(".py")
        for module, stage in STAGES.items():
            if module in name:
                return stage, f"{name.rsplit('/', 1)[-1]}:{frame.f_lineno} {frame.f_code.co_name}"
        frame = frame.f_back
    return OTHER, ""


def main(arguments: Sequence[str]) -> None:
    """Runs a command, and writes its processor seconds by stage, as JSON, to the file that comes first."""
    out, command, *given = arguments
    sampler = Sampler()
    sampler.start()
    try:
        COMMANDS[command](given)
    finally:
        sampler.stop()
        Path(out).write_text(json.dumps(sampler.seconds), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
