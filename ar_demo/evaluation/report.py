"""`python -m ar_demo.evaluation.report`, or `make benchmarks`: measures everything and writes docs/benchmarks.md.

Clips, tracks and figures stay in a working folder: what is there already, by the same code and weights, is not made
again, and after an interruption the same command goes on from there.
"""

import logging
import platform
import shutil
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import cv2
import openvino

from hdn.benchmark.datasets import open_dataset
from hdn.benchmark.degradation import DEGRADATIONS
from hdn.benchmark.evaluation import Evaluation
from hdn.benchmark.identity import commit, machine
from hdn.benchmark.metrics import Measures, figures, mean_figures, pooled
from hdn.benchmark.report import TRACKED_WRONGLY, Result, by_tracker, markdown, section
from hdn.benchmark.sequences import Sequence as Clips
from hdn.benchmark.synthplanar.cli import SETTINGS, VERSION, generate, made
from hdn.benchmark.synthplanar.pictures import Pictures
from hdn.benchmark.synthplanar.scenes import APPEARANCE, CHALLENGES, INTERRUPTED
from hdn.benchmark.trackers import weights_of
from hdn.commandline import DONE, Parser, run

from ..errors import InputError, RunError
from .cli import evaluate_all, sheet, write
from .published import PUBLISHED
from .scenes import read_scenes
from .tracking import CLIP_TRACKERS

ALL = ("ar-track", "hdn", "hdn-raw", "hdn-similarity", "hdn-residual", "sift", "orb", "ecc", "flow")
COMPARED = ("ar-track", "hdn", "sift", "orb", "ecc", "flow")
SEED, FRAMES = 0, 60  # of SynthPlanar's clips; of those whose view is interrupted for long, there are twice as many
FINAL_SEED = 2027  # of the clips that are made to judge composites, and are never looked at while these are worked on
CLIP_FRAMES = 60  # of a real clip, at most
WORKERS = 2  # processes at once, where no times are told
SHEET_ROWS, SHEET_WIDTH = 4, 800  # of the pictures in the report

TRACKERS = """\
`ar-track` is the product's own tracking of the whole clip, offline, with default options; `hdn` is the whole tracker,
once forward and frame by frame, as all others here; `hdn-raw` is HDN's stages alone, without refinement and without
looking again for what is lost; `hdn-similarity` and `hdn-residual` are its halves. `sift` and `orb` match keypoints
with the first frame (MAGSAC), `ecc` aligns the first view by its correlation, `flow` adds up pyramidal Lucas-Kanade
from frame to frame; all are OpenCV's. Errors are px of the frame, `ms` is a frame's time, which for `ar-track` includes
reading the video. `hdn/benchmark/metrics.py` defines every figure.
"""

INTERRUPTIONS = """\
The view is interrupted. `wall`: hands reach over a target on a wall in its plane; `hands`: the same before a street;
`board`: people and posts pass before a target on a board in its plane; `absence`: the target is out of view for a third
of the clip; `hidden`: it is wholly behind somebody for as long. Frames in which nothing of it is seen do not count.
"""

