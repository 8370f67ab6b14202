"""Stretches of frames that have something in common."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np


def segments(flags: Sequence[bool], cuts: Sequence[int] = ()) -> list[tuple[int, int]]:
    """Runs (start, stop) of true flags; cuts: indices before which a run is cut in two."""
    edges = np.flatnonzero(np.diff([0, *map(int, flags), 0]))
    runs = [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return [pair for a, b in runs for pair in pairwise([a, *(c for c in cuts if a < c < b), b])]
