"""What an evaluation writes for a person to read: tables, and a sheet of the worst frames."""

import csv
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from ..imaging.arrays import Array, Image
from .metrics import LIMITS, Measures, alignment_errors, figures, mean_figures, pooled
from .running import Track
from .sequences import Sequence

SHEET_FRAMES, SHEET_COLUMNS, SHEET_WIDTH = 12, 3, 480  # frames; frames a row; px of a frame
APART = 15  # frames of one sequence between two on a sheet
DECIMALS = {"median error": 2, "jitter": 2, "frames to recover": 1, "ms": 1}  # of a figure in a table, else 3
TRACKED_WRONGLY = f"Share of the frames called `tracked` that err by more than {LIMITS.tracked_px:g} px"
TRUE_COLOUR, TRACKED_COLOUR = (60, 220, 90), (240, 60, 60)


@dataclass(frozen=True)
class Result:
    """One tracker on one sequence."""

    tracker: str
    sequence: Sequence
    track: Track
    measures: Measures


def by_tracker(results: Iterable[Result]) -> dict[str, list[Result]]:
    """Results grouped, in the order in which trackers first come."""
    groups: dict[str, list[Result]] = {}
    for result in results:
        groups.setdefault(result.tracker, []).append(result)
    return groups


def write_tables(results: list[Result], folder: Path) -> str:
    """Writes summary.md, summary.csv and sequences.csv.

    Returns:
        The Markdown: for each data set a table of means over sequences, and one of all frames pooled.
    """
    text = ["# Evaluation", ""]
    rows: list[dict[str, str]] = []
    for dataset in dict.fromkeys(r.sequence.dataset for r in results):
        groups = by_tracker(r for r in results if r.sequence.dataset == dataset)
        text += [f"## {dataset}", "", *section(groups)]
        for average, table in averages(groups).items():
            rows += [{"dataset": dataset, "average": average, "tracker": t} | _written(f) for t, f in table.items()]
    _write_csv(folder / "summary.csv", rows)
    _write_csv(
        folder / "sequences.csv",
        [
            {"dataset": r.sequence.dataset, "sequence": r.sequence.name, "tracker": r.tracker}
            | _written(figures(r.measures))
            for r in results
        ],
    )
    written = "\n".join(text)
    (folder / "summary.md").write_text(written, encoding="utf-8")
    return written


def section(groups: dict[str, list[Result]]) -> list[str]:
    """Lines that say of one data set, by tracker, all that there is to say in figures."""
    counts = sorted({len(group) for group in groups.values()})
    frames = max(sum(len(r.measures.errors) for r in group) for group in groups.values())
    text = [f"{counts[-1]} sequences, {frames} frames that count.", ""]
    if len(counts) > 1:
        text += ["**Not all trackers ran on all sequences: their rows do not compare.**", ""]
    means = averages(groups)
    text += ["Mean over sequences:", "", *markdown(means["sequences"]), ""]
    text += ["All frames pooled:", "", *markdown(means["frames"]), ""]
    if any(r.sequence.attributes for group in groups.values() for r in group):
        text += ["Average precision by attribute:", "", *markdown(attribute_table(groups)), ""]
        text += [f"{TRACKED_WRONGLY}, by attribute:", "", *markdown(attribute_table(groups, "tracked wrongly")), ""]
    return text


def averages(groups: dict[str, list[Result]]) -> dict[str, dict[str, dict[str, float]]]:
    """Each tracker's figures, averaged over "sequences" and over all "frames" pooled."""
    measures = {tracker: [r.measures for r in group] for tracker, group in groups.items()}
    return {
        "sequences": {tracker: mean_figures(several) for tracker, several in measures.items()},
        "frames": {tracker: figures(pooled(several)) for tracker, several in measures.items()},
    }


def attribute_table(groups: dict[str, list[Result]], figure: str = "avg Prec") -> dict[str, dict[str, float]]:
    """Each tracker's average precision, or another figure, for each attribute, mean over its sequences."""
    attributes = sorted({a for group in groups.values() for r in group for a in r.sequence.attributes})
    table: dict[str, dict[str, float]] = {}
    for tracker, group in groups.items():
        having = {a: [r.measures for r in group if a in r.sequence.attributes] for a in attributes}
        table[tracker] = {a: mean_figures(m)[figure] if m else math.nan for a, m in having.items()}
    return table


