"""Photometric refinement: sub-pixel alignment of the rectified target to the template, from coarse to fine.

It is anchored to the template: errors do not add up over frames. `lucas_kanade` aligns the crops.
"""

from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from ..imaging.arrays import Array, Floats, Grey, Image, Mask
from ..imaging.blur import relative_blur, spectral_blur
from ..imaging.homography import derivative, normalised, transform
from ..imaging.observation import Observation
from ..imaging.photometry import quantile
from ..imaging.quads import mean_size, outline, side
from .agreement import CELLS, Agreement, cell_means
from .border import UNCONSTRAINED, Border
from .lucas_kanade import Level


@dataclass(frozen=True)
class RefinementModel:
    """Constants of the refinement. The *standard crop* is the rectified crop in which frames are judged."""

    # Sizes: the longer sides of the crops.
    standard_side_px: int = 160  # of the standard crop, at most; less where the target is smaller
    min_side_px: float = 24.0  # of the standard crop, however small the target
    coarse_ratio: float = 0.5  # of the coarse crop to the standard one
    max_fine_ratio: float = 2.0  # of the fine crop to the standard one, as far as the reference frame shows as much
    min_fine_shown: float = 0.7  # size of the target in the frame, as a share of the fine crop's, for that to be used
    min_cell_px: int = 3  # sides of a cell in any crop

    # Per level: standard deviation of the blur over both images, px of the crop, and pixels that are compared.
    coarse_blur_px: float = 1.0
    standard_blur_px: float = 0.8
    fine_blur_px: float = 0.8
    coarse_points: int = 2000
    standard_points: int = 4000
    fine_points: int = 8000

    # Steps.
    max_standard_steps: int = 3  # each with the frame rectified anew
    settled_px: float = 0.3  # of the standard crop, corner motion under which the next step would not tell more
    # How far off a start may be where nothing better is known: standard deviation of the eight parameters, px at the
    # edge of the standard crop; affine four, translation free, perspective.
    start_deviation_px: tuple[float, ...] = (5.0, 5.0, 100.0, 5.0, 5.0, 100.0, 2.0, 2.0)

    # Which cells count: by their correlation with the template.
    clear_quantile: float = 0.9  # of the cells' correlations: what a clear cell reaches in this frame's blur and noise
    min_clear_correlation: float = 0.7  # that clear cells reach once the crop is nearly aligned
    distrusted_ratio: float = 0.75  # of a cell's correlation to a clear one's, up to which it does not count
    trusted_ratio_range: float = 0.15  # above that, over which it comes to count in full
    min_trusted: float = 0.1  # share of the cells that have to count; with fewer all do

    # Texture: mean absolute difference of a cell's pixels to their surroundings.
    side_to_surroundings: float = 14.0  # the crop's longer side, to the deviation of the Gaussian for the surroundings
    textured_grey: float = 2.0  # grey levels, from which texture is not mere noise
    textured_ratio: float = 0.5  # or to the target's typical cell, of a target that has little texture
    min_usable: float = 0.5  # share of a cell that may be looked at
    # To the typical cell: with less, light that moves over a cell may pass for something that hides it.
    telling_ratio: float = 0.5
    # Deviation of the corners, as a share of the target's size, that its texture leaves even where all of it is seen,
    # from which it is vague, and its border counts as well: three times that of usual prints.
    vague_deviation: float = 0.005

    # Blur of the frame against the template.
    equal_correlation: float = 0.97  # of the typical cell, from which both are taken to be equally sharp
    min_matched_variance_px2: float = 0.3  # of the standard crop: less blur is not matched
    max_fine_variance_px2: float = 4.0  # of the standard crop: more blur leaves nothing finer to see
    # Of what the typical cell's correlation lacks to 1, that may be left after matching: noise gains a little as well.
    max_lack_left: float = 0.75


