"""Drawing of one surface's ad, or effect, into frames: lit and blurred as the surface is, behind what hides it."""

from fractions import Fraction

import cv2
import numpy as np

from hdn.imaging.arrays import Array, Image
from hdn.imaging.blur import blurred
from hdn.imaging.homography import from_corners
from hdn.imaging.quads import outline

from ..choices import Backend
from ..closing import Closing
from ..compositing.compositor import open_compositor
from ..compositing.effects import draw_outline, texture
from ..compositing.fit import fit_region, quad_aspect
from ..compositing.raster import WHOLE
from ..errors import InputError
from ..media.ad import Ad, open_ad
from ..scene.conditions import Conditions
from ..scene.light import GRID, Light, as_it_was
from ..surface import Surface

USUAL = 0.004  # by which light may differ from the reference frame's without a picture being lit anew
THIN = 0.2  # px^2, the least variance of a blur, across it: a thinner one would fall between the pixels
BLURRED = 0.05  # px^2 of the frame, from which a picture is blurred

NO_AD = "no ad is given: name a video or image, or choose --effect mosaic, blur or outline"


class Painter(Closing):
    """Draws what belongs on a surface; a context manager that holds the ad's file and a compositor."""

    def __init__(self, surface: Surface, quad: Array, size: tuple[int, int], backend: Backend) -> None:
        """Args:
            quad: (4, 2) the surface's corners in a frame of the size given, px, by which the ad's shape is fitted.

        Raises:
            InputError: no ad, or not one that can be read. RunError: the backend is not available.
        """
        if surface.effect == "replace" and surface.ad is None:
            raise InputError(NO_AD)
        self.surface = surface
        self._ad: Ad | None = None
        self._region = WHOLE
        if surface.effect == "replace" and surface.ad is not None:
            self._ad = open_ad(surface.ad, surface.playback)
            self._region = fit_region(surface.fit, self._ad.width / self._ad.height, quad_aspect(quad, size))
        self._lit: tuple[Image, Light, Image] | None = None  # a picture, a light, and the picture in this light
        # One compositor a surface: each keeps what is derived from its ad's current picture.
        self._compositor = open_compositor(backend)

    @property
    def description(self) -> str:
        """The compositor's backend and renderer."""
        return self._compositor.description

    def draw(
        self, image: Image, pose: Array, strength: float, time: Fraction, conditions: Conditions | None = None
    ) -> None:
        """Draws into a frame (H, W, 3), in place.

        Args:
            pose: (4, 2) the surface's corners, px; not finite where it is not known.
            strength: 0..1, the opacity.
            time: seconds since the ad began.
            conditions: under which the surface is seen; None draws an ad as it is.
        """
        if strength <= 0 or not np.isfinite(pose).all():
            return
        effect = self.surface.effect
        if effect == "outline":
            draw_outline(image, pose, strength)
        elif self._ad is None:
            self._compositor.composite(image, texture(effect, image, pose), pose, WHOLE, strength)
        elif (picture := self._ad.at(time)) is not None:
            if conditions is None:
                self._compositor.composite(image, picture, pose, self._region, strength, self.surface.feather)
            else:
                self._draw_in_scene(image, picture, pose, strength, conditions)

    def _draw_in_scene(
        self, image: Image, picture: Image, pose: Array, strength: float, conditions: Conditions
    ) -> None:
        picture = self._in_light(picture, pose, conditions.light)
        occluder = conditions.occluder
        if occluder is not None:
            # What is behind its soft edge is the ad, and not the surface.
            part = image[occluder.box]
            part[:] = np.where(occluder.share > 0, occluder.behind + 0.5, part)
        if np.linalg.eigvalsh(conditions.blur).max() > BLURRED:
            self._draw_blurred(image, picture, pose, strength, conditions.blur)
        else:
            self._compositor.composite(image, picture, pose, self._region, strength, self.surface.feather)
        if occluder is not None:
            part[:] = part * (1 - occluder.share) + occluder.colour + 0.5

    def _in_light(self, picture: Image, pose: Array, light: Light) -> Image:
        """A picture (h, w, 3 or 4) in a light over the surface; the same array as before for much the same light.

        It has no more pixels than are shown, about.
        """
        if light.differs(as_it_was()) < USUAL:
            return picture
        if self._lit is not None and self._lit[0] is picture and self._lit[1].differs(light) < USUAL:
            return self._lit[2]
        u0, v0, u1, v1 = self._region
        whole = np.array(picture.shape[1::-1]) * [u1 - u0, v1 - v0]
        sides = np.linalg.norm(np.roll(pose, -1, 0) - pose, axis=1)
        shrink = max(1, int((whole / [max(sides[0], sides[2]), max(sides[1], sides[3])]).min()))
        size = tuple(max(1, n // shrink) for n in picture.shape[1::-1])
        small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA) if shrink > 1 else picture
        corners = np.array([[u0, v0], [u1, v0], [u1, v1], [u0, v1]]) * size - 0.5
        grid_to_picture = from_corners(outline(GRID, GRID), corners)
        changed = cv2.convertScaleAbs(light.over(grid_to_picture, size).on(np.ascontiguousarray(small[..., :3])))
        self._lit = picture, light, np.concatenate([changed, small[..., 3:]], 2) if picture.shape[2] == 4 else changed
        return self._lit[2]

    def _draw_blurred(self, image: Image, picture: Image, pose: Array, strength: float, blur: Array) -> None:
        """Draws a picture blurred by a covariance (2, 2), px^2, its edge alike."""
        reach = int(np.ceil(3 * np.sqrt(np.linalg.eigvalsh(blur).max())))
        bounds = np.array(image.shape[1::-1])
        left, top = np.clip(np.floor(pose.min(0)) - reach, 0, bounds).astype(int)
        right, bottom = np.clip(np.ceil(pose.max(0)) + reach + 1, 0, bounds).astype(int)
        part = image[top:bottom, left:right]
        if part.size == 0:
            return
        # Drawn over black and over white, the difference is how much the ad lets through.
        over_black, over_white = np.zeros(part.shape, np.uint8), np.full(part.shape, 255, np.uint8)
        for ground in (over_black, over_white):
            self._compositor.composite(
                ground, picture, pose - [left, top], self._region, strength, self.surface.feather
            )
        blur = blur + THIN * np.eye(2)
        colour, white = (blurred(ground.astype(np.float32), blur) for ground in (over_black, over_white))
        part[:] = np.clip(colour + part * ((white - colour) / 255) + 0.5, 0, 255)

    def close(self) -> None:
        if self._ad is not None:
            self._ad.close()
        self._compositor.close()


def check_ad(surface: Surface) -> None:
    """Raises InputError where an ad is needed and there is none, or none that can be read."""
    if surface.effect != "replace":
        return
    if surface.ad is None:
        raise InputError(NO_AD)
    open_ad(surface.ad, surface.playback).close()
