"""The plane map: what surrounds a target on the same plane, learnt while the target itself is well seen.

A board around a poster or a wall around a window moves with the homography of the target; a tree behind it does not.
Cell by cell the map keeps how surely the surroundings do. Where the target is hidden or blurred, its pose is found by
those that do.

The map starts as what the reference frame shows, and grows: what lay outside that frame, or behind something that went
away, takes its texture from later ones, placed by the target itself. What agrees is not taken anew, so the map does not
drift.
"""

from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from ..alignment.agreement import CELLS, cell_means
from ..alignment.lucas_kanade import Level
from ..alignment.refinement import NO_BLUR
from ..imaging.arrays import Array, Floats, Grey, Image, Mask
from ..imaging.homography import from_corners, transform, translation
from ..imaging.observation import Observation
from ..imaging.pyramid import Pyramid
from ..imaging.quads import mean_size, outline
from ..imaging.regions import EVERYWHERE, Region
from .texture import Texture

Value = TypeVar("Value", np.bool_, np.float32)


@dataclass(frozen=True)
class PlaneMapModel:
    """Constants of the plane map; px are those of its crop, of which the target's longer side has `target_side_px`."""

    # The crop.
    target_side_px: int = 80
    min_cell_px: int = 3  # sides of a cell
    margin_cells: int = 8  # around the target, of which eight make its side: the map is three times as large
    max_stretch: float = 2.5  # of the depth at the map's corners to that at the target's centre: no horizon in sight
    blur_px: float = 1.0  # standard deviation of the Gaussian that reference frame and frames are blurred by
    points: int = 6000  # that are compared

    # Which cells have texture to judge by.
    min_shown: float = 0.99  # share of a cell that the reference frame shows
    min_gradient: float = 0.01  # mean square gradient of the normalised picture, per px^2

    # Which cells move with the target.
    unknown: float = 0.4  # how surely a cell does so before it was looked at
    min_correlation: float = 0.6  # with the reference frame
    max_offset_px: float = 0.5  # of a cell's picture from where the pose has it
    offset_ridge: float = 0.02  # mean square gradient, below which a cell's offset is drawn to zero
    gain: float = 0.25  # by a frame in which a cell moved with the target, of what it lacks to 1
    loss: float = 0.4  # by one in which it did not, of what it has

    # Growth, in frames in which the target is surely seen.
    unproven: float = 0.1  # how surely a cell moves with the target whose texture is new: two frames have to prove it
    growth_interval: int = 5  # frames in which there is something to take, to one in which it is taken
    max_taken_variance_px2: float = 1.0  # of the standard crop: a frame that is blurrier gives no texture
    frame_margin_px: int = 2  # at the edge of a frame, that is not taken from it
    # Frames in a row in which a cell did not agree, from which it may be something in front, and gives way to what is
    # seen now; each time that it does they double, since what moves behind the plane would do so for ever.
    patience: int = 10
    max_agreed: float = 0.1  # share of the frames in which it was seen, up to which a cell gives way: what agreed stays

    # Alignment.
    trusted: float = 0.35  # from which a cell is taken to lie on the plane
    min_cells: int = 6  # that are trusted and seen; with fewer, no pose is told
    min_agreement: float = 0.5  # share of them, for a pose to be believed
    steps: int = 3  # each with the frame rectified anew
    settled_px: float = 0.3  # of the standard crop, corner motion under which the next step would not tell more
    clear_quantile: float = 0.9  # of the cells' correlations: what a clear cell reaches in this frame's blur and noise
    min_clear_correlation: float = 0.6  # that clear cells reach once the crop is nearly aligned
    distrusted_ratio: float = 0.7  # of a cell's correlation to a clear one's, up to which it does not count
    trusted_ratio_range: float = 0.15  # above that, over which it comes to count in full
    min_matched_variance_px2: float = 1.0  # of the standard crop: less blur is not matched
    # Standard deviation that the plane's being a little bent adds to the eight parameters of a pose, px at the edge of
    # the standard crop.
    bent_deviation_px: tuple[float, ...] = (0.8, 0.8, 0.8, 0.8, 0.8, 0.8, 0.4, 0.4)

    unsure_brightness: float = 0.25  # of cells in the map's picture that do not lie on the plane