APPEARANCE_TEXT = """\
What a composite has to take on, beside where it lies: shadows and glare on the surface in the first frame already,
moving or still, a lens that goes out of focus or is soft throughout, grain, fingers and hair before a poster of their
colours, a screen. Their seed is used for this table alone.
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
    parser.add_argument(
        "--clip-frames", type=int, default=CLIP_FRAMES, metavar="N", help=f"of each real clip (default {CLIP_FRAMES})"
    )
    options = parser.parse_args(arguments)
    logging.basicConfig(format="%(levelname)s: %(message)s", level=logging.WARNING)
    if min(options.frames, options.clip_frames) < 2:
        raise InputError("--frames and --clip-frames take 2 or more")
    pictures = options.report.with_suffix("")
    pictures.mkdir(parents=True, exist_ok=True)
    heading = _heading(options.frames)  # before there is any load of ours
    made_clips = _make_clips(options.out / "SynthPlanar", CHALLENGES, options.frames)
    interrupted = _make_clips(options.out / "SynthPlanar-interrupted", INTERRUPTED, 2 * options.frames)
    text = [*heading, "## Tracking: SynthPlanar", "", TRACKERS, *_tracking(made_clips, ALL, options.out, pictures)]
    text += ["## Tracking: SynthPlanar, interrupted views", "", INTERRUPTIONS]
    text += _tracking(interrupted, COMPARED, options.out, pictures)
    if options.clips is not None:
        text += _real(options.clips, options.clip_frames, options.out, pictures)
    text += [
        "## Composites: SynthPlanar",
        "",
        COMPOSITES,
        *_compositing(made_clips, options.out, pictures, "composites"),
    ]
    judged = _make_clips(options.out / "SynthPlanar-appearance", APPEARANCE, options.frames, FINAL_SEED)
    text += ["## Composites: what has to pass for real", "", APPEARANCE_TEXT]
    text += [*_compositing(judged, options.out, pictures, "appearance"), PUBLISHED]
    options.report.write_text("\n".join(text), encoding="utf-8")
    print(f"Written to {options.report}")
    return DONE


def _make_clips(folder: Path, attributes: Iterable[str], frames: int, seed: int = SEED) -> Path:
    setting, pictures = SETTINGS["quick"], Pictures(None)
    for attribute in attributes:
        if not made(folder, attribute, 0, setting, frames, seed):
            generate(folder, attribute, 0, setting, frames, seed, pictures)
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
        f"{len(CHALLENGES)} clips of {frames} frames and {len(INTERRUPTED)} of {2 * frames}, "
        f"{setting.width}x{setting.height}.",
        "",
    ]


def _tracking(folder: Path, trackers: Sequence[str], out: Path, pictures: Path) -> list[str]:
    results = _run(open_dataset(f"clips:{folder}"), trackers, out / "tracking")
    plots = _plots(out / "tracking" / folder.name, pictures, folder.name.lower(), ("precision", "attributes"))
    return [*section(by_tracker(results)), *plots]


def _real(folder: Path, frames: int, out: Path, pictures: Path) -> list[str]:
    clips = [c.limited(frames) for c in open_dataset(str(folder))]
    results = _run(clips, COMPARED, out / "clips")
    plots = _plots(out / "clips" / clips[0].dataset, pictures, "clips", ("precision",))
    harder = _measure([c.degraded(kind) for kind in DEGRADATIONS for c in clips], COMPARED, out / "degraded", WORKERS)
    kinds = {"clean": results, **{kind: [] for kind in DEGRADATIONS}}
    for result in harder:
        kinds[result.sequence.dataset.rpartition("+")[2]].append(result)
    names = ", ".join(f"`{c.name}`" for c in clips)
    return [
        "## Tracking: real clips",
        "",
        f"{names}: the first {frames} frames of each, at most. Their corners are as good as whoever measured "
        "them; where that was by keypoints, `sift` is at an advantage.",
        "",
        *section(by_tracker(results)),
        *plots,
        "### The same clips made harder",
        "",
        "; ".join(f"{kind}: {text}" for kind, text in DEGRADATIONS.items()) + ".",
        "",
        "Average precision, mean over sequences:",
        "",
        *markdown(_by_kind(kinds, lambda measures: mean_figures(measures)["avg Prec"])),
        "",
        "P<=5, mean over sequences:",
        "",
        *markdown(_by_kind(kinds, lambda measures: mean_figures(measures)["P<=5"])),
        "",
        f"{TRACKED_WRONGLY}, all frames pooled:",
        "",
        *markdown(_by_kind(kinds, lambda measures: figures(pooled(measures))["tracked wrongly"])),
        "",
    ]


def _by_kind(kinds: dict[str, list[Result]], figure: Callable[[list[Measures]], float]) -> dict[str, dict[str, float]]:
    """Each tracker's figure for each kind of clips, and for all of them together."""
    everything = {**kinds, "all": [r for of_kind in kinds.values() for r in of_kind]}
    of_tracker = {kind: by_tracker(of_kind) for kind, of_kind in everything.items()}
    return {
        tracker: {kind: figure([r.measures for r in groups[tracker]]) for kind, groups in of_tracker.items()}
        for tracker in of_tracker["all"]
    }


def _compositing(folder: Path, out: Path, pictures: Path, name: str) -> list[str]:
    scores = evaluate_all(read_scenes(folder), out / "composites")
    tables = write(scores, out / "composites")
    ranked = sorted(scores, key=lambda s: float(s.mean[0, 0]))
    shown = sheet(ranked[:: -(-len(ranked) // SHEET_ROWS)], out / "composites", "median")
    size = (SHEET_WIDTH, round(shown.shape[0] * SHEET_WIDTH / shown.shape[1]))
    small = cv2.cvtColor(cv2.resize(shown, size, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2BGR)
    cv2.imwrite(str(pictures / f"{name}.jpg"), small, [cv2.IMWRITE_JPEG_QUALITY, 75])
    return [
        tables,
        "Median frames of some clips, from the worst clip to the best; poster, true ad, ours, plain warp:",
        "",
        f"![Composites]({pictures.name}/{name}.jpg)",
        "",
    ]


def _run(clips: list[Clips], trackers: Sequence[str], out: Path) -> list[Result]:
    """Measures trackers, and writes tables, plots and sheets of the worst frames."""
    evaluation = _evaluation(clips, trackers, out)
    evaluation.run()
    evaluation.check()
    evaluation.write()
    return evaluation.results()


def _measure(clips: list[Clips], trackers: Sequence[str], out: Path, workers: int) -> list[Result]:
    """Measures trackers; with several processes at once, by which times do not compare."""
    evaluation = _evaluation(clips, trackers, out)
    evaluation.run(workers)
    evaluation.check()
    return evaluation.results()


def _evaluation(clips: list[Clips], trackers: Sequence[str], out: Path) -> Evaluation:
    weights = {name: weights_of("hdn" if name in CLIP_TRACKERS else name, ()) for name in trackers}
    return Evaluation(clips, weights, out, CLIP_TRACKERS)


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
