"""A format of one's own: where the surface's diagonals cross, a line for each frame, for programs that follow a point.

Once this package is installed, `ar-export track.json point.centre` knows it by its ending.
"""

from ar_demo import Exporter, Keys


def centres(keys: Keys) -> str:
    """Frame, x and y, px: x right, y down, the picture's upper left corner at 0,0."""
    rows = []
    for frame, corners in zip(keys.frames, keys.corners, strict=True):
        top_left, top_right, bottom_right, bottom_left = corners + 0.5
        a, b, c = bottom_right - top_left, bottom_left - top_right, top_right - top_left
        x, y = top_left + a * (c[0] * b[1] - c[1] * b[0]) / (a[0] * b[1] - a[1] * b[0])
        rows.append(f"{frame} {x:.3f} {y:.3f}\n")
    return "".join(rows)


CENTRE = Exporter("centre", (".centre",), centres)
