"""Which pixels of a frame a picture covers, how much of each, and where on the picture they look.

A compositor only samples. The rest is decided here, in float64, so that OpenGL and OpenCV draw the same:

- coverage: every edge gives a ramp over the signed distance to it, in frame pixels; opposite ramps overlap and the two
  pairs multiply, which is the exact area for an upright rectangle, down to slivers thinner than a pixel;
- sampling: some taps along the direction in which the picture is most minified, each trilinear between two levels of a
  mipmap. The level follows, pixel by pixel, the footprint on the picture of what the taps leave to one sample, which
  is nearly round; so a slanted surface neither flickers on its far side nor smears.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np

from hdn.imaging.arrays import Array, Floats
from hdn.imaging.homography import derivative, transform, unit_to_quad
from hdn.imaging.quads import area, clip_polygon, is_drawable

from ..errors import InputError

Region = tuple[float, float, float, float]
"""(u0, v0, u1, v1): the part of the picture laid on the quad's corners, 0..1 across it; beyond it is transparent."""

WHOLE: Region = (0.0, 0.0, 1.0, 1.0)
CELL = 8  # px: the mipmap level is worked out at the centres of cells so large; divides the sizes of tiles


@dataclass(frozen=True)
class SamplingModel:
    """How closely pixels look at the picture."""

    max_taps: int = 8  # samples a pixel; more slant than they span is blurred a little
    crispness: float = 2**-0.25  # ratio of the footprint taken to the true one: closest to the exact mean over a pixel
    min_weight: float = (
        1e-6  # homogeneous weights are about 1 on the quad; so small at the horizon, where none is drawn
    )


MODEL = SamplingModel()


@dataclass(frozen=True)
class Sampling:
    """Where on the picture the pixels of a frame look, and how closely; x, y are frame pixels.

    Attributes:
        frame_to_picture: (3, 3) maps (x, y, 1) to (u, v, 1) * w, u and v in 0..1 across the picture, w about 1.
        texels: (2,) the picture's width and height.
        taps: (n, 2) offsets, frame pixels, at which the picture is sampled, to be averaged.
        footprint: (2, 2) columns are the two steps in the frame that span what one tap stands for.
    """

    frame_to_picture: Array
    texels: Array
    taps: Array
    footprint: Array

    def level(self, points: Array) -> Array:
        """Mipmap level at `points` (..., 2), of shape (...): log2 of the length of a tap's footprint in texels."""
        longer, _ = _axes(_texels_per_pixel(self.frame_to_picture, self.texels, points) @ self.footprint)
        return np.clip(np.log2(np.maximum(longer, MODEL.min_weight)), 0.0, np.log2(self.texels.max()))


class Tile(NamedTuple):
    """Part of a raster's box.

    Attributes:
        x0, y0, x1, y1: frame pixels, ends exclusive.
        full: whether the picture covers all of it.
        lowest, highest: range of the mipmap level over it.
    """

    x0: int
    y0: int
    x1: int
    y1: int
    full: bool
    lowest: float
    highest: float


class Step(NamedTuple):
    """What is drawn with one level of the mipmap, or two.

    Where three levels or more are looked at, it takes several steps, one over the other, from fine to coarse.

    Attributes:
        polygon: (n, 2) convex, frame pixels; it covers all pixels that look at the levels, and maybe others.
        fine: the level looked at.
        mixed: whether the next one is mixed in.
        again: whether pixels that look at finer levels alone keep what was drawn before.
    """

    polygon: Array
    fine: int
    mixed: bool
    again: bool


