"""Where in the reference frame a tracker may look: polygons given by hand, and the mask that they make."""

from dataclasses import dataclass

import cv2
import numpy as np

from ..errors import InputError
from .arrays import Array, Image
from .homography import transform
from .quads import area, clip_polygon, cross

MIN_AREA_PX2 = 256  # of what is left to look at: that of the smallest quad
MASK_SHIFT = 4  # bits of a pixel's fraction that OpenCV draws polygons by


@dataclass(frozen=True, eq=False)
class Region:
    """Where tracking may look, on the target's plane as the reference frame shows it.

    Attributes:
        include: polygon (n, 2), px of the reference frame, that tracking keeps to; it may be larger or smaller than the
            target's quad, and reach beyond the frame. None leaves it to the tracker.
        exclude: polygons (n, 2), px, that are never looked at, for what moves or shines.

    Raises:
        InputError: a polygon of under three corners, without area, or that crosses itself.
    """

    include: Array | None = None
    exclude: tuple[Array, ...] = ()

    def __post_init__(self) -> None:
        if self.include is not None:
            check_polygon(self.include, "the region")
        for polygon in self.exclude:
            check_polygon(polygon, "an excluded polygon")

    @property
    def is_everywhere(self) -> bool:
        """Whether nothing is given, and the tracker decides."""
        return self.include is None and not self.exclude

    def mask(self, width: int, height: int) -> Image:
        """uint8 (height, width) of the reference frame: 255 where tracking may look, else 0."""
        mask = np.full((height, width), 255 if self.include is None else 0, np.uint8)
        if self.include is not None:
            _fill(mask, self.include, 255)
        for polygon in self.exclude:
            _fill(mask, polygon, 0)
        return mask

    def transformed(self, homography: Array) -> "Region":
        """The same region in another picture of the plane; homography (3, 3) maps pixels of this one to that one's."""
        include = None if self.include is None else transform(homography, self.include)
        return Region(include, tuple(transform(homography, polygon) for polygon in self.exclude))


EVERYWHERE = Region()


def check_polygon(polygon: Array, name: str) -> None:
    """Raises InputError for what is no polygon (n, 2) with three or more corners, an area, and sides that do not cross.

    Args:
        name: how the polygon is called in the message.
    """
    if polygon.ndim != 2 or polygon.shape[1] != 2 or len(polygon) < 3 or not np.isfinite(polygon).all():
        raise InputError(f"{name} needs three corners x,y or more, in pixels of the reference frame")
    if _crosses_itself(polygon):
        raise InputError(f"{name} crosses itself: give its corners in order around it")
    if abs(area(polygon)) < 1:
        raise InputError(f"{name} is flat: give corners that enclose some of the frame")


def check_region(region: Region, width: int, height: int) -> None:
    """Raises InputError where a region leaves next to nothing of a reference frame of width x height px to look at."""
    if not region.is_everywhere and np.count_nonzero(region.mask(width, height)) < MIN_AREA_PX2:
        raise InputError(
            f"the region, without what is excluded, leaves under {MIN_AREA_PX2} px of the {width}x{height} frame to "
            "track: give a larger one"
        )


def _fill(mask: Image, polygon: Array, value: int) -> None:
    """Draws a polygon (n, 2), px, wherever it reaches."""
    height, width = mask.shape
    # Clipped just outside the mask, since OpenCV's coordinates are small whole numbers. Where a concave polygon falls
    # apart, the clipped one runs along the outside from piece to piece.
    inside = clip_polygon(polygon, (-2, -2, width + 1, height + 1))
    if len(inside):
        corners = np.round(inside * 2**MASK_SHIFT).astype(np.int32)
        cv2.fillPoly(mask, [corners], (value,), shift=MASK_SHIFT)


def _crosses_itself(polygon: Array) -> bool:
    """Whether two sides of a polygon (n, 2) cross; sides that touch do not."""
    a, b = polygon, np.roll(polygon, -1, 0)
    # On which side of each side (row) the ends of each other one (column) lie.
    begins = np.sign(cross((b - a)[:, None], a[None] - a[:, None]))
    ends = np.sign(cross((b - a)[:, None], b[None] - a[:, None]))
    divides = begins * ends < 0
    return bool((divides & divides.T).any())