MODEL = RefinementModel()
ALL_VISIBLE: Floats = np.ones((CELLS, CELLS), np.float32)
START_COVARIANCE = np.diag(np.square(MODEL.start_deviation_px))
NO_BLUR: Array = np.zeros((2, 2))


@dataclass(frozen=True)
class Prior:
    """What is known of a target before a frame is looked at.

    Attributes:
        homography: (3, 3) the likeliest pose, template to frame.
        covariance: (8, 8) of it, as an alignment tells it.
        visibility: (n, n) 0..1, which parts of the target may be looked at.
        blur: (2, 2) px^2 of the standard crop, by which the frame is expected to be blurrier than the template.
    """

    homography: Array
    covariance: Array
    visibility: Floats
    blur: Array = field(default_factory=lambda: np.zeros((2, 2)))


@dataclass(frozen=True)
class Alignment:
    """Where a frame fits the template.

    Attributes:
        homography: (3, 3) template to frame.
        agreement: how well it fits there; judged before the last step, that moved the corners by `last_step_px`.
        covariance: (8, 8) of the warp's eight parameters, px^2 at the edge of the standard crop: how far open the prior
            and the visible part of the target leave them.
        last_step_px: how far the last step moved the corners, px of the standard crop.
        prior: what the alignment started from.
        blur: (2, 2) px^2 of the standard crop, covariance of the Gaussian by which the frame is blurrier than the
            template; negative where it is sharper; 0 where it makes no difference.
        border: share of the target's border that is there, where its texture is too little to place it; else 0.
    """

    homography: Array
    agreement: Agreement
    covariance: Array
    measured: Array
    last_step_px: float
    prior: Prior
    blur: Array = field(default_factory=lambda: np.zeros((2, 2)))
    border: float = 0.0


