"""A table of corners, as `ar-export` writes it: px, y down, the centre of the top-left pixel at 0,0."""

import csv
import re
from io import StringIO

import numpy as np

from hdn.imaging.arrays import Array
from hdn.state import STATES, State

from ..errors import InputError
from ..export.csv_table import COLUMNS
from .curves import Corners

FIRST_FRAME = 0
OURS = re.compile(r"# ar-replace: .* frames from frame (-?\d+) on")
NEEDED = [COLUMNS[0], *COLUMNS[3:]]


def is_ours(text: str) -> bool:
    """Whether a file's text has the table's columns."""
    rows = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    return bool(rows) and set(NEEDED) <= {name.strip() for name in rows[0].lstrip("\ufeff").split(",")}


def read(text: str, width: int, height: int) -> Corners:
    """The corners of the rows that have all of them.

    Raises:
        InputError: a value that is no number.
    """
    lines = text.lstrip("\ufeff").splitlines()
    first = next((int(match[1]) for line in lines if (match := OURS.fullmatch(line))), None)
    points: dict[int, Array] = {}
    states: dict[int, State] = {}
    rows = csv.DictReader(
        StringIO("\n".join(line for line in lines if line.strip() and not line.startswith("#"))), skipinitialspace=True
    )
    rows.fieldnames = [name.strip() for name in rows.fieldnames or []]
    for number, row in enumerate(rows, 1):
        try:
            values = [row[name] or "" for name in NEEDED[1:]]
            if not all(value.strip() for value in values):
                continue
            frame = int(row[NEEDED[0]])
            points[frame] = np.array([float(value) for value in values]).reshape(4, 2)
        except (KeyError, TypeError, ValueError):
            raise InputError(
                f"row {number} has something else than numbers: give a frame and eight coordinates"
            ) from None
        for state in STATES:
            if row.get("state") == state:
                states[frame] = state
    if not points:
        raise InputError("no row has all corners: there is nothing to read")
    return Corners(points, first, states=states)
