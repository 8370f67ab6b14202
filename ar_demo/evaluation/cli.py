"""`ar-eval`: how good composites are, against the picture as it would have been.

SynthPlanar has each scene twice: with a poster, and with an ad in its place under the same light, blur and passers-by.
The whole pipeline puts the ad onto the poster clip, and what comes out is compared with the true ad clip, in every
frame where any of the surface is in view. Two more composites go the same way:

    true corners    our compositor with the true corners: what is still missing is not the tracker's fault
    plain warp      bilinear sampling and hard edges, with the corners that our pipeline found

What is compared is what the compositor made: it is written without loss, as RGB. The clips that are read are
compressed, the poster's and the true one alike, which bounds what can be reached.

`--self` needs no truth: see `own_surface`. `--marks` counts what is in front by marks made by hand: see `marks`.
"""

import csv
import json
import logging
import os
import sys
from argparse import Namespace
from collections.abc import Callable, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
from tqdm import tqdm

from hdn.benchmark.datasets import open_dataset
from hdn.benchmark.identity import digest, sources, tracker_sources
from hdn.commandline import DONE, Parser, run
from hdn.imaging.arrays import Array, Image
from hdn.networks.weights import configuration, shipped

from ..errors import InputError
from ..media.pictures import write_picture
from . import own_surface
from .marks import Count, count, read_marks
from .quality import NAMES
from .scenes import COMPOSITES, Scene, Scores, evaluate, read_scenes

# Modules that change no figure.
NO_PART = (
    "cli",
    "compositing/benchmark",
    *(f"evaluation/{name}" for name in ("cli", "drawn_clips", "published", "report", "speed", "stages", "transcode")),
    "progress",
)
SHEET_ROWS = 9

