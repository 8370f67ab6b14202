"""A video's frames by their numbers, quickly, in whichever order somebody scrubs through them.

One thread decodes, forward from where it stands or from the key frame before. What comes by is kept as JPEGs in a
temporary file, so that each frame is decoded about once: those that are asked for, then those that lie in the direction
of scrubbing, then, while nothing is asked for, all others. After that even the last frame of a long group of pictures
takes no longer than reading it. Until then whoever jumps into one is shown the nearest frame that is kept: at least the
key frame before it is.
"""

import logging
import math
import os
import shutil
import tempfile
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Container, Iterator
from concurrent.futures import Future
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Condition, Lock, Thread
from typing import Any, Generic, TypeVar

from platformdirs import user_cache_path

from hdn.imaging.arrays import Image

from ..media.reader import Frame, IndexDropped, VideoReader
from .errors import Refusal
from .pictures import from_jpeg, jpeg, scaled, smaller

log = logging.getLogger(__name__)

T = TypeVar("T")


@dataclass(frozen=True)
class FramesModel:
    """What is kept, and what is decoded before it is asked for."""

    kept_height_px: int = 1080  # of the JPEGs, at most
    most_disk_bytes: int = 4 << 30  # that they take, and no more than
    most_disk_share: float = 0.25  # of what is free
    memory_bytes: int = 48 << 20  # of pictures that were made smaller, or are not kept on disk
    whole_bytes: int = 64 << 20  # of the latest frames that were decoded, at full size
    before_frames: int = 8  # that are kept at full size on a long way from a key frame to one that is asked for
    block_frames: int = 96  # that are decoded at once where somebody scrubs backwards
    scrub_frames: int = 16  # from one that is asked for to the next, at most, for that to be scrubbing
    ahead_frames: int = 48  # that are decoded before they are asked for
    skip_frames: int = 12  # from which on a key frame on the way is gone to
    idle_seconds: float = 0.3  # without a request, after which all other frames are decoded
    patience_seconds: float = 0.1  # after which the nearest frame is shown
    renewal_seconds: float = 1.0  # within which a frame has to be asked for again, or it is not decoded


MODEL = FramesModel()


class Bounded(Generic[T]):
    """What was used last, up to a size."""

    def __init__(self, most: int) -> None:
        self._most, self._size, self._lock = most, 0, Lock()
        self._kept: OrderedDict[Any, tuple[T, int]] = OrderedDict()

    def get(self, key: Any) -> T | None:
        with self._lock:
            if key not in self._kept:
                return None
            self._kept.move_to_end(key)
            return self._kept[key][0]

    def put(self, key: Any, value: T, size: int = 1) -> None:
        with self._lock:
            self._size += size - self._kept.pop(key, (value, 0))[1]
            self._kept[key] = value, size
            while self._size > self._most:
                _, (_, dropped) = self._kept.popitem(last=False)
                self._size -= dropped

    def clear(self) -> None:
        with self._lock:
            self._kept.clear()
            self._size = 0


class Pile:
    """Pieces of bytes in a temporary file, which is gone when it is closed."""

    def __init__(self, model: FramesModel = MODEL) -> None:
        folder = user_cache_path("ar-replace", appauthor=False)  # /tmp may be memory
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115
        except OSError:
            folder = Path(tempfile.gettempdir())
            self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115
        free = shutil.disk_usage(folder).free
        self._most = min(model.most_disk_bytes, int(free * model.most_disk_share))
        self._places: dict[int, tuple[int, int]] = {}
        self._end = 0

    def __contains__(self, key: int) -> bool:
        return key in self._places

    @property
    def is_full(self) -> bool:
        return self._end >= self._most

    def put(self, key: int, data: bytes) -> None:
        """Adds a piece, unless it is full; from one thread."""
        if self.is_full:
            return
        try:
            written = os.pwrite(self._file.fileno(), data, self._end)
        except OSError:
            written = 0
        if written < len(data):
            log.warning("the disk is full: frames are decoded anew each time")
            self._most = 0
            return
        self._places[key] = self._end, len(data)
        self._end += len(data)

    def nearest(self, key: int) -> int | None:
        """The key of a piece that is nearest to this one; None where there is none."""
        return min(list(self._places), key=lambda other: abs(other - key), default=None)

    def get(self, key: int) -> bytes | None:
        place = self._places.get(key)
        return None if place is None else os.pread(self._file.fileno(), place[1], place[0])

    def clear(self) -> None:
        self._places.clear()
        self._end = 0

    def close(self) -> None:
        self._file.close()


class _Those(Container[int]):
    """The frames that a function says yes to."""

    def __init__(self, has: Callable[[int], bool]) -> None:
        self._has = has

    def __contains__(self, index: object) -> bool:
        return isinstance(index, int) and self._has(index)


@dataclass
class _Wanted:
    """A frame that is waited for, until when (`time.monotonic`)."""

    future: Future[Image]
    until: float


