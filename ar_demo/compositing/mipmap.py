"""A picture ready to be sampled: premultiplied, and halved again and again; kept as long as the picture is."""

import weakref
from collections.abc import Callable
from typing import Generic, TypeVar

import cv2
import numpy as np

from hdn.imaging.arrays import Floats, Image, Picture

from ..errors import InputError
from .layer import in_float, peak

T = TypeVar("T")


class Mipmap:
    """A picture as RGBA with premultiplied alpha, and its halved versions, made when asked for (Williams, 1983).

    Averaging premultiplied pixels keeps the hidden colour of transparent ones from showing as a fringe. Unlike a
    frame's `hdn.imaging.pyramid.Pyramid`, it goes on down to one pixel, and sizes are rounded down: levels are looked
    up by shares of the width and height, not by pixels.
    """

    def __init__(self, picture: Picture, max_side: int) -> None:
        """Args:
            picture: see `Picture`; uint16 becomes float32.
            max_side: px, to which a picture with a longer side is shrunk first.

        Raises:
            InputError: an array of another kind.
        """
        kinds = (np.uint8, np.uint16, np.float32)
        if picture.dtype not in kinds or picture.ndim != 3 or picture.shape[2] not in (3, 4) or picture.size == 0:
            raise InputError(
                f"an ad must be uint8, uint16 or float32 (height, width, 3 or 4), got {picture.dtype} {picture.shape}"
            )
        largest = _premultiplied(picture)
        if max(picture.shape[:2]) > max_side:
            factor = max_side / max(picture.shape[:2])
            largest = _shrink(largest, int(picture.shape[1] * factor), int(picture.shape[0] * factor))
        self._levels = [largest]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of level 0, px."""
        return self._levels[0].shape[1], self._levels[0].shape[0]

    def level(self, index: int) -> Image | Floats:
        """Level `index`, (h, w, 4): half the size of the one before it, rounded down; level 0 is the picture."""
        while len(self._levels) <= index:
            height, width = self._levels[-1].shape[:2]
            self._levels.append(_shrink(self._levels[-1], width // 2, height // 2))
        return self._levels[index]


class PictureCache(Generic[T]):
    """What is derived from pictures, each told by the identity of its array, and kept until that array is gone."""

    def __init__(self, derive: Callable[[Picture], T]) -> None:
        self._derive = derive
        self._kept: dict[int, tuple[weakref.ref[Picture], T]] = {}

    def of(self, picture: Picture) -> T:
        """What was derived from this very array, or now is."""
        key = id(picture)
        if key not in self._kept:
            kept = self._kept  # the weak reference is not to keep the cache alive
            gone = weakref.ref(picture, lambda _: kept.pop(key, None))
            self._kept[key] = gone, self._derive(picture)
        return self._kept[key][1]

    def clear(self) -> None:
        """Forgets all."""
        self._kept.clear()


def _premultiplied(picture: Picture) -> Image | Floats:
    """RGBA with colour times alpha, uint8 or float32, from RGB or straight RGBA; never a view of the picture."""
    if picture.dtype == np.uint16:
        picture = in_float(picture)
    if picture.shape[2] == 3:
        return np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2RGBA))  # its alpha is white's value
    alpha = picture[..., 3]
    weights = cv2.merge((alpha, alpha, alpha, np.full_like(alpha, peak(picture.dtype))))
    return np.asarray(cv2.multiply(picture, weights, scale=1 / peak(picture.dtype)))


def _shrink(image: Image | Floats, width: int, height: int) -> Image | Floats:
    return np.asarray(cv2.resize(image, (max(1, width), max(1, height)), interpolation=cv2.INTER_AREA))
