"""`python -m ar_demo.evaluation.report`, or `make benchmarks`: measures everything and writes docs/benchmarks.md.

Clips, tracks and figures stay in a working folder: what is there already, by the same code and weights, is not made
again, and after an interruption the same command goes on from there.
"""

import logging
import platform
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

import cv2
import openvino

from hdn.benchmark.datasets import open_dataset
from hdn.benchmark.degradation import DEGRADATIONS
from hdn.benchmark.evaluation import Evaluation
from hdn.benchmark.identity import commit, machine
from hdn.benchmark.report import Result, averages, by_tracker, markdown, section
from hdn.benchmark.sequences import Sequence as Clips
from hdn.benchmark.synthplanar.cli import SETTINGS, VERSION, generate, made
from hdn.benchmark.synthplanar.pictures import Pictures
from hdn.benchmark.synthplanar.scenes import CHALLENGES
from hdn.benchmark.trackers import weights_of
from hdn.commandline import DONE, Parser, run

from ..errors import InputError, RunError
from .cli import evaluate_all, sheet, write
from .published import PUBLISHED
from .scenes import read_scenes

ALL = ("hdn", "hdn-raw", "hdn-similarity", "hdn-residual", "sift", "orb", "ecc", "flow")
COMPARED = ("hdn", "sift", "orb", "ecc", "flow")
SEED, FRAMES = 0, 60  # of SynthPlanar's clips
CLIP_FRAMES = 60  # of a real clip, at most
SHEET_ROWS, SHEET_WIDTH = 4, 800  # of the pictures in the report

TRACKERS = """\
`hdn` is the whole tracker; `hdn-raw` is HDN's stages alone, without refinement and without looking again for what is
lost; `hdn-similarity` and `hdn-residual` are its halves. `sift` and `orb` match keypoints with the first frame
(MAGSAC), `ecc` aligns the first view by its correlation, `flow` adds up pyramidal Lucas-Kanade from frame to frame; all
are OpenCV's. Errors are px of the frame, `ms` is a frame's time. `hdn/benchmark/metrics.py` defines every figure.
"""

