"""A picture's own samples on their way from decoder to encoder: only where something is drawn do they change."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple, cast

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from hdn.imaging.arrays import Box, Mask, Picture

from .color import TURNS, Colour

Samples = NDArray[Any]  # (h, w) of one plane, uint8 or uint16

MARGIN_CELLS = 4  # chroma samples around a box that are converted with it, since filters reach over its edge

_PLANAR = re.compile(r"yuvj?4\d\dp(\d+le)?|gbrp(\d+le)?|gray(\d+le)?")  # one sample format, a plane for each component


class Drawn(NamedTuple):
    """What was drawn into a picture.

    Attributes:
        box: rows and columns of the picture.
        changed: (h, w) which pixels of the box are others than before.
    """

    box: Box
    changed: Mask

    @staticmethod
    def of(before: Picture, after: Picture, box: Box) -> Drawn:
        """In a box of a picture (H, W, 3)."""
        if before[box].size == 0:
            return Drawn(box, np.zeros(before[box].shape[:2], bool))
        difference = cv2.absdiff(before[box], after[box])
        return Drawn(box, cv2.inRange(difference, (0, 0, 0), (0, 0, 0)) == 0)


class Planes:
    """A decoded picture, upright.

    Attributes:
        pix_fmt: its pixel format, by FFmpeg's name; the old yuvj formats count as what they are, yuv in full range.
        colour: how its samples are to be understood.
    """

    def __init__(self, frame: av.VideoFrame, rotation: int = 0) -> None:
        """Args:
        frame: as decoded, of a format that `can_be_kept`.
        rotation: counterclockwise degrees (0, 90, 180 or 270) to turn it by.
        """
        self.pix_fmt, self.colour = plain(frame.format.name), Colour.of(frame)
        self._frame, self._rotation = frame, rotation

    def with_drawn(
        self, image: Picture, drawn: Iterable[Drawn], from_rgb: Callable[[Picture], av.VideoFrame]
    ) -> av.VideoFrame:
        """The picture with what was drawn on it; may be called once, since the samples are changed in place.

        Args:
            image: (H, W, 3) RGB, uint8 or uint16 in full scale.
            drawn: where it was drawn into; chroma samples that a changed pixel has a part in are changed too.
            from_rgb: converts to `pix_fmt` and `colour`.
        """
        frame = self.own()
        unit = cell(self.pix_fmt)
        for box, changed in drawn:
            outer = grown(box, MARGIN_CELLS, unit, image.shape)
            part = from_rgb(image[outer])
            for index in range(len(frame.planes)):
                width, height = unit if index and self.pix_fmt.startswith("yuv") else (1, 1)
                rows, columns = (
                    slice(s.start // n, -(-s.stop // n)) for s, n in zip(box, (height, width), strict=True)
                )
                top, left = outer[0].start // height, outer[1].start // width
                new = samples(part, index)[
                    rows.start - top : rows.stop - top, columns.start - left : columns.stop - left
                ]
                np.copyto(samples(frame, index)[rows, columns], new, where=_in_cells(changed, box, width, height))
        return frame

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, upright, px."""
        width, height = self._frame.width, self._frame.height
        return (height, width) if self._rotation in (90, 270) else (width, height)

    def own(self) -> av.VideoFrame:
        """The picture, upright, in memory that nobody else has; once, see `with_drawn`."""
        if not self._rotation and self.pix_fmt == self._frame.format.name:
            self._frame.make_writable()
            self._frame.pict_type = 0  # else the encoder takes over the source's key frames
            return self._frame
        own = av.VideoFrame(*self.size, self.pix_fmt)
        self.colour.tag(own)
        for index in range(len(own.planes)):
            plane = samples(self._frame, index)
            samples(own, index)[:] = cv2.rotate(plane, TURNS[self._rotation]) if self._rotation else plane
        return own


def can_be_kept(frame: av.VideoFrame, rotation: int = 0) -> bool:
    """Whether a decoded picture's samples can go to an encoder, turned upright without being interpolated."""
    if not _PLANAR.fullmatch(frame.format.name) or any(plane.line_size <= 0 for plane in frame.planes):
        return False
    width, height = cell(frame.format.name)
    whole = frame.width % width == 0 and frame.height % height == 0
    return rotation == 0 or (whole and (rotation == 180 or width == height))


def plain(pix_fmt: str) -> str:
    """A pixel format's name, without the j that stands for full range."""
    return pix_fmt.replace("yuvj", "yuv")


def cell(pix_fmt: str) -> tuple[int, int]:
    """Pixels (columns, rows) that share a chroma sample."""
    chroma = [c for c in av.VideoFormat(pix_fmt, 64, 64).components if not c.is_luma and not c.is_alpha]
    return (64 // chroma[0].width, 64 // chroma[0].height) if chroma else (1, 1)


def grown(box: Box, by: int, unit: tuple[int, int], shape: Sequence[int]) -> Box:
    """A box grown outward to whole units (columns, rows), and by so many of these, inside a picture (H, W, ...)."""
    rows, columns = box
    (width, height), (last_row, last_column) = unit, shape[:2]
    return (
        slice(max(rows.start // height - by, 0) * height, min((-(-rows.stop // height) + by) * height, last_row)),
        slice(max(columns.start // width - by, 0) * width, min((-(-columns.stop // width) + by) * width, last_column)),
    )


def _in_cells(changed: Mask, box: Box, width: int, height: int) -> Mask:
    """Which cells, of so many columns and rows of the picture, have a changed pixel of a box in them."""
    if width == height == 1:
        return changed
    (top, bottom), (left, right) = (
        (s.start % n, -(-s.stop // n) * n - s.start // n * n) for s, n in zip(box, (height, width), strict=True)
    )
    whole = np.zeros((bottom, right), bool)
    whole[top : top + changed.shape[0], left : left + changed.shape[1]] = changed
    parts = [whole[y::height, x::width] for y in range(height) for x in range(width)]
    return np.asarray(np.logical_or.reduce(parts))


def samples(frame: av.VideoFrame, index: int) -> Samples:
    """A plane's samples, not copied."""
    plane = frame.planes[index]
    kind = np.dtype(np.uint8 if frame.format.components[0].bits <= 8 else "<u2")
    rows = np.frombuffer(cast(Any, plane), kind).reshape(-1, plane.line_size // kind.itemsize)
    return rows[: plane.height, : plane.width]
