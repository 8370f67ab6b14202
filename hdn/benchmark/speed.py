"""`hdn-bench`: what a frame costs, stage by stage, and how much faster that is than HDN as its authors run it."""

import contextlib
import json
import logging
import os
import platform
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import openvino
import torch
from tqdm import tqdm

from ..commandline import DONE, Parser, natural, run
from ..errors import InputError
from ..imaging.arrays import Array, Image
from ..imaging.homography import from_corners, similarity, transform, translation
from ..imaging.observation import Observation
from ..imaging.quads import square
from ..networks import torch_engine, weights
from ..networks.authors import AuthorsTracker
from ..networks.config import PAPER
from ..networks.engine import Engine, Residual, Shift
from ..networks.pytorch import Hdn, load
from ..tracker import Tracker
from .synthplanar.drawings import draw_poster, draw_scene

log = logging.getLogger(__name__)

FRAME = (1280, 720)
TARGET = (280, 350)  # px, as large as the poster of the demo clip
FRAMES = 24  # of a motion that begins again
ROUNDS = 12
REST = 0.3  # s after which idle threads of PyTorch no longer spin
AUTHORS_MS = 674  # their code, a frame of 1920x804, on two AVX-512 cores of another machine
AGREEMENT = 0.1  # px, to which the engines' corners have to agree

COLUMNS = ("best", "p50", "p90")
STAGES = "HDN's three stages"


class Footage:
    """A poster that moves before a street: frames (H, W, 3), and the homographies (3, 3) from the first to each."""

    def __init__(self) -> None:
        rng = np.random.default_rng(7)
        street, poster = draw_scene(FRAME, rng), draw_poster(TARGET, rng)
        centre = np.array(FRAME) / 2
        outline = square(1) * TARGET
        self.quad = outline + centre
        poster_to_first = from_corners(outline + (np.array(TARGET) - 1) / 2, self.quad)
        self.homographies = [_pose(2 * np.pi * i / FRAMES, centre) for i in range(FRAMES)]
        self.frames = [self._draw(street, poster, pose @ poster_to_first) for pose in self.homographies]

    @staticmethod
    def _draw(street: Image, poster: Image, poster_to_frame: Array) -> Image:
        frame = street.copy()
        cv2.warpPerspective(poster, poster_to_frame, FRAME, frame, cv2.INTER_LINEAR, cv2.BORDER_TRANSPARENT)
        return frame


def _pose(phase: float, centre: Array) -> Array:
    """The pose at a phase of the motion; the identity at 0."""
    swing = np.sin(phase)
    moved = similarity(1 + 0.1 * swing, 0.1 * swing, 40 * swing, 20 * (1 - np.cos(phase)))
    tilt = np.array([[1, 0, 0], [0, 1, 0], [2e-4 * swing, 1e-4 * swing, 1]])
    return translation(*centre) @ moved @ tilt @ translation(*-centre)


class Clocked(Engine):
    """An engine that notes when a stage's network was done."""

    def __init__(self, network: Hdn, device: str, library: str) -> None:
        engine = torch_engine.engine(network, device) if library == "torch" else torch_engine.converted(network)
        super().__init__(engine.config, engine.functions, engine.description)
        self.done: dict[str, float] = {}

    def translation(self, *arguments: Any) -> Shift:
        answer = super().translation(*arguments)
        self.done["translation"] = time.perf_counter()
        return answer

    def polar(self, *arguments: Any) -> Shift:
        answer = super().polar(*arguments)
        self.done["polar"] = time.perf_counter()
        return answer

    def residual(self, *arguments: Any) -> Residual:
        answer = super().residual(*arguments)
        self.done["residual"] = time.perf_counter()
        return answer


@dataclass
class Subject:
    """What is measured.

    Attributes:
        measure: times frame i, from the true pose of the frame before: seconds by part.
        burst: frames in a row, after one that does not count, in each round.
        seconds: what was measured, by part.
    """

    name: str
    measure: Callable[[int], dict[str, float]]
    burst: int = 5
    seconds: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))

    def run(self, first: int) -> None:
        """One burst; its first frame only brings caches and threads back, those of others having come to rest."""
        time.sleep(REST)
        for i in range(first, first + self.burst + 1):
            for part, seconds in self.measure(i % FRAMES).items():
                if i > first:
                    self.seconds[part].append(seconds)

    def milliseconds(self) -> dict[str, dict[str, float]]:
        """Shortest, median and 90th percentile of each part."""
        return {
            part: dict(zip(COLUMNS, (float(q) for q in np.percentile(s, [0, 50, 90]) * 1000), strict=True))
            for part, s in self.seconds.items()
        }


