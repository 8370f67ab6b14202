"""The part of a page that shows a track over time: states, plots, lines of the steady surface, numbers on hover."""

import json
from html import escape
from typing import Any

import numpy as np

from hdn.imaging.arrays import Array
from hdn.state import STATES, State

from ..markup import state_bar, state_runs
from ..tracks import Track
from ..verdict import Limits
from .looking import Look
from .plots import plot
from .series import Series, series_of

MOST_POINTS, PAGE_POINTS = (
    1500,
    6000,
)  # of a plot, and of one of each surface; of a longer track several frames share one


def timeline(track: Track, number: int, surfaces: int, limits: Limits, look: Look | None) -> str:
    """Of one of so many surfaces; its number is for the ids of the page."""
    low, n = track.first, track.last + 1 - track.first
    each = -(-n // max(1, min(MOST_POINTS, PAGE_POINTS // surfaces)))
    series = series_of(track, limits, look)
    points = [one.points(each) for one in series]
    cuts = [(cut - low) / each for cut in track.cuts if low < cut < low + n]
    marks = [(x, "cut", f"another shot begins at frame {round(x * each) + low}") for x in cuts]
    given = [i for i in sorted(track.given) if low <= i < low + n]
    marks += [((i - low + 0.5) / each, "key", f"corners given by hand in frame {i}") for i in given]
    states = _states(track.states[track.inside], each)
    bands = [run for run in state_runs(states) if run[2] != "tracked"]
    rows = [f"<div class='row'><div><b>States</b></div>{state_bar(states, [round(x) for x in cuts])}</div>"]
    for one, values in zip(series, points, strict=True):
        label = (
            f"<div title='{escape(one.note, quote=True)}'><b>{one.name}</b><span class='soft'>{one.unit}</span></div>"
        )
        drawn = plot(one, values, marks, bands, f"{one.name} over time: {_range(one)}. {one.note}")
        rows.append(f"<div class='row'>{label}{drawn}<div class='value'>{_range(one)}</div></div>")
    if look is not None and look.rows and look.columns:
        for name, picture in (("Middle row", look.rows), ("Middle column", look.columns)):
            label = f"<div><b>{name}</b><span class='soft'>standing still</span></div>"
            alt = f"{name} of the steady surface, frame beside frame: where it wavers, the track does"
            rows.append(f"<div class='row'>{label}{picture.html(alt, stretched=True)}</div>")
    data = {
        "frames": [_point(track, i, min(i + each, low + n) - 1) for i in range(low, low + n, each)],
        "values": [_numbers(values, one.digits) for one, values in zip(series, points, strict=True)],
        "digits": [one.digits for one in series],
        "units": [one.unit for one in series],
    }
    legend = "".join(f"<span><i class='{state}'></i>{state}</span>" for state in STATES)
    legend += "<span>dotted line: cut</span><span>green line: corners given by hand</span>"
    notes = "".join(f"<li><b>{one.name}</b>: {escape(one.note)}</li>" for one in series)
    return (
        f"<p class='legend soft'>{legend}</p>"
        f"<div class='at'><label for='at{number}'>Frame</label><input id='at{number}' type='range' min='0' "
        f"max='{len(points[0]) - 1}' value='0'><output for='at{number}'></output></div>"
        f"<div class='plots'><script type='application/json'>{_json(data)}</script>{''.join(rows)}</div>"
        f"<details class='note'><summary>What these are</summary><ul>{notes}</ul></details>"
    )


def _states(states: list[State], each: int) -> list[State]:
    """The worst of so many frames each."""
    return [max(states[i : i + each], key=STATES.index) for i in range(0, len(states), each)]


def _point(track: Track, first: int, last: int) -> str:
    """Which frames a point stands for, when they are, and their state."""
    frames = f"frame {first}" if first == last else f"frames {first} to {last}"
    [state] = _states(track.states[first : last + 1], last + 1 - first)
    return f"{frames}, {float(track.times[first] - track.times[0]):.2f} s, {state}"


def _range(series: Series) -> str:
    known = series.values[np.isfinite(series.values)]
    if not len(known):
        return "no values"
    return f"{known.min():.{series.digits}f} to {known.max():.{series.digits}f}"


def _numbers(values: Array, digits: int) -> list[float | None]:
    return [round(float(v), digits) if np.isfinite(v) else None for v in values]


def _json(data: dict[str, Any]) -> str:
    """JSON that cannot end the script that it stands in."""
    return json.dumps(data, separators=(",", ":"), ensure_ascii=True).replace("<", "\\u003c")
