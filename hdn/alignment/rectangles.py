"""Likely rectangles in a frame, seen in perspective: screens, posters, pages, to be offered for tracking.

Straight edges are found (LSD: Grompone von Gioi et al., 2012) and joined to lines, and each two lines that run about
across make, with two that run about along, a quad. A quad is good where there is an edge along all of its sides, which
ends at the corners, and where its inside differs from what lies around it.
"""

from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ..imaging.arrays import Array, Floats, Image
from ..imaging.observation import Observation
from ..imaging.quads import LIMITS, cross, is_convex
from .snapping import snap


@dataclass(frozen=True)
class RectanglesModel:
    """Constants of the search; lengths are shares of the longer side of the frame, px those of what is searched."""

    searched_px: int = 640  # longer side that the frame is searched at
    min_segment: float = 0.02
    join_px: float = 2.0  # that a segment may lie beside a line, to belong to it
    join_degrees: float = 4.0
    most_lines: int = 32  # of each direction, the longest
    split_degrees: float = 50.0  # from the axis that lines of a direction may run
    min_overlap: float = 0.3  # share of the shorter of two lines, that lies beside the other
    min_side: float = 0.05
    max_side_ratio: float = 6.0  # of the longer to the shorter sides
    max_opposite_ratio: float = 2.2  # of two opposite sides' lengths
    corner_degrees: float = 40.0  # that a corner may be off a right angle
    beyond_ratio: float = 0.2  # of a side, looked at beyond its ends
    beyond_weight: float = 0.35  # of the support there, against a quad
    large: float = 0.15  # size from which a quad is not too small to be likely
    size_weight: float = 0.15  # for a large one
    min_slope_grey_per_px: float = 4.0
    along: float = 0.85  # cosine between the slope and the side's normal, from which there is an edge
    min_support: float = 0.55  # share of each side
    min_score: float = 0.45
    same_ratio: float = 0.12  # of the quad's size, within which two corners are the same
    most: int = 8


MODEL = RectanglesModel()


class Rectangle(NamedTuple):
    """A likely rectangle.

    Attributes:
        corners: (4, 2) px of the frame: top-left, top-right, bottom-right, bottom-left.
        score: 0..1, how likely.
    """

    corners: Array
    score: float


def find_rectangles(frame: Observation, model: RectanglesModel = MODEL) -> list[Rectangle]:
    """The likely rectangles in a frame, best first, at most `model.most`; their corners are snapped to edges."""
    image, scale = _reduced(frame.image, model.searched_px)
    quads, scores = _candidates(image, model)
    order = np.argsort(-scores)
    kept: list[tuple[Array, float]] = []
    for i in order[scores[order] >= model.min_score]:
        if not any(_is_of(quads[i], other, model) for other, _ in kept):
            kept.append((quads[i], float(scores[i])))
        if len(kept) == model.most:
            break
    return [Rectangle(_exact(frame, (quad + 0.5) * scale - 0.5), min(score, 1.0)) for quad, score in kept]


def _reduced(image: Image, longest: int) -> tuple[Image, float]:
    """The frame, small enough to be searched, and how many px of the frame one of its is."""
    scale = max(1.0, max(image.shape[:2]) / longest)
    size = round(image.shape[1] / scale), round(image.shape[0] / scale)
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA) if scale > 1 else image, image.shape[1] / size[0]


def _slopes(image: Image) -> Floats:
    """(H, W, 2) the steepest slope of any colour within a pixel, grey levels per px."""
    smooth = cv2.GaussianBlur(image, (0, 0), 0.8).astype(np.float32)
    slopes = np.stack([cv2.Sobel(smooth, cv2.CV_32F, *d, ksize=3, scale=1 / 8) for d in ((1, 0), (0, 1))], -1)
    best = np.take_along_axis(slopes, np.square(slopes).sum(-1).argmax(2)[..., None, None], 2)[:, :, 0]
    steep, found = np.square(best).sum(-1), best.copy()
    most = steep.copy()
    for dy, dx in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        other, theirs = np.roll(best, (dy, dx), (0, 1)), np.roll(steep, (dy, dx), (0, 1))
        better = theirs > most
        found[better], most[better] = other[better], theirs[better]
    return found