class Compact:
    """The compact configuration on one engine: times of its parts, and what it proposes for each frame."""

    def __init__(self, engine: Clocked, footage: Footage) -> None:
        self.engine, self.footage = engine, footage
        self.tracker = Tracker(engine=engine)
        self.tracker.init(footage.frames[0], footage.quad)
        self.proposals: dict[int, Array] = {}

    def measure(self, i: int) -> dict[str, float]:
        tracker, frame, done = self.tracker, self.footage.frames[i], self.engine.done
        tracker.place(self.footage.homographies[i - 1])
        observation = Observation(frame)  # what it computes when first asked is part of the times
        clock = time.perf_counter
        begin = clock()
        proposal = tracker.propose(observation).homography
        proposed = clock()
        tracker.target.refiner.align(observation, proposal)
        refined = clock()
        parts = {
            "translation": done["translation"] - begin,
            "scale and rotation": done["polar"] - done["translation"],
            "residual": proposed - done["polar"],
            STAGES: proposed - begin,
            "refinement": refined - proposed,
        }
        tracker.place(self.footage.homographies[i - 1])
        begin = clock()
        tracker.track(frame)
        parts["whole tracker"] = clock() - begin
        self.proposals[i] = proposal
        return parts


def authors(footage: Footage) -> Callable[[int], dict[str, float]]:
    """The paper's configuration as the authors run it."""
    tracker = AuthorsTracker(unmoved())
    tracker.init(footage.frames[0], footage.quad)

    def measure(i: int) -> dict[str, float]:
        tracker.homography = footage.homographies[i - 1]
        begin = time.perf_counter()
        tracker.track(footage.frames[i])
        return {STAGES: time.perf_counter() - begin}

    return measure


