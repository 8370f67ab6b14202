"""The plane map: what surrounds a target on the same plane, learnt while the target itself is well seen.

A board around a poster or a wall around a window moves with the homography of the target; a tree behind it does not.
Cell by cell the map keeps how surely the surroundings do. Where the target is hidden or blurred, its pose is found by
those that do. They are compared with the reference frame, so the map does not drift.
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from .alignment.agreement import CELLS, cell_means
from .alignment.lucas_kanade import Level
from .imaging.arrays import Array, Floats, Image
from .imaging.homography import from_corners, normalised
from .imaging.observation import Observation
from .imaging.pyramid import Pyramid
from .imaging.quads import outline
from .imaging.regions import EVERYWHERE, Region


@dataclass(frozen=True)
class PlaneMapModel:
    """Constants of the plane map; px are those of its crop, of which the target's longer side has `target_side_px`."""

    # The crop.
    target_side_px: int = 80
    margin_cells: int = 8  # around the target, of which eight make its side: the map is three times as large
    max_stretch: float = 2.5  # of the depth at the map's corners to that at the target's centre: no horizon in sight
    blur_px: float = 1.0  # standard deviation of the Gaussian that template and frames are blurred by
    points: int = 6000  # that are compared

    # Which cells have texture to judge by: mean square gradient of the normalised picture.
    min_gradient: float = 0.01

    # Which cells moved with the target.
    unknown: float = 0.4  # how surely a cell is taken to do so before it was looked at
    min_correlation: float = 0.6
    max_offset_px: float = 0.5  # of a cell's picture from where the pose has it
    offset_ridge: float = 0.02  # mean square gradient, below which a cell's offset is drawn to zero
    gain: float = 0.25  # of a frame in which a cell moved with the target
    loss: float = 0.4  # of one in which it did not

    # Alignment.
    min_matched_variance_px2: float = 1.0
    steps: int = 3  # each with the frame rectified anew
    settled_px: float = 0.3
    trusted: float = 0.35  # from which a cell is taken to lie on the plane
    min_cells: int = 6  # with texture, that are trusted; with fewer, no pose is told
    min_agreement: float = 0.5  # of the trusted cells, for the pose to be believed
    clear_quantile: float = 0.9
    min_clear_correlation: float = 0.6
    distrusted_ratio: float = 0.7
    trusted_ratio_range: float = 0.15
    # Standard deviation of the eight parameters that the plane's being a little bent adds, px at the edge of the
    # standard crop.
    bent_deviation_px: tuple[float, ...] = (0.8, 0.8, 0.8, 0.8, 0.8, 0.8, 0.4, 0.4)


MODEL = PlaneMapModel()
BENT_COVARIANCE = np.diag(np.square(MODEL.bent_deviation_px))


class MapPose(NamedTuple):
    """Where the surroundings have the target.

    Attributes:
        homography: (3, 3) reference frame to this one.
        covariance: (8, 8) of it, as `Alignment` tells it.
        agreement: share of the cells on the plane that agree, 0..1.
    """

    homography: Array
    covariance: Array
    agreement: float


