"""What is in front of a surface, marked by hand in frames of real clips, against what composites keep of it.

A blue and magenta checkerboard is put onto the surface by the whole pipeline; no clip shows such colours. Of the pixels
that are marked as something in front, those that the composite leaves as they were are counted, and of those that are
marked as the surface, those that are replaced.

A file of marks is JSON: [{"clip": "card.mp4", "quad": [[x, y] x 4], "frames": [{"frame": 50, "front": [[[x, y], ...]],
"surface": [[[x, y], ...]]}]}], polygons in px of the frame; "quad" is the surface in the first one.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import cv2
import msgspec
import numpy as np

from hdn.imaging.arrays import Array, Image, Mask
from hdn.imaging.quads import is_convex

from ..errors import InputError
from ..media.pictures import write_picture
from ..media.reader import VideoReader
from ..options import TrackingOptions
from ..pipeline import replace
from ..surface import Moment, Surface
from ..tracks import Track
from .quality import regions
from .scenes import LOSSLESS

Polygon = list[tuple[float, float]]


@dataclass(frozen=True)
class MarksModel:
    """How pixels are counted."""

    kept_grey: int = 20  # by which no channel of a pixel that is kept differs from the frame
    squares: int = 8  # of the checkerboard, along a side
    square_px: int = 32
    colours: tuple[tuple[int, int, int], ...] = ((0, 0, 255), (255, 0, 255))


MODEL = MarksModel()


class MarkedFrame(msgspec.Struct, forbid_unknown_fields=True):
    """Polygons in one frame, px: what is in front of the surface, and what is the surface."""

    frame: int
    front: list[Polygon]
    surface: list[Polygon]


class MarkedClip(msgspec.Struct, forbid_unknown_fields=True):
    """The marks of one clip; the quad is the surface in the first frame, px."""

    clip: str
    quad: Polygon
    frames: list[MarkedFrame]


class Count(NamedTuple):
    """Pixels of one marked frame.

    Attributes:
        front, kept: that are marked as in front, within the surface's quad, and those of them that are as they were.
        surface, replaced: that are marked as the surface, and those of them that are not.
    """

    frame: int
    front: int
    kept: int
    surface: int
    replaced: int


def read_marks(path: Path) -> list[MarkedClip]:
    """Marks from a file.

    Raises:
        InputError: it cannot be read or is not as described.
    """
    try:
        marks = msgspec.json.decode(path.read_bytes(), type=list[MarkedClip])
    except OSError as error:
        raise InputError(f"{path} cannot be read: name a file of marks") from error
    except msgspec.DecodeError as error:
        raise InputError(f"{path} has no marks: {error}") from error
    if not marks:
        raise InputError(f"{path} has no marks: its list is empty")
    return marks


def count(marked: MarkedClip, folder: Path, weights: Path | None, sheet: Path | None = None) -> list[Count]:
    """Puts the checkerboard onto a clip's surface and counts; nothing for frames in which the surface is lost.

    Args:
        folder: where the clip lies.
        sheet: a file for a picture of all marked frames; None for none.

    Raises:
        InputError, RunError: see `replace`.
    """
    frames = sorted(marked.frames, key=lambda frame: frame.frame)
    with TemporaryDirectory() as name:
        board, composite, saved = (Path(name) / file for file in ("board.png", "composite.mkv", "track.json"))
        write_picture(board, checkerboard())
        clip, surface = folder / marked.clip, Surface(board, np.array(marked.quad, np.float64))
        tracking = TrackingOptions(end=Moment(frame=frames[-1].frame), weights=weights)
        replace(clip, surface, composite, tracking, LOSSLESS, save_track=saved)
        track, counts, pictures = Track.load(saved), [], []
        for marks, (source, drawn) in zip(frames, _pictures(clip, composite, frames), strict=True):
            corners = track.corners[marks.frame]
            if np.isfinite(corners).all() and is_convex(corners):
                counts.append(_count(marks, corners, source, drawn))
                pictures.append(_outlined(marks, drawn))
    if sheet is not None and pictures:
        write_picture(sheet, np.hstack(pictures))
    return counts


def checkerboard() -> Image:
    """The picture (h, w, 3) that is put onto surfaces."""
    rows, columns = np.mgrid[: MODEL.squares, : MODEL.squares]
    board = np.array(MODEL.colours, np.uint8)[(rows + columns) % 2]
    return board.repeat(MODEL.square_px, 0).repeat(MODEL.square_px, 1)


def _pictures(clip: Path, composite: Path, frames: list[MarkedFrame]) -> Iterator[tuple[Image, Image]]:
    """The marked frames of a clip and of the composite, in pairs."""
    with VideoReader(clip) as left, VideoReader(composite) as right:
        for marks in frames:
            a, b = (next(reader.frames(marks.frame, marks.frame + 1)).image for reader in (left, right))
            yield np.asarray(a, np.uint8), np.asarray(b, np.uint8)


def _count(marks: MarkedFrame, corners: Array, source: Image, drawn: Image) -> Count:
    inside, _ = regions(corners, source.shape)
    kept = cv2.absdiff(source, drawn).max(2) <= MODEL.kept_grey
    front, surface = (inside & _mask(polygons, source.shape) for polygons in (marks.front, marks.surface))
    pixels = (mask.sum() for mask in (front, front & kept, surface, surface & ~kept))
    return Count(marks.frame, *(int(n) for n in pixels))


def _mask(polygons: list[Polygon], shape: tuple[int, ...]) -> Mask:
    mask = np.zeros(shape[:2], np.uint8)
    for polygon in polygons:
        cv2.fillPoly(mask, [np.round(polygon).astype(np.int32)], 1)
    return mask == 1


def _outlined(marks: MarkedFrame, drawn: Image) -> Image:
    """A composite with the marks' outlines: what is in front in red, the surface in yellow."""
    picture = drawn.copy()
    for polygons, colour in ((marks.front, (255, 0, 0)), (marks.surface, (255, 255, 0))):
        cv2.polylines(picture, [np.round(polygon).astype(np.int32) for polygon in polygons], True, colour, 1)
    return picture
