"""Lay an ad onto a quad of a frame: the interface, the choice of backend, and how an ad is fitted to a surface."""

import logging
from typing import Literal, Protocol

import numpy as np

from ar_demo.closing import Closing
from ar_demo.compositor_cv import CvCompositor
from ar_demo.compositor_gl import GlCompositor, open_egl, open_osmesa
from ar_demo.placement import WHOLE, Floats, Image, Region, is_drawable, unit_to_quad
from hdn.errors import InputError, RunError

__all__ = ["BACKENDS", "WHOLE", "Compositor", "Region", "fit_region", "open_compositor", "quad_aspect"]

log = logging.getLogger(__name__)

FOCAL_RANGE = (0.5, 2.5)  # focal lengths in frame widths that cameras have: 90 to 23 degrees of view
COMMON_FOCAL = 0.9  # 58 degrees, a phone's main camera
BACKENDS = ("auto", "egl", "osmesa", "opencv")


class Compositor(Closing, Protocol):
    """Draws ads into frames. One object serves one thread at a time; close it when done (it is a context manager)."""

    description: str

    def composite(
        self,
        frame: Image,
        ad: Image,
        quad: Floats,
        region: Region = WHOLE,
        opacity: float = 1.0,
        feather: float = 0.0,
    ) -> None:
        """Lay `ad` onto `frame`, in place, inside `quad`.

        Args:
            frame: uint8 (H, W, 3) RGB, C-contiguous. Only the quad's bounding box is touched.
            ad: uint8 (h, w, 3) RGB or (h, w, 4) RGBA with straight alpha. Pass the identical array while the ad's
                picture stays the same, never a changed one: what is derived from it is kept until another comes.
            quad: float (4, 2), frame pixels (centre of the top-left pixel is (0, 0)), the ad's TL, TR, BR, BL corners.
                Mirrored quads are fine. Nothing is drawn for one that is not strictly convex (folded, collapsed, or
                with a corner behind the camera), not finite, or outside the frame.
            region: the part of the ad that the corners take, see `fit_region`.
            opacity: 0 to 1, multiplies the ad's alpha.
            feather: width in frame pixels over which the ad's edge fades inward; at most half the drawn width.

        Raises:
            InputError: an array, the region or a number is not as described.
        """


def open_compositor(backend: str = "auto") -> Compositor:
    """Open a compositor: "egl" or "osmesa" (OpenGL without a window), "opencv", or "auto", the first that works.

    Raises:
        InputError: no such backend.
        RunError: the named backend does not work here; the message says what to install.
    """
    if backend not in BACKENDS:
        raise InputError(f"compositor backend {backend!r} is unknown: use one of {', '.join(BACKENDS)}")
    compositor: Compositor | None = None
    for name, open_context in (("egl", open_egl), ("osmesa", open_osmesa)):
        if backend not in ("auto", name):
            continue
        try:
            compositor = GlCompositor(*open_context())
            break
        except RunError as error:
            if backend == name:
                raise
            log.warning("compositor backend %s is not available, trying the next: %s", name, error)
    compositor = compositor or CvCompositor()
    log.info("compositor: %s", compositor.description)
    return compositor


def fit_region(fit: Literal["stretch", "contain", "cover"], ad_aspect: float, quad_aspect: float) -> Region:
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


def quad_aspect(quad: Floats, frame_size: tuple[int, int] | None = None) -> float:
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
    focal = np.sqrt(focal_squared) if FOCAL_RANGE[0] ** 2 < focal_squared < FOCAL_RANGE[1] ** 2 else COMMON_FOCAL
    camera = np.array([focal, focal, 1.0])
    return float(np.linalg.norm(h_x / camera) / np.linalg.norm(h_y / camera))
