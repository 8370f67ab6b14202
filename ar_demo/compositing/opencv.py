"""Composite with OpenCV on the CPU: tile by tile what the OpenGL shader does pixel by pixel.

Everything on the way has four channels of 8 bits, for which OpenCV's warps and products are fastest.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from ..closing import Closing
from .raster import WHOLE, Floats, Image, Placement, Pyramid, Region, Sampling, check_frame, place

TILE = (256, 128)  # width, height: fits the cache, and spans few pyramid levels
CELL = 8  # the pyramid level is worked out every so many pixels and interpolated; divides the tile
FULL = np.ones((1, 1), np.float32)  # the coverage of a tile that the ad fills
MAX_AD_SIDE = 16384  # cv2.warpPerspective takes sources below 32768


class CvCompositor(Closing):
    """See `Compositor`."""

    def __init__(self) -> None:
        self.description = f"OpenCV {cv2.__version__}, CPU"
        self._pyramid: Pyramid | None = None

    def composite(
        self,
        frame: Image,
        ad: Image,
        quad: Floats,
        region: Region = WHOLE,
        opacity: float = 1.0,
        feather: float = 0.0,
    ) -> None:
        """See `Compositor.composite`."""
        check_frame(frame)
        if self._pyramid is None or self._pyramid.ad is not ad:
            self._pyramid = Pyramid(ad, MAX_AD_SIDE)
        placement = place((frame.shape[1], frame.shape[0]), self._pyramid.size, quad, region, feather)
        if placement is None or not opacity > 0:
            return
        x0, y0, x1, y1 = placement.box
        level_map = _LevelMap(placement)
        for top in range(y0, y1, TILE[1]):
            for left in range(x0, x1, TILE[0]):
                tile = left, top, min(left + TILE[0], x1), min(top + TILE[1], y1)
                coverage = _coverage(placement, tile)
                if coverage is None:
                    continue
                picture = _sample(self._pyramid, placement.sampling, level_map.over(tile), tile)
                part = frame[tile[1] : tile[3], tile[0] : tile[2]]
                if self._pyramid.opaque and opacity >= 1 and coverage is FULL:
                    cv2.cvtColor(picture, cv2.COLOR_RGBA2RGB, dst=part)
                else:
                    _blend(part, picture, coverage * min(opacity, 1.0))

    def close(self) -> None:
        """Let go of the ad; calling again does nothing."""
        self._pyramid = None


Tile = tuple[int, int, int, int]  # x0, y0, x1, y1 in the frame, ends exclusive
Plane = NDArray[np.float32]


def _coverage(placement: Placement, tile: Tile) -> Plane | None:
    """How much of each pixel the ad covers, (h, w); FULL if it is 1 all over the tile, None if it is 0."""
    x0, y0, x1, y1 = tile
    corners = np.array([[x0, y0, 1], [x1 - 1, y0, 1], [x0, y1 - 1, 1], [x1 - 1, y1 - 1, 1]])
    ramps = placement.edges / placement.ramp
    ramps[:, 2] += 0.5 / placement.ramp
    extremes = corners @ ramps.T  # (corner, edge)
    if (extremes <= 0).all(axis=0).any():
        return None
    if (extremes >= 1).all():
        return FULL
    x, y = np.arange(x0, x1), np.arange(y0, y1)
    top, right, bottom, left = (
        np.clip(np.add.outer((b * y + c).astype(np.float32), (a * x).astype(np.float32)), 0, 1) if near else FULL
        for (a, b, c), near in zip(ramps, extremes.min(axis=0) < 1, strict=True)
    )
    coverage = np.maximum(top + bottom - FULL, 0) * np.maximum(left + right - FULL, 0)
    return np.asarray(np.broadcast_to(coverage, (y1 - y0, x1 - x0)), np.float32)


class _LevelMap:
    """The pyramid level over the box of a placement, worked out at the centres of cells and interpolated between."""

    def __init__(self, placement: Placement) -> None:
        lowest, highest = placement.levels
        x0, y0, x1, y1 = placement.box
        self._origin = x0, y0
        self._cells: Plane | None = None
        if highest > 0:
            x = np.arange(x0 - CELL, x1 + CELL, CELL) + (CELL - 1) / 2  # with one cell more on every side
            y = np.arange(y0 - CELL, y1 + CELL, CELL) + (CELL - 1) / 2
            levels = placement.sampling.level(np.stack(np.meshgrid(x, y), axis=-1))
            self._cells = np.clip(levels, lowest, highest).astype(np.float32)

    def over(self, tile: Tile) -> Plane:
        """Levels of a tile's pixels, (h, w); (1, 1) if all are 0."""
        if self._cells is None:
            return np.zeros((1, 1), np.float32)
        column, row = (tile[0] - self._origin[0]) // CELL, (tile[1] - self._origin[1]) // CELL
        width, height = tile[2] - tile[0], tile[3] - tile[1]
        cells = self._cells[row : row + -(-height // CELL) + 2, column : column + -(-width // CELL) + 2]
        pixels = cv2.resize(cells, (cells.shape[1] * CELL, cells.shape[0] * CELL), interpolation=cv2.INTER_LINEAR)
        return np.asarray(pixels[CELL : CELL + height, CELL : CELL + width], np.float32)


def _sample(pyramid: Pyramid, sampling: Sampling, level: Plane, tile: Tile) -> Image:
    """The premultiplied ad as it appears over a tile, (h, w, 4)."""
    first, last = int(level.min()), int(np.ceil(level.max()))
    picture = _warp(pyramid.level(first), sampling, tile)
    for coarser in range(first + 1, last + 1):
        mix = _weights(level - (coarser - 1))
        coarse = cv2.multiply(_warp(pyramid.level(coarser), sampling, tile), mix, scale=1 / 255)
        cv2.multiply(picture, cv2.bitwise_not(mix), dst=picture, scale=1 / 255)
        cv2.add(picture, coarse, dst=picture)
    return picture


def _warp(level: Image, sampling: Sampling, tile: Tile) -> Image:
    """One pyramid level over a tile, the mean of all taps, (h, w, 4)."""
    x0, y0, x1, y1 = tile
    height, width = level.shape[:2]
    ad_to_texel = np.array([[width, 0, -0.5], [0, height, -0.5], [0, 0, 1.0]])
    warped = []
    for dx, dy in sampling.taps:
        tile_to_frame = np.array([[1, 0, x0 + dx], [0, 1, y0 + dy], [0, 0, 1.0]])
        tile_to_texel = ad_to_texel @ sampling.frame_to_ad @ tile_to_frame
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        warped.append(
            cv2.warpPerspective(level, tile_to_texel, (x1 - x0, y1 - y0), flags=flags, borderMode=cv2.BORDER_REPLICATE)
        )
    if len(warped) == 1:
        return np.asarray(warped[0], np.uint8)
    total = np.zeros(warped[0].shape, np.float32)
    for picture in warped:
        cv2.accumulate(picture, total)
    return np.asarray(cv2.convertScaleAbs(total, alpha=1 / len(warped)), np.uint8)


def _blend(part: Image, picture: Image, coverage: Plane) -> None:
    """Lay a premultiplied picture (h, w, 4) over a part of the frame (h, w, 3), in place."""
    weights = _weights(np.ascontiguousarray(np.broadcast_to(coverage, part.shape[:2])))
    covered = cv2.multiply(picture, weights, scale=1 / 255)
    kept = cv2.bitwise_not(cv2.extractChannel(covered, 3))
    behind = cv2.multiply(part, cv2.merge((kept, kept, kept)), scale=1 / 255)
    cv2.add(behind, cv2.cvtColor(covered, cv2.COLOR_RGBA2RGB), dst=part)


def _weights(plane: Plane) -> Image:
    """0..1 (clipped) as 0..255 in four channels, (h, w, 4), to multiply a picture with."""
    weights = cv2.convertScaleAbs(np.clip(plane, 0, 1), alpha=255)
    return np.asarray(cv2.merge((weights, weights, weights, weights)), np.uint8)
