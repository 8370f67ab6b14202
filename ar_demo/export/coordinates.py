"""Where programs count coordinates from.

Ours: px, x right and y down, the centre of the top-left pixel at (0, 0). All others here have the picture's edges at 0
and at its width and height, so that the same centre is at (0.5, 0.5) from the corner that they count from.
"""

from hdn.imaging.arrays import Array

# Places of the corners of a quad, which has them in the order TL, TR, BR, BL.
TL, TR, BR, BL = range(4)


def from_top_left(corners: Array) -> Array:
    """Ours (..., 2) to px from the picture's upper left corner, y down: After Effects."""
    return corners + 0.5


def from_bottom_left(corners: Array, height: float) -> Array:
    """Ours (..., 2) to px from the picture's lower left corner, y up: Nuke."""
    return (corners + 0.5) * [1, -1] + [0, height]


def normalised(corners: Array, width: float, height: float) -> Array:
    """Ours (..., 2) to shares of width and height from the lower left corner, y up: Fusion, Blender."""
    return from_bottom_left(corners, height) / [width, height]


def to_top_left(corners: Array) -> Array:
    """The inverse of `from_top_left`."""
    return corners - 0.5


def to_bottom_left(corners: Array, height: float) -> Array:
    """The inverse of `from_bottom_left`."""
    return (corners - [0, height]) * [1, -1] - 0.5