@dataclass(frozen=True)
class Raster:
    """A picture on its way into a frame; x, y are frame pixels.

    Attributes:
        box: x0, y0, x1, y1, the pixels touched, ends exclusive, inside the frame.
        edges: (4, 3) rows (a, b, c): a*x + b*y + c is the distance inward from an edge, px.
        ramp: px over which coverage rises from 0 to 1, from half a pixel outside an edge.
        sampling: where the pixels look.
        levels: the lowest and the highest mipmap level over the drawn pixels.
    """

    box: tuple[int, int, int, int]
    edges: Array
    ramp: float
    sampling: Sampling
    levels: tuple[float, float]

    @cached_property
    def ramps(self) -> Array:
        """(4, 3) rows (a, b, c): clipped to 0..1, a*x + b*y + c is what an edge leaves of a pixel."""
        ramps = self.edges / self.ramp
        ramps[:, 2] += 0.5 / self.ramp
        return ramps

    def tiles(self, width: int, height: int) -> list[Tile]:
        """The box cut into tiles of a size that CELL divides, without those that the picture does not reach."""
        x0, y0, x1, y1 = self.box
        left, top = np.arange(x0, x1, width), np.arange(y0, y1, height)
        right, bottom = np.minimum(left + width, x1), np.minimum(top + height, y1)
        # A ramp over a tile is least and most at two of its corners: (edge, row of tiles, column of tiles).
        a, b, c = self.ramps.T[:, :, None]
        along, down = np.sort([a * left, a * (right - 1)], 0), np.sort([b * top, b * (bottom - 1)], 0)
        least, most = (down[i][:, :, None] + along[i][:, None, :] + c[:, :, None] for i in (0, 1))
        full = (least >= 1).all(0)
        lowest = highest = np.zeros(full.shape)
        if self.levels[1] > 0:
            rows, columns = np.arange(len(top)) * (height // CELL), np.arange(len(left)) * (width // CELL)
            lowest, highest = (
                extreme.reduceat(
                    extreme.reduceat(around(self._cell_levels, np.ones((3, 3)))[1:-1, 1:-1], rows), columns, 1
                )
                for extreme, around in ((np.minimum, cv2.erode), (np.maximum, cv2.dilate))
            )
        return [
            Tile(left[j], top[i], right[j], bottom[i], full[i, j], lowest[i, j], highest[i, j])
            for i, j in np.argwhere((most > 0).all(0)).tolist()
        ]

    def coverage(self, tile: Tile) -> Floats:
        """How much of each pixel of a tile the picture covers, (h, w), 0..1."""
        x, y = np.arange(tile.x0, tile.x1), np.arange(tile.y0, tile.y1)
        covered = np.ones((len(y), len(x)), np.float32)
        for pair in self.ramps[[[0, 2], [1, 3]]]:  # opposite edges
            sides = []
            for a, b, c in pair:
                along, down = a * x, b * y + c
                if min(along[0], along[-1]) + min(down[0], down[-1]) < 1:  # else all is well inside of it
                    side = np.add.outer(down.astype(np.float32), along.astype(np.float32))
                    sides.append(np.clip(side, 0, 1, out=side))
            if len(sides) == 2:
                sides = [np.maximum(sides[0] + sides[1] - 1, 0)]
            for side in sides:
                covered *= side
        return covered

    def steps(self) -> list[Step]:
        """The steps in which all is drawn by a renderer that looks at two levels at once."""
        x0, y0, x1, y1 = self.box
        first, last = int(self.levels[0]), int(np.ceil(self.levels[1]))
        if last <= first + 1:
            return [Step(self._polygon(x0, y0, x1, y1), first, last > first, False)]
        finest, coarsest = (f(self._cell_levels, np.ones((3, 3)))[1:-1, 1:-1] for f in (cv2.erode, cv2.dilate))
        steps = []
        for fine in range(first, last):
            rows, columns = np.nonzero((coarsest >= fine) & (finest <= fine + 1))
            if len(rows):
                left, top = x0 + columns.min() * CELL, y0 + rows.min() * CELL
                right, bottom = x0 + (columns.max() + 1) * CELL, y0 + (rows.max() + 1) * CELL
                polygon = self._polygon(left, top, min(right, x1), min(bottom, y1))
                steps.append(Step(polygon, fine, True, fine > first))
        return steps

    def _polygon(self, x0: int, y0: int, x1: int, y1: int) -> Array:
        """What is drawn of a part of the box, as a convex polygon (n, 2); empty if nothing."""
        lines = self.edges + np.array([0, 0, 1])  # a pixel outward, so that all that are covered in part are inside
        corners = np.cross(np.roll(lines, 1, axis=0), lines)  # where two lines meet, in homogeneous coordinates
        return clip_polygon(corners[:, :2] / corners[:, 2:], (x0 - 0.5, y0 - 0.5, x1 - 0.5, y1 - 0.5))

    @cached_property
    def _cell_levels(self) -> Floats:
        """The mipmap level at the centres of cells, with one cell more on every side of the box."""
        x0, y0, x1, y1 = self.box
        x = np.arange(x0 - CELL, x1 + CELL, CELL) + (CELL - 1) / 2
        y = np.arange(y0 - CELL, y1 + CELL, CELL) + (CELL - 1) / 2
        levels = self.sampling.level(np.stack(np.meshgrid(x, y), axis=-1))
        return np.clip(levels, *self.levels).astype(np.float32)

    def level_map(self, tile: Tile) -> Floats:
        """The mipmap levels of a tile's pixels, (h, w), interpolated between cells."""
        column, row = (tile.x0 - self.box[0]) // CELL, (tile.y0 - self.box[1]) // CELL
        width, height = tile.x1 - tile.x0, tile.y1 - tile.y0
        cells = self._cell_levels[row : row + -(-height // CELL) + 2, column : column + -(-width // CELL) + 2]
        pixels = cv2.resize(cells, (cells.shape[1] * CELL, cells.shape[0] * CELL), interpolation=cv2.INTER_LINEAR)
        return np.asarray(pixels[CELL : CELL + height, CELL : CELL + width], np.float32)


def rasterise(
    frame_size: tuple[int, int], picture_size: tuple[int, int], quad: Array, region: Region = WHOLE,
    feather: float = 0.0,
) -> Raster | None:  # fmt: skip
    """Works out how a picture is drawn into a frame; None where there is nothing to draw.

    Args:
        frame_size, picture_size: (width, height) in pixels.
        quad: (4, 2) frame pixels, the corners TL, TR, BR, BL of the region.
        region: the part of the picture that the corners take.
        feather: px of the frame over which the edge fades inward; half the drawn shape's width at most is used.

    Raises:
        InputError: the quad is not of shape (4, 2), the region is empty or inverted, the feather is negative.
    """
    quad = np.asarray(quad, np.float64)
    u0, v0, u1, v1 = region
    if quad.shape != (4, 2):
        raise InputError(f"a quad has four corners (x, y), got an array of shape {quad.shape}")
    if not (u1 > u0 and v1 > v0 and np.isfinite(region).all()):
        raise InputError(f"the ad's region must be (u0, v0, u1, v1) with u0 < u1 and v0 < v1, got {region}")
    if not feather >= 0:
        raise InputError(f"feather must be 0 or more pixels, got {feather}")

    # What lies beyond the picture is transparent: the shape to draw is the part of the quad that has some of it.
    left, top, right, bottom = max(u0, 0.0), max(v0, 0.0), min(u1, 1.0), min(v1, 1.0)
    if not is_drawable(quad) or left >= right or top >= bottom:
        return None
    corners_to_unit = np.array([[1 / (u1 - u0), 0, -u0 / (u1 - u0)], [0, 1 / (v1 - v0), -v0 / (v1 - v0)], [0, 0, 1]])
    picture_to_frame = unit_to_quad(quad) @ corners_to_unit
    shape = transform(picture_to_frame, np.array([[left, top], [right, top], [right, bottom], [left, bottom]]))
    if not is_drawable(shape):
        return None
    width, height = frame_size
    visible = clip_polygon(shape, (-0.5, -0.5, width - 0.5, height - 0.5))
    if len(visible) == 0:
        return None
    x0, y0 = np.maximum(np.ceil(visible.min(axis=0) - 0.5), 0).astype(int).tolist()
    x1, y1 = np.minimum(np.floor(visible.max(axis=0) + 0.5) + 1, frame_size).astype(int).tolist()

    seen = np.vstack((visible, visible.mean(axis=0)))
    frame_to_picture = np.linalg.inv(picture_to_frame)
    frame_to_picture /= np.append(seen[-1], 1) @ frame_to_picture[2]
    texels = np.array(picture_size, np.float64)
    sampling = Sampling(frame_to_picture, texels, *_taps(_texels_per_pixel(frame_to_picture, texels, seen)))
    levels = sampling.level(seen)
    edges, thickness = _edges(shape)
    ramp = 1 + min(feather, thickness / 2)
    return Raster((x0, y0, x1, y1), edges, ramp, sampling, (float(levels.min()), float(levels.max())))


def _taps(jacobians: Array) -> tuple[Array, Array]:
    """Taps (n, 2) and the footprint each leaves (2, 2), from the jacobians (m, 2, 2) over the drawn shape.

    The taps span what the footprint is longer than round, so nothing jumps when a moving quad needs one more of them.
    """
    longer, shorter = _axes(jacobians)
    stretch = float(np.clip((longer / np.maximum(shorter, 1.0)).max(), 1.0, MODEL.max_taps))
    metric = (np.swapaxes(jacobians, -1, -2) @ jacobians).sum(axis=0)  # the most minified places weigh most
    angle = 0.5 * np.arctan2(2 * metric[0, 1], metric[0, 0] - metric[1, 1])
    axis = np.array([np.cos(angle), np.sin(angle)])
    n = max(1, int(np.ceil(stretch - 0.4)))
    reach = (1 - 1 / stretch) / 2 if n > 1 else 0.0
    footprint = MODEL.crispness * np.column_stack((axis / stretch, (-axis[1], axis[0])))
    return np.linspace(-reach, reach, n)[:, None] * axis, footprint


def _edges(shape: Array) -> tuple[Array, float]:
    """Inward distance to each side of a convex quad, (4, 3) rows (a, b, c), and the quad's width at its thinnest."""
    sides = np.roll(shape, -1, axis=0) - shape
    lengths = np.linalg.norm(sides, axis=1)
    enclosed = area(shape)
    normals = np.column_stack((-sides[:, 1], sides[:, 0])) * (np.sign(enclosed) / lengths[:, None])
    return np.column_stack((normals, -(normals * shape).sum(axis=1))), float(abs(enclosed) / lengths.max())


def _texels_per_pixel(frame_to_picture: Array, texels: Array, points: Array) -> Array:
    """d(texel) / d(frame pixel) at points (..., 2), of shape (..., 2, 2)."""
    return derivative(frame_to_picture, points, MODEL.min_weight) * texels[:, None]


def _axes(jacobians: Array) -> tuple[Array, Array]:
    """Longer and shorter singular value of matrices (..., 2, 2): what they stretch a pixel to."""
    xx, xy, yx, yy = (jacobians[..., i, j] for i in (0, 1) for j in (0, 1))
    a, b, c = xx**2 + yx**2, xx * xy + yx * yy, xy**2 + yy**2
    mean, spread = (a + c) / 2, np.hypot((a - c) / 2, b)
    return np.sqrt(mean + spread), np.sqrt(np.maximum(mean - spread, 0.0))
