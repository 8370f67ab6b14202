"""What a rendering would look like, frame by frame, and the steady view: drawn in one thread, by the session."""

from collections.abc import Callable, Container, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor

from ..media.reader import Frame
from ..rendering.preview import Preview
from ..rendering.steady import SteadyView
from ..session import Session
from ..surface import Surface
from ..tracks import Track
from .frames import Bounded, Frames
from .pictures import jpeg, scaled

MOST_BYTES = 32 << 20  # of pictures that are kept


class Composites:
    """Draws a project's frames with the ads on them. Its methods may be called from any thread."""

    def __init__(self, session: Session, frames: Frames) -> None:
        self._session, self._frames = session, frames
        # The networks are loaded once for each thread.
        self._thread = ThreadPoolExecutor(1, "composites")
        self._kept: Bounded[bytes] = Bounded(MOST_BYTES)
        self._preview: Preview | None = None
        self._revision = -1

    def close(self) -> None:
        """Waits for what is under way."""
        self._thread.submit(self._end).result()
        self._thread.shutdown()

    def composite(
        self, index: int, height: int | None, revision: int, surfaces: Callable[[], Sequence[Surface]]
    ) -> bytes:
        """A frame with the ads, as JPEG.

        Args:
            revision: of the surfaces, which are only asked for where it is another than before.

        Raises:
            InputError, RunError: see `Session.preview`.
        """
        return self._thread.submit(self._composite, index, height, revision, surfaces).result()

    def steady(self, track: Track, index: int, height: int | None) -> bytes:
        """The surface of a track in a frame, standing still, as JPEG."""
        image = self._frames.view(index)
        return jpeg(scaled(SteadyView(track).of(image, index), height))

    def _composite(
        self, index: int, height: int | None, revision: int, surfaces: Callable[[], Sequence[Surface]]
    ) -> bytes:
        if (kept := self._kept.get((revision, index, height))) is not None:
            return kept
        if self._preview is None or revision != self._revision:
            self._end()
            self._preview = self._session.preview(surfaces(), frames=self._range)
            self._revision = revision
        image = self._preview.frame(index)
        picture = jpeg(scaled(self._frames.view(index) if image is None else image, height))
        self._kept.put((revision, index, height), picture, len(picture))
        return picture

    def _range(self, first: int, stop: int, only: Container[int] | None = None) -> Iterator[Frame]:
        """Frames that may be drawn into."""
        times = self._session.reader.times
        for index in range(first, min(stop, self._frames.count)):
            if only is None or index in only:
                last = index + 1 == len(times)
                duration = 1 / self._session.reader.info.rate if last else times[index + 1] - times[index]
                yield Frame(index, times[index], duration, self._frames.view(index).copy())

    def _end(self) -> None:
        if self._preview is not None:
            self._preview.__exit__()
            self._preview = None
