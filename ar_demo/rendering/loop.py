"""The render loop: ads onto their tracked surfaces, frame by frame."""

import logging
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import replace as changed
from fractions import Fraction
from typing import Any

import numpy as np

from hdn.imaging.arrays import Box, Grey, Image
from hdn.networks.loading import shared_matte

from ..choices import Backend
from ..compositing.compositor import Compositor, open_compositor
from ..compositing.separation import Insert
from ..errors import InputError
from ..media.mattes import GivenMatte
from ..media.reader import Frame, VideoReader
from ..scene.conditions import Appearance, Conditions
from ..scene.first_light import FirstLight
from ..surface import Surface
from ..tracks import Track
from .painting import Painter
from .presentation import presentation
from .study import Frames, first_lights

log = logging.getLogger(__name__)

RUN_UP_FRAMES = 50  # before a part of a video, of which its light, grain and shutter are known


def run_up(first: int) -> int:
    """Index of the frame from which frames are looked at, so that those from `first` on look as in the whole video."""
    return max(first - RUN_UP_FRAMES, 0)


class _Drawn:
    """A tracked surface on its way into frames.

    Raises:
        InputError: no ad, or not one that can be read.
    """

    def __init__(
        self,
        surface: Surface,
        track: Track,
        first_light: FirstLight | None,
        reader: VideoReader,
        compositor: Compositor,
        frames: Frames,
    ) -> None:
        self.track = track
        self.painter = Painter(surface, track.quad, (reader.info.width, reader.info.height), compositor)
        self._poses, self._opacities = presentation(track, surface)
        self._begin, _ = track.seconds
        self.matte: GivenMatte | None = None
        if surface.matte is not None:
            self.matte = GivenMatte(surface.matte, reader.info, range(len(track), len(reader.times) + 1))
        self._appearance: Appearance | None = None
        if surface.in_scene:
            at = track.reference_frame
            for frame in frames(at, at + 1):
                self._appearance = Appearance(
                    frame.image,
                    track.quad,
                    shared_matte(),
                    surface.shutter,
                    grain=surface.grain == "auto",
                    softness=surface.softness == "auto",
                    first_light=first_light,
                    kind=surface.surface_kind,
                )

    @property
    def is_blank(self) -> bool:
        """Whether the surface has no texture, and what is in front of it has to be told by colour and border."""
        return self.matte is None and self._appearance is not None and self._appearance.is_blank

    def conditions(self, index: int, image: Image) -> Conditions | None:
        """Under which the surface is seen in a frame (H, W, 3) of this index; None where nothing is told."""
        track = self.track
        if self._appearance is None or index not in range(len(track))[track.inside]:
            return None
        lost, cut = track.states[index] == "lost", index in track.cuts
        motion = track.motion(index)
        found = self._appearance.conditions(
            image, track.corners[index], float(track.deviation[index]), lost, cut, motion, self._matte_at(index)
        )
        # By the frame's own number, so that a part of the video has the grain that it has in the whole.
        return found if found.grain is None else changed(found, grain=changed(found.grain, number=index))

    def draw(self, frame: Frame, elapsed: Fraction, conditions: Conditions | None, cover: Grey | None) -> Box | None:
        """Draws into the frame; elapsed: seconds since the video began. See `Painter.draw` for the rest."""
        if frame.index >= len(self._poses):
            return None
        pose, opacity = self._poses[frame.index], float(self._opacities[frame.index])
        after = elapsed - self._begin
        matte = self._matte_at(frame.index)
        return self.painter.draw(frame.image, pose, opacity, after, conditions, cover, frame.hdr, matte)

    def _matte_at(self, index: int) -> Grey | None:
        """The matte (H, W) that is given for a frame."""
        return None if self.matte is None else self.matte.at(index)


def _track(surface: Surface) -> Track:
    if surface.track is None:
        raise InputError("a surface has no track yet: track it first")
    return surface.track


def _told(surface: Surface) -> Track | None:
    """The track of a surface whose first view's light is to be told; None where it is not."""
    lit = surface.in_scene and surface.first_light == "auto" and surface.blend == "normal"
    return _track(surface) if lit else None


class Renderer(AbstractContextManager["Renderer"]):
    """Draws ads onto the tracked surfaces of a video; later ones lie over earlier ones."""

    def __init__(
        self, reader: VideoReader, surfaces: Sequence[Surface], backend: Backend, frames: Frames | None = None
    ) -> None:
        """Args:
            surfaces: with their tracks.
            backend: what draws.
            frames: gives the reader's frames from one to before another; None takes the reader's own.

        Raises:
            InputError: an ad that cannot be read, a surface without a track.
            RunError: the backend is not available.

        Attributes:
            blank: of each surface whether it has no texture, so that colour and border tell what is in front of it.
            first_lights: of each surface what is told of the light in its reference frame; None for nothing.
        """
        self._reader = reader
        self._drawn: list[_Drawn] = []
        with ExitStack() as opened:  # closed where one of them fails
            self._compositor = opened.enter_context(open_compositor(backend))
            frames = frames or reader.frames
            lights = first_lights(str(reader.path), frames, [_told(surface) for surface in surfaces])
            self.first_lights = [None if light is None else light.summary for light in lights]
            for surface, light in zip(surfaces, lights, strict=True):
                drawn = _Drawn(surface, _track(surface), light, reader, self._compositor, frames)
                opened.enter_context(drawn.painter)
                if drawn.matte is not None:
                    opened.enter_context(drawn.matte)
                self._drawn.append(drawn)
                if drawn.is_blank:
                    log.info("%s: the surface is blank, so colour and border tell what is in front", surface.name)
            self.blank = [drawn.is_blank for drawn in self._drawn]
            self._opened = opened.pop_all()

    def __exit__(self, *error: Any) -> None:
        self._opened.close()

    @property
    def description(self) -> str:
        """What draws: backend and renderer."""
        return self._compositor.description

    @property
    def warnings(self) -> list[str]:
        """What is wrong with files that belong to surfaces."""
        return [warning for drawn in self._drawn if drawn.matte is not None for warning in drawn.matte.warnings]

    @property
    def length(self) -> int:
        """Frames of the longest track."""
        return max(len(drawn.track) for drawn in self._drawn)

    def draw(
        self, frames: Iterable[Frame], apart: bool = False, first: int = 0
    ) -> Iterator[tuple[Frame, Insert | None]]:
        """Frames from the video, of 8 or 16 bits, with the ads on them: they are drawn into in place, and say where.

        Args:
            apart: whether what was laid on them comes beside them, by itself.
            first: index of the first frame that is drawn into; those before are looked at alone, see `run_up`.
        """
        for frame in frames:
            if frame.index < first:
                for drawn in self._drawn:
                    drawn.conditions(frame.index, frame.view)
                continue
            before = frame.image.copy()
            cover = np.zeros(frame.image.shape[:2], np.float32) if apart else None
            boxes = self._draw(frame, cover)
            frame.add_drawn(before, boxes)
            yield frame, None if cover is None else Insert.of(before, frame.image, cover, boxes)

    def _draw(self, frame: Frame, cover: Grey | None) -> list[Box]:
        elapsed = frame.time - self._reader.times[0]
        seen = [drawn.conditions(frame.index, frame.view) for drawn in self._drawn]  # before anything is drawn
        boxes = [
            drawn.draw(frame, elapsed, conditions, cover) for drawn, conditions in zip(self._drawn, seen, strict=True)
        ]
        return [box for box in boxes if box is not None]
