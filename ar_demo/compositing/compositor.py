"""Draw a picture as it is seen on a surface: the interface, and the choice of backend."""

import logging
import sys
from contextlib import AbstractContextManager
from pathlib import Path
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
    """Opens a compositor: "egl" or "osmesa" (OpenGL without a window), "opencv", or "auto": OpenGL on a GPU
    through EGL where there is one, else OpenCV, which draws as fast as OpenGL in software, and takes less memory.

    Raises:
        InputError: no such backend.
        RunError: the named backend does not work here; the message says what to install.
    """
    if backend not in get_args(Backend):
        raise InputError(f"compositor backend {backend!r} is unknown: use one of {', '.join(get_args(Backend))}")
    compositor: GlCompositor | CvCompositor | None = None
    if backend == "egl":
        compositor = GlCompositor(*open_egl())
    elif backend == "osmesa":
        compositor = GlCompositor(*open_osmesa())
    elif backend == "auto" and may_have_gpu():
        compositor = _on_gpu()
    compositor = compositor or CvCompositor()
    log.info("compositor: %s", compositor.description)
    return compositor


def may_have_gpu() -> bool:
    """Whether there may be a GPU: opening OpenGL only to find that it is software takes 90 MB."""
    if sys.platform != "linux":
        return True
    return any(any(Path("/dev").glob(pattern)) for pattern in ("dri/renderD*", "nvidia[0-9]*", "dxg"))


def _on_gpu() -> GlCompositor | None:
    """OpenGL through EGL; None where there is none, or in software."""
    try:
        compositor = GlCompositor(*open_egl())
    except RunError as error:
        log.warning("compositor backend egl is not available, OpenCV draws in its place: %s", error)
        return None
    if compositor.in_software:
        compositor.close()
        return None
    return compositor
