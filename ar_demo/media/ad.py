"""The ad: a still, an animated image or a video, looked up by time."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from fractions import Fraction
from functools import partial
from pathlib import Path

import av
import numpy as np
from PIL import Image, ImageOps, UnidentifiedImageError

from hdn.imaging.arrays import Picture

from ..choices import CHOICES, Playback
from ..errors import InputError
from . import color
from .decode import Clock, decode, frame_rate, has_alpha, open_video, picture_duration
from .limits import BeyondLimits, check_count, check_size

log = logging.getLogger(__name__)

# A frame's start in seconds from the ad's beginning, and how to get its picture: frames skipped are never converted.
TimedPicture = tuple[Fraction, Callable[[], Picture]]

_IMAGE_FORMATS = ("PNG", "JPEG", "MPO", "WEBP", "GIF", "BMP", "TIFF", "PPM", "AVIF")
_DEFAULT_FRAME_SECONDS = Fraction(1, 10)  # an animated image's frame of no stated duration, as browsers show it


class Ad(AbstractContextManager["Ad"]):
    """An opened ad. A context manager that closes the file.

    Attributes:
        path: the file.
        width, height: px.
        duration: seconds, None for a still.
        playback: what comes after the end: "loop" begins again, "hold" keeps the last frame, "once" shows nothing.
    """

    def __init__(
        self,
        path: Path,
        playback: Playback,
        duration: Fraction | None,
        start: Callable[[], Iterator[TimedPicture]],
    ) -> None:
        """Shows the first frame.

        Args:
            path: the file.
            playback: what comes after the end.
            duration: seconds; None for a still.
            start: begins the ad: an iterator over its frames, which is closed where it can be.

        Raises:
            InputError: there is no frame.
        """
        self.path = path
        self.playback = playback
        self.duration = duration
        self._start = start
        self._frames: Iterator[TimedPicture] = iter(())
        self._next: TimedPicture | None = None
        self._shown: Picture | None = None  # the current frame's picture, once it has been asked for
        self._time, self._convert = self._restart()
        self.height, self.width = self._picture().shape[:2]

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the file; calling again does nothing."""
        self._stop()

    def at(self, time: Fraction) -> Picture | None:
        """The picture shown at a time; times that do not decrease are fast, an earlier one starts the ad afresh.

        Args:
            time: seconds since the ad began.

        Returns:
            uint8 (h, w, 3) RGB or (h, w, 4) RGBA with straight alpha, not to be written to; the identical array where
            the same frame is asked for again. None after the end of an ad played "once".
        """
        time = max(time, Fraction(0))
        if self.duration is not None and time >= self.duration:
            if self.playback == "once":
                return None
            if self.playback == "loop":
                time %= self.duration
        if time < self._time:
            self._time, self._convert = self._restart()
        while self._next is not None and self._next[0] <= time:
            self._time, self._convert = self._next
            self._shown = None
            self._next = next(self._frames, None)
        return self._picture()

    def _picture(self) -> Picture:
        picture = self._shown
        if picture is None:
            picture = self._shown = self._convert()
        return picture

    def _restart(self) -> TimedPicture:
        self._stop()
        self._frames = self._start()
        first = next(self._frames, None)
        if first is None:
            raise InputError(f"{self.path} has no frame that can be decoded: the ad is damaged or empty")
        self._shown = None
        self._next = next(self._frames, None)
        return first

    def _stop(self) -> None:
        close = getattr(self._frames, "close", None)
        if close:
            close()


def open_ad(path: Path | str, playback: Playback = "loop") -> Ad:
    """Opens an image, an animated image or a video as an ad.

    Raises:
        InputError: the file is missing or none of these, or there is no such playback.
    """
    path = Path(path)
    if playback not in CHOICES["playback"]:
        raise InputError(f'ad playback "{playback}" is unknown: use {", ".join(CHOICES["playback"])}')
    if not path.is_file():
        raise InputError(f"{path} does not exist or is not a file: check the ad's file name")
    Image.init()
    try:
        image = Image.open(path, formats=[name for name in _IMAGE_FORMATS if name in Image.OPEN])
    except UnidentifiedImageError:
        return _open_video_ad(path, playback)
    except (OSError, Image.DecompressionBombError) as error:
        raise InputError(f"{path} cannot be read as an ad: {error}") from error
    with image:
        return _open_image_ad(path, playback, image)