# ---- lines ----


def _lines(image: Image, model: RectanglesModel) -> tuple[Array, Array]:
    """The longest lines (n, 4), as x0, y0, x1, y1 of their ends, that run about across, and about along."""
    red, _, blue = cv2.split(image)
    segments = []
    for channel in (red, blue):  # hardly an edge is seen in neither
        found = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD).detect(channel)[0]
        if found is not None:
            segments.append(found.reshape(-1, 4).astype(np.float64))
    if not segments:
        return np.empty((0, 4)), np.empty((0, 4))
    all_segments = np.concatenate(segments)
    ways = all_segments[:, 2:] - all_segments[:, :2]
    length = np.linalg.norm(ways, axis=1)
    long = length > model.min_segment * max(image.shape[:2])
    all_segments, ways, length = all_segments[long], ways[long], length[long]
    angle = np.degrees(np.arctan2(ways[:, 1], ways[:, 0])) % 180
    across = np.minimum(angle, 180 - angle) < model.split_degrees
    upright = np.abs(angle - 90) < model.split_degrees
    return _joined(all_segments[across], model), _joined(all_segments[upright], model)


def _joined(segments: Array, model: RectanglesModel) -> Array:
    """Segments that lie on one line joined, the longest first."""
    order = np.argsort(-np.linalg.norm(segments[:, 2:] - segments[:, :2], axis=1))
    left = segments[order]
    lines, lengths = [], []
    while len(left):
        seed = left[0]
        way = (seed[2:] - seed[:2]) / np.linalg.norm(seed[2:] - seed[:2])
        normal = np.array([-way[1], way[0]])
        ends = left.reshape(-1, 2, 2)
        beside = np.abs((ends - seed[:2]) @ normal).max(1)
        ways = ends[:, 1] - ends[:, 0]
        turned = np.abs(cross(ways, way)) / np.linalg.norm(ways, axis=1)
        own = (beside < model.join_px) & (turned < np.sin(np.radians(model.join_degrees)))
        own[0] = True
        points = ends[own].reshape(-1, 2)
        at = (points - seed[:2]) @ way
        line = np.concatenate([seed[:2] + at.min() * way, seed[:2] + at.max() * way])
        # What is drawn twice counts once: several colours show the same edge.
        covered = np.zeros(int(at.max() - at.min()) + 2, bool)
        for a, b in np.sort(at.reshape(-1, 2) - at.min(), axis=1):
            covered[int(a) : int(b) + 1] = True
        lines.append(line)
        lengths.append(covered.sum())
        left = left[~own]
    best = sorted(range(len(lines)), key=lambda i: -lengths[i])[: model.most_lines]
    return np.array([lines[i] for i in best]).reshape(-1, 4)


class _Edges:
    """How much of lines runs along edges: (n,) lines by their ends (n, 4), each sampled at every pixel."""

    def __init__(self, lines: Array, slope: Floats, model: RectanglesModel) -> None:
        height, width = slope.shape[:2]
        self._begin = lines[:, :2]
        way = lines[:, 2:] - lines[:, :2]
        self._way = way / np.linalg.norm(way, axis=1, keepdims=True)
        self._zero = int(np.hypot(height, width)) + 2  # the sample of a line's own beginning
        along = np.arange(-self._zero, self._zero + 1)
        points = np.rint(self._begin[:, None] + along[:, None] * self._way[:, None]).astype(np.intp)
        x, y = points[..., 0], points[..., 1]
        seen = slope[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)]
        steep = np.sqrt(np.square(seen).sum(-1))
        across = np.abs(cross(seen, self._way[:, None]))
        there = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        edge = there & (steep > model.min_slope_grey_per_px) & (across > model.along * steep)
        self._sum = np.pad(np.cumsum(edge, axis=1), ((0, 0), (1, 0)))

    def place(self, points: Array) -> Array:
        """Where points (n, m, 2) lie along the lines: (n, m), px from their beginnings."""
        return np.asarray(np.einsum("nmk,nk->nm", points - self._begin[:, None], self._way))

    def share(self, line: NDArray[np.intp], a: Array, b: Array) -> Array:
        """The share of the stretches a to b (k,), px, of lines (k,), along which there is an edge."""
        limit = self._sum.shape[1] - 1
        first, last = (np.clip(np.rint(np.c_[a, b]).astype(np.intp) + self._zero, 0, limit)).T
        low, high = np.minimum(first, last), np.maximum(first, last)
        return np.asarray((self._sum[line, high] - self._sum[line, low]) / np.maximum(high - low, 1))


