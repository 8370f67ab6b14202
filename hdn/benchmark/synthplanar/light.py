"""SynthPlanar's light and sensor: shadows that drift, a lamp mirrored in the poster, exposure, grain."""

from dataclasses import dataclass

import cv2
import numpy as np

from ...imaging.arrays import Array, Floats, Image
from ...imaging.homography import translation
from .drawings import noise

WHITE = 255.0**2  # light of a pixel value of 255: values are roots of light, see render
_SPOT = 65  # texels of a glare's width
_ROOM = 64  # px by which the grain is moved about from frame to frame


@dataclass(frozen=True)
class Light:
    """The light of a scene.

    shadows: (n, n) share of the sun's light, 255 being all, over the background. drift: (2,) of the shadows, background
    units a frame. ambient: share of the light that reaches shadows. colour: (3,) of the whole. exposure: light that
    arrives, ratio. swing: log of the brightness's changes. rates: (2,) of them, rad a frame. glare: the lamp's light, 1
    being white. lamp: (2,) where it is mirrored, target units. spread: of that, target units.
    """

    shadows: Image
    drift: Array
    ambient: float
    colour: Array
    exposure: float
    swing: float
    rates: Array
    glare: float
    lamp: Array
    spread: float

    def gain(self, time: float, background_to_frame: Array, size: tuple[int, int]) -> Floats:
        """What the light of a frame of size (height, width) is multiplied by, (H, W, 3)."""
        n = len(self.shadows)
        texel = np.array([[1.4 / n, 0, -0.7], [0, 1.4 / n, -0.7], [0, 0, 1]])
        matrix = background_to_frame @ translation(*(self.drift * time)) @ texel
        lit = cv2.warpPerspective(self.shadows, matrix, size[::-1], borderMode=cv2.BORDER_REFLECT)
        sun = np.linspace(0, 1, 256)[:, None]
        sky = self.ambient * np.array([0.9, 1.0, 1.15])  # shadows are bluer than sunlight
        brightness = self.exposure * np.exp(self.swing * np.sin(self.rates * time).sum() / 2)
        table = ((sky + (1 - sky) * sun) * self.colour * brightness).astype(np.float32)
        return np.asarray(cv2.merge([cv2.LUT(lit, np.ascontiguousarray(table[:, c])) for c in range(3)]), np.float32)

    def glare_on(self, pose: Array, plane_to_box: Array, size: tuple[int, int]) -> Floats:
        """The lamp's light (h, w) in a box of the frame that the target's plane, at `pose` (6,), fills."""
        # A mirror turned by an angle turns its picture by twice that; a lamp is some way off, so that it runs fast.
        place = self.lamp + 1.2 * np.array([pose[3], -pose[4]])
        r = np.linspace(-3, 3, _SPOT)
        spot = np.exp(-0.5 * (r[:, None] ** 2 + r**2)).astype(np.float32)
        spot -= spot[0, _SPOT // 2]  # nothing at the border, so that none is seen
        s = 6 * self.spread / _SPOT
        texel = np.array([[s, 0, place[0] - 3 * self.spread], [0, 2 * s, place[1] - 6 * self.spread], [0, 0, 1]])
        spot = np.maximum(spot, 0) * np.float32(self.glare * WHITE * self.exposure)
        return np.asarray(cv2.warpPerspective(spot, plane_to_box @ texel, size[::-1]), np.float32)


class Sensor:
    """Turns light into pixel values, with a grain of standard deviation `grain` that is new in every frame.

    Photon noise grows as the root of light: in values that are roots of light it is the same everywhere.
    """

    def __init__(self, width: int, height: int, grain: float, rng: np.random.Generator) -> None:
        shape = (height + _ROOM, width + _ROOM)
        grey = noise(shape, 1, rng, 1)
        fields = [0.8 * grey + 0.5 * cv2.GaussianBlur(noise(shape, 1, rng, 1), (0, 0), 0.8) for _ in range(3)]
        self._grain = np.asarray(cv2.merge([grain * field for field in fields]), np.float32)
        self._rng = rng
        self.expose()

    def expose(self) -> None:
        """The next frame: other grain."""
        self._row, self._column = self._rng.integers(_ROOM, size=2).tolist()

    def develop(self, light: Floats, top: int, left: int) -> Image:
        """Pixel values of light (h, w, 3), which is overwritten, in the frame's box from (top, left) on."""
        height, width = light.shape[:2]
        y, x = self._row + top, self._column + left
        cv2.sqrt(light, light)
        cv2.add(light, self._grain[y : y + height, x : x + width], light)
        return np.asarray(cv2.convertScaleAbs(light), np.uint8)