class PlaneMap:
    """What surrounds one target, and how surely it moves with it.

    Attributes:
        coplanar: (n, n) 0..1, how surely each cell moves with the target; 0 in the target itself.
    """

    def __init__(self, frame: Observation, quad: Array, standard_side: int, region: Region = EVERYWHERE) -> None:
        """Args:
        frame: the reference frame.
        quad: (4, 2) the target's corners in it, px.
        standard_side: px, of the crop in whose pixels covariances are told.
        region: what a user says of where tracking may look; what it includes is taken to lie on the plane.
        """
        sides = np.linalg.norm(np.roll(quad, -1, 0) - quad, axis=1)
        lengths = np.array([sides[0] + sides[2], sides[1] + sides[3]]) / 2
        size = np.maximum(np.round(MODEL.target_side_px * lengths / lengths.max() / CELLS), 3).astype(int) * CELLS
        w, h = int(size[0]), int(size[1])
        self._quad = quad
        margin = _margin(quad, w, h)
        usable = None if region.is_everywhere else region.mask(*frame.colour.size)
        self.level = Level(frame.grey, quad, (w, h), MODEL.blur_px, standard_side, MODEL.points, margin, usable)
        cells = self.level.cells
        self.coplanar: Floats = np.full((cells, cells), MODEL.unknown, np.float32)
        if region.include is not None:
            self.coplanar[:] = 1
        self._is_given = region.include is not None
        self.margin, self.lengths = margin, lengths
        self._around = np.ones((cells, cells), bool)
        self._around[margin : cells - margin, margin : cells - margin] = False
        shown = cell_means(self.level.shown.astype(np.float32), cells) > 0.99
        template = self.level.template
        gy, gx = (np.asarray(g, np.float32) for g in np.gradient(template))
        self._gx, self._gy = gx, gy
        xx, xy, yy = (cell_means(g, cells) for g in (gx * gx, gx * gy, gy * gy))
        ridge = MODEL.offset_ridge
        determinant = (xx + ridge) * (yy + ridge) - xy * xy
        self._inverse = (yy + ridge) / determinant, -xy / determinant, (xx + ridge) / determinant
        self._textured = (xx + yy > MODEL.min_gradient) & shown & self._around

    def look(self, frame: Pyramid, homography: Array, learn: bool) -> Floats:
        """Which cells (n, n), 0 or 1, a grey frame shows where a pose (3, 3) has them.

        Args:
            learn: whether the target is well seen there, so that the cells tell whether they moved with it.
        """
        search = self.level.rectify(frame, homography)
        cells = self.level.cells
        correlation = self.level.correlation(search)
        error = search - self.level.template
        ex, ey = cell_means(self._gx * error, cells), cell_means(self._gy * error, cells)
        a, b, c = self._inverse
        offset = np.hypot(a * ex + b * ey, b * ex + c * ey)
        moved_along = (correlation > MODEL.min_correlation) & (offset < MODEL.max_offset_px)
        judged = self._textured & self.level.in_frame(frame, homography)
        if learn and not self._is_given:
            change = np.where(moved_along, MODEL.gain * (1 - self.coplanar), -MODEL.loss * self.coplanar)
            self.coplanar = self.coplanar + np.where(judged, change, 0).astype(np.float32)
        return np.asarray(moved_along & judged, np.float32)

    def trust(self, shown: Floats, visibility: Floats) -> Floats:
        """Weights (m, m) of all parts, by the cells that are shown (n, n) and the parts of the target seen (p, p)."""
        scale = len(visibility) // CELLS
        trust = (self.coplanar * (self.coplanar > MODEL.trusted) * shown).astype(np.float32)
        trust = np.repeat(np.repeat(trust, scale, 0), scale, 1)
        inner = slice(self.margin * scale, (self.margin + CELLS) * scale)
        trust[inner, inner] = visibility
        return trust

    def align(self, frame: Pyramid, start: Array, covariance: Array, seen: Floats, blur: Array) -> MapPose | None:
        """Finds the target's pose in a grey frame by what surrounds it.

        Args:
            start: (3, 3) reference frame to this one, the pose that is expected.
            covariance: (8, 8) of it, as `Alignment` tells it.
            seen: (n, n) 0..1, how probably each cell is seen.
            blur: (2, 2) px^2 of the standard crop, by which the frame is blurrier than the reference frame.

        Returns:
            None where too little of the surroundings is known or seen to tell.
        """
        level, pose = self._matched(blur), start
        for _ in range(MODEL.steps):
            search = level.rectify(frame, pose)
            known = self._textured & (self.coplanar > MODEL.trusted) & (seen > 0.5) & level.in_frame(frame, pose)
            if known.sum() < MODEL.min_cells:
                return None
            trust = self._trust(level.correlation(search), known) * self.coplanar * seen * known
            prior = level.from_template @ np.linalg.inv(pose) @ start @ level.to_template
            warp, found = level.align(search, trust, prior, covariance)
            pose = normalised(pose @ level.to_template @ warp @ level.from_template)
            if not np.isfinite(pose).all():
                return None
            if level.corner_motion(warp) < MODEL.settled_px:
                break
        search = level.rectify(frame, pose)
        known = self._textured & (self.coplanar > MODEL.trusted) & (seen > 0.5) & level.in_frame(frame, pose)
        if known.sum() < MODEL.min_cells:
            return None
        agreement = float((level.correlation(search)[known] > MODEL.min_correlation).mean())
        if agreement < MODEL.min_agreement:
            return None
        return MapPose(pose, found + BENT_COVARIANCE, agreement)

    def _matched(self, blur: Array) -> Level:
        if float(np.abs(blur).max()) < MODEL.min_matched_variance_px2:
            return self.level
        return self.level.matched(blur)

    def picture(self, frame: Image) -> Image:
        """The map as an RGB picture of the reference frame, dim where it is not sure to lie on the plane."""
        level = self.level
        crop = Pyramid(frame).crop(level.to_template, level.width, level.height)
        sure = np.where(self._around, self.coplanar * self._textured, 1).astype(np.float32)
        sure = cv2.resize(sure, (level.width, level.height), interpolation=cv2.INTER_NEAREST)[..., None]
        return np.asarray(crop * (0.25 + 0.75 * sure), np.uint8)

    def _trust(self, correlation: Floats, known: Array) -> Floats:
        clear = float(np.quantile(correlation[known], MODEL.clear_quantile))
        if clear < MODEL.min_clear_correlation:
            return np.ones_like(correlation)
        trust = np.clip((correlation / clear - MODEL.distrusted_ratio) / MODEL.trusted_ratio_range, 0, 1)
        return np.asarray(trust if (trust * known).sum() >= MODEL.min_cells else np.ones_like(trust), np.float32)


def _margin(quad: Array, width: int, height: int) -> int:
    """How many cells around a target of so many px the map may show before the plane tilts too far away."""
    to_quad = from_corners(outline(width, height), quad)
    for margin in range(MODEL.margin_cells, 0, -1):
        beyond = np.array([width, height]) * margin / CELLS
        corners = outline(width, height)
        wide = corners + np.sign(corners - corners.mean(0)) * beyond
        depth = wide @ to_quad[2, :2] + to_quad[2, 2]
        middle = corners.mean(0) @ to_quad[2, :2] + to_quad[2, 2]
        if (depth / middle > 1 / MODEL.max_stretch).all() and (depth / middle < MODEL.max_stretch).all():
            return margin
    return 0
