"""Drawing of one surface's ad, or effect, into frames."""

from fractions import Fraction
from pathlib import Path

import numpy as np

from hdn.errors import InputError
from hdn.homography import Array
from hdn.sampling import Image

from .ads import Ad, open_ad
from .closing import Closing
from .compositor import WHOLE, fit_region, open_compositor, quad_aspect
from .effects import draw_outline, texture
from .options import Backend, Placing

NO_AD = "no ad is given: name a video or image, or choose --effect mosaic, blur or outline"


class Painter(Closing):
    """Draws what belongs on a surface; a context manager that holds the ad's file and a compositor."""

    def __init__(
        self, ad: Path | str | None, placing: Placing, quad: Array, size: tuple[int, int], backend: Backend
    ) -> None:
        """Args:
            ad: video, image or animated image; not needed by some effects.
            quad: (4, 2) the surface's corners in a frame of the size given, px, by which the ad's shape is fitted.

        Raises:
            InputError: no ad, or not one that can be read. RunError: the backend is not available.
        """
        if placing.effect == "replace" and ad is None:
            raise InputError(NO_AD)
        self.placing = placing
        self._ad: Ad | None = None
        self._region = WHOLE
        if placing.effect == "replace" and ad is not None:
            self._ad = open_ad(ad, placing.playback)
            self._region = fit_region(placing.fit, self._ad.width / self._ad.height, quad_aspect(quad, size))
        # One compositor a surface: each keeps what is derived from its ad's current picture.
        self._compositor = open_compositor(backend)

    @property
    def description(self) -> str:
        """The compositor's backend and renderer."""
        return self._compositor.description

    def draw(self, image: Image, pose: Array, strength: float, time: Fraction) -> None:
        """Draws into a frame (H, W, 3), in place.

        Args:
            pose: (4, 2) the surface's corners, px; not finite where it is not known.
            strength: 0..1, the opacity.
            time: seconds since the ad began.
        """
        if strength <= 0 or not np.isfinite(pose).all():
            return
        effect, feather = self.placing.effect, self.placing.feather
        if effect == "outline":
            draw_outline(image, pose, strength)
        elif self._ad is None:
            self._compositor.composite(image, texture(effect, image, pose), pose, WHOLE, strength)
        elif (picture := self._ad.at(time)) is not None:
            self._compositor.composite(image, picture, pose, self._region, strength, feather)

    def close(self) -> None:
        if self._ad is not None:
            self._ad.close()
        self._compositor.close()


def check_ad(ad: Path | str | None, placing: Placing) -> None:
    """Raises InputError where an ad is needed and there is none, or none that can be read."""
    if placing.effect != "replace":
        return
    if ad is None:
        raise InputError(NO_AD)
    open_ad(ad, placing.playback).close()
