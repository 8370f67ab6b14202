"""`ar-bench`: what tracking and rendering cost, beside a plain transcode of the same clip.

Each job is a process of its own, as a user starts it, and they take turns: transcode, track, render from that track,
and the whole. The system's own account of each finished process gives its processor time and its peak memory, so that
what else the machine does disturbs the ratios little.
"""

import json
import logging
import os
import subprocess
import sys
import time
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from hdn.benchmark.identity import commit, machine
from hdn.commandline import DONE, Parser, natural, run

from ..errors import InputError, RunError
from ..media.reader import VideoReader
from .drawn_clips import Kind

JOBS = ("transcode", "track", "render", "whole")
MODULES = {
    "transcode": ["-m", "ar_demo.evaluation.transcode"],
    "track": ["-c", "from ar_demo.cli.entry import track_main; track_main()"],
    "render": ["-c", "from ar_demo.cli.entry import replace_main; replace_main()"],
}
ROUNDS = 3
AD_SIZE = (640, 360)  # px, of the drawn clips' ad
MIB = 2**20


@dataclass(frozen=True)
class Cost:
    """What a process cost.

    Attributes:
        seconds: by the clock. processor: seconds of all its threads. memory: MiB at its peak.
        first: seconds to its first frame; None where it does not tell.
    """

    seconds: float
    processor: float
    memory: float
    first: float | None


@dataclass(frozen=True)
class Subject:
    """A clip that is measured: its name, its file, how many frames it has, and the arguments that say the surfaces."""

    name: str
    clip: Path
    frames: int
    quads: list[str]
    ad: Path


class Bench:
    """Runs the jobs on a clip, by turns."""

    def __init__(self, subject: Subject, folder: Path) -> None:
        self.subject, self._folder = subject, folder
        self.costs: dict[str, list[Cost]] = {job: [] for job in JOBS}
        self._track = folder / "track.json"

    def command(self, job: str) -> list[str]:
        """The arguments of a job, after Python's."""
        s, out = self.subject, str(self._folder / f"{job}.mp4")
        told = ["--overwrite", "--progress", "json"]
        if job == "transcode":
            return [str(s.clip), out]
        if job == "track":
            return [str(s.clip), "--quad", *s.quads[0].split(), "-o", str(self._track), *told]
        if job == "render":
            return [str(s.clip), str(s.ad), "--track", str(self._track), "-o", out, *told]
        if len(s.quads) == 1:
            return [str(s.clip), str(s.ad), "--quad", *s.quads[0].split(), "-o", out, *told]
        surfaces = [word for quad in s.quads for word in ("--surface", str(s.ad), *quad.split())]
        return [str(s.clip), *surfaces, "-o", out, *told]

    def run(self, rounds: int) -> None:
        """Measures all jobs so many times, in turns; of several surfaces the transcode and the whole alone.

        Raises:
            RunError: a job failed.
        """
        jobs = JOBS if len(self.subject.quads) == 1 else ("transcode", "whole")
        for _ in range(rounds):
            for job in jobs:
                self.costs[job].append(cost_of([*MODULES["render" if job == "whole" else job], *self.command(job)]))

    def stages(self) -> dict[str, dict[str, float]]:
        """Processor time by job and stage, ms a frame; see `stages`."""
        told = {}
        for job in ("track", "render"):
            out = self._folder / f"{job}.stages.json"
            name = "ar-track" if job == "track" else "ar-replace"
            cost_of(["-m", "ar_demo.evaluation.stages", str(out), name, *self.command(job)])
            seconds = json.loads(out.read_text(encoding="utf-8"))
            told[job] = {stage: s * 1000 / self.subject.frames for stage, s in seconds.items()}
        return told


