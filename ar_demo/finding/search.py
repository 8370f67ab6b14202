"""The search of a whole video for pictures, in one pass over it."""

import logging
import sys
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from hdn import Observation
from hdn.networks.engine import Engine

from ..errors import NotFound
from ..media.reader import Frame, VideoReader
from ..media.threads import ahead
from ..options import TrackingOptions
from ..progress import Listener, Stage
from ..stopping import StopSignal
from ..surface import FIRST
from ..tracking.cuts import CutDetector
from ..tracking.moments import index_of, until
from ..words import counted
from .checking import MODEL as CHECK
from .checking import Checker
from .matching import Matcher
from .pictures import Picture
from .sightings import Appearance, Instance, Sighting, instances, is_whole, overlap

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class SearchModel:
    """Which frames are looked at, how closely, and which sightings are of one appearance."""

    interval_s: Fraction = Fraction(2, 5)  # from one frame that is looked at to the next
    min_looks: int = 24  # frames that are looked at in all, though they be closer to each other in a short video
    longest_px: int = 960  # of the frame's longer side, where keypoints are looked for; else it is halved
    close_px: int = 1920  # the same in frames that are looked at closely, for what is small, if nothing was found
    close_interval: int = 4  # frames that are looked at, to one that is looked at closely
    same_place: float = 0.3  # overlap of two pictures in one frame, from which only the surer one is there
    same_thing: float = 0.15  # overlap of a picture with itself in the frame looked at before, if there was no cut


MODEL = SearchModel()


@dataclass(frozen=True)
class Found:
    """Where and when a video shows pictures.

    Attributes:
        video: as it was given; size: width and height of its frames, px.
        pictures: that were looked for.
        instances: of each picture its copies; none where it was not found.
        nearest: of each picture the best of what was taken for something else; None where nothing was like it.
        looks: frames that were looked at.
    """

    video: str
    size: tuple[int, int]
    pictures: Sequence[Picture]
    instances: Sequence[Sequence[Instance]]
    nearest: Sequence[Sighting | None]
    looks: int

    def check(self, number: int) -> None:
        """Raises NotFound, with the best candidate, where a picture was not found."""
        if not self.instances[number]:
            raise NotFound(f"{self.pictures[number].path} is not seen in {self.video}: {self.in_words(number)}")

    def in_words(self, number: int) -> str:
        """What comes nearest to a picture that was not found."""
        nearest = self.nearest[number]
        if nearest is None:
            return f"nothing in the {counted(self.looks, 'frame')} that were looked at is like it"
        x, y = nearest.corners.mean(0)
        return (
            f"the best candidate is in frame {nearest.index} at {x:.0f},{y:.0f}, with a score of {nearest.score:.2f} "
            f"where {CHECK.min_agreement} is needed"
        )

    def summary(self) -> dict[str, Any]:
        """As JSON can hold it."""
        pictures = [
            {
                "picture": str(picture.path),
                "instances": [copy.summary() for copy in copies],
                **({} if copies or nearest is None else {"nearest": nearest.summary()}),
            }
            for picture, copies, nearest in zip(self.pictures, self.instances, self.nearest, strict=True)
        ]
        return {"video": self.video, "looks": self.looks, "pictures": pictures}


@dataclass
class _Open:
    """Appearances that may go on in the next frame that is looked at, and all that there are."""

    cuts: CutDetector = field(default_factory=CutDetector)
    going_on: list[Appearance] = field(default_factory=list)
    all: list[Appearance] = field(default_factory=list)


def search(
    reader: VideoReader,
    pictures: Sequence[Picture],
    options: TrackingOptions,
    load: Callable[[], Engine],
    listen: Listener,
    stop: StopSignal,
) -> Found:
    """Looks for pictures in a video, in the part of it that the options name.

    Args:
        load: gives the networks, where something is to be looked at with them.

    Raises:
        InputError: the part is beyond the end.
        Stopped: somebody asked to.
    """
    matcher, checker = Matcher(pictures), Checker(pictures, load)
    seen, looks = _Open(), 0
    nearest: dict[int, Sighting] = {}
    first, total, step = _extent(reader, options)
    show = Stage(listen, "find", 0, None if total is None else -(-total // step))
    with ahead(reader.frames(first, only=range(first, sys.maxsize, step))) as frames:
        for frame in until(stop.watch(frames), options.last, reader.times[0]):
            observation = Observation(frame.view)
            close = looks % MODEL.close_interval == 0
            sightings = [*_sightings(matcher, checker, frame, observation, close, reader.times[0], nearest)]
            _link(seen, looks, observation, sightings)
            looks += 1
            show(preview=frame.view)
    by_picture: dict[int, list[Appearance]] = defaultdict(list)
    for each in seen.all:
        by_picture[each.picture].append(each)
    numbers = range(len(pictures))
    copies = [instances(by_picture[number]) for number in numbers]
    return Found(
        reader.given,
        (reader.info.width, reader.info.height),
        pictures,
        copies,
        [nearest.get(number) for number in numbers],
        looks,
    )


def _extent(reader: VideoReader, options: TrackingOptions) -> tuple[int, int | None, int]:
    """The first frame that is looked at; how many there are from it on, None for unknown; the step between looks."""
    begin = (options.time and options.time.begin) or FIRST
    first = index_of(begin, reader.times) or 0
    total = len(reader.times) - first if reader.seekable else reader.info.frames
    step = max(1, round(reader.info.rate * MODEL.interval_s))
    if total is not None:
        step = max(1, min(step, total // MODEL.min_looks))
    return first, total, step


def _sightings(
    matcher: Matcher,
    checker: Checker,
    frame: Frame,
    observation: Observation,
    close: bool,
    zero: Fraction,
    nearest: dict[int, Sighting],
) -> Iterator[Sighting]:
    """What a frame shows of the pictures, each place once; `nearest` takes the best of what proves to be nothing."""
    width, height = observation.colour.size
    found: list[Sighting] = []
    is_large = max(width, height) > MODEL.longest_px
    for longest in (MODEL.longest_px, MODEL.close_px) if close and is_large else (MODEL.longest_px,):
        for place in matcher.places(observation, longest) if not found else ():
            checked = checker.check(observation, place)
            whole = is_whole(checked.corners, width, height)
            sighting = Sighting(
                place.picture,
                frame.index,
                frame.time - zero,
                checked.corners,
                checked.score,
                checked.deviation,
                len(place.target),
                whole,
                checked.sharpness,
            )
            if checked.is_there:
                found.append(sighting)
            elif place.picture not in nearest or nearest[place.picture].score < sighting.score:
                nearest[place.picture] = sighting
    taken: list[Sighting] = []
    for sighting in sorted(found, key=lambda one: one.surety, reverse=True):
        if all(overlap(sighting.corners, other.corners) < MODEL.same_place for other in taken):
            taken.append(sighting)
            yield sighting


def _link(seen: _Open, look: int, frame: Observation, sightings: Iterable[Sighting]) -> None:
    """Adds what a frame shows to the appearances that go on in it, or begins others."""
    if seen.cuts.is_cut(look, frame.grey):
        seen.going_on = []
    before, seen.going_on = seen.going_on, []
    for sighting in sightings:
        same = [each for each in before if each.picture == sighting.picture]
        best = max(same, key=lambda each: overlap(each.last.corners, sighting.corners), default=None)
        if best is None or overlap(best.last.corners, sighting.corners) < MODEL.same_thing:
            seen.all.append(best := Appearance())
        else:
            before.remove(best)
        best.sightings.append(sighting)
        seen.going_on.append(best)
