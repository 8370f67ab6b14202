"""A table, comma-separated, whose header says how frames and coordinates are counted."""

import csv
from io import StringIO

from .keys import Keys

COLUMNS = ["frame", "seconds", "state", *(f"{axis}{corner}" for corner in range(1, 5) for axis in "xy")]
LEGEND = (
    "corners in px: x right, y down, the centre of the top-left pixel at 0,0",
    "corner 1 top-left, 2 top-right, 3 bottom-right, 4 bottom-left of the insert",
)


def table(keys: Keys) -> str:
    """A row for each key; lines that begin with # tell of them all."""
    text = StringIO()
    for line in (*keys.notes, *LEGEND):
        text.write(f"# {line}\n")
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(COLUMNS)
    for index, frame, time, corners in zip(keys.indices, keys.frames, keys.times, keys.corners, strict=True):
        state = keys.track.states[index]
        rows.writerow([frame, f"{float(time):.6f}", state, *(f"{v:.4f}" for v in corners.ravel())])
    return text.getvalue()
