"""SynthPlanar's light, lens and sensor: shadows that drift, a lamp mirrored in the poster, focus, exposure, grain."""

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

    shadows: (n, n) share of the sun's light, 255 being all. reach: of them, units of the plane that they lie on, which
    is the background's, or where the light is `still`, the target's; the lamp does not move over the target either
    then. drift: (2,) of the shadows, units a frame. ambient: share of the light that reaches shadows. colour: (3,) of
    the whole. exposure: light that arrives, ratio. swing: log of the brightness's changes. rates: (2,) of them, rad a
    frame. glare: the lamp's light, 1 being white. lamp: (2,) where it is mirrored, target units. spread: of that,
    target units. glow: light of a target that shines by itself, on which none falls, ratio; None for a printed one.
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
    still: bool = False
    reach: float = 1.4
    glow: float | None = None

    def gain(self, time: float, plane_to_frame: Array, size: tuple[int, int]) -> Floats:
        """What the light of a frame of size (height, width) is multiplied by, (H, W, 3); the plane is the shadows'."""
        n = len(self.shadows)
        step, middle = self.reach / n, self.reach / 2
        texel = np.array([[step, 0, -middle], [0, step, -middle], [0, 0, 1]])
        matrix = plane_to_frame @ translation(*(self.drift * time)) @ texel
        lit = cv2.warpPerspective(self.shadows, matrix, size[::-1], borderMode=cv2.BORDER_REFLECT)
        sun = np.linspace(0, 1, 256)[:, None]
        sky = self.ambient * np.array([0.9, 1.0, 1.15])  # shadows are bluer than sunlight
        brightness = self.exposure * np.exp(self.swing * np.sin(self.rates * time).sum() / 2)
        table = ((sky + (1 - sky) * sun) * self.colour * brightness).astype(np.float32)
        return np.asarray(cv2.merge([cv2.LUT(lit, np.ascontiguousarray(table[:, c])) for c in range(3)]), np.float32)

    def glare_on(self, pose: Array, plane_to_box: Array, size: tuple[int, int]) -> Floats:
        """The lamp's light (h, w) in a box of the frame that the target's plane, at `pose` (6,), fills."""
        # A mirror turned by an angle turns its picture by twice that; a lamp is some way off, so that it runs fast.
        place = self.lamp + (0.0 if self.still else 1.2) * np.array([pose[3], -pose[4]])
        r = np.linspace(-3, 3, _SPOT)
        spot = np.exp(-0.5 * (r[:, None] ** 2 + r**2)).astype(np.float32)
        spot -= spot[0, _SPOT // 2]  # nothing at the border, so that none is seen
        s = 6 * self.spread / _SPOT
        texel = np.array([[s, 0, place[0] - 3 * self.spread], [0, 2 * s, place[1] - 6 * self.spread], [0, 0, 1]])
        spot = np.maximum(spot, 0) * np.float32(self.glare * WHITE * self.exposure)
        return np.asarray(cv2.warpPerspective(spot, plane_to_box @ texel, size[::-1]), np.float32)


@dataclass(frozen=True)
class Focus:
    """How far a lens is out of focus: a point becomes a disc, whose radius goes to and fro.

    least, most: radius, px of a frame 1280 px wide. rate: rad a frame. phase: rad.
    """

    least: float
    most: float
    rate: float
    phase: float

    def reach(self, scale: float) -> int:
        """How far a point spreads at most, whole px of a frame `scale` times as wide as 1280 px."""
        return int(np.ceil(self.most * scale)) + 1

    def blur(self, light: Floats, time: float, scale: float) -> Floats:
        """Light (H, W, 3) through the lens."""
        radius = scale * (self.least + (self.most - self.least) * (1 + np.sin(self.rate * time + self.phase)) / 2)
        reach, fine = self.reach(scale), 8
        steps = (np.arange((2 * reach + 1) * fine) + 0.5) / fine - reach - 0.5
        disc = (np.hypot(steps[:, None], steps) <= max(radius, 0.4)).astype(np.float32)
        kernel = cv2.resize(disc, (2 * reach + 1,) * 2, interpolation=cv2.INTER_AREA)
        return np.asarray(cv2.filter2D(light, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REFLECT), np.float32)


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
