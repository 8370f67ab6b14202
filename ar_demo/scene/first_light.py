"""The light that lies on a surface in its first view already: a shadow's edge, a lamp that is mirrored.

What a picture takes on in place of the print is light as it is, not how it differs from the first view's. So that one's
is told from views over the clip (`hdn.networks.lighting`), and what is printed is what is left without it.
"""

from dataclasses import dataclass

import numpy as np

from hdn.imaging.arrays import Array, Floats, Image
from hdn.imaging.homography import from_corners
from hdn.imaging.observation import Observation
from hdn.imaging.pyramid import Pyramid
from hdn.imaging.quads import is_drawable
from hdn.networks.config import LIGHT_SIZE
from hdn.networks.lighting import INNER, Lighting, to_frame
from hdn.networks.lighting import FirstLight as Found
from hdn.networks.matte import Matte
from hdn.plane.occlusion import Occlusion

from .light import Light, exposure
from .occlusion import find


@dataclass(frozen=True)
class FirstLightModel:
    """Which views are looked at."""

    min_views: int = 3  # with fewer, the light is taken for even
    min_seen: float = 0.3  # share of the surface that a view has to show
    goes: float = 0.4  # share of it that has to be gone in the mean of the other views, for it to be light that moves
    faint: float = 0.03  # light, in which less than that is none


MODEL = FirstLightModel()


@dataclass(frozen=True)
class FirstLight:
    """The light on a surface in its first view.

    Attributes:
        moving: the part of it that is elsewhere in other views, and so is no part of what is printed.
        staying: the part that stays where it is, as the print does.
    """

    moving: Light
    staying: Light

    @property
    def summary(self) -> dict[str, float | bool]:
        """For a report: the least gain, the most that is mirrored, and whether either moves on."""
        whole = self.staying.under(self.moving)
        moves = bool((self.moving.gain != 1).any() or self.moving.gloss.any())
        least, most = float(whole.gain.min()), float(whole.gloss.max())
        return {"least_gain": round(least, 2), "most_glare": round(most, 2), "moves": moves}

    @property
    def mirrored(self) -> "FirstLight":
        """What is mirrored of it alone, as in a screen, on which no shadow falls."""
        return FirstLight(*(Light(np.ones_like(part.gain), part.gloss) for part in (self.moving, self.staying)))


class LightStudy:
    """Collects views of a surface, and tells the light on the first of them."""

    def __init__(self, reference: Image, quad: Array, matte: Matte, lighting: Lighting) -> None:
        """Args:
        reference: (H, W, 3) the frame of the first view. quad: (4, 2) the surface's corners there, px.
        matte: tells what hides the surface.
        lighting: tells the light.
        """
        self._quad, self._lighting = quad, lighting
        self._exposure = exposure(reference)
        side = INNER.stop - INNER.start
        self._occlusion = Occlusion(matte, Observation(reference), quad, side, framed=True)
        self._views: list[Image] = []
        self._known: list[Image] = []
        self.see(reference, quad)

    def see(self, frame: Image, pose: Array) -> None:
        """Takes a frame (H, W, 3) into account, in which the surface has the corners `pose` (4, 2)."""
        if not np.isfinite(pose).all() or not is_drawable(pose):
            return
        view_to_frame = to_frame(pose)
        observation = Observation(frame)
        seen = self._occlusion.seen(observation, from_corners(self._quad, pose))
        known = _inside(frame, view_to_frame)
        known[INNER, INNER] *= (seen > 0.5) & (find(1 - seen) == 0)
        if self._views and known[INNER, INNER].mean() < MODEL.min_seen:
            return
        view = Pyramid(frame).crop(view_to_frame, LIGHT_SIZE, LIGHT_SIZE) / np.sqrt(self._exposure)
        self._views.append(np.minimum(view, 255).astype(np.uint8))
        self._known.append(known)

    def light(self) -> FirstLight | None:
        """The light on the first view; None where too few others were seen to tell."""
        if len(self._views) <= MODEL.min_views:
            return None
        found = self._lighting(self._views, self._known)
        gain = np.repeat(found.gain[..., None], 3, 2).astype(np.float32)
        glare = (found.glare * self._exposure).astype(np.float32)
        shade_goes, glare_goes = self._goes(found)
        even, none = np.ones_like(gain), np.zeros_like(glare)
        return FirstLight(
            Light(gain if shade_goes else even, glare if glare_goes else none),
            Light(even if shade_goes else gain, none if glare_goes else glare),
        )

    def _goes(self, found: Found) -> tuple[bool, bool]:
        """Whether shadows, and what is mirrored, go elsewhere: views differ from the first one as they would then."""
        inner = np.stack(self._views)[:, INNER, INNER].astype(np.float32) / 255
        known = np.stack(self._known)[:, INNER, INNER] > 0
        light = np.square(inner).mean(3) + 1e-3
        shade = np.log(found.gain) - np.log(found.gain).mean()
        shares: list[list[float]] = [[], []]
        for view, seen in zip(light[1:], known[1:] & known[0], strict=True):
            if seen.sum() < 16:
                continue
            ratio = np.log(view[seen] / light[0][seen])
            level = np.exp(np.median(ratio))
            shares[0].append(_share(ratio, -shade[seen]))
            shares[1].append(_share(view[seen] / level - light[0][seen], -found.glare[seen]))
        goes = [float(np.median(share)) > MODEL.goes if share else False for share in shares]
        return goes[0], goes[1]


def _share(change: Floats, expected: Floats) -> float:
    """How much of an expected change took place: the slope of a regression; 0 where none is expected."""
    expected = expected - expected.mean()
    square = float(np.square(expected).mean())
    return float((expected * change).mean()) / square if square > MODEL.faint**2 else 0.0


def _inside(frame: Image, view_to_frame: Array) -> Image:
    """The pixels (n, n) of a view that lie in a frame, 0 or 1."""
    at = np.arange(float(LIGHT_SIZE))
    x, y = np.meshgrid(at, at)
    points = np.stack([x, y, np.ones_like(x)], -1) @ view_to_frame.T
    ahead = points[..., 2] > 0
    place = points[..., :2] / np.where(ahead, points[..., 2], 1)[..., None]
    bounds = np.array(frame.shape[1::-1]) - 1
    return (ahead & (place >= 0).all(-1) & (place <= bounds).all(-1)).astype(np.uint8)
