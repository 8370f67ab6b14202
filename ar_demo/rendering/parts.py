"""Where a video is divided to be rendered in parts that are joined."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise


@dataclass(frozen=True)
class PartModel:
    """How a video is divided."""

    # Frames after which H.264 and H.265 begin a group of pictures anew at the latest, counted from a cut or from where
    # they began: with seams at such places, parts have their groups where the whole has them.
    group_frames: int = 250
    least_frames: int = 250  # of a part: each looks at some frames before it first, and takes a second to begin
    each_process: int = 2  # parts for each, since some take longer than others


MODEL = PartModel()


def divided(frames: int, cuts: Iterable[int], processes: int) -> list[range]:
    """The parts of so many frames. cuts: indices of frames that begin another shot."""
    count = min(processes * MODEL.each_process, frames // MODEL.least_frames)
    shots = sorted({0, *(cut for cut in cuts if 0 < cut < frames)})
    places = {
        place
        for shot, after in pairwise([*shots, frames])
        for place in range(shot, after, MODEL.group_frames)
        if 0 < place < frames
    }
    edges = {0, frames}
    for number in range(1, count):
        if places:
            ideal = frames * number / count
            edges.add(min(places, key=lambda place: abs(place - ideal)))
    return [range(a, b) for a, b in pairwise(sorted(edges))]
