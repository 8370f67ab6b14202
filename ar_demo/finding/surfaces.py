"""From what was found of pictures to surfaces that can be tracked."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace as changed

from hdn.state import BOUNDS

from ..errors import NotFound
from ..surface import Keyframe, Moment, Surface
from .pictures import Picture, read_pictures
from .search import Found
from .sightings import Instance

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class KeyframeModel:
    """Which sightings are given to tracking as keyframes."""

    max_deviation_px: float = 2.0  # of the corners: about as exact as those set by hand


MODEL = KeyframeModel()


class Wanted:
    """The pictures of several surfaces, for one search.

    Attributes:
        pictures: all of them, in the order of the surfaces.
    """

    def __init__(self, surfaces: Sequence[Surface]) -> None:
        """Reads the pictures of the surfaces that have to be found.

        Raises:
            InputError: a picture that cannot be looked for.
        """
        self._surfaces = surfaces
        self._own = [[] if surface.find is None else read_pictures([surface.find]) for surface in surfaces]
        self.pictures: list[Picture] = [picture for own in self._own for picture in own]

    def located(self, found: Found) -> list[Surface]:
        """The surfaces with their quads; one for each copy of a picture, the one that is seen best first.

        Raises:
            NotFound: a picture, or all those of a folder, are not seen, or never wholly inside the frame.
        """
        located: list[Surface] = []
        number = 0
        for surface, own in zip(self._surfaces, self._own, strict=True):
            numbers = range(number, number + len(own))
            number += len(own)
            if surface.find is None:
                located.append(surface)
                continue
            copies = [copy for each in numbers for copy in found.instances[each]]
            if not copies:
                best = max(numbers, key=lambda each: -1 if (near := found.nearest[each]) is None else near.score)
                found.check(best)
            whole = sorted((copy for copy in copies if copy.best.is_whole), key=lambda copy: copy.best.exactness)
            if not whole:
                self._only_in_part(copies, found)
            if len(whole) < len(copies):
                log.warning("%s: places that never lie wholly inside the frame are left out", surface.find)
            for copy in whole:
                self._tell_if_unsure(copy, found)
            located += [_at(surface, copy, self.pictures[copy.best.picture]) for copy in whole]
        return located

    def _tell_if_unsure(self, copy: Instance, found: Found) -> None:
        best = copy.best
        if best.deviation > BOUNDS.sharp(max(found.size)):
            log.warning(
                "%s: its corners are known to %.1f px only, in frame %d: check them; --snap may help, or a picture "
                "that is sharper or more alike",
                self.pictures[best.picture].path,
                best.deviation,
                best.index,
            )

    def _only_in_part(self, copies: Sequence[Instance], found: Found) -> None:
        best = min((copy.best for copy in copies), key=lambda one: one.exactness)
        raise NotFound(
            f"{self.pictures[best.picture].path} is seen in {found.video}, best in frame {best.index} with a score of "
            f"{best.score:.2f}, but never wholly inside the frame: look for a part of the picture that is"
        )


def _at(surface: Surface, copy: Instance, picture: Picture) -> Surface:
    """A surface where a copy of its picture was found, with a keyframe in each other shot that shows it."""
    best = copy.best
    others = [each.best for each in copy.appearances if best not in each.sightings]
    keyframes = tuple(
        Keyframe(Moment(frame=one.index), one.corners) for one in others if one.deviation < MODEL.max_deviation_px
    )
    log.info(
        "%s is seen in frames %s, best in frame %d with a score of %.2f",
        picture.path,
        ", ".join(f"{each.first.index} to {each.last.index}" for each in copy.appearances),
        best.index,
        best.score,
    )
    return changed(surface, find=None, quad=best.corners, start=Moment(frame=best.index), keyframes=keyframes)
