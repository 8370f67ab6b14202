"""Where an ad goes in a frame, how its edge fades and how finely it is sampled: all that the compositors share.

A compositor only samples and blends. The rest is decided here, in float64, so that OpenGL and OpenCV draw the same:

- coverage: every edge gives a ramp over the signed distance to it, in frame pixels; opposite ramps overlap and the two
  pairs multiply, which is the exact area for an upright rectangle, down to slivers thinner than a pixel;
- sampling: some taps along the direction in which the ad is most minified, each trilinear between two levels of an
  image pyramid. The level follows, pixel by pixel, the footprint on the ad of what the taps leave to one sample, which
  is nearly round; so a slanted surface neither flickers on its far side nor smears.
"""

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import InputError

Image = NDArray[np.uint8]
Floats = NDArray[np.float64]
Region = tuple[float, float, float, float]
"""(u0, v0, u1, v1): the part of the ad laid on the quad's corners, 0..1 across it; beyond 0..1 it is transparent."""

WHOLE: Region = (0.0, 0.0, 1.0, 1.0)
MAX_TAPS = 8  # more slant than this is blurred a little
CRISPNESS = 2**-0.25  # footprints are taken this much smaller, which comes closest to the exact mean over each pixel
TINY_W = 1e-6  # homogeneous weights are about 1 on the quad; this small is at the horizon, never a drawn pixel


@dataclass(frozen=True)
class Sampling:
    """Where on the ad the pixels of a frame look, and how closely; x, y are frame pixels."""

    frame_to_ad: Floats  # (3, 3): (x, y, 1) -> (u, v, 1) * w, u and v in 0..1 across the ad, w about 1 and positive
    texels: Floats  # (2,): the ad's width and height
    taps: Floats  # (n, 2): offsets at which the ad is sampled, to be averaged
    squeeze: Floats  # (2, 2): columns are the two steps in the frame that span the footprint of one tap

    def level(self, points: Floats) -> Floats:
        """Pyramid level at `points` (..., 2), of shape (...): log2 of the length of a tap's footprint in texels."""
        longer, _ = _axes(_jacobians(self.frame_to_ad, self.texels, points) @ self.squeeze)
        return np.clip(np.log2(np.maximum(longer, TINY_W)), 0.0, np.log2(self.texels.max()))


@dataclass(frozen=True)
class Placement:
    """How one ad is drawn into one frame; x, y are frame pixels."""

    box: tuple[int, int, int, int]  # x0, y0, x1, y1: the pixels touched, ends exclusive, inside the frame
    edges: Floats  # (4, 3): rows (a, b, c), a*x + b*y + c is the distance inward from an edge
    ramp: float  # pixels over which coverage rises from 0 to 1, from half a pixel outside an edge
    sampling: Sampling
    levels: tuple[float, float]  # lowest and highest pyramid level over the drawn pixels


