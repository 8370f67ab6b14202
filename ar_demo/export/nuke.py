"""Nuke: nodes as they are copied to the clipboard, CornerPin2D and Tracker4.

Pixels from the lower left corner, y up. The node file's grammar is that of Nuke's own copies: a knob's value in braces,
an animated one as {curve xFRAME value ...}.
"""

from collections.abc import Sequence

from hdn.imaging.arrays import Array

from .coordinates import BL, BR, TL, TR, from_bottom_left
from .keys import Keys, number

HEADER = ["set cut_paste_input [stack 0]", "version 14.0 v1", "push $cut_paste_input"]
LABEL_LINES = 8  # of a node's label, which is drawn in the node graph
ORDER = (BL, BR, TR, TL)  # of to1 to to4
TRACK_NAMES = ("bottom left", "bottom right", "top right", "top left")

# The columns of Tracker4's table, each as its type, whether it is shown, its width, and its name twice.
COLUMNS = (
    "5 1 20 enable e 1",
    "3 1 75 name name 1",
    *(f"2 1 58 {name} {name} 1" for name in ("track_x", "track_y")),
    *(f"2 1 63 {name} {name} 1" for name in ("offset_x", "offset_y")),
    *(f"4 1 27 {name} {name} 1" for name in ("T", "R", "S")),
    "2 0 45 error error 1",
    *(f"1 1 0 {name} {name} 1" for name in ("error_min", "error_max")),
    *(f"1 1 0 {area}_{side} {area}_{side} 1" for area in ("pattern", "search") for side in "xyrt"),
    "2 1 0 key_track key_track 1",
    *(f"2 1 0 key_{area}_{side} key_{area}_{side} 1" for area in ("search", "track") for side in "xyrt"),
    *(f"2 1 0 key_centre_offset_{axis} key_centre_offset_{axis} 1" for axis in "xy"),
)
KEY_COLUMNS = sum(" key_" in column for column in COLUMNS)


def corner_pin(keys: Keys) -> str:
    """A CornerPin2D that pins an insert of `keys.insert` px."""
    width, height = keys.insert
    return _corner_pin(keys, "CornerPin", [(0, 0), (width, 0), (width, height), (0, height)], invert=False)


def stabilise(keys: Keys) -> str:
    """A CornerPin2D that takes the video and holds the surface still where the reference frame has it."""
    corners = from_bottom_left(keys.track.quad, keys.size[1])
    return _corner_pin(keys, "Stabilize", [tuple(corners[place]) for place in ORDER], invert=True)


def _corner_pin(keys: Keys, name: str, corners: Sequence[tuple[float, ...]], invert: bool) -> str:
    moving = from_bottom_left(keys.corners, keys.size[1])
    knobs = [f"to{n} {{{_point(keys.frames, moving[:, place])}}}" for n, place in enumerate(ORDER, 1)]
    knobs.append(f"invert {str(invert).lower()}")
    knobs += [f"from{n} {{{number(x)} {number(y)}}}" for n, (x, y) in enumerate(corners, 1)]
    return _node(keys, "CornerPin2D", name, knobs)


def tracker(keys: Keys) -> str:
    """A Tracker4 with a track for each corner, on for translation, rotation and scale."""
    moving, start = from_bottom_left(keys.corners, keys.size[1]), keys.frames[0]
    rows = []
    for title, place in zip(TRACK_NAMES, ORDER, strict=True):
        enabled, nothing = f"{{curve K x{start} 1}}", f"{{curve K x{start} 0}}"
        boxes = "-32 -32 32 32 -22 -22 22 22"  # pattern and search, px around the point
        rows.append(
            f' {{ {enabled} "{title}" {_point(keys.frames, moving[:, place])} {nothing} {nothing} 1 1 1 '
            f"{{curve x{start} 0}} 0 0 {boxes} {' '.join(['{}'] * KEY_COLUMNS)} }}"
        )
    columns = "\n".join(f"{{ {column} }}" for column in COLUMNS)
    table = "\n".join([f"tracks {{ {{ 1 {len(COLUMNS)} {len(rows)} }}", f"{{ {columns}", "}", "{", *rows, "}", "}"])
    return _node(keys, "Tracker4", "Tracker", [table])


def _point(frames: Sequence[int], points: Array) -> str:
    """Points (n, 2) at frames as two curves."""
    return " ".join(
        "{curve " + " ".join(f"x{frame} {number(v)}" for frame, v in zip(frames, values, strict=True)) + "}"
        for values in points.T
    )


def _node(keys: Keys, kind: str, name: str, knobs: Sequence[str]) -> str:
    comments = [f"# {note}" for note in keys.notes]
    marks = keys.marks
    if len(marks) > LABEL_LINES:
        marks = [*marks[:LABEL_LINES], f"and {len(marks) - LABEL_LINES} more"]
    label = "\\n".join(marks)
    place = [f"name {name}_of_surface", *([f'label "{label}"'] if label else []), "selected true", "xpos 0", "ypos 0"]
    return "\n".join([*comments, *HEADER, f"{kind} {{", *(f" {knob}" for knob in [*knobs, *place]), "}", ""])
