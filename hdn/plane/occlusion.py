"""Which parts of a plane are seen in a frame, and which are hidden by something in front of it."""

from collections.abc import Callable

import cv2
import numpy as np

from ..imaging.arrays import Array, Floats, Image, Mask
from ..imaging.homography import from_corners
from ..imaging.observation import Observation
from ..imaging.quads import outline, square
from ..networks.config import MATTE_SIZE, MATTE_SURFACE

MIN_KNOWN = 0.99  # share of a pixel of the template
PIXELS: Array = np.stack(np.meshgrid(*[np.arange(float(MATTE_SIZE))] * 2), -1)  # (n, n, 2) of a crop
BORDER = round(MATTE_SIZE * (1 - MATTE_SURFACE) / 2)  # px around a framed area


class Occlusion:
    """The matte network with one area of a plane for its template: as the reference frame shows it, or as it grew."""

    def __init__(
        self, matte: Callable[..., Floats], frame: Observation, quad: Array, parts: int, framed: bool = False
    ) -> None:
        """Args:
        matte: the network, `Matte` or `Engine.matte`.
        frame: the reference frame.
        quad: (4, 2) the area's corners in it, px; they may lie outside.
        parts: along either side, that are told apart.
        framed: whether what lies around the area is looked at in frames, since what is in front comes in from there.
        """
        self._matte, self._parts = matte, parts
        self._border = BORDER if framed else 0
        inner = square(MATTE_SIZE - 2 * self._border) + self._border
        self._to_reference = from_corners(inner, quad)
        self._template = self._crop(frame, np.eye(3))
        self._known = np.zeros((MATTE_SIZE, MATTE_SIZE), np.uint8)
        self._known[self._inner] = self._inside(frame, np.eye(3))[self._inner]

    def take(self, picture: Image, known: Mask) -> None:
        """Takes a rectified picture (h, w, 3) of the area for the template, of which pixels (h, w) are known."""
        side = MATTE_SIZE - 2 * self._border
        self._template[self._inner] = cv2.resize(picture, (side, side), interpolation=cv2.INTER_AREA)
        share = cv2.resize(known.astype(np.float32), (side, side), interpolation=cv2.INTER_AREA)
        self._known[self._inner] = np.where(share > MIN_KNOWN, 255, 0)

    def seen(self, frame: Observation, homography: Array) -> Floats:
        """How probably each part (parts, parts) is seen in a frame, at a pose (3, 3); 0 outside the frame."""
        inside = self._inside(frame, homography)
        around = inside & ~self._known if self._border else None
        seen = self._matte(self._crop(frame, homography), self._template, inside & self._known, around)[self._inner]
        return np.asarray(cv2.resize(seen, (self._parts, self._parts), interpolation=cv2.INTER_AREA), np.float32)

    @property
    def _inner(self) -> tuple[slice, slice]:
        """Rows and columns of the crop that the area takes."""
        return (slice(self._border, MATTE_SIZE - self._border),) * 2

    def _crop(self, frame: Observation, homography: Array) -> Image:
        return frame.colour.crop(homography @ self._to_reference, MATTE_SIZE, MATTE_SIZE)

    def _inside(self, frame: Observation, homography: Array) -> Image:
        """(n, n) 255 at the crop's pixels that lie in a frame, else 0."""
        to_frame = homography @ self._to_reference
        if frame.colour.shows(to_frame, outline(MATTE_SIZE, MATTE_SIZE)).all():
            return np.full((MATTE_SIZE, MATTE_SIZE), 255, np.uint8)
        return np.where(frame.colour.shows(to_frame, PIXELS), 255, 0).astype(np.uint8)
