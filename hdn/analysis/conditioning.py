"""The paper's figure of condition numbers: what it takes to find the parameters of a homography.

With the displacement D(x) = H(x) p - p of a corner p and the parameters x = (t1, t2, gamma, theta, k1, k2, nu1, nu2) of
eq. 2, the paper's appendix defines

    Cond(x) = |x| |J(x)| / |D(x)|,    J = dD/dx, all norms l2 (of J: the root of the sum of its squared entries).

Once a group of parameters is given, its transformation is undone: these parameters are no longer in x, and D is what
the others still move.
"""

import csv
from collections.abc import Iterable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from ..imaging.arrays import Array
from ..imaging.quads import square
from ..networks.config import PAPER
from .figures import new_figure, save

PARAMETERS = ("t1", "t2", "gamma", "theta", "k1", "k2", "nu1", "nu2")
IDENTITY = np.array([0, 0, 1, 0, 1, 0, 0, 0.0])
# The ranges of the paper's experiments. It lists k1 in [-0.1, 0.1], which has to be the deviation from 1: in eq. 2
# itself, k1 = 0 is no homography.
LOW = np.array([-32, -32, 1 / 1.38, -0.7, 0.9, -0.015, -0.0015, -0.0015])
HIGH = np.array([32, 32, 1.38, 0.7, 1.1, 0.015, 0.0015, 0.0015])

GIVEN = {"nothing given": 0, "translation given": 2, "similarity given": 4}  # so many of the first parameters

# What the paper leaves open: whose displacement counts, px from the template's centre ...
_TEMPLATE = square(PAPER.template_size) - (PAPER.template_size - 1) / 2
CORNERS = {"one corner": _TEMPLATE[:1], "four corners": _TEMPLATE}
# ... and in which terms the parameters are measured: from which values of eq. 2's on, and in which units.
_ONE, _ZERO = np.ones(len(PARAMETERS)), np.zeros(len(PARAMETERS))
MEASURES = {
    "x as listed": (np.eye(len(PARAMETERS))[4], _ONE),  # k1 by its deviation from 1, gamma as it is
    "x from the identity": (IDENTITY, _ONE),
    "x as in eq. 2": (_ZERO, _ONE),
    "x in its ranges": (IDENTITY, (HIGH - LOW) / 2),  # no longer px beside radians and ratios
}
SHOWN = ("one corner", "x as listed")  # in the figure

LISTED = 1000  # samples of each setting that are written down


def displacements(x: Array, corner: Array) -> tuple[Array, Array]:
    """D(x) (2, N), px, of a corner (2,) at parameters (N, 8) of eq. 2, and J(x) (8, 2, N)."""
    t1, t2, gamma, theta, k1, k2, nu1, nu2 = x.T
    u, v = corner
    zero, one = np.zeros(len(x)), np.ones(len(x))
    cos, sin = gamma * np.cos(theta), gamma * np.sin(theta)
    w = nu1 * u + nu2 * v + 1
    a, b = (k1 * u + k2 * v) / w, v / (k1 * w)  # the corner after the residual group
    by_residual = [(u / w, -b / k1), (v / w, zero), (-a * u / w, -b * u / w), (-a * v / w, -b * v / w)]
    x_moved, y_moved = cos * a - sin * b, sin * a + cos * b
    jacobian = [(one, zero), (zero, one), (x_moved / gamma, y_moved / gamma), (-y_moved, x_moved)]
    jacobian += [(cos * da - sin * db, sin * da + cos * db) for da, db in by_residual]
    return np.stack([x_moved + t1 - u, y_moved + t2 - v]), np.array(jacobian)


def undone(x: Array, given: int) -> Array:
    """Parameters (N, 8) with the given ones, so many of the first, put to the identity."""
    return np.concatenate([np.broadcast_to(IDENTITY[:given], (len(x), given)), x[:, given:]], 1)


def sensitivity(x: Array, given: int, corners: Array) -> tuple[Array, Array]:
    """|dD/dx_i| (8 - given, N) by each parameter that is not given, and |D(x)| (N,), px, of parameters (N, 8)."""
    slopes, lengths = np.zeros((len(PARAMETERS) - given, len(x))), np.zeros(len(x))
    for corner in corners:
        moved, jacobian = displacements(undone(x, given), corner)
        slopes += np.square(jacobian[given:]).sum(1)
        lengths += np.square(moved).sum(0)
    return np.sqrt(slopes), np.sqrt(lengths)


def condition_numbers(x: Array, given: int, sensed: tuple[Array, Array], measure: tuple[Array, Array]) -> Array:
    """Cond (N,) at parameters (N, 8) of eq. 2.

    Args:
        given: 0, 2 or 4: so many of the first parameters are known; their values make no difference.
        sensed: what `sensitivity` says of them.
        measure: (8,) the values from which the parameters are measured, and (8,) the units.
    """
    zero, unit = measure
    slopes, lengths = sensed
    size = np.linalg.norm(((x - zero) / unit)[:, given:], axis=1)
    return np.asarray(size * np.linalg.norm(slopes * unit[given:, None], axis=0) / lengths)