def unmoved() -> Hdn:
    """The paper's networks with weights by chance, but for last layers that answer 'the pose is as it was'.

    They take the time of trained ones, and no chance answer makes for vast windows.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        network = Hdn(PAPER)
    s: Any = network.similarity
    fc: Any = network.residual.fc
    heads = [head.head[-1] for maps in (s.translation, s.polar) for head in (*maps.cls.values(), *maps.loc.values())]
    with torch.no_grad():
        for layer in (*heads, fc):
            layer.weight.zero_()
            layer.bias.zero_()
        for head in s.polar.cls.values():
            head.head[-1].bias[1] = -5.0  # a low score: neither scale nor rotation
    return network


def difference(one: dict[int, Array], other: dict[int, Array], quad: Array) -> float:
    """Largest distance, px, between the corners that two engines propose for the same frames from the same poses."""
    common = one.keys() & other.keys()
    return max(float(np.linalg.norm(transform(one[i], quad) - transform(other[i], quad), axis=1).max()) for i in common)


@contextlib.contextmanager
def limited(threads: int | None) -> Iterator[int]:
    """All libraries kept to so many processors, or to all there are: how many that is.

    Raises:
        InputError: there are fewer, or the system cannot keep a process to some of its processors.
    """
    every = sorted(os.sched_getaffinity(0)) if sys.platform == "linux" else list(range(os.cpu_count() or 1))
    if threads is None or threads == len(every):
        yield len(every)
        return
    if threads > len(every):
        raise InputError(f"--threads {threads}: this machine has {len(every)}")
    if sys.platform != "linux":
        raise InputError("--threads can only be less than all on Linux: leave it out")
    before = torch.get_num_threads(), cv2.getNumThreads()
    os.sched_setaffinity(0, every[:threads])
    torch.set_num_threads(threads)
    cv2.setNumThreads(threads)
    try:
        yield threads
    finally:
        os.sched_setaffinity(0, every)
        torch.set_num_threads(before[0])
        cv2.setNumThreads(before[1])


def benchmark(rounds: int, threads: int, weights_path: Path | None = None) -> dict[str, Any]:
    """Measures all subjects in turns, so that whatever else the machine does biases none.

    Returns:
        Machine, times in ms by subject and part, ratios of medians, and the engines' largest corner differences, px.
    """
    machine = _machine(threads)
    if machine["load"] and machine["load"] > threads / 2:
        log.warning("other work keeps the machine busy, which slows PyTorch more than OpenVINO: repeat it when idle")
    footage = Footage()
    engines = [("cpu", "openvino"), ("cpu", "torch")]
    engines += [("cuda", "torch")] if torch.cuda.is_available() else []
    path = weights_path or weights.shipped()
    # Each engine loads its own networks, for PyTorch moves them to its device.
    compacts = [Compact(Clocked(load(path), *engine), footage) for engine in engines]
    subjects = [Subject(f"compact, {_title(c.engine)}", c.measure) for c in compacts]
    subjects.append(Subject("paper, as its authors run it, PyTorch on the CPU", authors(footage), burst=1))
    for number in tqdm(range(rounds), unit=" rounds", disable=not sys.stderr.isatty()):
        for subject in subjects:
            subject.run(number * 5)

    times = {s.name: s.milliseconds() for s in subjects}
    fast, slow, *_, paper = (times[s.name][STAGES]["p50"] for s in subjects)
    return {
        "machine": machine,
        "frame": FRAME,
        "rounds": rounds,
        "ms": times,
        "ratios": {
            "paper as its authors run it : compact through OpenVINO": paper / fast,
            f"the authors' {AUTHORS_MS} ms : compact through OpenVINO": AUTHORS_MS / fast,
            "compact through PyTorch : through OpenVINO": slow / fast,
        },
        "corner_difference_px": {
            s.name: difference(compacts[0].proposals, c.proposals, footage.quad)
            for s, c in zip(subjects[1:], compacts[1:], strict=False)
        },
        "cuda": torch.cuda.get_device_name() if torch.cuda.is_available() else None,
    }


def _title(engine: Clocked) -> str:
    half = ", half precision" if "cuda" in engine.description and engine.config.half else ""
    return engine.description.replace(" cpu", " the CPU").replace("cuda", "CUDA") + half


def _machine(threads: int) -> dict[str, Any]:
    info = Path("/proc/cpuinfo")
    names = [line.split(":")[1].strip() for line in _lines(info) if line.startswith("model name")]
    return {
        "processor": names[0] if names else platform.processor() or platform.machine(),
        "processors": os.cpu_count(),
        "threads": threads,
        "load": round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None,
        "python": platform.python_version(),
        "torch": torch.__version__,
        "openvino": openvino.__version__.split("-")[0],
        "opencv": cv2.__version__,
    }


def _lines(path: Path) -> list[str]:
    return path.read_text().splitlines() if path.exists() else []


def describe(report: dict[str, Any]) -> str:
    """The report of `benchmark` as lines to read."""
    m = report["machine"]
    lines = [
        f"{m['processor']}, {m['threads']} of {m['processors']} processors, load {m['load']} at the start",
        f"Python {m['python']}, PyTorch {m['torch']}, OpenVINO {m['openvino']}, OpenCV {m['opencv']}",
        f"Frames of {report['frame'][0]}x{report['frame'][1]}, the target {TARGET[0]}x{TARGET[1]}; all measured in "
        f"turns, {report['rounds']} rounds",
        "",
        f"{'ms a frame':46}" + "".join(f"{column:>9}" for column in COLUMNS),
    ]
    for subject, parts in report["ms"].items():
        lines.append(subject)
        lines += [f"  {part:44}" + "".join(f"{ms[c]:9.1f}" for c in COLUMNS) for part, ms in parts.items()]
    if report["cuda"] is None:
        lines.append("compact, PyTorch on CUDA, half precision: none, for there is no CUDA device")
    lines += ["", f"Ratios of {STAGES}, medians:"]
    lines += [f"  {name:62}{ratio:9.1f}" for name, ratio in report["ratios"].items()]
    lines.append(f"  (their {AUTHORS_MS} ms: frames of 1920x804, on two AVX-512 cores of another machine)")
    lines += ["", f"Largest difference of corners from OpenVINO's, px (to agree to {AGREEMENT}):"]
    lines += [f"  {name:62}{px:9.4f}" for name, px in report["corner_difference_px"].items()]
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of hdn-bench."""
    sys.exit(run(_command, arguments, "nothing was measured to the end"))


def _command(arguments: Sequence[str] | None) -> int:
    options = _parser().parse_args(arguments)
    logging.basicConfig(format="%(levelname)s: %(message)s", level=logging.WARNING)
    with limited(options.threads) as threads:
        report = benchmark(options.rounds, threads, options.weights)
    print(json.dumps(report, indent=2) if options.json else describe(report))
    return DONE


def _parser() -> Parser:
    parser = Parser(
        "hdn-bench",
        "Time HDN on this machine: the compact configuration stage by stage, through OpenVINO and PyTorch, and the "
        "paper's as its authors run it, on frames of 1280x720 drawn here.",
        "Exit status: 0 done, 1 failed while working, 2 wrong input.",
    )
    parser.add_argument("--threads", type=natural, metavar="N", help="processors to use (default: all)")
    parser.add_argument("--rounds", type=natural, default=ROUNDS, metavar="N", help=f"turns (default {ROUNDS})")
    parser.add_argument("--weights", type=Path, metavar="FILE", help="of the compact configuration (default: shipped)")
    parser.add_argument("--json", action="store_true", help="print JSON")
    return parser


if __name__ == "__main__":
    main()