def _candidates(image: Image, model: RectanglesModel) -> tuple[Array, Array]:
    """Quads (n, 4, 2) between two lines across and two upright ones, and how likely each is a rectangle (n,)."""
    lines = across, upright = _lines(image, model)
    if len(across) < 2 or len(upright) < 2:
        return np.empty((0, 4, 2)), np.empty(0)
    slope = _slopes(image)
    a_edges, u_edges = (_Edges(each, slope, model) for each in lines)
    meet = np.cross(_homogeneous(across)[:, None], _homogeneous(upright)[None])  # each with each
    points = meet[..., :2] / np.where(np.abs(meet[..., 2:]) < 1e-9, np.nan, meet[..., 2:])
    points = np.nan_to_num(points, nan=-1e6)
    on_a, on_u = a_edges.place(points), u_edges.place(points.swapaxes(0, 1))
    a, u = (_pairs(each, model.min_overlap) for each in (across[:, ::2], upright[:, 1::2]))
    # Of each line, between each two that it crosses: most stretches are no edge, and are no side of anything.
    along_a = _shares(a_edges, on_a, u) >= model.min_support
    along_u = _shares(u_edges, on_u, a) >= model.min_support
    i, j = np.nonzero(along_a[a].all(1) & along_u[u].all(1).T)
    top, bottom, left, right = a[i, 0], a[i, 1], u[j, 0], u[j, 1]
    quads = np.stack([points[top, left], points[top, right], points[bottom, right], points[bottom, left]], 1)
    fits = _plausible(quads, image, model)
    quads, top, bottom, left, right = (each[fits] for each in (quads, top, bottom, left, right))
    if not len(quads):
        return np.empty((0, 4, 2)), np.empty(0)
    sides = [
        (a_edges, top, on_a[top, left], on_a[top, right]),
        (a_edges, bottom, on_a[bottom, left], on_a[bottom, right]),
        (u_edges, left, on_u[left, top], on_u[left, bottom]),
        (u_edges, right, on_u[right, top], on_u[right, bottom]),
    ]
    support = np.stack([edges.share(line, begin, end) for edges, line, begin, end in sides], 1)
    beyond = np.mean([_beyond(*side, model) for side in sides], axis=0)
    lengths = np.linalg.norm(np.roll(quads, -1, 1) - quads, axis=2)
    size = np.sqrt(lengths[:, [0, 2]].mean(1) * lengths[:, [1, 3]].mean(1)) / max(image.shape[:2])
    score = (support.mean(1) + support.min(1)) / 2 - model.beyond_weight * beyond
    score = score * np.clip(size / model.large, 0.5, 1) + model.size_weight * np.minimum(size, 0.6)
    return _ordered(quads), score


def _shares(edges: _Edges, crossings: Array, pairs: NDArray[np.intp]) -> Array:
    """The share of edge (n, k) along lines, between each pair (k, 2) of those that they cross at (n, m), px."""
    n, k = len(crossings), len(pairs)
    line = np.repeat(np.arange(n), k)
    begin, end = (crossings[:, pairs[:, side]].ravel() for side in (0, 1))
    return edges.share(line, begin, end).reshape(n, k)