def sample(count: int, seed: int) -> Array:
    """Parameters (count, 8), uniform over the paper's ranges."""
    return np.random.default_rng(seed).uniform(LOW, HIGH, (count, len(PARAMETERS)))


def degrees(count: int = 100) -> tuple[Array, Array]:
    """Ratios (count,) up to 1, and the parameters (count, 8) on the straight way from the identity to their maxima."""
    ratio = np.arange(1, count + 1) / count
    return ratio, IDENTITY + ratio[:, None] * (HIGH - IDENTITY)


def write(folder: Path, samples: int, seed: int) -> tuple[list[str], list[Path]]:
    """Writes the figure and its numbers into a folder; returns lines to print and the paths written."""
    x = sample(samples, seed)
    ratio, way = degrees()
    clouds, rows, listed, curves = {}, [], [], {}
    for (setting, given), (points, corners) in product(GIVEN.items(), CORNERS.items()):
        sensed, sensed_way = sensitivity(x, given, corners), sensitivity(way, given, corners)
        for name, measure in MEASURES.items():
            numbers = condition_numbers(x, given, sensed, measure)
            curves[points, name, setting] = condition_numbers(way, given, sensed_way, measure)
            rows.append([points, name, setting, *np.quantile(numbers, [0.1, 0.5, 0.9, 0.99, 1]), samples, seed])
            if (points, name) == SHOWN:
                clouds[setting] = sensed[1], numbers
                drawn = np.column_stack([undone(x, given), sensed[1], numbers])
                listed += [[setting, *values] for values in drawn[:LISTED]]

    tables = {
        "summary": (
            ["corners", "parameters", "setting", "p10", "median", "p90", "p99", "max", "samples", "seed"],
            rows,
        ),
        "samples": (["setting", *PARAMETERS, "displacement", "condition"], listed),
        "degree": (
            ["corners", "parameters", "setting", "degree", "condition"],
            [[*key, r, c] for key, curve in curves.items() for r, c in zip(ratio, curve, strict=True)],
        ),
    }
    paths = [folder / "condition-number.png"]
    _draw(paths[0], clouds, ratio, curves)
    for table, (heading, content) in tables.items():
        paths.append(folder / f"condition-number-{table}.csv")
        _write_csv(paths[-1], heading, content)
    return _lines(rows), paths


def _lines(rows: list[list[Any]]) -> list[str]:
    lines = [f"{'corners':14}{'|x|':21}{'setting':20}{'median':>10}{'p99':>10}{'max':>10}"]
    lines += ["{:14}{:21}{:20}{:>10.3g}{:>10.3g}{:>10.3g}".format(*row[:3], row[4], row[6], row[7]) for row in rows]
    return lines


def _write_csv(path: Path, heading: list[str], rows: Iterable[list[Any]]) -> None:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(heading)
        writer.writerows([f"{v:.9g}" if isinstance(v, float) else v for v in row] for row in rows)


def _draw(
    path: Path,
    clouds: dict[str, tuple[Array, Array]],
    ratio: Array,
    curves: dict[tuple[str, str, str], Array],
) -> None:
    """The four panels: the density of samples over displacement and condition number, then the degree."""
    from matplotlib.colors import LogNorm

    figure = new_figure(11, 8, dpi=72)
    panels = figure.subplots(2, 2).ravel()
    everything = np.log10(np.concatenate([numbers for _, numbers in clouds.values()]))
    edges = np.linspace(everything.min(), everything.max(), 101)
    for axes, letter, (setting, (length, numbers)) in zip(panels, "abc", clouds.items(), strict=False):
        # Density per px of displacement and decade of condition number, one scale of condition numbers for all.
        density, x, y = np.histogram2d(length, np.log10(numbers), (90, edges), density=True)
        picture = axes.pcolormesh(x, 10**y, np.ma.masked_equal(density.T, 0), norm=LogNorm(), rasterized=True)
        figure.colorbar(picture, ax=axes, label="probability density")
        axes.set(yscale="log", xlabel="displacement of the corner, px", ylabel="condition number")
        axes.set_title(f"({letter}) {setting}\nmedian {np.median(numbers):.3g}, largest {numbers.max():.2g}")
    last = panels[-1]
    for colour, setting in enumerate(GIVEN):
        points, _ = SHOWN
        for style, name in (("-", "x as listed"), ("--", "x from the identity")):
            last.plot(ratio, curves[points, name, setting], style, color=f"C{colour}", label=f"{setting}, {name}")
    last.set(yscale="log", xlabel="degree: share of the way to the largest parameters", ylabel="condition number")
    last.set_title("(d) all parameters growing at once")
    last.grid(alpha=0.3)
    last.set_ylim(top=1e6)  # room for the legend
    last.legend(fontsize="small", ncols=1)
    save(figure, path)
