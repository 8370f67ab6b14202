"""Which frames of a track are worth a look, and what seems to be the matter there."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hdn.imaging.arrays import Array
from hdn.imaging.quads import area, clip_polygon, side

from ..tracking.segments import segments
from ..tracks import Track
from ..words import counted


@dataclass(frozen=True)
class StretchModel:
    """What makes a stretch, and what is told of it."""

    merged_frames: int = 15  # between two stretches, up to which they are told as one
    outside_share: float = 0.1  # of the surface beyond the frame's edge, from which that is told
    hidden_share: float = 0.2  # of the surface that is not seen as it was, from which that is told
    blurred_px: float = 3.0  # standard deviation of the blur, from which it is told
    small_px: float = 40.0  # size, the root of the surface's area, under which that is told
    apart_share: float = 1 / 40  # of the frames, between two that are shown


MODEL = StretchModel()
FRACTIONS = {
    1 / 10: "a tenth",
    1 / 4: "a quarter",
    1 / 3: "a third",
    1 / 2: "half",
    2 / 3: "two thirds",
    3 / 4: "three quarters",
    9 / 10: "nine tenths",
    1.0: "all",
}


@dataclass(frozen=True)
class Stretch:
    """Frames that are held or lost, but for moments between.

    Attributes:
        first, last: indices.
        text: what seems to be the matter, in words.
        weight: how much it is worth a look; for sorting.
    """

    first: int
    last: int
    text: str
    weight: float

    @property
    def frames(self) -> str:
        """As in 'frames 161 to 173'."""
        return f"frame {self.first}" if self.first == self.last else f"frames {self.first} to {self.last}"


def stretches(track: Track, blur: Array | None = None) -> list[Stretch]:
    """The stretches of a track's span, in their order.

    Args:
        blur: (N,) px, standard deviation of the blur beyond that of the first view; NaN where it is not known.
    """
    low, high = track.first, track.last + 1
    doubtful = [low <= i < high and state != "tracked" for i, state in enumerate(track.states)]
    merged: list[tuple[int, int]] = []
    for start, stop in segments(doubtful, track.cuts):
        if merged and start - merged[-1][1] <= MODEL.merged_frames and not _cut_between(track, merged[-1][1], start):
            merged[-1] = merged[-1][0], stop
        else:
            merged.append((start, stop))
    return [_told(track, start, stop, doubtful, blur) for start, stop in merged]


def _cut_between(track: Track, start: int, stop: int) -> bool:
    return any(start <= cut <= stop for cut in track.cuts)


def _told(track: Track, start: int, stop: int, doubtful: Sequence[bool], blur: Array | None) -> Stretch:
    inside = [i for i in range(start, stop) if doubtful[i]]
    held = [i for i in inside if track.states[i] == "held"]
    said = []
    if lost := len(inside) - len(held):
        said.append("lost" if not held else f"lost in {counted(lost, 'frame')}, held in {len(held)}")
    else:
        said.append("held")
    if held:
        said.append(f"corners uncertain by up to {track.deviation[held].max():.1f} px")
        seen = float(np.median(track.confidence[held]))
        beyond = float(np.median([outside(track, i) for i in held]))
        size = float(np.median([side(track.corners[i]) for i in held]))
        if beyond >= MODEL.outside_share:
            said.append(f"{fraction(beyond)} outside the frame")
        if 1 - seen >= MODEL.hidden_share:
            said.append(f"{fraction(1 - seen)} hidden, or unlike the first view")
        if size < MODEL.small_px:
            said.append(f"only {size:.0f} px large")
    if blur is not None and np.isfinite(blur[inside]).any():
        width = float(np.nanmedian(blur[inside]))
        if width >= MODEL.blurred_px:
            said.append(f"blurred by {width:.0f} px")
    return Stretch(start, stop - 1, ", ".join(said), lost + sum(min(track.deviation[i], 10) / 10 for i in held))


def outside(track: Track, index: int) -> float:
    """Share of the surface that lies beyond the frame's edge, 0..1."""
    quad = track.corners[index]
    within = clip_polygon(quad, (-0.5, -0.5, track.source.width - 0.5, track.source.height - 0.5))
    if len(within) < 3:
        return 1.0
    return float(np.clip(1 - abs(area(within)) / max(abs(area(quad)), 1e-9), 0, 1))


def fraction(share: float) -> str:
    """A share 0..1 in words, as in 'about two thirds'."""
    nearest = min(FRACTIONS, key=lambda value: abs(value - share))
    return "almost all" if nearest == 1 else f"about {FRACTIONS[nearest]}"


def worst(track: Track, count: int) -> list[int]:
    """The frames most worth a look, the worst first: where corners are least known, and one for each loss.

    They lie apart, so that they do not all show the same moment.
    """
    low, high = track.first, track.last + 1
    lost = segments([low <= i < high and state == "lost" for i, state in enumerate(track.states)], track.cuts)
    middles = sorted(((start + stop) // 2 for start, stop in lost), key=lambda i: -_length(lost, i))
    known = [i for i in range(low, high) if track.known[i] and i != track.reference_frame]
    ranked = sorted(known, key=lambda i: (-track.deviation[i], track.confidence[i]))
    apart = max(1, round(MODEL.apart_share * (high - low)))
    chosen: list[int] = middles[: max(count // 2, count - len(ranked))]
    for index in ranked:
        if len(chosen) >= count:
            break
        if all(abs(index - other) >= apart for other in chosen):
            chosen.append(index)
    return chosen


def _length(runs: Sequence[tuple[int, int]], index: int) -> int:
    return next(stop - start for start, stop in runs if start <= index < stop)