def _pairs(extents: Array, min_overlap: float) -> NDArray[np.intp]:
    """Those pairs (k, 2) of lines that lie side by side: extents (n, 2) are where each begins and ends."""
    low, high = extents.min(1), extents.max(1)
    pairs = np.array([*combinations(range(len(extents)), 2)], np.intp)
    one, other = pairs.T
    shared = np.minimum(high[one], high[other]) - np.maximum(low[one], low[other])
    return pairs[shared > min_overlap * np.minimum((high - low)[one], (high - low)[other])]


def _beyond(edges: _Edges, line: NDArray[np.intp], begin: Array, end: Array, model: RectanglesModel) -> Array:
    """The share of what lies beyond both ends of sides (k,) along which there is an edge."""
    more = model.beyond_ratio * (end - begin)
    gap = 2 * np.sign(more)  # px: corners are blurred
    return (edges.share(line, begin - gap, begin - gap - more) + edges.share(line, end + gap, end + gap + more)) / 2


def _homogeneous(lines: Array) -> Array:
    """Lines (n, 3) through the ends (n, 4)."""
    ones = np.ones((len(lines), 1))
    return np.cross(np.hstack([lines[:, :2], ones]), np.hstack([lines[:, 2:], ones]))


def _ordered(quads: Array) -> Array:
    """The quads with the upper side first, its left corner first."""
    flip = quads[:, :2, 1].sum(1) > quads[:, 2:, 1].sum(1)
    quads = np.where(flip[:, None, None], quads[:, [3, 2, 1, 0]], quads)
    flip = quads[:, [0, 3], 0].sum(1) > quads[:, [1, 2], 0].sum(1)
    return np.asarray(np.where(flip[:, None, None], quads[:, [1, 0, 3, 2]], quads))


def _plausible(quads: Array, image: Image, model: RectanglesModel) -> NDArray[np.bool_]:
    """Which of the quads (n, 4, 2) lie in the frame, and may be a rectangle in perspective."""
    height, width = image.shape[:2]
    inside = ((quads >= 0) & (quads <= [width - 1, height - 1])).all((1, 2))
    sides = np.roll(quads, -1, 1) - quads
    lengths = np.maximum(np.linalg.norm(sides, axis=2), 1e-9)
    turns = cross(sides, np.roll(sides, -1, 1)) / (lengths * np.roll(lengths, -1, 1))
    turns = turns * np.sign(turns.sum(1, keepdims=True))  # they may run either way round
    opposite = np.maximum(lengths[:, :2] / lengths[:, 2:], lengths[:, 2:] / lengths[:, :2])
    means = (lengths[:, :2] + lengths[:, 2:]) / 2
    return np.asarray(
        inside
        & (turns > np.cos(np.radians(model.corner_degrees))).all(1)
        & (lengths.min(1) > model.min_side * max(width, height))
        & (opposite.max(1) < model.max_opposite_ratio)
        & (means.max(1) < model.max_side_ratio * means.min(1))
    )


def _is_of(quad: Array, better: Array, model: RectanglesModel) -> bool:
    """Whether a quad is about the same as a better one, or a part of it, as are columns of a page."""
    size = np.sqrt(np.linalg.norm(better[1] - better[0]) * np.linalg.norm(better[3] - better[0]))
    same = np.linalg.norm(quad - better, axis=1) < model.same_ratio * size
    if same.all():
        return True
    return bool(same.sum() >= 2 and cv2.pointPolygonTest(better.astype(np.float32), quad.mean(0).tolist(), False) >= 0)


def _exact(frame: Observation, quad: Array) -> Array:
    """The quad (4, 2) at the edges of the frame itself."""
    height, width = frame.image.shape[:2]
    quad = np.clip(quad, 0, [width - 1, height - 1])
    if not is_convex(quad) or np.linalg.norm(np.roll(quad, -1, 0) - quad, axis=1).min() < LIMITS.min_side_px:
        return quad
    return snap(frame, quad).quad