# ---- images ----


def _open_image_ad(path: Path, playback: Playback, image: Image.Image) -> Ad:
    try:
        check_size(path, image.width, image.height)
        check_count(path, getattr(image, "n_frames", 1))
        if getattr(image, "n_frames", 1) == 1 or image.format in ("MPO", "TIFF"):  # whose frames are pages, not time
            picture = _pixels(image)
            return Ad(path, playback, None, lambda: iter([(Fraction(0), lambda: picture)]))
        duration = sum((_step(image, index) for index in range(image.n_frames)), Fraction(0))  # type: ignore[attr-defined]
    except BeyondLimits:
        raise
    except (OSError, SyntaxError, ValueError, EOFError, Image.DecompressionBombError) as error:
        raise InputError(f"{path} is a damaged image: save it anew as PNG, JPEG, GIF or WebP") from error
    return Ad(path, playback, duration, partial(_animation, path))


def _animation(path: Path) -> Iterator[TimedPicture]:
    time = Fraction(0)
    with Image.open(path) as image:
        for index in range(image.n_frames):  # type: ignore[attr-defined]
            step = _step(image, index)
            picture = _pixels(image)
            yield time, partial(_same, picture)
            time += step


def _same(picture: Picture) -> Picture:
    return picture


def _step(image: Image.Image, index: int) -> Fraction:
    """Goes to a frame of an animated image; returns for how many seconds it is shown."""
    image.seek(index)
    image.load()  # WebP knows the duration only then
    milliseconds = image.info.get("duration") or 0
    return Fraction(milliseconds) / 1000 if milliseconds > 0 else _DEFAULT_FRAME_SECONDS


def _pixels(image: Image.Image) -> Picture:
    """The current frame as RGB, or RGBA where it has transparency; upright by its EXIF orientation; 8 bit."""
    image = ImageOps.exif_transpose(image)
    if image.mode.startswith("I"):  # 16-bit grey, which convert() would clip to white
        grey = (np.clip(np.asarray(image, dtype=np.int64), 0, 65535) >> 8).astype(np.uint8)
        return np.ascontiguousarray(np.repeat(grey[..., None], 3, axis=2))
    mode = "RGBA" if image.has_transparency_data else "RGB"
    return np.asarray(image.convert(mode))


# ---- videos ----


def _open_video_ad(path: Path, playback: Playback) -> Ad:
    try:
        container, stream = open_video(path)
        with container:
            alpha = has_alpha(stream)
        duration = picture_duration(path)
    except BeyondLimits:
        raise
    except InputError as error:
        raise InputError(
            f"{path} is no ad that can be shown: give an image (PNG, JPEG, WebP, BMP, TIFF), an animated GIF, WebP or "
            f"PNG, or a video (MP4, MOV, MKV, WebM)"
        ) from error
    return Ad(path, playback, duration, partial(_video, path, alpha))


def _video(path: Path, alpha: bool) -> Iterator[TimedPicture]:
    container, stream = open_video(path)
    with container:
        rate = frame_rate(stream)
        clock = Clock(rate, stream.time_base or 1 / rate)
        counter = itertools.count()

        def damaged(since: int | None) -> None:
            if next(counter) == 0:
                log.warning("%s is damaged: what can be decoded is shown", path.name)

        begin: Fraction | None = None
        rotation = 0
        size = (0, 0)
        for frame in decode(container, stream, damaged, alpha=alpha):
            time = clock.time(frame)
            if begin is None:
                begin, rotation, size = time, color.rotation_of(frame), (frame.width, frame.height)
                to_rgb = color.ToRGB("rgba" if alpha else "rgb24", color.hdr_of(frame))
            yield time - begin, partial(_convert, to_rgb, frame, rotation, size)


def _convert(to_rgb: color.ToRGB, frame: av.VideoFrame, rotation: int, size: tuple[int, int]) -> Picture:
    return to_rgb(frame, rotation, size)
