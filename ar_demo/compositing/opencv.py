"""Draw with OpenCV on the CPU: tile by tile what the OpenGL shader does pixel by pixel.

Everything on the way has four channels, for which OpenCV's warps and products are fastest.
"""

from contextlib import AbstractContextManager

import cv2
import numpy as np

from hdn.imaging.arrays import Array, Floats, Image, Picture

from .layer import Layer, as_box, peak
from .mipmap import Mipmap, PictureCache
from .raster import WHOLE, Raster, Region, Sampling, Tile, rasterise

TILE = (256, 128)  # px, width and height: fits the cache, and spans few levels of the mipmap
MAX_SIDE = 16384  # px: cv2.warpPerspective takes pictures below 32768


class CvCompositor(AbstractContextManager["CvCompositor"]):
    """See `Compositor`."""

    def __init__(self) -> None:
        self.description = f"OpenCV {cv2.__version__}, CPU"
        self._mipmaps = PictureCache(lambda picture: Mipmap(picture, MAX_SIDE))

    def draw(
        self, picture: Picture, quad: Array, frame_size: tuple[int, int], region: Region = WHOLE, feather: float = 0.0
    ) -> Layer | None:
        """See `Compositor.draw`."""
        mipmap = self._mipmaps.of(picture)
        raster = rasterise(frame_size, mipmap.size, quad, region, feather)
        if raster is None:
            return None
        x0, y0, x1, y1 = raster.box
        rgba = np.zeros((y1 - y0, x1 - x0, 4), mipmap.level(0).dtype)
        for tile in raster.tiles(*TILE):
            out = rgba[tile.y0 - y0 : tile.y1 - y0, tile.x0 - x0 : tile.x1 - x0]
            _sample(mipmap, raster, tile, out)
            if not tile.full:
                cover = _weights(raster.coverage(tile), out.dtype)
                cv2.multiply(out, cover, dst=out, scale=1 / peak(out.dtype))
        return Layer(as_box(*raster.box), rgba)

    def close(self) -> None:
        """Lets go of the pictures; calling again does nothing."""
        self._mipmaps.clear()

    def __exit__(self, *error: object) -> None:
        self.close()


def _sample(mipmap: Mipmap, raster: Raster, tile: Tile, out: Image | Floats) -> None:
    """The premultiplied picture as it appears over a tile, into `out` (h, w, 4)."""
    first, last = int(tile.lowest), int(np.ceil(tile.highest))
    _warp(mipmap.level(first), raster.sampling, tile, out)
    for coarser in range(first + 1, last + 1):
        share = _weights(np.clip(raster.level_map(tile) - (coarser - 1), 0, 1), out.dtype)
        coarse = np.empty_like(out)
        _warp(mipmap.level(coarser), raster.sampling, tile, coarse)
        if out.dtype == np.uint8:
            cv2.multiply(coarse, share, dst=coarse, scale=1 / 255)
            cv2.multiply(out, cv2.bitwise_not(share), dst=out, scale=1 / 255)
        else:
            cv2.subtract(coarse, out, dst=coarse)
            cv2.multiply(coarse, share, dst=coarse)
        cv2.add(out, coarse, dst=out)


def _warp(level: Image | Floats, sampling: Sampling, tile: Tile, out: Image | Floats) -> None:
    """One level of the mipmap over a tile, the mean of all taps, into `out` (h, w, 4)."""
    height, width = level.shape[:2]
    size = tile.x1 - tile.x0, tile.y1 - tile.y0
    unit_to_texel = np.array([[width, 0, -0.5], [0, height, -0.5], [0, 0, 1.0]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    total = np.zeros(out.shape, np.float32) if len(sampling.taps) > 1 else None
    for dx, dy in sampling.taps:
        tile_to_frame = np.array([[1, 0, tile.x0 + dx], [0, 1, tile.y0 + dy], [0, 0, 1.0]])
        tile_to_texel = unit_to_texel @ sampling.frame_to_picture @ tile_to_frame
        cv2.warpPerspective(level, tile_to_texel, size, dst=out, flags=flags, borderMode=cv2.BORDER_REPLICATE)
        if total is not None:
            cv2.accumulate(out, total)
    if total is not None and out.dtype == np.uint8:
        cv2.convertScaleAbs(total, dst=out, alpha=1 / len(sampling.taps))
    elif total is not None:
        np.multiply(total, np.float32(1 / len(sampling.taps)), out=out)


def _weights(plane: Floats, dtype: np.dtype[np.uint8] | np.dtype[np.float32]) -> Image | Floats:
    """Shares (h, w), 0..1, as values of a type in four channels, (h, w, 4), to multiply a picture with."""
    if dtype == np.uint8:
        plane = cv2.convertScaleAbs(plane, alpha=255)
    return np.asarray(cv2.merge((plane, plane, plane, plane)))
