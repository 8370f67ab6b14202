"""Small pieces of HTML and SVG, with which tracks, results and reports show themselves."""

from collections.abc import Iterable, Sequence
from html import escape
from itertools import accumulate, groupby

from hdn.state import State

# Readable on white and on near-black alike; told by height as well, for those who do not see colours.
STATE_COLOURS: dict[State, str] = {"tracked": "#3f9a5f", "held": "#d98a1f", "lost": "#d64545"}
STATE_HEIGHTS: dict[State, float] = {"tracked": 0.4, "held": 0.7, "lost": 1.0}


def table(rows: Iterable[tuple[str, object]]) -> str:
    """Rows of a name and what there is to say of it, as text."""
    lines = (f"<tr><th scope='row'>{escape(name)}</th><td>{escape(str(value))}</td></tr>" for name, value in rows)
    return f"<table>{''.join(lines)}</table>"


def items(lines: Sequence[str]) -> str:
    """A list of sentences; nothing where there are none."""
    return f"<ul>{''.join(f'<li>{escape(line)}</li>' for line in lines)}</ul>" if lines else ""


def state_bar(states: Sequence[State], cuts: Sequence[int] = (), height: int = 22) -> str:
    """An SVG as wide as its place that shows the states along the time, cuts as lines; height in px."""
    bars = "".join(
        f"<rect x='{first}' width='{count}' y='{1 - STATE_HEIGHTS[state]:g}' height='{STATE_HEIGHTS[state]:g}' "
        f"fill='{STATE_COLOURS[state]}'><title>{_frames(first, first + count - 1)}: {state}</title></rect>"
        for first, count, state in state_runs(states)
    )
    lines = "".join(
        f"<line x1='{cut}' x2='{cut}' y1='0' y2='1' stroke='currentColor' vector-effect='non-scaling-stroke'/>"
        for cut in cuts
    )
    told = ", ".join(f"{sum(s == state for s in states)} {state}" for state in STATE_COLOURS)
    return (
        f"<svg viewBox='0 0 {len(states)} 1' width='100%' height='{height}' preserveAspectRatio='none' role='img' "
        f"aria-label='States of {len(states)} frames: {told}'>{bars}{lines}</svg>"
    )


def state_runs(states: Sequence[State]) -> list[tuple[int, int, State]]:
    """Frames in a row of the same state: the first, how many, and their state."""
    lengths = [(state, len([*run])) for state, run in groupby(states)]
    starts = accumulate((length for _, length in lengths), initial=0)
    return [(first, length, state) for first, (state, length) in zip(starts, lengths, strict=False)]


def _frames(first: int, last: int) -> str:
    return f"frame {first}" if first == last else f"frames {first} to {last}"
