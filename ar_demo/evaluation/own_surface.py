"""A surface's own picture, put back onto it as if it were the ad: what comes out should be the video itself.

No truth is needed, so that this measures any footage: light, blur, grain and what is in front all have to be right for
the composite to equal the frame that it was made from.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import cv2
import numpy as np

from hdn.benchmark.sequences import Sequence
from hdn.imaging.arrays import Array, Floats, Image
from hdn.imaging.homography import from_corners
from hdn.imaging.pyramid import Pyramid
from hdn.imaging.quads import is_convex, mean_size, outline

from ..errors import InputError, RunError
from ..media.pictures import write_picture
from ..media.reader import VideoReader
from ..options import TrackingOptions
from ..pipeline import replace
from ..surface import Moment, Surface
from ..tracks import Track
from .quality import gradient_deviation, quality
from .scenes import LOSSLESS

NAMES = ("PSNR inside", "SSIM inside", "PSNR edge", "SSIM edge", "gradient deviation", "temporal noise")


@dataclass(frozen=True)
class OwnSurfaceModel:
    """How a surface's own picture is taken, and the views in which changes over time are compared."""

    oversampling: float = 2.0  # pixels of the picture to a pixel of the frame that it is taken from
    view_px: int = 96  # side of the rectified views
    usual_share: float = 0.8  # of the pixels, those that change least: what moves is no noise


MODEL = OwnSurfaceModel()


class OwnSurface(NamedTuple):
    """What came out for one clip.

    Attributes:
        frames: (N, 5) of the first five of NAMES, NaN where the surface is lost or out of view.
        noise: how strongly the composite changes from frame to frame, as a share of how the video does: 1 is right,
            less is too clean, more flickers.
    """

    name: str
    frames: Array
    noise: float

    @property
    def mean(self) -> Array:
        """(6,) of NAMES, over the frames."""
        return np.array([*np.nanmean(self.frames, 0), self.noise])


def evaluate_own(clip: Sequence, weights: Path | None, out: Path | None = None) -> OwnSurface:
    """Replaces a clip's surface by its own picture in the first frame, and compares with the clip.

    Args:
        out: a file for the picture of the worst frame, source and composite side by side; None for none.

    Raises:
        InputError, RunError: see `replace`; the clip is no video file.
    """
    if not isinstance(clip.source, Path):
        raise InputError(f"{clip.name} is not a video file: give clips as NAME.mp4 with NAME.json")
    with TemporaryDirectory() as name:
        folder = Path(name)
        picture, composite, saved = folder / "own.png", folder / "composite.mkv", folder / "track.json"
        with VideoReader(clip.source) as reader:
            first = next(reader.frames(0, 1)).image
            last = Moment(frame=min(len(clip.truth), len(reader.times)) - 1)
        write_picture(picture, taken(np.asarray(first, np.uint8), clip.quad))
        tracking = TrackingOptions(end=last, weights=weights)
        # The picture has its frame's light and softness already.
        surface = Surface(picture, clip.quad, softness="off", first_light="even")
        replace(clip.source, surface, composite, tracking, LOSSLESS, save_track=saved)
        track = Track.load(saved)
        frames, views = np.full((len(track), 5), np.nan), []
        worst: tuple[float, Image] | None = None
        for index, (source, drawn) in enumerate(_pictures(clip.source, composite, len(track))):
            corners = track.corners[index]
            seen = np.isfinite(corners).all() and is_convex(corners)
            figures = quality(drawn, source, corners) if seen else None
            views.append((_view(source, corners), _view(drawn, corners)) if figures is not None else None)
            if figures is None:
                continue
            frames[index] = [*figures, gradient_deviation(drawn, source, corners)]
            if worst is None or figures[0] < worst[0]:
                worst = float(figures[0]), _side_by_side(source, drawn, corners)
        if out is not None and worst is not None:
            write_picture(out, worst[1])
    if not np.isfinite(frames).any():
        raise RunError(f"{clip.name}: the surface is lost in every frame: there is nothing to compare")
    return OwnSurface(clip.name, frames, _noise(views))


def taken(frame: Image, quad: Array) -> Image:
    """A surface's picture (h, w, 3), rectified out of a frame by its quad (4, 2)."""
    width, height = (max(2, round(2 * MODEL.oversampling * side) // 2) for side in mean_size(quad))
    to_frame = from_corners(outline(width, height), quad)
    how = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    picture = cv2.warpPerspective(frame, to_frame, (width, height), flags=how, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(picture, np.uint8)


def _pictures(source: Path, composite: Path, count: int) -> Iterator[tuple[Image, Image]]:
    """The clip's frames and the composites', in pairs."""
    with VideoReader(source) as left, VideoReader(composite) as right:
        for a, b in zip(left.frames(0, count), right.frames(0, count), strict=True):
            yield np.asarray(a.image, np.uint8), np.asarray(b.image, np.uint8)


def _view(frame: Image, corners: Array) -> Floats:
    side = MODEL.view_px
    crop = Pyramid(frame).crop(from_corners(outline(side, side), corners), side, side)
    return np.asarray(cv2.cvtColor(crop, cv2.COLOR_RGB2GRAY), np.float32)


def _noise(views: list[tuple[Floats, Floats] | None]) -> float:
    """The usual change against the mean of the frames before and after, the composite's over the clip's."""
    changes: list[list[float]] = [[], []]
    for before, now, after in ((a, b, c) for (a, b), (_, c) in pairwise(pairwise(views))):
        if before is None or now is None or after is None:
            continue
        for kind in range(2):
            change = np.abs(now[kind] - (before[kind] + after[kind]) / 2)
            changes[kind].append(float(change[change <= np.quantile(change, MODEL.usual_share)].mean()))
    source, composite = (float(np.mean(c)) if c else np.nan for c in changes)
    return composite / source if source > 0 else np.nan


def _side_by_side(source: Image, drawn: Image, corners: Array) -> Image:
    low, high = corners.min(0), corners.max(0)
    margin = 0.1 * (high - low).max()
    size = np.array(source.shape[1::-1])
    x0, y0 = np.clip(np.floor(low - margin), 0, size - 2).astype(int)
    x1, y1 = np.clip(np.ceil(high + margin), [x0 + 2, y0 + 2], size).astype(int)
    return np.hstack([source[y0:y1, x0:x1], drawn[y0:y1, x0:x1]])
