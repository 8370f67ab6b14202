"""Which parts of a plane are seen in a frame, and which are hidden by something in front of it."""

import cv2
import numpy as np

from ..imaging.arrays import Array, Floats, Image, Mask
from ..imaging.homography import from_corners
from ..imaging.observation import Observation
from ..imaging.quads import outline, square
from ..networks.config import MATTE_SIZE
from ..networks.engine import Engine

MIN_KNOWN = 0.99  # share of a pixel of the template
PIXELS: Array = np.stack(np.meshgrid(*[np.arange(float(MATTE_SIZE))] * 2), -1)  # (n, n, 2) of a crop


class Occlusion:
    """The matte network with one area of a plane for its template: as the reference frame shows it, or as it grew."""

    def __init__(self, engine: Engine, frame: Observation, quad: Array, parts: int) -> None:
        """Args:
        engine: the networks.
        frame: the reference frame.
        quad: (4, 2) the area's corners in it, px; they may lie outside.
        parts: along either side, that are told apart.
        """
        self._engine, self._parts = engine, parts
        self._to_reference = from_corners(square(MATTE_SIZE), quad)
        self._template = self._crop(frame, np.eye(3))
        self._known = self._inside(frame, np.eye(3))

    def take(self, picture: Image, known: Mask) -> None:
        """Takes a rectified picture (h, w, 3) of the area for the template, of which pixels (h, w) are known."""
        size = MATTE_SIZE, MATTE_SIZE
        self._template = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
        share = cv2.resize(known.astype(np.float32), size, interpolation=cv2.INTER_AREA)
        self._known = np.where(share > MIN_KNOWN, 255, 0).astype(np.uint8)

    def seen(self, frame: Observation, homography: Array) -> Floats:
        """How probably each part (parts, parts) is seen in a frame, at a pose (3, 3); 0 outside the frame."""
        valid = self._inside(frame, homography) & self._known
        seen = self._engine.matte(self._crop(frame, homography), self._template, valid)
        return np.asarray(cv2.resize(seen, (self._parts, self._parts), interpolation=cv2.INTER_AREA), np.float32)

    def _crop(self, frame: Observation, homography: Array) -> Image:
        return frame.colour.crop(homography @ self._to_reference, MATTE_SIZE, MATTE_SIZE)

    def _inside(self, frame: Observation, homography: Array) -> Image:
        """(n, n) 255 at the crop's pixels that lie in a frame, else 0."""
        to_frame = homography @ self._to_reference
        if frame.colour.shows(to_frame, outline(MATTE_SIZE, MATTE_SIZE)).all():
            return np.full((MATTE_SIZE, MATTE_SIZE), 255, np.uint8)
        return np.where(frame.colour.shows(to_frame, PIXELS), 255, 0).astype(np.uint8)
