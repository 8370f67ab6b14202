"""Lay an ad onto a quad of a frame: the interface, the choice of backend, and how an ad is fitted to a surface."""

import logging
from typing import Protocol

from ..closing import Closing
from ..errors import InputError, RunError
from .opencv import CvCompositor
from .opengl import GlCompositor, open_egl, open_osmesa
from .raster import WHOLE, Floats, Image, Region

log = logging.getLogger(__name__)

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
