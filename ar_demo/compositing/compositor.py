"""Draw a picture as it is seen on a surface: the interface, and the choice of backend."""

import logging
from contextlib import AbstractContextManager
from typing import Protocol, get_args

from hdn.imaging.arrays import Array, Picture

from ..choices import Backend
from ..errors import InputError, RunError
from .layer import Layer
from .opencv import CvCompositor
from .opengl import GlCompositor, open_egl, open_osmesa
from .raster import WHOLE, Region

log = logging.getLogger(__name__)


class Compositor(AbstractContextManager["Compositor"], Protocol):
    """Draws pictures in perspective; `merge` lays the layers on frames.

    One serves all surfaces, and one thread at a time; close it when done (it is a context manager).
    """

    description: str

    def draw(
        self, picture: Picture, quad: Array, frame_size: tuple[int, int], region: Region = WHOLE, feather: float = 0.0
    ) -> Layer | None:
        """Draws a picture on a quad: as a layer, or None where there is nothing to see.

        Args:
            picture: see `Picture`. Pass the identical array while the picture stays the same, never a changed one: what
                is derived from it is kept as long as the array is.
            quad: (4, 2) px of the frame (the centre of the top-left pixel is (0, 0)), the picture's TL, TR, BR, BL
                corners. Mirrored quads are fine. Nothing is drawn for one that is not strictly convex (folded,
                collapsed, or with a corner behind the camera), not finite, or outside the frame.
            frame_size: width and height of the frame, px.
            region: the part of the picture that the corners take, see `fit_region`.
            feather: px of the frame over which the picture's edge fades inward; at most half the drawn width.

        Returns:
            uint8 for a uint8 picture, else float32; only the quad's bounding box.

        Raises:
            InputError: an array, the region or a number is not as described.
        """

    def close(self) -> None:
        """Lets go of all that is held; calling again does nothing."""


def open_compositor(backend: Backend = "auto") -> Compositor:
    """Opens a compositor: "egl" or "osmesa" (OpenGL without a window), "opencv", or "auto", the first that works.

    Raises:
        InputError: no such backend.
        RunError: the named backend does not work here; the message says what to install.
    """
    if backend not in get_args(Backend):
        raise InputError(f"compositor backend {backend!r} is unknown: use one of {', '.join(get_args(Backend))}")
    compositor: GlCompositor | CvCompositor | None = None
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