def place(
    frame_size: tuple[int, int], ad_size: tuple[int, int], quad: Floats, region: Region = WHOLE, feather: float = 0.0
) -> Placement | None:
    """Work out the placement of an ad, or None where there is nothing to draw.

    Args:
        frame_size, ad_size: (width, height) in pixels.
        quad: (4, 2) frame pixels, the corners TL, TR, BR, BL of the region.
        region: the part of the ad that the corners take.
        feather: width in frame pixels over which the edge fades inward; half the drawn shape's width at most is used.

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

    # What lies beyond the ad is transparent, so the shape to draw is the part of the quad that has some ad on it.
    left, top, right, bottom = max(u0, 0.0), max(v0, 0.0), min(u1, 1.0), min(v1, 1.0)
    if not is_drawable(quad) or left >= right or top >= bottom:
        return None
    corners_to_unit = np.array([[1 / (u1 - u0), 0, -u0 / (u1 - u0)], [0, 1 / (v1 - v0), -v0 / (v1 - v0)], [0, 0, 1]])
    ad_to_frame = unit_to_quad(quad) @ corners_to_unit
    shape = _project(ad_to_frame, np.array([[left, top], [right, top], [right, bottom], [left, bottom]]))
    width, height = frame_size
    visible = _clip(shape, (-0.5, -0.5, width - 0.5, height - 0.5)) if is_drawable(shape) else shape[:0]
    if len(visible) == 0:
        return None
    x0, y0 = np.maximum(np.ceil(visible.min(axis=0) - 0.5), 0).astype(int).tolist()
    x1, y1 = np.minimum(np.floor(visible.max(axis=0) + 0.5) + 1, frame_size).astype(int).tolist()

    seen = np.vstack((visible, visible.mean(axis=0)))
    frame_to_ad: Floats = np.linalg.inv(ad_to_frame)
    frame_to_ad /= np.append(seen[-1], 1) @ frame_to_ad[2]
    texels = np.array(ad_size, np.float64)
    sampling = Sampling(frame_to_ad, texels, *_taps(_jacobians(frame_to_ad, texels, seen)))
    levels = sampling.level(seen)
    edges, thickness = _edges(shape)
    ramp = 1 + min(feather, thickness / 2)
    return Placement((x0, y0, x1, y1), edges, ramp, sampling, (float(levels.min()), float(levels.max())))


def is_drawable(quad: Floats) -> bool:
    """Whether a quad (4, 2) can be a picture seen in perspective: finite, strictly convex, not below half a pixel.

    One with a corner behind the camera projects to a concave or self-crossing quad, so it is told apart here too.
    """
    if not np.isfinite(quad).all():
        return False
    sides = np.roll(quad, -1, axis=0) - quad
    turns = _cross(sides, np.roll(sides, -1, axis=0))  # twice the area of each corner's triangle
    turns = turns * np.sign(turns.sum())
    return bool(abs(_area(quad)) >= 0.5 and turns.min() > 1e-3 * turns.max())


def unit_to_quad(quad: Floats) -> Floats:
    """Homography (3, 3) from the unit square (0,0), (1,0), (1,1), (0,1) to the corners of a convex quad (4, 2)."""
    p0, p1, p2, p3 = quad
    skew = p0 - p1 + p2 - p3
    along, down = p1 - p2, p3 - p2
    g, h = _cross(skew, down) / _cross(along, down), _cross(along, skew) / _cross(along, down)
    x, y = np.column_stack((p1 - p0 + g * p1, p3 - p0 + h * p3, p0))
    return np.array([x, y, [g, h, 1.0]])


def check_frame(frame: Image) -> None:
    """Raise InputError unless the frame can be drawn into."""
    if frame.dtype != np.uint8 or frame.ndim != 3 or frame.shape[2] != 3 or frame.size == 0:
        raise InputError(f"a frame must be uint8 (height, width, 3), got {frame.dtype} {frame.shape}")
    if not (frame.flags.c_contiguous and frame.flags.writeable):
        raise InputError("a frame must be C-contiguous and writeable: pass a copy")


class Pyramid:
    """An ad as RGBA with premultiplied alpha, and its halved versions, made when asked for.

    Averaging premultiplied pixels keeps the hidden colour of transparent ones from showing as a fringe.
    An ad with a side over `max_side` is shrunk to it first.
    """

    def __init__(self, ad: Image, max_side: int) -> None:
        if ad.dtype != np.uint8 or ad.ndim != 3 or ad.shape[2] not in (3, 4) or ad.size == 0:
            raise InputError(f"an ad must be uint8 (height, width, 3 or 4), got {ad.dtype} {ad.shape}")
        self.ad = ad  # keeps the array alive, so that identity stays a sound test for "the same ad"
        self.opaque = ad.shape[2] == 3
        largest = _premultiplied(ad)
        if max(ad.shape[:2]) > max_side:
            factor = max_side / max(ad.shape[:2])
            largest = _shrink(largest, int(ad.shape[1] * factor), int(ad.shape[0] * factor))
        self._levels = [largest]
        self.size = (largest.shape[1], largest.shape[0])

    def level(self, index: int) -> Image:
        """Level `index`, (h, w, 4): half the size of the one before it, rounded down; level 0 is the ad."""
        while len(self._levels) <= index:
            height, width = self._levels[-1].shape[:2]
            self._levels.append(_shrink(self._levels[-1], width // 2, height // 2))
        return self._levels[index]


def _premultiplied(ad: Image) -> Image:
    """RGBA with colour times alpha, from RGB or straight RGBA."""
    if ad.shape[2] == 3:
        return np.asarray(cv2.cvtColor(ad, cv2.COLOR_RGB2RGBA), np.uint8)
    alpha = ad[..., 3]
    weights = cv2.merge((alpha, alpha, alpha, np.full_like(alpha, 255)))
    return np.asarray(cv2.multiply(ad, weights, scale=1 / 255), np.uint8)


def _shrink(image: Image, width: int, height: int) -> Image:
    size = max(1, width), max(1, height)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def _taps(jacobians: Floats) -> tuple[Floats, Floats]:
    """Taps (n, 2) and the footprint each leaves (2, 2), from the jacobians (m, 2, 2) over the drawn shape.

    The taps span what the footprint is longer than round, so nothing jumps when a moving quad needs one more of them.
    """
    longer, shorter = _axes(jacobians)
    stretch = float(np.clip((longer / np.maximum(shorter, 1.0)).max(), 1.0, MAX_TAPS))
    metric = (np.swapaxes(jacobians, -1, -2) @ jacobians).sum(axis=0)  # the most minified places weigh most
    angle = 0.5 * np.arctan2(2 * metric[0, 1], metric[0, 0] - metric[1, 1])
    axis = np.array([np.cos(angle), np.sin(angle)])
    n = max(1, int(np.ceil(stretch - 0.4)))
    reach = (1 - 1 / stretch) / 2 if n > 1 else 0.0
    squeeze = CRISPNESS * np.column_stack((axis / stretch, (-axis[1], axis[0])))
    return np.linspace(-reach, reach, n)[:, None] * axis, squeeze


def _edges(shape: Floats) -> tuple[Floats, float]:
    """Inward distance to each side of a convex quad, (4, 3) rows (a, b, c), and the quad's width at its thinnest."""
    sides = np.roll(shape, -1, axis=0) - shape
    lengths = np.linalg.norm(sides, axis=1)
    area = _area(shape)
    normals = np.column_stack((-sides[:, 1], sides[:, 0])) * (np.sign(area) / lengths[:, None])
    return np.column_stack((normals, -(normals * shape).sum(axis=1))), float(abs(area) / lengths.max())


