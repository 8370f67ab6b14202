"""Tracks to export: one that moves, one of a turned video, one with a cut, one that is lost for a while."""

from fractions import Fraction

import numpy as np

from ar_demo.tracks import Source, Track
from hdn.imaging.arrays import Array

from ..scenes import path

QUAD = np.array([[100.25, 70], [220, 74.5], [216, 166], [102, 160.125]])
FRAMES = 9
CUT = 5
LOST = (3, 4, 8)


def make(corners: Array, width: int = 320, height: int = 240, cuts: tuple[int, ...] = ()) -> Track:
    """A track of corners (n, 4, 2), px; lost where they are NaN."""
    known = np.isfinite(corners).all((1, 2))
    source = Source("street.mp4", width, height, Fraction(30000, 1001), len(corners))
    return Track(
        source,
        int(np.argmax(known)),
        corners[np.argmax(known)],
        [Fraction(i * 1001, 30000) for i in range(len(corners))],
        corners,
        ["tracked" if is_known else "lost" for is_known in known],
        known.astype(float),
        np.where(known, 0.2, np.inf),
        cuts=list(cuts),
    )


def moving() -> Track:
    return make(np.stack(path(QUAD, FRAMES)))


def turned() -> Track:
    """Of a video that is stored on its side: sizes and corners are those of the upright picture."""
    return make(np.stack(path(QUAD - [60, 0], FRAMES)), 240, 320)


def cut() -> Track:
    corners = np.stack(path(QUAD, FRAMES))
    corners[CUT:] = corners[CUT:] * 0.5 + [90, 20]
    return make(corners, cuts=(CUT,))


def lost() -> Track:
    corners = np.stack(path(QUAD, FRAMES))
    corners[list(LOST)] = np.nan
    return make(corners)


TRACKS = {"moving": moving, "turned": turned, "cut": cut, "lost": lost}