T = TypeVar("T")


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of ar-eval."""
    sys.exit(run(_command, arguments, "finished sequences are kept, the same command goes on from there"))


def _command(arguments: Sequence[str] | None) -> int:
    parser = Parser(
        prog="ar-eval",
        description="Compare our composites on SynthPlanar with the picture as it would have been: PSNR and SSIM "
        "inside the surface and on its edge, with the plain warp as the baseline. Finished sequences are kept, and run "
        "again when code or weights have changed.",
        epilog="Exit status: 0 done, 1 failed while working, 2 wrong input.",
    )
    parser.add_argument("folder", type=Path, help="what hdn-synthplanar wrote; with --self or --marks, clips")
    other = parser.add_mutually_exclusive_group()
    other.add_argument(
        "--self",
        action="store_true",
        dest="own",
        help="put each surface's own picture back onto it, and compare with the clip itself (folder of NAME.mp4 with "
        "NAME.json, or any that hdn-eval reads)",
    )
    other.add_argument(
        "--marks",
        type=Path,
        metavar="FILE",
        help="count how much of what is in front is kept, and of the surface replaced, by a file of marks",
    )
    parser.add_argument("--out", type=Path, default=Path("runs/ar-eval"), metavar="DIR", help="default runs/ar-eval")
    parser.add_argument("--only", metavar="PATTERN", help="only sequences with such names, as in 'scale-*'")
    parser.add_argument("--limit", type=int, metavar="N", help="only each clip's first N frames")
    parser.add_argument("--weights", type=Path, metavar="FILE", help="another weights file than the shipped one")
    parser.add_argument("--quiet", action="store_true", help="print no table")
    options = parser.parse_args(arguments)
    logging.basicConfig(format="%(levelname)s: %(message)s", level=logging.WARNING)
    if options.limit is not None and options.limit < 2:
        raise InputError("--limit takes 2 or more")
    evaluate = _own if options.own else _drawn if options.marks is None else _marked
    markdown = evaluate(options)
    if not options.quiet:
        print(markdown)
        print(f"Written to {options.out}")
    return DONE


def _drawn(options: Namespace) -> str:
    scenes = _called_so(read_scenes(options.folder), options.only, lambda scene: scene.name)
    scores = evaluate_all([s.limited(options.limit) for s in scenes], options.out, options.weights)
    return write(scores, options.out)


def _called_so(all_of_them: Sequence[T], pattern: str | None, name: Callable[[T], str]) -> list[T]:
    """Those whose name fits a pattern, None for all; raises InputError for none."""
    found = [one for one in all_of_them if pattern is None or fnmatchcase(name(one), pattern)]
    if not found:
        raise InputError(f"no sequence is called like '{pattern}': see the names without --only")
    return found


def _own(options: Namespace) -> str:
    clips = _called_so(open_dataset(str(options.folder)), options.only, lambda clip: clip.name)
    options.out.mkdir(parents=True, exist_ok=True)
    lines = ["| clip | " + " | ".join(own_surface.NAMES) + " |", "|---" * (len(own_surface.NAMES) + 1) + "|"]
    found = [
        own_surface.evaluate_own(clip.limited(options.limit), options.weights, options.out / f"{clip.name}-worst.png")
        for clip in tqdm(clips, unit=" clips", disable=not sys.stderr.isatty())
    ]
    rows = [(one.name, one.mean) for one in found] + [("mean", np.mean([one.mean for one in found], 0))]
    for name, mean in rows:
        digits = (2 if figure.startswith("PSNR") else 3 for figure in own_surface.NAMES)
        lines.append(f"| {name} | " + " | ".join(f"{m:.{n}f}" for m, n in zip(mean, digits, strict=True)) + " |")
    markdown = "\n".join(lines) + "\n"
    (options.out / "own.md").write_text(markdown, encoding="utf-8")
    return markdown


def _marked(options: Namespace) -> str:
    clips = _called_so(read_marks(options.marks), options.only, lambda clip: Path(clip.clip).stem)
    options.out.mkdir(parents=True, exist_ok=True)
    lines = ["| clip | frame | in front, kept | surface, replaced |", "|---|---|---|---|"]
    counts: list[Count] = []
    for clip in tqdm(clips, unit=" clips", disable=not sys.stderr.isatty()):
        name = Path(clip.clip).stem
        found = count(clip, options.folder, options.weights, options.out / f"{name}-marks.png")
        lines += [f"| {name} | {one.frame} | {_shares([one])} |" for one in found]
        lines.append(f"| {name} | {len(found)} of {len(clip.frames)} | {_shares(found)} |")
        counts += found
    lines.append(f"| all | {len(counts)} | {_shares(counts)} |")
    markdown = "\n".join(lines) + "\n"
    (options.out / "marks.md").write_text(markdown, encoding="utf-8")
    return markdown


def _shares(counts: Sequence[Count]) -> str:
    """Of the pixels in front the share that is kept, and of the surface's the share that is replaced, as cells."""
    front, kept, surface, replaced = (sum(one[k] for one in counts) for k in range(1, 5))
    return " | ".join(f"{part / whole:.3f}" if whole else "" for part, whole in ((kept, front), (replaced, surface)))


def evaluate_all(scenes: list[Scene], out: Path, weights: Path | None = None) -> list[Scores]:
    """Evaluates scenes, those apart of which the folder `out` has the figures by the same code and weights.

    Raises:
        InputError, RunError: see `replace`.
    """
    if weights is not None:
        configuration(weights)  # says now what is wrong with them
    kept = out / "scenes"
    kept.mkdir(parents=True, exist_ok=True)
    code = [*sources(Path(__file__).parents[1], NO_PART), *tracker_sources(), weights or shipped()]
    scores = []
    for scene in tqdm(scenes, unit=" sequences", disable=not sys.stderr.isatty()):
        files = [scene.file, scene.clip, scene.ad, scene.truth]
        made_of = f"{digest([*code, *files])}, {len(scene.corners)} frames"
        found = _load(scene, kept, made_of)
        if found is None:
            found, rows = evaluate(scene, weights)
            for kind, row in rows.items():
                write_picture(kept / f"{scene.name}-{kind}.png", row)
            _save(found, kept, made_of)
            found = _load(scene, kept, made_of) or found  # rounded as it is kept, so that a table is the same next time
        scores.append(found)
    return scores