def markdown(table: dict[str, dict[str, float]]) -> list[str]:
    """Lines of a table with a row for each tracker and a column for each figure; all have the same figures."""
    names = list(next(iter(table.values())))
    lines = ["| tracker | " + " | ".join(names) + " |", "|---" * (len(names) + 1) + "|"]
    for tracker, values in table.items():
        lines.append(f"| {tracker} | " + " | ".join(_written(values).values()) + " |")
    return lines


def _written(values: dict[str, float]) -> dict[str, str]:
    return {name: "–" if math.isnan(value) else f"{value:.{DECIMALS.get(name, 3)}f}" for name, value in values.items()}


def _write_csv(path: Path, rows: list[dict[str, str]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def write_sheet(results: list[Result], path: Path) -> None:
    """Writes a JPEG of the worst frames of one tracker, the true quad in green and the tracked in red."""
    worst = worst_frames(results)
    cells = []
    for result in results:
        wanted = {frame: error for r, frame, error in worst if r is result}
        for index, frame in enumerate(result.sequence.frames()) if wanted else ():
            if index in wanted:
                cells.append((wanted[index], _cell(result, index, frame, wanted[index])))
            if index >= max(wanted):
                break
    cells.sort(key=lambda cell: -cell[0])
    height = max(image.shape[0] for _, image in cells)
    filled = [np.pad(image, ((0, height - image.shape[0]), (0, 0), (0, 0))) for _, image in cells]
    filled += [np.zeros_like(filled[0])] * (-len(filled) % SHEET_COLUMNS)
    rows = [np.hstack(filled[i : i + SHEET_COLUMNS]) for i in range(0, len(filled), SHEET_COLUMNS)]
    cv2.imwrite(str(path), cv2.cvtColor(np.vstack(rows), cv2.COLOR_RGB2BGR))


def worst_frames(results: list[Result]) -> list[tuple[Result, int, float]]:
    """The frames with the largest alignment errors (px, infinite where there was no answer), apart from each other."""
    ranked = []
    for result in results:
        count = len(result.track.corners)
        truth, corners = result.sequence.truth[1:count], result.track.corners[1:]
        errors = np.where(np.isnan(corners).any((1, 2)), np.inf, alignment_errors(truth, corners))
        known = np.flatnonzero(np.isfinite(truth).all((1, 2)))
        ranked += [(result, int(i) + 1, float(errors[i])) for i in known]
    ranked.sort(key=lambda entry: -entry[2])
    chosen: list[tuple[Result, int, float]] = []
    for result, frame, error in ranked:
        if all(r is not result or abs(f - frame) >= APART for r, f, _ in chosen):
            chosen.append((result, frame, error))
        if len(chosen) == SHEET_FRAMES:
            break
    return chosen


def _cell(result: Result, index: int, frame: Image, error: float) -> Image:
    scale = SHEET_WIDTH / frame.shape[1]
    size = (SHEET_WIDTH, max(1, round(frame.shape[0] * scale)))
    cell = np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_AREA), np.uint8)
    for quad, colour in ((result.sequence.truth[index], TRUE_COLOUR), (result.track.corners[index], TRACKED_COLOUR)):
        if np.isfinite(quad).all():
            cv2.polylines(cell, [_fixed_point((quad + 0.5) * scale - 0.5)], True, colour, 2, cv2.LINE_AA, shift=4)
    said = "no answer" if math.isinf(error) else f"{error:.1f} px"
    caption = f"{result.sequence.name} {index}: {said}, {result.track.states[index]}"
    cv2.rectangle(cell, (0, 0), (SHEET_WIDTH, 20), (0, 0, 0), -1)
    cv2.putText(cell, caption, (6, 15), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1, cv2.LINE_AA)
    return cell


def _fixed_point(points: Array) -> np.ndarray:
    """For OpenCV's drawing with shift=4; far-off corners are brought to where its integers still hold."""
    return np.round(np.clip(points, -1e5, 1e5) * 16).astype(np.int32)
