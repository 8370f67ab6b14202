"""Single frames with the ads on them, in any order, before or after all is tracked."""

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from dataclasses import replace as changed
from typing import Any

import numpy as np

from hdn import Observation
from hdn.imaging.arrays import Image

from ..choices import Backend
from ..media.reader import VideoReader
from ..surface import FIRST, Surface
from ..tracking.moments import index_of
from ..tracking.solution import blank
from ..tracks import Source
from .loop import Renderer
from .study import Frames


@dataclass(frozen=True)
class PreviewModel:
    """How much is looked at for a single frame."""

    run_up_frames: int = 2  # before it, of which its light, grain and shutter are learnt; 50 make it exact


MODEL = PreviewModel()


class Preview(AbstractContextManager["Preview"]):
    """Draws frames as they will be rendered; light and grain are exact where frames are asked for one after the other.

    It is to be used in one thread.
    """

    def __init__(
        self,
        reader: VideoReader,
        surfaces: Sequence[Surface],
        backend: Backend = "opencv",
        frames: Frames | None = None,
        model: PreviewModel = MODEL,
    ) -> None:
        """Args:
            surfaces: those without a track are drawn in the frame of their quad alone, those without a quad nowhere.
            backend: what draws.
            frames: as `Renderer` takes them.

        Raises:
            InputError: an ad that cannot be read, a quad that is impossible.
            RunError: the backend is not available.
        """
        self._frames, self._model = frames or reader.frames, model
        placed = [self._placed(surface, reader) for surface in surfaces]
        shown = [surface for surface in placed if surface is not None]
        self._renderer = Renderer(reader, shown, backend, self._frames)
        self._next = 0

    def frame(self, index: int) -> Image | None:
        """A frame (H, W, 3), RGB in SDR, with the ads; None where the video has none of this index."""
        first = index if index == self._next else max(index - self._model.run_up_frames, 0)
        self._next = index + 1
        drawn = self._renderer.draw(self._frames(first, index + 1), first=index)
        return next((frame.view for frame, _ in drawn), None)

    def _placed(self, surface: Surface, reader: VideoReader) -> Surface | None:
        """The surface with a track: its own, or one of a single frame."""
        if surface.track is not None or surface.quad is None:
            return None if surface.track is None else surface
        start = index_of(surface.start, reader.times)
        frame = None if start is None else next(iter(self._frames(start, start + 1)), None)
        if start is None or frame is None:
            return None
        quad, info, times = surface.quad_in(Observation(frame.view)), reader.info, list(reader.times)
        source = Source(str(reader.path), info.width, info.height, info.rate, len(times), None, info.pixel_aspect)
        track = blank(source, start, np.asarray(quad), times, {}, (start, start))
        place: dict[str, Any] = {"quad": None, "snap": False, "start": FIRST, "region": None, "exclude": ()}
        return changed(surface, **place, keyframes=(), track=track)

    def __exit__(self, *error: Any) -> None:
        self._renderer.__exit__(*error)
