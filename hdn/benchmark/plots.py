"""Plots of an evaluation, with Matplotlib, which is an optional dependency."""

import logging
from pathlib import Path

import numpy as np

from ..imaging.arrays import Array
from .metrics import HOMOGRAPHY_THRESHOLDS, LENGTH_THRESHOLDS, PRECISION_THRESHOLDS, curves
from .report import Result, attribute_table, by_tracker

log = logging.getLogger(__name__)

PLOTS: dict[str, tuple[str, Array, str, str]] = {
    "precision": ("precision", PRECISION_THRESHOLDS, "alignment error threshold, px", "precision"),
    "hsr": ("homography", HOMOGRAPHY_THRESHOLDS, "homography discrepancy threshold", "success rate"),
    "robustness": ("length", LENGTH_THRESHOLDS, "trajectory length, frames", "share of trajectories not longer"),
}


def write_plots(results: list[Result], folder: Path) -> None:
    """Writes precision.png, hsr.png and robustness.png of one data set into a folder, means over its sequences.

    Where sequences have attributes, also attributes.png: bars of the average precision for each. Without Matplotlib
    nothing is written, and the log says so.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        log.warning("no plots: Matplotlib is not installed (pip install 'ar-replace[bench]')")
        return
    groups = by_tracker(results)
    lines = {tracker: curves([r.measures for r in group]) for tracker, group in groups.items()}
    dataset = results[0].sequence.dataset
    for name, (curve, thresholds, x_label, y_label) in PLOTS.items():
        figure = Figure(figsize=(7, 5), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots()
        for tracker, values in lines.items():
            label = tracker if name == "robustness" else f"{tracker} [{values[curve].mean():.3f}]"
            axes.plot(thresholds, values[curve], label=label)
        axes.set(title=dataset, xlabel=x_label, ylabel=y_label, ylim=(-0.02, 1.02))
        axes.grid(alpha=0.3)
        axes.legend()
        figure.savefig(folder / f"{name}.png", dpi=110)

    attributes = sorted({a for r in results for a in r.sequence.attributes})
    if not attributes:
        return
    figure = Figure(figsize=(max(7, 1.4 * len(attributes)), 5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    width = 0.8 / len(groups)
    for number, (tracker, row) in enumerate(attribute_table(groups).items()):
        at = np.arange(len(attributes)) + (number - (len(groups) - 1) / 2) * width
        axes.bar(at, [row[attribute] for attribute in attributes], width, label=tracker)
    axes.set(title=dataset, ylabel="average precision", ylim=(0, 1))
    axes.set_xticks(range(len(attributes)), attributes, rotation=20)
    figure.legend(loc="outside right upper")
    figure.savefig(folder / "attributes.png", dpi=110)
