"""SynthPlanar's textures: photographs from a folder, or drawings of our own."""

from pathlib import Path

import cv2
import numpy as np

from ...errors import InputError
from ...imaging.arrays import Image
from ..sequences import IMAGES
from .drawings import draw_poster, draw_scene


class Pictures:
    """Pictures by chance: photographs from a folder, or, without one, drawings.

    Raises:
        InputError: the folder is none, or holds no image.
    """

    def __init__(self, folder: Path | None) -> None:
        self._paths: list[Path] = []
        if folder is not None:
            if not folder.is_dir():
                raise InputError(f"{folder} is not a folder: give one that holds images")
            self._paths = sorted(p for p in folder.rglob("*") if p.suffix.lower() in IMAGES)
            if not self._paths:
                raise InputError(f"{folder} holds no images: give one that does, or leave --textures out")

    def poster(self, size: tuple[int, int], rng: np.random.Generator) -> tuple[Image, str]:
        """A picture of size (width, height), and where it comes from."""
        return self._photograph(size, rng) if self._paths else (draw_poster(size, rng), "drawn")

    def scene(self, size: tuple[int, int], rng: np.random.Generator) -> Image:
        """A background (height, width, 3), a little out of focus."""
        image = self._photograph(size, rng)[0] if self._paths else draw_scene(size, rng)
        defocus = size[0] * rng.uniform(0.001, 0.0028)
        return np.asarray(cv2.GaussianBlur(image, (0, 0), defocus), np.uint8)

    def _photograph(self, size: tuple[int, int], rng: np.random.Generator) -> tuple[Image, str]:
        path = self._paths[int(rng.integers(len(self._paths)))]
        image = cv2.imread(str(path), cv2.IMREAD_COLOR)
        if image is None:
            raise InputError(f"{path} cannot be read as an image: remove it from the folder of textures")
        height, width = image.shape[:2]
        share = min(width / size[0], height / size[1])
        w, h = max(1, int(size[0] * share)), max(1, int(size[1] * share))
        x, y = int(rng.integers(width - w + 1)), int(rng.integers(height - h + 1))
        way = cv2.INTER_AREA if share > 1 else cv2.INTER_CUBIC
        crop = cv2.resize(image[y : y + h, x : x + w], size, interpolation=way)
        return np.asarray(cv2.cvtColor(crop, cv2.COLOR_BGR2RGB), np.uint8), path.name
