"""How an ad of one shape is fitted to a surface of another."""

from dataclasses import dataclass

import numpy as np

from hdn.imaging.arrays import Array
from hdn.imaging.homography import unit_to_quad
from hdn.imaging.quads import is_drawable

from ..choices import Fit
from ..errors import InputError
from .raster import Region


@dataclass(frozen=True)
class CameraModel:
    """Focal lengths in frame widths."""

    shortest: float = 0.5  # 90 degrees of view
    longest: float = 2.5  # 23 degrees
    common: float = 0.9  # 58 degrees, a phone's main camera


CAMERA = CameraModel()


def fit_region(fit: Fit, ad_aspect: float, quad_aspect: float) -> Region:
    """The region that fits an ad to a surface: distorted, whole with transparent bars, or cropped; centred.

    Args:
        fit: "stretch", "contain" (whole ad, bars) or "cover" (full surface, ad cropped).
        ad_aspect, quad_aspect: width / height of the ad as shown, and of the surface (see `quad_aspect`).

    Raises:
        InputError: unknown fit, or an aspect that is not a positive number.
    """
    if not (np.isfinite([ad_aspect, quad_aspect]).all() and ad_aspect > 0 and quad_aspect > 0):
        raise InputError(f"aspect ratios must be positive numbers, got {ad_aspect} (ad) and {quad_aspect} (surface)")
    ratio = quad_aspect / ad_aspect  # width of the surface in ads that are as high as it
    if fit == "stretch":
        width = height = 1.0
    elif fit == "contain":
        width, height = max(ratio, 1.0), max(1.0 / ratio, 1.0)
    elif fit == "cover":
        width, height = min(ratio, 1.0), min(1.0 / ratio, 1.0)
    else:
        raise InputError(f"fit {fit!r} is unknown: use stretch, contain or cover")
    return (0.5 - width / 2, 0.5 - height / 2, 0.5 + width / 2, 0.5 + height / 2)


def quad_aspect(quad: Array, frame_size: tuple[int, int] | None = None) -> float:
    """Width / height of the flat rectangle that a quad shows.

    The sides of a slanted rectangle are foreshortened, so their lengths mislead: by 23% on average over random views,
    with corners off by 0.7 pixels, where the following is 5% off.
    With `h_x`, `h_y` the first columns of the homography from the unit square to pixels from the frame's centre, and a
    camera of focal length f there, the rectangle's sides are K^-1 h_x and K^-1 h_y, K = diag(f, f, 1). That they are
    at right angles gives f (Zhang and He, "Whiteboard scanning and image enhancement", 2007). Where only one pair of
    sides converges, or neither, that says nothing or nonsense; then f is that of a common lens.

    Args:
        quad: float (4, 2), frame pixels, TL, TR, BR, BL.
        frame_size: (width, height) in pixels. Without it the ratio of the mean sides is returned.

    Raises:
        InputError: the quad is not convex, or has no area.
    """
    quad = np.asarray(quad, np.float64)
    if quad.shape != (4, 2) or not is_drawable(quad):
        raise InputError("the surface's corners must make a convex quad, in the order TL, TR, BR, BL")
    if frame_size is None:
        sides = np.linalg.norm(np.roll(quad, -1, axis=0) - quad, axis=1)
        return float((sides[0] + sides[2]) / (sides[1] + sides[3]))
    unit = max(frame_size)  # lengths in frame widths, so that a focal length is about 1
    h_x, h_y, _ = unit_to_quad((quad - (np.array(frame_size) - 1) / 2) / unit).T
    converging = h_x[2] * h_y[2]
    focal_squared = -(h_x[:2] @ h_y[:2]) / converging if converging else 0.0
    known = CAMERA.shortest**2 < focal_squared < CAMERA.longest**2
    focal = np.sqrt(focal_squared) if known else CAMERA.common
    camera = np.array([focal, focal, 1.0])
    return float(np.linalg.norm(h_x / camera) / np.linalg.norm(h_y / camera))
