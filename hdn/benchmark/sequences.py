"""One sequence of a benchmark: its frames, and where its target is known to be."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from ..errors import InputError
from ..imaging.arrays import Array, Image
from .degradation import DEGRADATIONS, SETTINGS, degrade

IMAGES = {".jpg", ".jpeg", ".png", ".bmp", ".ppm", ".pgm", ".webp", ".tif", ".tiff"}
VIDEOS = (".avi", ".mp4", ".mov", ".mkv", ".webm", ".m4v")


@dataclass(frozen=True)
class Sequence:
    """Frames with the target's true corners.

    Attributes:
        dataset, name: together unique.
        source: a video, or the images of its frames in order.
        quad: (4, 2) the target in the first frame, px, in reading order as far as the data set keeps one.
        truth: (N, 4, 2) px, one row a frame, NaN where the corners are not known or not to be counted.
        attributes: the challenges it poses, for scores by attribute.
        step: every how many-th frame of the source is a frame of the sequence.
        degradation: what is done to its frames, one of DEGRADATIONS, or "" for nothing.
    """

    dataset: str
    name: str
    source: Path | tuple[Path, ...]
    quad: Array
    truth: Array
    attributes: tuple[str, ...] = ()
    step: int = 1
    degradation: str = ""

    def frames(self) -> Iterator[Image]:
        """RGB frames (H, W, 3), as many as the truth has rows, or fewer where the source ends before.

        Raises:
            InputError: the video or an image cannot be read.
        """
        corners = self._everywhere()
        for index, frame in enumerate(islice(self._read(), 0, self.step * len(self.truth), self.step)):
            yield degrade(frame, self.degradation, index, corners) if self.degradation else frame

    def _everywhere(self) -> Array:
        """The corners (N, 4, 2) of all frames: where they are not known, between those known before and after."""
        rows = self.truth.reshape(-1, 8).copy()
        rows[0] = self.quad.ravel()
        known = np.flatnonzero(np.isfinite(rows).all(1))
        columns = [np.interp(np.arange(len(rows)), known, column) for column in rows[known].T]
        return np.stack(columns, 1).reshape(-1, 4, 2)

    def limited(self, frames: int | None) -> "Sequence":
        """Only its first frames; None keeps them all."""
        return self if frames is None else replace(self, truth=self.truth[:frames])

    def degraded(self, kind: str) -> "Sequence":
        """The sequence made harder in one of the ways of DEGRADATIONS; its data set's name then says so.

        Raises:
            InputError: no such degradation.
        """
        if kind not in DEGRADATIONS:
            raise InputError(f"there is no degradation '{kind}': choose from {', '.join(DEGRADATIONS)}")
        dataset = f"{self.dataset}+{kind}"
        if kind == "skip":
            step = SETTINGS.skip_frames
            return replace(self, dataset=dataset, truth=self.truth[::step], step=step)
        return replace(self, dataset=dataset, degradation=kind)

    def _read(self) -> Iterator[Image]:
        if isinstance(self.source, tuple):
            for path in self.source:
                image = cv2.imread(str(path), cv2.IMREAD_COLOR)
                if image is None:
                    raise InputError(f"{path} cannot be read as an image: copy it again from its data set")
                yield np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)
            return
        video = cv2.VideoCapture(str(self.source))
        try:
            if not video.isOpened():
                raise InputError(f"{self.source} cannot be opened as a video: copy it again from its data set")
            while True:
                there, image = video.read()
                if not there:
                    return
                yield np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)
        finally:
            video.release()


def find_source(name: str, folders: list[Path]) -> Path | tuple[Path, ...] | None:
    """The frames called `name` in the first of the folders that has them: a folder of images, or a video."""
    for folder in folders:
        if (folder / name).is_dir():
            images = [p for p in (folder / name).iterdir() if p.suffix.lower() in IMAGES]
            if images:
                return tuple(sorted(images, key=_natural))
        for suffix in VIDEOS:
            if (folder / f"{name}{suffix}").is_file():
                return folder / f"{name}{suffix}"
    return None


def _natural(path: Path) -> list[tuple[int, str]]:
    """Sorts frame9 before frame10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path.name)]