class Refiner:
    """Aligns frames to one template.

    Attributes:
        textured: (8, 8) which cells of the target have texture to compare.
        is_vague: whether that is so little that even all of it does not place the target well.
    """

    def __init__(self, frame: Observation, quad: Array, usable: Image | None = None) -> None:
        """Args:
        frame: the reference frame, which gives the template.
        quad: (4, 2) the target's corners in it, px.
        usable: (H, W) 255 where the reference frame may be looked at; None takes all of it.
        """
        self._quad = quad
        size = mean_size(quad)
        longest = max(MODEL.min_side_px, min(MODEL.standard_side_px, size.max()))
        fine_ratio = np.clip(size.max() / longest, 1, MODEL.max_fine_ratio)
        standard = _crop_size(size, longest)
        self._coarse, self._standard, self._fine = (
            Level(frame.grey, quad, crop_size, blur, max(standard), points, usable=usable)
            for crop_size, blur, points in (
                (_crop_size(size, longest * MODEL.coarse_ratio), MODEL.coarse_blur_px, MODEL.coarse_points),
                (standard, MODEL.standard_blur_px, MODEL.standard_points),
                (_crop_size(size, longest * fine_ratio), MODEL.fine_blur_px, MODEL.fine_points),
            )
        )
        least = self.deviation(np.eye(3), self._standard.best_covariance)
        self.is_vague = least > MODEL.vague_deviation * side(quad)
        borders = [Border(frame.colour, v.to_template, v.width, v.height) for v in (self._coarse, self._standard)]
        self._borders = borders if self.is_vague and all(border.is_distinct for border in borders) else []
        self._blurred: dict[tuple[int, bytes], Level] = {}
        raw = frame.grey.crop(self._standard.to_template, *standard).astype(np.float32)
        surroundings = cv2.GaussianBlur(raw, (0, 0), max(standard) / MODEL.side_to_surroundings)
        texture = cell_means(np.abs(raw - surroundings))
        typical = float(np.median(texture))
        shown = cell_means(self._standard.shown.astype(np.float32)) > MODEL.min_usable
        self.textured: Mask = shown & (texture > min(MODEL.textured_grey, MODEL.textured_ratio * typical))
        self._telling = self.textured & (texture > MODEL.telling_ratio * typical)

    def align(
        self,
        frame: Observation,
        start: Array,
        visibility: Floats = ALL_VISIBLE,
        covariance: Array = START_COVARIANCE,
    ) -> Alignment:
        """Finds the pose at which a frame fits the template, as far as the prior allows.

        Args:
            frame: the frame.
            start: (3, 3) template to frame, the pose that is expected.
            visibility: (8, 8) 0..1, which cells of the target may be looked at.
            covariance: (8, 8) of the expected pose, as an alignment tells it.
        """
        return self.align_finely(frame, self.align_roughly(frame, start, visibility, covariance))

    def align_roughly(
        self,
        frame: Observation,
        start: Array,
        visibility: Floats = ALL_VISIBLE,
        covariance: Array = START_COVARIANCE,
        blur: Array = NO_BLUR,
    ) -> Alignment:
        """As `align`, but for the last fractions of a pixel: enough to judge by, and far cheaper.

        Args:
            blur: (2, 2) px^2 of the standard crop, by which the frame is expected to be blurrier than the template.
        """
        prior = Prior(start, covariance, visibility, blur)
        coarse, standard = self._matched(self._coarse, blur), self._matched(self._standard, blur)
        alignment = self._step(coarse, frame, start, prior)
        for _ in range(MODEL.max_standard_steps):
            alignment = self._step(standard, frame, alignment.homography, prior)
            if alignment.last_step_px < MODEL.settled_px:
                break
        if self._borders:
            share = self._borders[-1].matching_share(frame.colour, alignment.homography)
            alignment = replace(alignment, border=share)
        return alignment

    def align_finely(self, frame: Observation, alignment: Alignment) -> Alignment:
        """Adds the last fractions of a pixel to what `align_roughly` found.

        It compares at the size at which the frame shows the target, and blurs the sharper of template and frame as
        the other is, if that makes them agree clearly better.
        """
        expected = alignment.prior.blur
        blur = self.relative_blur(frame, alignment)
        variance = _variance(blur)
        shown = side(transform(alignment.homography, self._quad))
        fine_side = np.sqrt(self._fine.width * self._fine.height)
        is_fine = shown > MODEL.min_fine_shown * fine_side and variance < MODEL.max_fine_variance_px2
        level = self._fine if is_fine else self._standard
        if variance > MODEL.min_matched_variance_px2:
            matched = self._step(self._standard.matched(blur), frame, alignment.homography, alignment.prior)
            lacking, before = (1 - _typical_correlation(a.agreement) for a in (matched, alignment))
            if lacking < MODEL.max_lack_left * before or (
                _variance(expected) > MODEL.min_matched_variance_px2 and lacking < before
            ):
                return replace(self._step(level.matched(blur), frame, matched.homography, alignment.prior), blur=blur)
        if _variance(expected) > MODEL.min_matched_variance_px2:
            return replace(
                self._step(self._standard.matched(expected), frame, alignment.homography, alignment.prior),
                blur=expected,
            )
        return self._step(level, frame, alignment.homography, alignment.prior) if is_fine else alignment

    def frame_blur(self, alignment: Alignment) -> Array:
        """The blur of an alignment in pixels of the frame about the target's middle: (2, 2) px^2."""
        to_frame = alignment.homography @ self._standard.to_template
        middle = np.array([(self._standard.width - 1) / 2, (self._standard.height - 1) / 2])
        stretch = derivative(to_frame, middle)
        return np.asarray(stretch @ alignment.blur @ stretch.T)

    @property
    def standard_side(self) -> int:
        """Longer side of the standard crop, px."""
        return max(self._standard.width, self._standard.height)

    def deviation(self, homography: Array, covariance: Array) -> float:
        """Standard deviation of the corners, px of the frame: the root of its mean square over them.

        Args:
            homography: (3, 3) the pose, template to frame.
            covariance: (8, 8) of it, as an alignment tells it.
        """
        return deviation_of(self.corner_covariance(homography, covariance))

    def corner_covariance(self, homography: Array, covariance: Array) -> Array:
        """Covariance (8, 8), px^2 of the frame, of the corners x0, y0, x1, y1 ...; arguments as `deviation`'s."""
        level = self._standard
        stretch = derivative(homography @ level.to_template, outline(level.width, level.height))
        motion = np.einsum("cij,cjp->cip", stretch, level.corners).reshape(8, 8)
        return np.asarray(motion @ covariance @ motion.T)

    def information(self, homography: Array, points: Array, variance: float) -> Array:
        """Information (8, 8) on a pose, to a covariance as an alignment tells it, of points that are matched there.

        Args:
            homography: (3, 3) the pose, template to frame.
            points: (N, 2) px of the template.
            variance: px^2 of the frame, of a coordinate of a point there.
        """
        at = transform(np.asarray(self._standard.from_template, np.float64), points)
        stretch = derivative(homography @ self._standard.to_template, at)
        motion = np.einsum("nij,njp->nip", stretch, self._standard.motion(at)).reshape(-1, 8)
        return np.asarray(motion.T @ motion / variance)

    def combined(
        self, homography: Array, covariance: Array, other: Array, other_covariance: Array
    ) -> tuple[Array, Array, float]:
        """Two estimates of one pose, (3, 3) with their covariances (8, 8), as one.

        Returns:
            Its homography and covariance, and the squared Mahalanobis distance between the two.
        """
        level = self._standard
        apart = level.parameters(level.from_template @ np.linalg.inv(homography) @ other @ level.to_template)
        gain = covariance @ np.linalg.inv(covariance + other_covariance)
        pose = normalised(homography @ level.to_template @ level.warp(gain @ apart) @ level.from_template)
        joint = covariance - gain @ covariance
        distance = float(apart @ np.linalg.inv(covariance + other_covariance) @ apart)
        return pose, (joint + joint.T) / 2, distance

    def agreement(self, frame: Observation, homography: Array) -> Agreement:
        """Compares a frame, rectified by a homography (3, 3), with the template."""
        return self._compare(self._standard, frame, homography)[1]

    def _step(self, level: Level, frame: Observation, homography: Array, prior: Prior) -> Alignment:
        """One alignment at one level, from a pose that the steps before led to."""
        search, agreement = self._compare(level, frame, homography)
        trust = _finer(self._trust(agreement.correlation), len(prior.visibility)) * prior.visibility
        constraint = UNCONSTRAINED
        if self._borders:
            border = self._borders[level is not self._coarse]
            constraint = border.constraint(frame.colour, homography, as_cells(prior.visibility))
        found, fit = level.step(search, homography, prior.homography, trust, prior.covariance, constraint)
        return Alignment(found, agreement, fit.covariance, fit.measured, level.corner_motion(fit.warp), prior)

    def _compare(self, level: Level, frame: Observation, homography: Array) -> tuple[Grey, Agreement]:
        search = level.rectify(frame.grey, homography)
        return search, Agreement(level.correlation(search), level.in_frame(frame.grey, homography), self.textured)

    def _matched(self, level: Level, blur: Array) -> Level:
        if _variance(blur) < MODEL.min_matched_variance_px2:
            return level
        key = (id(level), blur.tobytes())
        if key not in self._blurred:
            if len(self._blurred) > 8:
                self._blurred.clear()
            self._blurred[key] = level.matched(blur)
        return self._blurred[key]

    def likeness(self, frame: Observation, homography: Array, visibility: Floats, blur: Array) -> float:
        """Mean correlation of the visible cells, of a frame at a pose with the template blurred."""
        level = self._matched(self._coarse, blur)
        correlation = np.maximum(level.correlation(level.rectify(frame.grey, homography)), 0)
        weight = as_cells(visibility) * self.textured + 1e-6
        return float((correlation * weight).sum() / weight.sum())

    def spectral_blur(self, frame: Observation, homography: Array) -> Array:
        """Blur (2, 2) px^2 of the standard crop of a frame against the template, as `spectral_blur` tells it."""
        level = self._standard
        view = level.crop(frame.grey, homography)
        return spectral_blur(level.raw, view)

    def relative_blur(self, frame: Observation, alignment: Alignment) -> Array:
        """How much blurrier the frame shows the target than the template, (2, 2) px^2 of the standard crop.

        Zeros where both are equally sharp, or where the crop is not aligned.
        """
        correlation = alignment.agreement.correlation
        is_rough = self._clear_correlation(correlation) < MODEL.min_clear_correlation
        if is_rough or _typical_correlation(alignment.agreement) > MODEL.equal_correlation:
            return alignment.prior.blur
        visibility = alignment.prior.visibility
        trust = _finer(self._trust(correlation), len(visibility)) * visibility
        level = self._standard
        trusted = cv2.resize(trust, (level.width, level.height), interpolation=cv2.INTER_NEAREST)
        return relative_blur(
            level.raw, level.crop(frame.grey, alignment.homography), trusted, level.window, alignment.prior.blur
        )

    def _trust(self, correlation: Floats) -> Floats:
        """Weights (8, 8) of the cells for alignment; where hardly any agrees, all count: it is not aligned yet."""
        clear = self._clear_correlation(correlation)
        if clear < MODEL.min_clear_correlation:
            return np.ones_like(correlation)
        agree = np.clip((correlation / clear - MODEL.distrusted_ratio) / MODEL.trusted_ratio_range, 0, 1)
        # Beside an occluder a cell is half its, even where it agrees.
        apart = agree * cv2.erode(np.where(self._telling, agree, 1), np.ones((3, 3), np.uint8))
        for trust in (apart, agree):
            if trust.sum() > MODEL.min_trusted * trust.size:
                return np.asarray(trust, np.float32)
        return np.ones_like(correlation)

    def _clear_correlation(self, correlation: Floats) -> float:
        """How well a clear cell agrees, in this frame's blur and noise: the best cells (8, 8) show it."""
        return quantile(correlation[self.textured], MODEL.clear_quantile) if self.textured.any() else 0.0