class Frames(AbstractContextManager["Frames"]):
    """The frames of a video, for as long as it is open. Its methods may be called from any thread."""

    def __init__(self, reader: VideoReader, count: int, model: FramesModel = MODEL) -> None:
        """Args: count: of the video's frames."""
        self._reader, self.count, self._model = reader, count, model
        self._kept = Pile(model)
        self._small: Bounded[bytes] = Bounded(model.memory_bytes)
        self._whole: Bounded[Image] = Bounded(model.whole_bytes)
        self._changed = Condition()
        self._waiting: dict[int, _Wanted] = {}
        self._asked: deque[int] = deque(maxlen=2)  # the latest frames that were asked for
        self._asked_at = 0.0
        self._missing: set[int] = set()  # frames that cannot be decoded
        self._filled = 0  # all before it are kept
        self._at = -1  # the frame that the iteration gives next
        self._heading = -1  # the frame that is decoded towards
        self._entered = -1  # the frame that the iteration began with
        self._iteration: Iterator[Frame] | None = None
        self._is_paused = self._is_closed = False
        self._thread = Thread(target=self._work, name="frames", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Ends decoding; waits for the frame that is under way."""
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()
        self._thread.join()
        self._kept.close()

    def __exit__(self, *error: Any) -> None:
        self.close()

    @property
    def is_filled(self) -> bool:
        """Whether there is no frame left to be kept, or no room."""
        return self._kept.is_full or not any(map(self._lacks, range(self.count)))

    def pause(self, paused: bool) -> None:
        """Whether only what is asked for is decoded, as while there is other work for the processor."""
        with self._changed:
            self._is_paused = paused
            self._changed.notify_all()

    def picture(self, index: int, height: int | None = None) -> bytes:
        """A frame as JPEG, at a height, px, or at its own where that is less.

        Raises:
            Refusal: there is no such frame.
        """
        self._ask(index)
        return self._picture(index, height)

    def _picture(self, index: int, height: int | None) -> bytes:
        height = None if height is None or height >= self._reader.info.height else height
        key = index, height
        if (small := self._small.get(key)) is not None:
            return small
        data = self._kept.get(index)
        kept_height = min(self._reader.info.height, self._model.kept_height_px)
        if data is not None and height in (None, kept_height) and kept_height == self._reader.info.height:
            return data
        if data is not None and height is not None and height <= kept_height:
            picture = smaller(data, height)
        else:
            picture = jpeg(scaled(self.image(index), height))
        self._small.put(key, picture, len(picture))
        return picture

    def near(self, index: int, height: int | None, known: int | None) -> tuple[int, bytes | None]:
        """A frame as of `picture`, if it is had in a moment, or else the nearest that is kept, and which it is.

        Args: known: a frame that is shown already; where there is no nearer one, None takes the picture's place.

        Raises:
            Refusal: there is no such frame.
        """
        self._ask(index)
        if self._is_had(index):
            return index, self._picture(index, height)
        other = self._kept.nearest(index)
        if other is None or (known is not None and abs(other - index) >= abs(known - index)):
            return index if other is None else other, None
        return other, self._picture(other, height)

    def rough(self, index: int, height: int | None) -> tuple[int, bytes]:
        """A frame as of `picture` that costs little, and which it is: the nearest that is kept, or a key frame."""
        self.check(index)
        key, other = self._reader.key_before(index), self._kept.nearest(index)
        if other is None or abs(other - index) > index - key:
            other = key
        return other, self._picture(other, height)

    def image(self, index: int, seconds: float | None = None) -> Image:
        """A frame (H, W, 3), RGB, as it was decoded; not to be written to.

        Args: seconds: to wait for it.

        Raises:
            Refusal: there is no such frame, or not yet.
        """
        if (image := self._whole.get(index)) is not None:
            return image
        now = time.monotonic()
        until = math.inf if seconds is None else now + seconds + self._model.renewal_seconds
        with self._changed:
            self.check(index)
            if self._is_closed:
                raise Refusal(410, "this video was closed: open it again")
            wanted = self._waiting.pop(index, None) or _Wanted(Future(), now)
            wanted.until = max(wanted.until, until)
            self._waiting[index] = wanted  # the latest comes last
            self._changed.notify_all()
        try:
            return wanted.future.result(seconds)
        except TimeoutError:
            raise Refusal(503, f"frame {index} is not decoded yet: ask again") from None

    def view(self, index: int, seconds: float | None = None) -> Image:
        """A frame (H, W, 3), RGB, as it is kept where that is in full size, else as it was decoded; see `image`."""
        self.check(index)
        is_whole = self._reader.info.height <= self._model.kept_height_px
        data = self._kept.get(index) if is_whole and self._whole.get(index) is None else None
        return self.image(index, seconds) if data is None else from_jpeg(data)

    def exact(self, index: int) -> Image:
        """A frame (H, W, 3), RGB, as it was decoded if it is had in a moment, else as it is kept.

        Raises:
            Refusal: there is no such frame, or not yet.
        """
        try:
            return self.image(index, self._model.patience_seconds)
        except Refusal as error:
            if error.status != 503:
                raise
            return self.view(index, 0)

    def _is_had(self, index: int) -> bool:
        """Whether a frame is there, after a moment."""
        if index in self._kept:
            return True
        try:
            self.image(index, self._model.patience_seconds)
        except Refusal as error:
            if error.status != 503:
                raise
        return index in self._kept or self._whole.get(index) is not None

    def check(self, index: int) -> None:
        """Raises Refusal where there is no frame of this index."""
        if not 0 <= index < self.count:
            raise Refusal(404, f"there is no frame {index}: the video has frames 0 to {self.count - 1}")

    def _ask(self, index: int) -> None:
        self.check(index)
        with self._changed:
            if not self._asked or self._asked[-1] != index:
                self._asked.append(index)
            self._asked_at = time.monotonic()
            self._changed.notify_all()

    # ---- the thread that decodes ----

    def _work(self) -> None:
        while True:
            with self._changed:
                goal = None
                while not self._is_closed and (goal := self._goal()) is None:
                    self._changed.wait(self._model.idle_seconds)
                if goal is None:
                    break
            try:
                self._decode_towards(goal)
            except IndexDropped:
                log.info("frames are numbered anew: packets and frames do not agree")
                self._kept.clear()
                self._small.clear()
                self._whole.clear()
                self._filled, self._iteration = 0, None
            except Exception as error:  # whatever it is, whoever waits is told
                self._iteration = None
                self._missing.add(goal)
                self._fail(goal, error)
        self._close_iteration()
        for index in list(self._waiting):
            self._fail(index, Refusal(410, "this video was closed: open it again"))

    def _goal(self) -> int | None:
        """The frame that is wanted most: one that is asked for, one that will be soon, or one that is not kept yet."""
        now = time.monotonic()
        self._waiting = {index: wanted for index, wanted in self._waiting.items() if wanted.until > now}
        if self._waiting:
            return next(reversed(self._waiting))
        if self._kept.is_full or self._is_paused:
            return None
        soon = next((i for i in self._soon() if self._lacks(i)), None)
        if soon is not None or time.monotonic() - self._asked_at < self._model.idle_seconds:
            return soon
        if self._lacks(self._at):
            return self._at
        while self._filled < self.count and not self._lacks(self._filled):
            self._filled += 1
        return self._filled if self._filled < self.count else None

    def _lacks(self, index: int) -> bool:
        return 0 <= index < self.count and index not in self._kept and index not in self._missing

    def _soon(self) -> range:
        """Frames in the direction of scrubbing."""
        if len(self._asked) < 2 or abs(self._asked[1] - self._asked[0]) > self._model.scrub_frames:
            return range(0)
        before, last = self._asked
        if before < last:
            return range(last, min(last + self._model.ahead_frames, self.count))
        size = self._model.block_frames
        begin = last // size * size  # of the block, which is decoded forward
        whole = range(begin, min(begin + size, self.count))
        return range(max(begin - size, 0), begin) if not any(map(self._lacks, whole)) else whole

    def _decode_towards(self, goal: int) -> None:
        """Decodes on the way to a frame, up to it or to the next one of use."""
        self._heading = goal
        if not self._leads_to(goal):
            self._close_iteration()
            self._entered = self._reader.key_before(goal)
            self._iteration = self._reader.frames(self._entered, only=_Those(self._is_of_use))
        assert self._iteration is not None
        frame = next(self._iteration, None)
        if frame is None:
            self._iteration = None
            raise Refusal(404, f"frame {goal} cannot be decoded: the file is damaged")
        self._at = frame.index + 1
        with self._changed:
            is_near = self._is_near(frame.index)
            may_take_time = not self._waiting or frame.index in self._soon() or frame.index == self._entered
            wanted = self._waiting.pop(frame.index, None)
        if is_near or wanted is not None:
            self._whole.put(frame.index, frame.view, frame.view.nbytes)
        if wanted is not None:
            wanted.future.set_result(frame.view)
        if frame.index not in self._kept and (wanted is not None or may_take_time):
            self._kept.put(frame.index, jpeg(scaled(frame.view, self._model.kept_height_px)))

    def _is_of_use(self, index: int) -> bool:
        """Whether a frame that was just decoded is given out: as it is of use, or as another is headed for now."""
        with self._changed:
            if not self._waiting:
                return self._lacks(index)
            has_changed = next(reversed(self._waiting)) != self._heading
            is_first = index == self._entered and self._lacks(index)
            return has_changed or is_first or index in self._waiting or index in self._soon() or self._is_near(index)

    def _is_near(self, index: int) -> bool:
        """Whether it is a little before a frame that is waited for: whoever jumped there may go on backwards."""
        return bool(self._waiting) and 0 <= self._heading - index < self._model.before_frames

    def _leads_to(self, goal: int) -> bool:
        """Whether a frame is best reached from where decoding stands."""
        if self._iteration is None or self._at > goal:
            return False
        return goal - self._at <= self._model.skip_frames or self._reader.key_before(goal) <= self._at

    def _close_iteration(self) -> None:
        close = getattr(self._iteration, "close", None)
        if close is not None:
            with suppress(Exception):
                close()
        self._iteration = None

    def _fail(self, index: int, error: Exception) -> None:
        with self._changed:
            wanted = self._waiting.pop(index, None)
        if wanted is not None:
            wanted.future.set_exception(error)
