"""Which parts of a target are seen in a frame, and which are hidden by something in front of it."""

import cv2
import numpy as np

from .imaging.arrays import Array, Floats, Image
from .imaging.homography import from_corners
from .imaging.observation import Observation
from .imaging.quads import square
from .networks.engine import Engine

PARTS = 32  # the target is told part by part, on a grid of 32 x 32


class Occlusion:
    """The matte network with one part of a plane as its template."""

    def __init__(self, engine: Engine, frame: Observation, quad: Array, parts: int = PARTS) -> None:
        """Args:
        engine: the networks.
        frame: the reference frame.
        quad: (4, 2) the part of the plane in it, px; it may reach beyond the frame.
        parts: along either side, that are told apart.
        """
        self._engine, self._size, self._parts = engine, 128, parts
        self._to_reference = from_corners(square(self._size), quad)
        self._template = frame.colour.crop(self._to_reference, self._size, self._size)
        self._known = self._inside(frame, np.eye(3))

    def _inside(self, frame: Observation, homography: Array) -> Image:
        n = self._size
        whole = np.full(frame.image.shape[:2], 255, np.uint8)
        return cv2.warpPerspective(whole, homography @ self._to_reference, (n, n), flags=cv2.WARP_INVERSE_MAP)

    def seen(self, frame: Observation, homography: Array) -> Floats:
        """How probably each part (n, n) is seen in a frame, at a pose (3, 3); 0 outside the frame."""
        n = self._size
        to_frame = homography @ self._to_reference
        crop = frame.colour.crop(to_frame, n, n)
        valid = self._inside(frame, homography) & self._known
        seen = self._engine.matte(crop, self._template, valid)
        return np.asarray(cv2.resize(seen, (self._parts, self._parts), interpolation=cv2.INTER_AREA), np.float32)