MODEL = PlaneMapModel()
BENT_COVARIANCE = np.diag(np.square(MODEL.bent_deviation_px))


class MapPose(NamedTuple):
    """Where its surroundings have a target.

    Attributes:
        homography: (3, 3) reference frame to this one.
        covariance, measured: (8, 8) of it, with and without what was expected, as `Alignment` tells them.
        agreement: share of the cells on the plane that agree, of those that are seen, 0..1.
    """

    homography: Array
    covariance: Array
    measured: Array
    agreement: float


class PlaneMap:
    """What surrounds one target, and how surely it moves with it; it learns.

    Attributes:
        standard_side: px, of the crop in whose pixels covariances are told.
        margin: cells around the target.
        level: the map as it is compared, the target in its middle.
        texture: the map's picture.
        coplanar: (n, n) 0..1, how surely each cell moves with the target.
        seen, agreed: (n, n) in how many frames each cell was looked at while it learnt, and agreed.
    """

    def __init__(
        self,
        frame: Observation,
        quad: Array,
        standard_side: int,
        region: Region = EVERYWHERE,
        known: Image | None = None,
    ) -> None:
        """Args:
        frame: the reference frame.
        quad: (4, 2) the target's corners in it, px.
        standard_side: px, of the crop in whose pixels covariances are told.
        region: what a user says of where tracking may look; what it includes is taken to lie on the plane.
        known: (H, W) 255 where the reference frame shows the plane; None: maybe anywhere.
        """
        self._quad = quad
        self.standard_side = standard_side
        size = self.size(MODEL.target_side_px)
        self.margin = margin_around(quad, *size)
        usable = known if region.is_everywhere else region.mask(*frame.colour.size)
        if usable is not None and known is not None:
            usable = usable & known
        self.level = level = Level(
            frame.grey, quad, size, MODEL.blur_px, standard_side, MODEL.points, self.margin, usable
        )
        n = level.cells
        picture = frame.colour.crop(level.to_template, level.width, level.height)
        self.texture = Texture(picture, level.raw, level.shown, n)
        self._prepare_judgement()
        self._allowed = self._region_mask(region)
        self._around: Mask = np.ones((n, n), bool)
        inner = slice(self.margin, n - self.margin)
        self._around[inner, inner] = False
        is_given = region.include is not None
        self.coplanar: Floats = np.full((n, n), 1 if is_given else MODEL.unknown, np.float32)
        self._given: Mask = np.full((n, n), is_given)  # cells that need not prove to lie on the plane
        self.seen, self.agreed = np.zeros((n, n), np.int32), np.zeros((n, n), np.int32)
        self._failed = np.zeros((n, n), np.int32)  # in a row
        self._patience = np.full((n, n), MODEL.patience, np.int32)
        self._waited = 0  # frames with something to take
        self._missing = self._find_missing()

    @property
    def corners(self) -> Array:
        """The map's corners (4, 2), px of the reference frame; they may lie outside."""
        return transform(self.level.to_template, outline(self.level.width, self.level.height))

    def size(self, longest: int) -> tuple[int, int]:
        """Width and height of the target, px, in a crop in which its longer side is about so many."""
        return target_size(self._quad, longest)

    def look(self, frame: Observation, homography: Array, learn: bool, blur: Array = NO_BLUR) -> Mask:
        """Which cells (n, n) around the target a frame shows just where a pose (3, 3) has them.

        Args:
            learn: whether the pose was found by the target itself, so that these cells prove to move with it, and the
                map may grow.
            blur: (2, 2) px^2 of the standard crop, by which the frame is blurrier than the reference frame.
        """
        level, n = self.level, self.level.cells
        search = level.rectify(frame.grey, homography)
        error = search - level.template
        along = np.array([cell_means(g * error, n) for g in self._gradient])
        offset = np.linalg.norm(np.einsum("ij...,j...->i...", self._inverse, along), axis=0)
        agrees = (level.correlation(search) > MODEL.min_correlation) & (offset < MODEL.max_offset_px)
        inside = self._wholly_in(frame, homography)
        judged = self._textured & self._around & inside
        if learn:
            self._learn(judged, agrees)
            if np.abs(blur).max() < MODEL.max_taken_variance_px2:
                self._grow(frame, homography, inside, judged & agrees)
        return np.asarray(judged & agrees)

    def trust(self, shown: Mask, target: Floats) -> Floats:
        """Weights (m, m) of the map's parts: of the cells around that are shown (n, n), and of the target's (p, p)."""
        parts = len(target) // CELLS  # to a cell
        trust = self.coplanar * (shown & self._is_trusted)
        trust = np.repeat(np.repeat(trust, parts, 0), parts, 1).astype(np.float32)
        inner = slice(self.margin * parts, (self.margin + CELLS) * parts)
        trust[inner, inner] = target
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
        is_blurred = np.abs(blur).max() > MODEL.min_matched_variance_px2
        level = self.level.matched(blur) if is_blurred else self.level
        trusted = self._is_trusted & (seen > 0.5)

        def weigh(search: Grey, pose: Array) -> Floats | None:
            known = trusted & level.in_frame(frame, pose)
            if known.sum() < MODEL.min_cells:
                return None
            return _trust(level.correlation(search), known) * self.coplanar * seen * known

        found = level.settle(frame, start, start, covariance, weigh, MODEL.steps, MODEL.settled_px)
        if found is None:
            return None
        pose, fit = found
        known = trusted & level.in_frame(frame, pose)
        if known.sum() < MODEL.min_cells:
            return None
        agrees = level.correlation(level.rectify(frame, pose)) > MODEL.min_correlation
        agreement = float(agrees[known].mean())
        if agreement < MODEL.min_agreement:
            return None
        return MapPose(pose, fit.covariance + BENT_COVARIANCE, fit.measured + BENT_COVARIANCE, agreement)

    @property
    def picture(self) -> Image:
        """The map as an RGB picture (h, w, 3), rectified; dim where it does not prove to lie on the plane."""
        sure = np.where(self._around, self.coplanar * self._is_trusted, 1).astype(np.float32)
        brightness = MODEL.unsure_brightness + (1 - MODEL.unsure_brightness) * self._pixels(sure)[..., None]
        return np.asarray(self.texture.picture * brightness * self.texture.known[..., None], np.uint8)

    def _learn(self, judged: Mask, agrees: Mask) -> None:
        """Takes into account which of the cells (n, n) that can be judged in a frame agree with it."""
        change = np.where(agrees, MODEL.gain * (1 - self.coplanar), -MODEL.loss * self.coplanar)
        self.coplanar += np.where(judged & ~self._given, change, 0).astype(np.float32)
        self.seen += judged
        self.agreed += judged & agrees
        self._failed = np.where(judged, np.where(agrees, 0, self._failed + 1), self._failed)

    def _grow(self, frame: Observation, homography: Array, inside: Mask, agree: Mask) -> None:
        """Takes the texture that is missing from a frame at a pose (3, 3), once in a while.

        Args:
            inside, agree: (n, n) the cells that lie in the frame, and those around the target that agree.
        """
        texture = self.texture
        refuted = (self._failed >= self._patience) & (self.agreed <= MODEL.max_agreed * self.seen) & inside
        missing = self._missing & inside
        if not (refuted | missing).any():
            return
        self._waited += 1
        if self._waited < MODEL.growth_interval:
            return
        self._waited = 0
        taken = self._allowed & (self._pixels(refuted) | (self._pixels(missing) & ~texture.known))
        overlap = texture.known & self._pixels((agree | ~self._around) & inside & ~refuted)
        crop = frame.colour.crop(homography @ self.level.to_template, self.level.width, self.level.height)
        texture.take(crop, taken, overlap)
        self.level = self.level.with_template(texture.grey, texture.comparable)
        self._prepare_judgement()
        self._missing = self._find_missing()
        new = refuted | missing
        self._patience[refuted] *= 2
        self._given &= ~new
        self.coplanar[new] = MODEL.unproven
        for count in (self.seen, self.agreed, self._failed):
            count[new] = 0

    def _prepare_judgement(self) -> None:
        """Finds which cells have texture, and what they are judged by."""
        level, n = self.level, self.level.cells
        gy, gx = (np.asarray(g, np.float32) for g in np.gradient(level.template))
        self._gradient = gx, gy
        xx, xy, yy = (cell_means(g, n) for g in (gx * gx, gx * gy, gy * gy))
        shown = cell_means(self.texture.known.astype(np.float32), n) > MODEL.min_shown
        self._textured: Mask = (xx + yy > MODEL.min_gradient) & shown
        a, d = xx + MODEL.offset_ridge, yy + MODEL.offset_ridge
        self._inverse = np.array([[d, -xy], [-xy, a]]) / (a * d - xy * xy)  # (2, 2, n, n)

    def _region_mask(self, region: Region) -> Mask:
        """The map's pixels (h, w) that tracking may look at, in the reference frame or beyond it."""
        level = self.level
        if region.is_everywhere:
            return np.ones((level.height, level.width), bool)
        first, last = np.floor(self.corners.min(0)), np.ceil(self.corners.max(0))
        to_mask = translation(*-first)
        mask = region.transformed(to_mask).mask(*(int(length) + 1 for length in last - first))
        size = level.width, level.height
        return np.asarray(
            cv2.warpPerspective(mask, to_mask @ level.to_template, size, flags=cv2.WARP_INVERSE_MAP) == 255
        )

    def _wholly_in(self, frame: Observation, homography: Array) -> Mask:
        """Which of the cells (n, n) lie in a frame with all that they have, by a pose (3, 3)."""
        level, n = self.level, self.level.cells
        y, x = np.mgrid[: n + 1, : n + 1] / n
        corners = np.stack([x * level.width, y * level.height], -1) - 0.5
        to_frame = homography @ level.to_template
        is_in = frame.colour.shows(to_frame, corners, MODEL.frame_margin_px)
        return np.asarray(is_in[1:, 1:] & is_in[1:, :-1] & is_in[:-1, 1:] & is_in[:-1, :-1])

    def _pixels(self, cells: NDArray[Value]) -> NDArray[Value]:
        """Values of the cells (n, n) at the map's pixels (h, w)."""
        n = self.level.cells
        return np.repeat(np.repeat(cells, self.level.height // n, 0), self.level.width // n, 1)

    def _find_missing(self) -> Mask:
        """Which cells (n, n) around the target some of is not known, though it may be looked at."""
        missing = cell_means((self._allowed & ~self.texture.known).astype(np.float32), self.level.cells) > 0
        return np.asarray(missing & self._around)

    @property
    def tells(self) -> bool:
        """Whether enough around the target lies on its plane for a pose to be told by it."""
        return int(self._is_trusted.sum()) >= MODEL.min_cells

    @property
    def _is_trusted(self) -> Mask:
        """Which cells (n, n) around the target have texture and are taken to lie on its plane."""
        return np.asarray(self._textured & self._around & (self.coplanar > MODEL.trusted))


def _trust(correlation: Floats, known: Mask) -> Floats:
    """Weights (n, n) of the cells for alignment; where too few of those known agree, all count: not aligned yet."""
    clear = float(np.quantile(correlation[known], MODEL.clear_quantile))
    everywhere = np.ones_like(correlation)
    if clear < MODEL.min_clear_correlation:
        return everywhere
    trust = np.clip((correlation / clear - MODEL.distrusted_ratio) / MODEL.trusted_ratio_range, 0, 1)
    return trust if trust[known].sum() >= MODEL.min_cells else everywhere


def target_size(quad: Array, longest: int) -> tuple[int, int]:
    """Width and height, px, of a target (4, 2) in a rectified crop in which its longer side is about so many."""
    mean = mean_size(quad)
    cell = np.maximum(np.round(longest * mean / mean.max() / CELLS), MODEL.min_cell_px)
    width, height = (CELLS * int(side) for side in cell)
    return width, height


def margin_around(quad: Array, width: int, height: int) -> int:
    """How many cells around a target of so many px the map may show before the plane tilts too far away."""
    corners = outline(width, height)
    middle = corners.mean(0)
    to_quad = from_corners(corners, quad)
    for margin in range(MODEL.margin_cells, 0, -1):
        wider = middle + (corners - middle) * (1 + 2 * margin / CELLS)
        depth = (wider @ to_quad[2, :2] + to_quad[2, 2]) / (middle @ to_quad[2, :2] + to_quad[2, 2])
        if depth.min() > 1 / MODEL.max_stretch and depth.max() < MODEL.max_stretch:
            return margin
    return 0