def _jacobians(frame_to_ad: Floats, texels: Floats, points: Floats) -> Floats:
    """d(texel) / d(frame pixel) at points (..., 2), of shape (..., 2, 2)."""
    u_v_w = points @ frame_to_ad[:, :2].T + frame_to_ad[:, 2]
    w = np.maximum(u_v_w[..., 2], TINY_W)[..., None]
    uv = u_v_w[..., :2] / w
    slopes = frame_to_ad[:2, :2] - uv[..., :, None] * frame_to_ad[2, :2]
    return np.asarray(slopes * (texels[:, None] / w[..., None]), np.float64)


def _axes(jacobians: Floats) -> tuple[Floats, Floats]:
    """Longer and shorter singular value of matrices (..., 2, 2): what they stretch a pixel to."""
    xx, xy, yx, yy = (jacobians[..., i, j] for i in (0, 1) for j in (0, 1))
    a, b, c = xx**2 + yx**2, xx * xy + yx * yy, xy**2 + yy**2
    mean, spread = (a + c) / 2, np.hypot((a - c) / 2, b)
    return np.sqrt(mean + spread), np.sqrt(np.maximum(mean - spread, 0.0))


def _clip(polygon: Floats, bounds: tuple[float, float, float, float]) -> Floats:
    """The part of a convex polygon (n, 2) inside x0, y0, x1, y1 (Sutherland and Hodgman), (m, 2), empty if none."""
    x0, y0, x1, y1 = bounds
    for normal, offset in (((1, 0), -x0), ((0, 1), -y0), ((-1, 0), x1), ((0, -1), y1)):
        kept: list[Floats] = []
        inside = polygon @ np.array(normal) + offset
        ring = [*zip(polygon, inside, strict=True)]
        for (a, a_in), (b, b_in) in pairwise([*ring, *ring[:1]]):
            if a_in >= 0:
                kept.append(a)
            if (a_in >= 0) != (b_in >= 0):
                kept.append(a + (b - a) * (a_in / (a_in - b_in)))
        polygon = np.array(kept).reshape(-1, 2)
    return polygon


def _project(homography: Floats, points: Floats) -> Floats:
    x_y_w = points @ homography[:, :2].T + homography[:, 2]
    return np.asarray(x_y_w[:, :2] / x_y_w[:, 2:], np.float64)


def _cross(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], np.float64)


def _area(quad: Floats) -> float:
    """Signed area, positive where the corners run clockwise on the screen."""
    return float(_cross(quad[2] - quad[0], quad[3] - quad[1])) / 2
