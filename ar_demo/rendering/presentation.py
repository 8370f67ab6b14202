"""Where the ad is drawn in every frame, and how strongly, while the surface is seen and while it is lost."""

import numpy as np
from numpy.typing import NDArray

from hdn.imaging.arrays import Array

from ..surface import Surface
from ..tracking.segments import segments
from ..tracks import Track

FADE_SECONDS = 0.25  # that the ad takes to go
GLIDE_SECONDS = 0.25  # that a held ad takes to where the surface is found again


def presentation(track: Track, surface: Surface) -> tuple[Array, NDArray[np.float64]]:
    """Where the ad is drawn, (N, 4, 2) px, and how strongly, (N,) 0..1, in every frame.

    Wherever the surface's pose is known the ad is there in full: what it replaces never shines through. While the
    surface is lost the ad keeps its last pose. It fades out there (`lost='fade'`), goes at once ('hide'), or stays and
    glides to where the surface is found again, so that it never jumps ('hold'). A cut ends all of that. Outside the
    track's span there is no ad.
    """
    poses = track.corners.copy()
    inside = np.zeros(len(track), bool)
    inside[track.inside] = True
    shown = track.known & inside
    times = np.array([float(t) for t in track.times])
    opacity = shown.astype(np.float64)
    for start, stop in segments((~shown).tolist(), track.cuts):
        leaves = start > 0 and start not in track.cuts and bool(shown[start - 1])
        returns = stop < len(poses) and stop not in track.cuts
        if leaves:
            poses[start:stop] = poses[start - 1]
        if surface.lost == "hold" and leaves:
            opacity[start:stop] = 1
            if returns:
                way = np.clip(1 - (times[stop] - times[start:stop]) / GLIDE_SECONDS, 0, 1)
                ease = (way * way * (3 - 2 * way))[:, None, None]
                poses[start:stop] += (poses[stop] - poses[start:stop]) * ease
        elif surface.lost == "fade" and leaves:
            opacity[start:stop] = 1 - (times[start:stop] - times[start - 1]) / FADE_SECONDS
    return poses, np.where(inside, np.clip(opacity, 0, 1) * surface.opacity, 0)
