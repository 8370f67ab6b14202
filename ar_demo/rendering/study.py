"""A look at a clip before it is drawn on: how its surfaces were lit in their first views."""

from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass
from hashlib import sha256
from typing import Protocol

import numpy as np

from hdn.networks.loading import load_lighting, shared_matte

from ..media.reader import Frame
from ..scene.first_light import FirstLight, LightStudy
from ..tracks import Track


class Frames(Protocol):
    """Gives a video's frames from one to before another, or only some of these."""

    def __call__(self, start: int, stop: int, only: Container[int] | None = None, /) -> Iterable[Frame]: ...


@dataclass(frozen=True)
class StudyModel:
    """How much of a clip is looked at."""

    views: int = 24  # of a surface
    reach_frames: int = 360  # to each side of the first view, so that long clips take no longer
    remembered: int = 16  # surfaces: previews ask for the same ones again and again


MODEL = StudyModel()
_known: dict[str, FirstLight | None] = {}


def first_lights(video: str, frames: Frames, tracks: Sequence[Track | None]) -> list[FirstLight | None]:
    """The light on each tracked surface in its reference frame, in one go through the clip.

    Args:
        video: its name, by which what was told before is known.
        frames: its frames.
        tracks: None where nothing is asked.

    Returns:
        None where nothing was asked, or cannot be told.
    """
    names = [None if track is None else _name(video, track) for track in tracks]
    asked = {name: track for name, track in zip(names, tracks, strict=True) if name not in (None, *_known)}
    for name, light in _told(frames, {n: t for n, t in asked.items() if n is not None and t is not None}).items():
        _known[name] = light
        while len(_known) > max(MODEL.remembered, len(tracks)):
            del _known[next(iter(_known))]
    return [None if name is None else _known[name] for name in names]


def views_of(track: Track) -> set[int]:
    """Frames that are looked at beside the reference frame: evenly chosen of those that show the surface."""
    at = track.reference_frame
    known = np.flatnonzero(np.array([state == "tracked" for state in track.states]) & track.known)
    known = known[(known != at) & (np.abs(known - at) <= MODEL.reach_frames)]
    return set(known[np.linspace(0, len(known) - 1, min(len(known), MODEL.views)).round().astype(int)].tolist())


def _told(frames: Frames, tracks: dict[str, Track]) -> dict[str, FirstLight | None]:
    studies: dict[str, LightStudy] = {}
    chosen: dict[int, list[str]] = {}
    for name, track in tracks.items():
        at, indices = track.reference_frame, views_of(track)
        first = next(iter(frames(at, at + 1)), None) if indices else None
        if first is not None:
            studies[name] = LightStudy(first.view, track.quad, shared_matte(), load_lighting())
            for index in indices:
                chosen.setdefault(index, []).append(name)
    for frame in frames(min(chosen), max(chosen) + 1, chosen) if chosen else ():
        for name in chosen[frame.index]:
            if not frame.damaged:
                studies[name].see(frame.view, tracks[name].corners[frame.index])
    return {name: studies[name].light() if name in studies else None for name in tracks}


def _name(video: str, track: Track) -> str:
    """A surface of a video, by where it is in the frames that are looked at."""
    looked_at = sorted({track.reference_frame, *views_of(track)})
    return sha256(f"{video} {looked_at}".encode() + track.corners[looked_at].tobytes()).hexdigest()