def _load(scene: Scene, folder: Path, made_of: str) -> Scores | None:
    try:
        data = json.loads((folder / f"{scene.name}.json").read_text(encoding="utf-8"))
    except (FileNotFoundError, json.JSONDecodeError):
        return None
    if data["of"] != made_of:
        return None
    nothing = [[np.nan] * len(NAMES)] * len(COMPOSITES)
    frames = np.array([nothing if f is None else f for f in data["frames"]], np.float64)
    return Scores(scene, frames, data["compositor"])


def _save(scores: Scores, folder: Path, made_of: str) -> None:
    frames = [None if np.isnan(f).any() else np.round(f, 4).tolist() for f in scores.frames]
    data = {"of": made_of, "compositor": scores.compositor, "frames": frames}
    part = folder / f".{scores.scene.name}.{os.getpid()}.part"
    part.write_text(json.dumps(data), encoding="utf-8")
    part.replace(folder / f"{scores.scene.name}.json")


def write(scores: list[Scores], out: Path) -> str:
    """Writes quality.md, quality.csv, worst.png and median.png; returns the Markdown."""
    frames = sum(int(np.isfinite(s.frames[:, 0, 0]).sum()) for s in scores)
    drawn = ", ".join(dict.fromkeys(s.compositor for s in scores))
    text = [f"{len(scores)} sequences, {frames} frames in view. Compositor: {drawn}.", ""]
    attributes = ["all", *dict.fromkeys(s.scene.attribute for s in scores)]
    means = {a: np.mean([s.mean for s in scores if a in ("all", s.scene.attribute)], 0) for a in attributes}
    for where, title in (("inside", "Inside the surface"), ("edge", "In a band of 6 px on its edge")):
        text += [f"{title}:", "", *_markdown(means, where), ""]
    markdown = "\n".join(text)
    (out / "quality.md").write_text(markdown, encoding="utf-8")
    with (out / "quality.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["attribute", "composite", *NAMES])
        for attribute, mean in means.items():
            for composite, figures in zip(COMPOSITES, mean, strict=True):
                writer.writerow([attribute, composite, *(f"{f:.4f}" for f in figures)])
    worst_first = sorted(scores, key=lambda s: float(s.frames[s.ranked[0], 0, 0]))
    for kind in ("worst", "median"):
        write_picture(out / f"{kind}.png", sheet(worst_first, out, kind))
    return markdown


def _markdown(means: dict[str, Array], where: str) -> list[str]:
    columns = [(n, metric) for n, metric in enumerate(NAMES) if metric.endswith(where)]
    heads = [f"{metric.split()[0]}, {composite}" for _, metric in columns for composite in COMPOSITES]
    lines = ["| attribute | " + " | ".join(heads) + " |", "|---" * (len(heads) + 1) + "|"]
    for attribute, mean in means.items():
        cells = [f"{mean[k, n]:.{2 if metric.startswith('PSNR') else 3}f}" for n, metric in columns for k in range(3)]
        lines.append(f"| {attribute} | " + " | ".join(cells) + " |")
    return lines


def sheet(scores: list[Scores], out: Path, kind: str) -> Image:
    """The "worst" or "median" frames, a row each: poster, true ad, ours, plain warp around the surface."""
    rows = [cv2.imread(str(out / "scenes" / f"{s.scene.name}-{kind}.png")) for s in scores[:SHEET_ROWS]]
    return np.asarray(cv2.cvtColor(np.vstack([r for r in rows if r is not None]), cv2.COLOR_BGR2RGB), np.uint8)


if __name__ == "__main__":
    main()