COMPOSITES = """\
`ar-eval` puts the ad onto the poster's clip and compares with the same scene filmed with the ad. `ours` is the pipeline
as it is without options; `true corners` is our compositor with the true corners, so that the gap between the two is the
tracker's; `plain warp` has our corners, bilinear sampling and hard edges. Composites are compared as they are drawn,
before any encoding; the clips they are drawn on, and the true one, are compressed.
"""


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point."""
    sys.exit(run(_command, arguments, "what is finished is kept, the same command goes on from there"))


def _command(arguments: Sequence[str] | None) -> int:
    parser = Parser(prog="python -m ar_demo.evaluation.report", description="Measure everything, and write it down.")
    parser.add_argument("clips", type=Path, nargs="?", help="also a folder of real clips with their corners")
    parser.add_argument("--out", type=Path, default=Path("runs/benchmarks"), metavar="DIR", help="working folder")
    parser.add_argument("--report", type=Path, default=Path("docs/benchmarks.md"), metavar="FILE")
    parser.add_argument("--frames", type=int, default=FRAMES, metavar="N", help=f"in each made clip (default {FRAMES})")
    options = parser.parse_args(arguments)
    logging.basicConfig(format="%(levelname)s: %(message)s", level=logging.WARNING)
    if options.frames < 2:
        raise InputError("--frames takes 2 or more")
    pictures = options.report.with_suffix("")
    pictures.mkdir(parents=True, exist_ok=True)
    heading = _heading(options.frames)  # before there is any load of ours
    made_clips = _make_clips(options.out / "SynthPlanar", options.frames)
    text = [*heading, *_tracking(made_clips, options.out, pictures)]
    if options.clips is not None:
        text += _real(options.clips, options.out, pictures)
    text += [*_compositing(made_clips, options.out, pictures), PUBLISHED]
    options.report.write_text("\n".join(text), encoding="utf-8")
    print(f"Written to {options.report}")
    return DONE


def _make_clips(folder: Path, frames: int) -> Path:
    setting, pictures = SETTINGS["quick"], Pictures(None)
    for attribute in CHALLENGES:
        if not made(folder, attribute, 0, setting, frames, SEED):
            generate(folder, attribute, 0, setting, frames, SEED, pictures)
    return folder


def _heading(frames: int) -> list[str]:
    setting = SETTINGS["quick"]
    versions = f"Python {platform.python_version()}, OpenCV {cv2.__version__}, OpenVINO {openvino.__version__}"
    return [
        "# Benchmarks",
        "",
        "`make benchmarks CLIPS=folder` wrote this page; `make benchmarks` leaves the real clips out.",
        "",
        f"Machine: {machine()}. Commit: {commit()}. {versions}. SynthPlanar: version {VERSION}, seed {SEED}, "
        f"{len(CHALLENGES)} clips of {frames} frames, {setting.width}x{setting.height}.",
        "",
    ]


def _tracking(folder: Path, out: Path, pictures: Path) -> list[str]:
    results = _run(open_dataset(f"clips:{folder}"), ALL, out / "tracking")
    plots = _plots(out / "tracking" / folder.name, pictures, "synthplanar", ("precision", "attributes"))
    return ["## Tracking: SynthPlanar", "", TRACKERS, *section(by_tracker(results)), *plots]


def _real(folder: Path, out: Path, pictures: Path) -> list[str]:
    clips = [c.limited(CLIP_FRAMES) for c in open_dataset(str(folder))]
    results = _run(clips, COMPARED, out / "clips")
    plots = _plots(out / "clips" / clips[0].dataset, pictures, "clips", ("precision",))
    names = ", ".join(f"`{c.name}`" for c in clips)
    harder = _run([c.degraded(kind) for kind in DEGRADATIONS for c in clips], COMPARED, out / "degraded")
    kinds = {f"{clips[0].dataset}+{kind}": kind for kind in DEGRADATIONS}
    table = {
        tracker: {kind: _average_precision(group, dataset) for dataset, kind in kinds.items()}
        for tracker, group in by_tracker(harder).items()
    }
    return [
        "## Tracking: real clips",
        "",
        f"{names}: the first {CLIP_FRAMES} frames of each, at most. Their corners are as good as whoever measured "
        "them; where that was by keypoints, `sift` is at an advantage.",
        "",
        *section(by_tracker(results)),
        *plots,
        "The same clips made harder, average precision:",
        "",
        *markdown(table),
        "",
        "; ".join(f"{kind}: {text}" for kind, text in DEGRADATIONS.items()) + ".",
        "",
    ]


def _average_precision(group: list[Result], dataset: str) -> float:
    return averages({"": [r for r in group if r.sequence.dataset == dataset]})["sequences"][""]["avg Prec"]


def _compositing(folder: Path, out: Path, pictures: Path) -> list[str]:
    scores = evaluate_all(read_scenes(folder), out / "composites")
    tables = write(scores, out / "composites")
    ranked = sorted(scores, key=lambda s: float(s.mean[0, 0]))
    shown = sheet(ranked[:: -(-len(ranked) // SHEET_ROWS)], out / "composites", "median")
    size = (SHEET_WIDTH, round(shown.shape[0] * SHEET_WIDTH / shown.shape[1]))
    small = cv2.cvtColor(cv2.resize(shown, size, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2BGR)
    cv2.imwrite(str(pictures / "composites.jpg"), small, [cv2.IMWRITE_JPEG_QUALITY, 75])
    return [
        "## Composites: SynthPlanar",
        "",
        COMPOSITES,
        tables,
        "Median frames of some clips, from the worst clip to the best; poster, true ad, ours, plain warp:",
        "",
        f"![Composites]({pictures.name}/composites.jpg)",
        "",
    ]


def _run(clips: list[Clips], trackers: Sequence[str], out: Path) -> list[Result]:
    evaluation = Evaluation(clips, {name: weights_of(name, ()) for name in trackers}, out)
    evaluation.run()
    evaluation.check()
    evaluation.write()
    return evaluation.results()


def _plots(source: Path, pictures: Path, prefix: str, names: Sequence[str]) -> list[str]:
    """Copies plots beside the report, and returns the lines that show them."""
    lines = []
    for name in names:
        if not (source / f"{name}.png").is_file():
            raise RunError(f"{source / name}.png was not drawn: install Matplotlib (pip install 'ar-replace[bench]')")
        shutil.copyfile(source / f"{name}.png", pictures / f"{prefix}-{name}.png")
        lines += [f"![{name}]({pictures.name}/{prefix}-{name}.png)", ""]
    return lines


if __name__ == "__main__":
    main()