def cost_of(arguments: Sequence[str]) -> Cost:
    """Runs Python with these arguments; the first line that it prints tells of the first frame.

    Raises:
        RunError: it failed.
    """
    begin = time.perf_counter()
    process = subprocess.Popen([sys.executable, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stderr is not None
    first = time.perf_counter() - begin if process.stdout.readline() else None
    process.stdout.read()
    said = process.stderr.read()
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - begin
    process.returncode = os.waitstatus_to_exitcode(status)
    process.stdout.close()
    process.stderr.close()
    if process.returncode:
        raise RunError(f"'{' '.join(arguments[:3])} ...' failed: {said.decode(errors='replace').strip()[-300:]}")
    memory = usage.ru_maxrss / (MIB if sys.platform == "darwin" else 1024)
    return Cost(seconds, usage.ru_utime + usage.ru_stime, memory, first)


def measure(subject: Subject, rounds: int, with_stages: bool) -> dict[str, Any]:
    """The report on a clip: costs by job (medians), the ratios of each round's jobs to its transcode (medians)."""
    with TemporaryDirectory(dir=subject.clip.parent) as folder:
        bench = Bench(subject, Path(folder))
        bench.run(rounds)
        stages = bench.stages() if with_stages and len(subject.quads) == 1 else {}
    costs = {job: found for job, found in bench.costs.items() if found}
    plain = costs["transcode"]
    return {
        "name": subject.name,
        "frames": subject.frames,
        "surfaces": len(subject.quads),
        "jobs": {job: _median([asdict(cost) for cost in found]) for job, found in costs.items()},
        "to_transcode": {
            job: _median(
                [
                    {
                        "seconds": cost.seconds / one.seconds,
                        "processor": cost.processor / one.processor,
                        "memory": cost.memory - one.memory,
                        "ms_a_frame": (cost.processor - one.processor) * 1000 / subject.frames,
                    }
                    for cost, one in zip(found, plain, strict=True)
                ]
            )
            for job, found in costs.items()
        },
        "stages": stages,
    }


def _median(rows: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        key: None if any(row[key] is None for row in rows) else float(np.median([row[key] for row in rows]))
        for key in rows[0]
    }


def describe(reports: Sequence[dict[str, Any]], rounds: int) -> str:
    """The reports as Markdown."""
    lines = [
        f"{machine()}; commit {commit()}. Medians of {rounds} turns. `cpu` is processor time of all threads, its start "
        "among it, ms a frame, and `over` how much more than the transcode's; `cpu ratio` and `wall` are ratios to the "
        "transcode's of the same turn; `memory` is the peak, MiB, and `over` how much more than the transcode's; "
        "`first` is from the start of the process to its first frame, s.",
        "",
        "| clip | job | cpu | over | cpu ratio | wall | memory | over | first |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for report in reports:
        for job, cost in report["jobs"].items():
            to = report["to_transcode"][job]
            first = "" if cost["first"] is None or job == "transcode" else f"{cost['first']:.2f}"
            lines.append(
                f"| {report['name']} | {job} | {cost['processor'] * 1000 / report['frames']:.1f} | "
                f"{to['ms_a_frame']:.1f} | {to['processor']:.2f} | {to['seconds']:.2f} | {cost['memory']:.0f} | "
                f"{to['memory']:.0f} | {first} |"
            )
    for report in reports:
        for job, stages in report["stages"].items():
            lines += ["", f"{report['name']}, {job}, ms of processor time a frame by stage:", ""]
            lines += ["| stage | ms |", "|---|---|"]
            lines += [f"| {stage} | {ms:.2f} |" for stage, ms in sorted(stages.items(), key=lambda one: -one[1])]
    return "\n".join(lines) + "\n"


def plot(reports: Sequence[dict[str, Any]], path: Path) -> None:
    """Draws where the time goes: a bar for each job whose stages are known.

    Raises:
        RunError: Matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ModuleNotFoundError as error:
        raise RunError("--plot takes Matplotlib: pip install 'ar-replace[bench]'") from error
    bars = [(f"{r['name']}\n{job}", stages) for r in reports for job, stages in r["stages"].items()]
    figure = Figure(figsize=(9, 1.5 + 0.9 * len(bars)), layout="constrained")
    axes = figure.subplots()
    names = sorted({s for _, stages in bars for s in stages}, key=lambda s: -max(one.get(s, 0) for _, one in bars))
    left = np.zeros(len(bars))
    for k, name in enumerate(names):
        widths = np.array([stages.get(name, 0) for _, stages in bars])
        axes.barh([label for label, _ in bars], widths, left=left, label=name, color=f"C{k % 10}", hatch=HATCH[k // 10])
        left += widths
    axes.set_xlabel("ms of processor time a frame")
    axes.legend(ncols=4, fontsize=8, loc="upper center", bbox_to_anchor=(0.45, -0.25))
    figure.savefig(path, dpi=110)


HATCH = ("", "//", "..")


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of ar-bench."""
    sys.exit(run(_command, arguments, "nothing was measured to the end"))


def _command(arguments: Sequence[str] | None) -> int:
    options = _parser().parse_args(arguments)
    logging.basicConfig(format="%(levelname)s: %(message)s", level=logging.WARNING)
    if not hasattr(os, "wait4"):
        raise InputError("ar-bench needs a system that accounts for finished processes: Linux or macOS")
    if options.plot is not None and not options.stages:
        raise InputError("--plot draws what --stages measures: give both")
    with TemporaryDirectory(prefix="ar-bench-", dir=options.folder) as folder:
        if options.clip is not None:
            subjects = [_given(options)]
        else:
            subjects = [_drawn(kind, Path(folder)) for kind in _kinds(options)]
        reports = [measure(subject, options.rounds, options.stages) for subject in subjects]
    if options.plot is not None:
        plot(reports, options.plot)
    print(json.dumps(reports, indent=2) if options.json else describe(reports, options.rounds), end="")
    return DONE


def _given(options: Namespace) -> Subject:
    """The clip of the command line.

    Raises:
        InputError: it is not given whole, or cannot be read; options for drawn clips.
    """
    if options.ad is None or options.quad is None:
        raise InputError("give a clip, an ad and --quad: ar-bench CLIP AD --quad x,y x,y x,y x,y; or none of them")
    for name in ("size", "share", "frames", "surfaces"):
        if getattr(options, name) is not None:
            raise InputError(f"--{name} is for clips that are drawn, and {options.clip} is given: leave it out")
    with VideoReader(options.clip) as reader:
        frames = len(reader.times) if reader.seekable else reader.info.frames
        name = f"{options.clip.name}, {reader.info.width}x{reader.info.height}"
    if not frames:
        raise InputError(f"{options.clip} does not tell how many frames it has: transcode it first")
    return Subject(name, options.clip.resolve(), frames, [" ".join(options.quad)], options.ad.resolve())


def _kinds(options: Namespace) -> list[Kind]:
    """The kinds of clips that are to be drawn.

    Raises:
        InputError: an option for a clip that is not given.
    """
    if options.quad is not None:
        raise InputError("--quad is for a clip that is given: name it, or leave --quad out")
    sizes, shares = options.size or ["1280x720"], options.share or [25.0]
    kinds = product(map(_size, sizes), shares, options.frames or [100], options.surfaces or [1])
    return [Kind(*size, share / 100, frames, surfaces) for size, share, frames, surfaces in kinds]


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal() and min(int(width), int(height)) >= 64):
        raise InputError(f"size {text!r} is not like 1280x720: give width and height in px, 64 at least")
    return int(width), int(height)


def _drawn(kind: Kind, folder: Path) -> Subject:
    name = f"{kind.width}x{kind.height}, {kind.share:.0%}, {kind.frames} frames"
    if kind.surfaces > 1:
        name += f", {kind.surfaces} surfaces"
    clip, ad = folder / f"{name.replace(', ', '-').replace(' ', '-')}.mp4", folder / "ad.mp4"
    _draw(clip, kind)
    if not ad.exists():
        _draw(ad, Kind(*AD_SIZE, 0.5, 60))
    quads = [" ".join(f"{x:.2f},{y:.2f}" for x, y in quad) for quad in kind.quads]
    return Subject(name, clip, kind.frames, quads, ad)


def _draw(path: Path, kind: Kind) -> None:
    """Draws a clip in a process of its own: on Linux a job's peak memory is at least that of whoever starts it."""
    cost_of(["-m", "ar_demo.evaluation.drawn_clips", str(path), *map(str, astuple(kind))])


def _parser() -> Parser:
    parser = Parser(
        "ar-bench",
        "Measure tracking, rendering and the whole job on a clip beside a plain transcode with the same decoder and "
        "encoder: processor and wall time, ms a frame, peak memory. Without a clip, clips are drawn.",
        "Exit status: 0 done, 1 failed while working, 2 wrong input.",
    )
    parser.add_argument("clip", type=Path, nargs="?", help="video with one surface (default: clips that are drawn)")
    parser.add_argument("ad", type=Path, nargs="?", help="what is put on it")
    parser.add_argument("--quad", nargs=4, metavar="X,Y", help="the surface's corners in the clip's first frame, px")
    parser.add_argument("--rounds", type=natural, default=ROUNDS, metavar="N", help=f"turns (default {ROUNDS})")
    parser.add_argument("--stages", action="store_true", help="tell processor time by stage as well (Linux)")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw that: PNG or SVG")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--folder", type=Path, metavar="DIR", help="where clips are written (default: the system's)")
    drawn = parser.add_argument_group("clips that are drawn; several values each, all combinations are measured")
    drawn.add_argument("--size", nargs="+", metavar="WxH", help="px (default 1280x720)")
    drawn.add_argument("--share", nargs="+", type=float, metavar="%", help="of the frame's area (default 25)")
    drawn.add_argument("--frames", nargs="+", type=natural, metavar="N", help="length (default 100)")
    drawn.add_argument("--surfaces", nargs="+", type=natural, metavar="N", help="that share the area (default 1)")
    return parser


if __name__ == "__main__":
    main()
