"""What a report plots over the frames of a track, and how many frames are put into one point of a long one."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hdn.imaging.arrays import Array
from hdn.imaging.quads import side

from ..tracks import Track
from ..verdict import Limits
from .looking import Look

Summary = Callable[[Array], float]


@dataclass(frozen=True)
class Series:
    """A quantity of each frame of a span.

    Attributes:
        name, unit: unit is '' where the name says it all.
        note: one sentence on what it is.
        values: (n,), NaN where there is none.
        summary: what stands for several frames that share a point.
        digits: after the decimal point.
        limit: a value worth a line, None for none. top: the axis ends there at least.
    """

    name: str
    unit: str
    note: str
    values: Array
    summary: Summary = np.mean
    digits: int = 2
    limit: float | None = None
    top: float = 0.0

    def points(self, frames_each: int) -> Array:
        """The values, so many frames to a point: (ceil(n / frames_each),)."""
        starts = range(0, len(self.values), frames_each)
        chunks = (self.values[start : start + frames_each] for start in starts)
        known = (chunk[np.isfinite(chunk)] for chunk in chunks)
        return np.array([self.summary(chunk) if len(chunk) else np.nan for chunk in known])


def series_of(track: Track, limits: Limits, look: Look | None = None) -> list[Series]:
    """All that is plotted of a track; without a look at the video, light and blur are left out."""
    span = track.inside
    sizes = np.array([side(corners) for corners in track.corners])  # NaN where there is no pose
    deviation = np.where(np.isfinite(track.deviation), track.deviation, np.nan)
    found = [
        Series(
            "Deviation",
            "px",
            "Standard deviation of the corners: how surely they are known. The dashed line is --max-deviation.",
            deviation[span],
            np.max,
            limit=limits.deviation_in(track),
        ),
        Series(
            "Confidence",
            "",
            "Share of the surface in the frame that is seen as in the first view.",
            np.where(track.known, track.confidence, np.nan)[span],
            np.min,
            top=1.0,
        ),
        Series(
            "Jitter",
            "px",
            "Second difference of the corners from frame to frame, the camera's own shake included.",
            jitter(track)[span],
            np.max,
        ),
        Series("Size", "px", "The root of the surface's area.", sizes[span], np.mean, 0),
    ]
    if look is not None:
        found += [
            Series(
                "Blur",
                "px",
                "Standard deviation of the blur beyond the first view's, along its widest axis; rough where much is "
                "hidden.",
                look.blur[span],
                np.max,
                1,
            ),
            Series(
                "Light", "×", "Brightness of the surface to that in the first view.", look.light[span], np.mean, top=1.0
            ),
        ]
    return found


def jitter(track: Track) -> Array:
    """(N,) second difference of the corners, px, root mean square over them; NaN beside a cut, or a frame without."""
    n = len(track)
    found = np.full(n, np.nan)
    if n > 2:
        second = track.corners[2:] - 2 * track.corners[1:-1] + track.corners[:-2]
        found[1:-1] = np.sqrt(np.square(second).sum(2).mean(1))
    for cut in track.cuts:
        found[max(cut - 1, 0) : cut + 1] = np.nan
    return found
