"""A track as keys, one for each frame: what every exporter writes."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np

from hdn.imaging.arrays import Array

from ..choices import LostKeys
from ..errors import InputError
from ..tracks import Track


@dataclass(frozen=True)
class Keys:
    """A track as keys.

    Attributes:
        track: the track itself.
        first_frame: the number that the video's first frame has in the other program.
        insert: (width, height) px of the picture that will be pinned.
        lost: 'hold' where lost frames repeat the corners before them, 'omit' where they have no key.
        indices: (n,) the frames that have a key, by their index in the track.
        corners: (n, 4, 2) px, as the track has them.
    """

    track: Track
    first_frame: int
    insert: tuple[int, int]
    lost: LostKeys
    indices: list[int]
    corners: Array

    @property
    def frames(self) -> list[int]:
        """(n,) the keys' frames, as the other program numbers them."""
        return [self.first_frame + index for index in self.indices]

    @property
    def times(self) -> list[Fraction]:
        """(n,) the keys' times, seconds from the video's first frame."""
        return [self.track.times[index] - self.track.times[0] for index in self.indices]

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) px of the video."""
        return self.track.source.width, self.track.source.height

    @property
    def lost_runs(self) -> list[tuple[int, int]]:
        """First and last frame of each run of lost frames, as the other program numbers them."""
        first, lost_ones = self.track.first, ~self.track.known[self.track.inside]
        return [(a + first + self.first_frame, b + first + self.first_frame) for a, b in runs(lost_ones.tolist())]

    @property
    def cuts(self) -> list[int]:
        """Frames that begin another shot, as the other program numbers them."""
        return [self.first_frame + cut for cut in self.track.cuts if self.track.first < cut <= self.track.last]

    @property
    def notes(self) -> list[str]:
        """What a person should know of the keys, a line each, for formats that have comments."""
        source = self.track.source
        return [
            f"ar-replace: corners of a surface in {printable(Path(source.path).name)}, {source.width}x{source.height}, "
            f"{float(source.fps):.6g} frames/s, {len(self.track)} frames from frame {self.first_frame} on",
            *([f"frames {self.frames[0]} to {self.frames[-1]} alone have keys"] if self.track.span else []),
            *self.marks,
        ]

    @property
    def marks(self) -> list[str]:
        """Which frames are lost, and where shots begin, a line each."""
        done = "held at the corners before" if self.lost == "hold" else "left out"
        return [
            *(f"{_span(first, last)}: lost, {done}" for first, last in self.lost_runs),
            *(f"frame {cut}: another shot begins" for cut in self.cuts),
        ]


def keys_of(track: Track, first_frame: int, insert: tuple[int, int] | None = None, lost: LostKeys = "hold") -> Keys:
    """A track as keys; of one that has a span, in that.

    Frames that are lost before the surface is first found take its first corners.

    Args:
        insert: px; None for the video's own size.

    Raises:
        InputError: the surface is lost in all frames.
    """
    inside = np.arange(len(track))[track.inside]
    known = inside[track.known[inside]]
    if not len(known):
        raise InputError("the surface is lost in every frame: there is nothing to export")
    if lost == "omit":
        indices = known
        sources = known
    else:
        indices = inside
        sources = known[np.maximum(np.searchsorted(known, indices, "right") - 1, 0)]
    size = (track.source.width, track.source.height)
    return Keys(track, first_frame, insert or size, lost, indices.tolist(), track.corners[sources])


def runs(flags: Sequence[bool]) -> list[tuple[int, int]]:
    """First and last place of each run of true flags."""
    edges = np.flatnonzero(np.diff([0, *map(int, flags), 0]))
    return [(int(start), int(stop) - 1) for start, stop in zip(edges[::2], edges[1::2], strict=True)]


def printable(text: str) -> str:
    """The text on one line, whatever is in a file's name: a comment must not end before its end."""
    return "".join(character if character.isprintable() else "?" for character in text)


def number(value: float, digits: int = 4) -> str:
    """A number as text, without zeros that say nothing."""
    text = f"{value:.{digits}f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text


def _span(first: int, last: int) -> str:
    return f"frame {first}" if first == last else f"frames {first} to {last}"
