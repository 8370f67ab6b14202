"""Pictures of tracked surfaces' planes, put together from the whole video."""

import logging
from collections.abc import Sequence

import numpy as np

from hdn import Observation
from hdn.plane.picture import PictureBuilder, PlanePicture

from ..errors import InputError
from ..media.reader import VideoReader
from ..media.threads import ahead
from ..progress import Listener, Stage
from ..stopping import Steps
from ..tracks import Track

log = logging.getLogger(__name__)

LOOKED_AT = 200  # frames, at most, that are looked at for a picture


def plane_pictures(reader: VideoReader, tracks: Sequence[Track], listen: Listener) -> Steps[list[PlanePicture]]:
    """The pictures of the planes of tracked surfaces, in one go through the video.

    Raises:
        InputError: a reference frame cannot be decoded.
    """
    builders = [_builder(reader, track) for track in tracks]
    chosen = [_worth_a_look(track) for track in tracks]
    wanted = set().union(*chosen)
    if wanted:
        first, end = min(wanted), max(wanted) + 1
        show = Stage(listen, "look again", 0, len(wanted))
        with ahead(reader.frames(first, end, wanted)) as frames:
            for frame in frames:
                if not frame.damaged:
                    seen = Observation(frame.image)
                    for builder, track, indices in zip(builders, tracks, chosen, strict=True):
                        if frame.index in indices:
                            corners, deviation = track.corners[frame.index], float(track.deviation[frame.index])
                            builder.offer(frame.index, seen, corners, deviation)
                show(tuple(track.states[frame.index] for track in tracks), frame.image)
                yield
    return [builder.build() for builder in builders]


def reference_frame(reader: VideoReader, index: int, rough: bool = False) -> Observation:
    """One frame, for trackers, which take it rough, and pictures to begin with.

    Raises:
        InputError: it cannot be decoded.
    """
    frame = next(reader.frames(index, index + 1, rough=rough), None)
    if frame is None:
        raise InputError(f"frame {index} of {reader.path} cannot be decoded: choose another --start")
    return Observation(frame.image)


def _builder(reader: VideoReader, track: Track) -> PictureBuilder:
    start = track.reference_frame
    known = track.corners[track.known]
    longest = float(np.linalg.norm(np.roll(known, -1, 1) - known, axis=2).max())
    return PictureBuilder(start, reference_frame(reader, start), track.quad, longest)


def _worth_a_look(track: Track) -> set[int]:
    """Frames in which the corners are known, evenly chosen, but for the reference frame."""
    known = np.flatnonzero(track.known & np.isfinite(track.deviation))
    known = known[known != track.reference_frame]
    if len(known) > LOOKED_AT:
        known = known[np.linspace(0, len(known) - 1, LOOKED_AT).round().astype(int)]
    return set(known.tolist())