def deviation_of(covariance: Array) -> float:
    """Standard deviation of corners by their covariance (8, 8): the root of its mean square over them."""
    return float(np.sqrt(np.trace(covariance) / 4))


def as_cells(parts: Floats) -> Floats:
    """A map (n, n) of the target, of any resolution, as (8, 8)."""
    if len(parts) == CELLS:
        return parts
    return np.asarray(cv2.resize(parts, (CELLS, CELLS), interpolation=cv2.INTER_AREA), np.float32)


def _finer(cells: Floats, parts: int) -> Floats:
    """A map (8, 8) of the target as (n, n), n parts along either side."""
    if len(cells) == parts:
        return cells
    return np.asarray(cv2.resize(cells, (parts, parts), interpolation=cv2.INTER_NEAREST), np.float32)


def _variance(blur: Array) -> float:
    """The largest variance of a blur (2, 2), px^2, along any direction."""
    return float(np.abs(np.linalg.eigvalsh(blur)).max())


def _typical_correlation(agreement: Agreement) -> float:
    """Median correlation of the cells that can be judged; 0 where there are none."""
    return float(np.median(agreement.correlation[agreement.visible])) if agreement.visible.any() else 0.0


def _crop_size(sides: Array, longest: float) -> tuple[int, int]:
    """Width and height of a crop, px, whose longer side is about so many: whole numbers of pixels to a cell."""
    width, height = (
        CELLS * max(MODEL.min_cell_px, round(side * longest / sides.max() / CELLS)) for side in sides.tolist()
    )
    return width, height
