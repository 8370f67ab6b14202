"""Mattes made elsewhere: how much of each pixel of a video an insert may take, frame by frame."""

from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from hdn.imaging.arrays import Grey

from ..errors import InputError
from ..words import counted
from .reader import Frame, VideoInfo, VideoReader

ASPECT_TOLERANCE = 0.01  # share by which width over height may differ: sizes are rounded


class GivenMatte(AbstractContextManager["GivenMatte"]):
    """A matte as `--save-matte` writes it: white where the insert is seen, black where the video is.

    A video, an image sequence, or one picture for all frames. Its green channel counts.
    """

    def __init__(self, path: Path | str, video: VideoInfo, frames: range) -> None:
        """Opens a matte for a video.

        Args:
            frames: the least and the most, not included, that it may have, if it is not a single picture.

        Raises:
            InputError: it cannot be read, has another shape, or is shorter or longer.
        """
        self._reader = VideoReader(path)
        self._size = video.width, video.height
        info = self._reader.info
        ratio = info.width * video.height / (info.height * video.width)
        if abs(ratio - 1) > ASPECT_TOLERANCE:
            self.close()
            raise InputError(
                f"matte {path} is {info.width}x{info.height} and the video {video.width}x{video.height}: "
                "give one of the same shape"
            )
        count = len(self._reader.times)
        if count not in frames and count != 1:
            self.close()
            least, most = frames.start, frames.stop - 1
            asked = counted(least, "frame") if least == most else f"{least} to {most} frames"
            raise InputError(f"matte {path} has {counted(count, 'frame')}: give one of {asked}, or a single picture")
        self._is_still = count == 1
        self._frames: Iterator[Frame] = iter(())
        self._last: tuple[int, Grey] | None = None

    def at(self, index: int) -> Grey:
        """The matte (H, W) 0..1 of a frame of this index; frames one after the other are fast. White after its end."""
        index = 0 if self._is_still else index
        if self._last is not None and self._last[0] == index:
            return self._last[1]
        if self._last is None or index != self._last[0] + 1:
            self._frames = self._reader.frames(index)
        frame = next(self._frames, None)
        if frame is None:
            return np.ones(self._size[::-1], np.float32)
        grey = frame.image[..., 1] * np.float32(1 / 255)
        if grey.shape[::-1] != self._size:
            how = cv2.INTER_AREA if grey.shape[1] > self._size[0] else cv2.INTER_LINEAR
            grey = np.asarray(cv2.resize(grey, self._size, interpolation=how), np.float32)
        self._last = index, grey
        return grey

    @property
    def warnings(self) -> list[str]:
        """What is wrong with the file, one sentence each."""
        return self._reader.warnings

    def close(self) -> None:
        """Closes the file."""
        self._reader.close()

    def __exit__(self, *error: Any) -> None:
        self.close()
