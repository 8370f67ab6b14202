"""How far the tracker knows how well it does: its states, confidence, deviation and visibility against the truth."""

import csv
import logging
from collections.abc import Iterator
from collections.abc import Sequence as Many
from itertools import chain
from pathlib import Path

import numpy as np

from ..benchmark.metrics import alignment_errors
from ..errors import InputError
from ..networks.loading import load_engine
from ..tracker import Tracker
from .figures import new_figure, save
from .states_clips import EVENTS, Clip, drawn_clips, measured_clips, staged
from .states_measures import DEVIATIONS, Answers, figures, precision, reliability, spread

log = logging.getLogger(__name__)

SHARES = {"tracked", "false tracked", "false lost", "found soon", "precision", "recall", "within 2 deviations"}


def answers(tracker: Tracker, clip: Clip, event: str) -> Answers:
    """Runs a tracker over a clip with one of EVENTS put on, from its first frame."""
    views = staged(clip, event)
    first = next(views)
    tracker.init(first.image, first.corners)
    estimates, truth, seen, in_frame = [], [], [], []
    for view in views:
        estimates.append(tracker.track(view.image))
        truth.append(view.corners)
        seen.append(view.seen)
        in_frame.append(view.in_frame)
    return Answers(
        clip.group,
        event,
        np.array([e.state for e in estimates]),
        np.array([e.confidence for e in estimates]),
        np.array([e.deviation for e in estimates]),
        np.stack([e.visibility for e in estimates]).astype(float),
        alignment_errors(np.stack(truth), np.stack([e.corners for e in estimates])),
        np.stack(seen),
        np.stack(in_frame),
    )


def write(folder: Path, clips: Many[Path], each: int, frames: int, seed: int) -> tuple[list[str], list[Path]]:
    """Writes the figure and the frames' numbers into a folder; returns lines to print and the paths written.

    Args:
        clips: folders of clips with measured corners.
        each: drawn clips of textured targets, and as many of targets of low texture.
        frames: of each clip. seed: of the drawn ones.

    Raises:
        InputError: a folder without clips, or one that cannot be read; a single frame.
    """
    if frames < 2:
        raise InputError("a tracker is judged from the second frame on: give --frames of 2 or more")
    every = chain(drawn_clips(each, frames, seed), *(measured_clips(f, frames) for f in clips))
    engine = load_engine()
    said: dict[tuple[str, str], list[Answers]] = {}
    rows: list[list[object]] = []
    for clip in every:
        for event in EVENTS:
            found = answers(Tracker(engine=engine), clip, event)
            said.setdefault((clip.group, event), []).append(found)
            rows += [[clip.name, event, *row] for row in _rows(found)]
            log.info("%s, %s", clip.name, event)
    groups = list(dict.fromkeys(group for group, _ in said))
    by_group = {g: [a for (group, _), several in said.items() if group == g for a in several] for g in groups}
    paths = [folder / "states.png", folder / "states.csv"]
    _draw(paths[0], by_group)
    with paths[1].open("w", newline="") as file:
        heading = ["clip", "event", "frame", "state", "confidence", "deviation", "error", "seen", "in frame"]
        csv.writer(file).writerows([heading, *rows])
    return list(_lines(said, by_group)), paths


def _rows(a: Answers) -> Iterator[list[object]]:
    shares, inside = a.share, a.in_frame.mean((1, 2))
    for i, state in enumerate(a.states):
        numbers = a.confidences[i], a.deviations[i], a.errors[i], shares[i], inside[i]
        yield [i + 1, state, *(f"{v:.4g}" for v in numbers)]


def _lines(said: dict[tuple[str, str], list[Answers]], by_group: dict[str, list[Answers]]) -> Iterator[str]:
    names = list(figures(next(iter(said.values()))))
    yield "| clips | " + " | ".join(names) + " |"
    yield "|---" * (len(names) + 1) + "|"
    wholes = [((group, "all"), several) for group, several in by_group.items()]
    for (group, event), several in [*said.items(), *wholes]:
        numbers = (_number(name, value) for name, value in figures(several).items())
        yield f"| {group}, {event} | " + " | ".join(numbers) + " |"
    for title, bins_of in (
        ("confidence: share truly seen", reliability),
        ("confidence of tracked frames: share within 5 px", precision),
        ("deviation of tracked frames, px: error, px", spread),
    ):
        for group, several in by_group.items():
            bins = bins_of(several)
            yield f"{group}, {title} (frames): " + ", ".join(
                f"{s:.2f}: {t:.2f} ({n})" for s, t, n in zip(bins.said, bins.true, bins.counts, strict=True) if n
            )


def _number(name: str, value: float) -> str:
    if np.isnan(value):
        return "-"
    return f"{100 * value:.1f} %" if name in SHARES else f"{value:g}" if value == round(value) else f"{value:.3f}"


def _draw(path: Path, by_group: dict[str, list[Answers]]) -> None:
    """Three panels: reliability of the confidence, precision by confidence, error by deviation."""
    figure = new_figure(13, 4.4, dpi=72)
    left, middle, right = figure.subplots(1, 3)
    for colour, (group, several) in enumerate(by_group.items()):
        for axes, bins in ((left, reliability(several)), (middle, precision(several)), (right, spread(several))):
            filled = bins.counts > 0
            sizes = 6 + 90 * bins.counts[filled] / bins.counts.max()
            axes.plot(bins.said[filled], bins.true[filled], color=f"C{colour}", linewidth=1)
            axes.scatter(bins.said[filled], bins.true[filled], sizes, color=f"C{colour}", label=group)
    for axes, low, high in ((left, 0, 1), (right, DEVIATIONS[1] / 2, DEVIATIONS[-1])):
        axes.plot([low, high], [low, high], "--", color="grey", linewidth=1)
    left.set(xlabel="confidence", ylabel="share of the target in the frame truly seen", title="all frames")
    middle.set(xlabel="confidence", ylabel="share of frames within 5 px", title="tracked frames", xlim=(-0.03, 1.03))
    middle.set_ylim(-0.03, 1.03)
    right.set(xscale="log", yscale="log", xlabel="deviation, px", ylabel="error, px (root mean square)")
    right.set_title("tracked frames")
    for axes in (left, middle, right):
        axes.grid(alpha=0.3)
    left.legend(fontsize="small")
    save(figure, path)
