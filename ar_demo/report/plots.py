"""Plots over time as SVG: lines as wide as the page, axes beside them; numbers on hover come from the page's script."""

from collections.abc import Sequence
from html import escape

import numpy as np

from hdn.imaging.arrays import Array

from .series import Series

HEIGHT = 72  # px of a plot
AXIS_WIDTH = 46  # px


def plot(
    series: Series,
    points: Array,
    marks: Sequence[tuple[float, str, str]],
    bands: Sequence[tuple[int, int, str]],
    label: str,
) -> str:
    """One quantity over time: its axis and its line.

    Args:
        points: (m,) the values, NaN where there is none.
        marks: where there are vertical lines, 0..m, with their kind (a class of the style sheet) and what they are.
        bands: from which point on, how many points, are behind the line in the colour of a class.
        label: for those who do not see it.
    """
    top = max(series.top, axis_end(max(float(np.nanmax(points, initial=0.0)), series.limit or 0.0)))
    y = HEIGHT * (1 - points / top)
    lines = "".join(
        f"<rect class='{kind}' x='{first}' y='0' width='{count}' height='{HEIGHT}'/>" for first, count, kind in bands
    )
    lines += "".join(
        f"<line class='{kind}' x1='{x:g}' x2='{x:g}' y1='0' y2='{HEIGHT}'><title>{escape(text)}</title></line>"
        for x, kind, text in marks
    )
    if series.limit is not None:
        at = HEIGHT * (1 - series.limit / top)
        lines += f"<line class='limit' x1='0' x2='{len(points)}' y1='{at:.1f}' y2='{at:.1f}'/>"
    ticks = "".join(
        f"<text x='{AXIS_WIDTH - 6}' y='{y}'>{value:.{series.digits}f}</text>"
        for value, y in ((top, 10), (top / 2, HEIGHT / 2 + 4), (0, HEIGHT - 2))
    )
    return (
        f"<svg class='axis' width='{AXIS_WIDTH}' height='{HEIGHT}' aria-hidden='true'>{ticks}</svg>"
        f"<svg class='line' viewBox='0 0 {len(points)} {HEIGHT}' preserveAspectRatio='none' role='img' "
        f"aria-label='{escape(label)}'>{lines}<path d='{_path(y)}'/></svg>"
    )


def axis_end(value: float) -> float:
    """The round number at which an axis ends that has to hold a value."""
    if value <= 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in (1, 1.5, 2, 3, 4, 5, 6, 8, 10) if step * power >= value - 1e-9 * power))


def _path(y: Array) -> str:
    """A line through the middles of the points' places; it breaks where there is none, and a lone point is a dash."""
    known = np.isfinite(y)
    parts = []
    for i in np.flatnonzero(known):
        begins = i == 0 or not known[i - 1]
        ends = i + 1 == len(y) or not known[i + 1]
        if begins and ends:
            parts.append(f"M{i:d} {y[i]:.1f}h1")
        else:
            parts.append(f"{'M' if begins else 'L'}{i + 0.5:g} {y[i]:.1f}")
    return "".join(parts)
