"""The pictures that are looked for, with their keypoints as seen from far, from near and from aside."""

from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np

from hdn.imaging.arrays import Floats, Image, Mask
from hdn.imaging.observation import Keypoints, find_keypoints
from hdn.imaging.pyramid import Pyramid
from hdn.imaging.quads import outline

from ..errors import InputError
from ..media.ad import open_ad
from ..media.sequences import SUFFIXES


@dataclass(frozen=True)
class PictureModel:
    """How a picture is described."""

    longest_px: int = 640  # of its sides: larger ones are reduced, since surfaces are seldom shown larger
    min_side_px: int = 16  # of its shorter side, reduced; with less there is nothing to tell it by
    # Views of it whose keypoints are taken: their longer side, px; the share that width and height are squeezed to, as
    # when it is seen from aside (Morel and Yu, 2009); and how many keypoints, of the strongest.
    views: tuple[tuple[int, float, float, int], ...] = (
        (480, 1.0, 1.0, 600),
        (240, 1.0, 1.0, 300),
        (120, 1.0, 1.0, 150),
        (480, 0.45, 1.0, 300),
        (480, 1.0, 0.45, 300),
    )
    min_keypoints: int = 12  # in all
    same_place: float = 0.05  # of its longer side: keypoints nearer to each other show the same thing
    opaque: int = 128  # alpha from which a pixel belongs to the picture
    backdrop: int = 128  # grey level behind what is transparent


MODEL = PictureModel()


class Picture:
    """A picture that is looked for.

    Attributes:
        path: its file.
        image: (h, w, 3) RGB, at most 640 px long.
        quad: (4, 2) the corners of the whole picture, px of `image`.
        opaque: (h, w) 255 where it is not transparent; None for all of it.
        points: (N, 2) px of `image`, keypoints at all sizes.
        descriptors: (N, 128), of length 1.
    """

    def __init__(self, path: Path, picture: Image) -> None:
        """Args: picture: (h, w, 3) RGB or (h, w, 4) RGBA.

        Raises:
            InputError: it is too narrow, or shows too little to be told by.
        """
        self.path = path
        height, width = picture.shape[:2]
        self.image, self.opaque = _reduced(picture, MODEL.longest_px)
        height, width = self.image.shape[:2]
        if min(width, height) < MODEL.min_side_px:
            raise InputError(f"{path} is too narrow to be looked for: give a picture of {MODEL.min_side_px} px or more")
        self.quad = outline(width, height)
        found = [self._keypoints(*view) for view in MODEL.views]
        self.points = np.concatenate([points for points, _ in found])
        self.descriptors = unit_descriptors(np.concatenate([descriptors for _, descriptors in found]))
        if len(self.points) < MODEL.min_keypoints:
            raise InputError(f"{path} shows too little to be looked for: give its corners by --quad instead")

    @property
    def name(self) -> str:
        return self.path.name

    @cached_property
    def same_place(self) -> Mask:
        """(N, N) which keypoints show the same thing, at several sizes or beside each other."""
        apart = np.square(self.points[:, None] - self.points).sum(-1)
        return np.asarray(apart < np.square(MODEL.same_place * max(self.image.shape[:2])))

    def _keypoints(self, longest: int, across: float, down: float, most: int) -> Keypoints:
        """Keypoints of a view, see `PictureModel.views`."""
        height, width = self.image.shape[:2]
        ratio = min(1.0, longest / max(width, height))
        size = max(1, round(width * ratio * across)), max(1, round(height * ratio * down))
        grey = cv2.cvtColor(cv2.resize(self.image, size, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY)
        points, descriptors = find_keypoints(Pyramid(np.asarray(grey, np.uint8)), most)
        points = (points + 0.5) * [width / size[0], height / size[1]] - 0.5
        if self.opaque is not None:
            x, y = np.clip(np.round(points), 0, [width - 1, height - 1]).astype(int).T
            points, descriptors = points[self.opaque[y, x] > 0], descriptors[self.opaque[y, x] > 0]
        return points, descriptors


def read_pictures(paths: Iterable[Path | str]) -> list[Picture]:
    """The pictures of files, and of folders of them, in their order.

    Raises:
        InputError: a file is no picture, or shows too little; a folder without any.
    """
    files: list[Path] = []
    for path in map(Path, paths):
        found = sorted(file for file in path.iterdir() if file.suffix.lower() in SUFFIXES) if path.is_dir() else [path]
        if not found:
            raise InputError(f"{path} has no pictures: give a folder with some, or a picture")
        files += found
    return [_read(file) for file in dict.fromkeys(files)]


def _read(path: Path) -> Picture:
    if not path.is_file():
        raise InputError(f"{path} does not exist or is not a file: check the picture's file name")
    try:
        with open_ad(path) as opened:
            picture = opened.at(Fraction(0))
            assert picture is not None  # only after the end of one that is played once
    except InputError as error:
        raise InputError(f"{path} is no picture that can be looked for: give PNG, JPEG, WebP, BMP or TIFF") from error
    return Picture(path, picture)


def _reduced(picture: Image, longest: int) -> tuple[Image, Image | None]:
    """RGB of at most so many px, on grey where it is transparent; and where it is opaque, None for everywhere."""
    height, width = picture.shape[:2]
    ratio = min(1.0, longest / max(width, height))
    size = max(1, round(width * ratio)), max(1, round(height * ratio))
    opaque = None
    if picture.shape[2] == 4:
        alpha = picture[..., 3:].astype(np.float32) / 255
        mixed = picture[..., :3] * alpha + MODEL.backdrop * (1 - alpha)
        if picture[..., 3].min() < MODEL.opaque:
            small = cv2.resize(picture[..., 3], size, interpolation=cv2.INTER_AREA)
            opaque = np.where(small < MODEL.opaque, 0, 255).astype(np.uint8)
        picture = np.round(mixed).astype(np.uint8)
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8), opaque


def unit_descriptors(descriptors: Floats) -> Floats:
    """SIFT descriptors (N, 128) as RootSIFT (Arandjelovic and Zisserman, 2012): their products tell their likeness."""
    total = np.maximum(descriptors.sum(1, keepdims=True), 1e-9)
    return np.asarray(np.sqrt(descriptors / total), np.float32)
