"""What a training has come to: CSV files and a picture, written anew each time from what the checkpoint holds."""

import csv
import logging
import math
from pathlib import Path

from ..errors import RunError

Row = dict[str, float]
INTERVAL_NAMES = ("median", "p90")

log = logging.getLogger(__name__)


def write_csv(rows: list[Row], path: Path) -> None:
    """Rows under all names that they have between them; a loss that came later is blank before."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    try:
        with open(path, "w", newline="") as file:
            writer = csv.DictWriter(file, names)
            writer.writeheader()
            writer.writerows({k: v if k == "step" else f"{v:.6g}" for k, v in row.items()} for row in rows)
    except OSError as error:
        raise RunError(f"{path} cannot be written: {error.strerror}") from error


def plot(losses: list[Row], validations: list[Row], path: Path) -> bool:
    """Losses and validation figures over the steps as a PNG; False without Matplotlib, which the log says.

    Args:
        losses: columns step, rate, loss, and the loss's parts.
        validations: columns step, and 'SET FIGURE', such as 'clean corners px median'.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        log.warning("no plot of the curves: Matplotlib is not installed (pip install 'ar-replace[bench]')")
        return False
    panels: dict[str, list[str]] = {}  # title to columns of the validations
    for column in validations[0] if validations else ():
        if column != "step":
            words = column.split(" ")[1:]
            title = " ".join(words[:-1] if words[-1] in INTERVAL_NAMES else words)
            panels.setdefault("areas under the ROC" if title.endswith("AUC") else title, []).append(column)
    figure = Figure(figsize=(5 * (1 + len(panels)), 4.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, 1 + len(panels), squeeze=False)[0]
    for name in losses[-1] if losses else ():
        if name not in ("step", "rate"):
            values = [max(row.get(name, math.nan), 1e-6) for row in losses]
            axes[0].plot([row["step"] for row in losses], values, ".-", markersize=2, label=name)
    axes[0].set_yscale("log")
    axes[0].set(title="losses", xlabel="step")
    for axis, (title, columns) in zip(axes[1:], panels.items(), strict=True):
        for column in columns:
            axis.plot([r["step"] for r in validations], [r[column] for r in validations], ".-", label=column)
        axis.set(title=title, xlabel="step")
        if title != "areas under the ROC":
            axis.set_ylim(bottom=0)
    for axis in axes:
        axis.grid(alpha=0.3)
        if axis.lines:
            axis.legend(fontsize="x-small")
    figure.savefig(path, dpi=100)
    return True
