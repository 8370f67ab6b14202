"""Inverse-compositional Lucas-Kanade (Baker and Matthews, 2004) over the eight parameters of a homography.

It compares locally normalised grey levels, which are free of gain and bias, so of uneven light too, and weighs them
robustly, so that an occluder or a glare does not pull.
"""

import copy
import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from ..imaging.arrays import Array, Floats, Grey, Image, Mask
from ..imaging.blur import blurred, equalising_blurs
from ..imaging.homography import from_corners, normalised, transform, warp_jacobian
from ..imaging.photometry import MAD_TO_DEVIATION, normalise, tukey
from ..imaging.pyramid import Pyramid
from ..imaging.quads import outline, square
from .agreement import CELLS, Cells
from .border import UNCONSTRAINED, WarpConstraint


@dataclass(frozen=True)
class LucasKanade:
    """Constants of the alignment at one level."""

    max_steps: int = 6  # after them the frame is rectified anew
    still_px: float = 0.02  # of the crop, that a step moves its edge by, under which the steps end
    noise_grey: float = 2.0  # grey levels, standard deviation of a pixel's noise, in a frame of usual contrast
    mismatch: float = 0.15  # normalised grey levels, deviation that light and blur leave even without noise
    outside: float = 1e3  # normalised grey levels: pixels outside the crop are taken for outliers
    # Pixels that share their errors, and count as one, on a crop of the standard size.
    pixels_per_error: float = 50
    window_ratio: float = 0.1  # half the window of the local normalisation, to the crop's longer side
    margin_px: int = 2  # at the crop's edge, where gradients see what lies outside
    cells_per_block: int = 2  # x 2 cells, a block of which gives its pixels of the strongest gradients
    worth_leaving_out: float = 0.8  # share of the pixels that have any trust, below which the others are left out
    min_relative_trust: float = 0.5  # to the most trusted cell, for a cell's pixels to tell the noise
    noise_floor: float = 0.05  # of the median pixel's certainty: least deviation of the residuals
    weak_prior: float = 1e-4  # px^-2: information that stands for what was expected, where only what is seen counts
    ridge: float = 1e-6  # on the information of a crop that is wholly seen, against templates without texture


MODEL = LucasKanade()


class Fit(NamedTuple):
    """How a frame lies on the template.

    Attributes:
        warp: (3, 3) pixels of the template's crop to those of the frame's.
        covariance: (8, 8) of its parameters, px^2 at the edge of the standard crop.
        measured: (8, 8) the same by what is seen alone, without what was expected.
    """

    warp: Array
    covariance: Array
    measured: Array


class Level:
    """The template at one scale, with its steepest-descent images.

    The *standard crop* is the rectified crop of the scale at which frames are judged: covariances, and how far a warp
    moves, are told in its pixels at every level.

    Attributes:
        width, height: of the crop, px.
        cells: the crop is a grid of so many cells along either side.
        to_template, from_template: (3, 3) the crop's pixels to the template's, and back.
        shown: (h, w) the pixels that may be compared: those that the reference frame shows, or that were added.
        raw: (h, w) the template at this scale, grey levels.
        template: (h, w) the same as it is compared: blurred and locally normalised.
        window: px, of the local normalisation.
        corners: (4, 2, 8) how the corners move with the eight parameters, px.
    """

    def __init__(
        self,
        frame: Pyramid,
        quad: Array,
        size: tuple[int, int],
        blur: float,
        standard_side: int,
        most_points: int,
        margin: int = 0,
        usable: Image | None = None,
    ) -> None:
        """Args:
        frame: grey pyramid of the reference frame.
        quad: (4, 2) the target's corners in it, px.
        size: width and height of the target in the crop, px, multiples of CELLS.
        blur: standard deviation of the Gaussian that template and frames are blurred by, px.
        standard_side: px of the standard crop's longer side.
        most_points: how many pixels are compared.
        margin: cells around the target that the crop shows as well.
        usable: (H, W) 255 where the reference frame may be looked at; None takes all of it.
        """
        w, h = size
        self.cells, beyond = CELLS + 2 * margin, np.array(size) * margin // CELLS
        self.width, self.height = w + 2 * int(beyond[0]), h + 2 * int(beyond[1])
        self.to_template = from_corners(outline(w, h) + beyond, quad)
        self.from_template = np.linalg.inv(self.to_template)
        self._blur, self.window = blur, 2 * round(max(w, h) * MODEL.window_ratio) + 1
        self.raw = self.crop(frame, np.eye(3))
        self._per_standard_pixel = max(w, h) / standard_side  # px of this crop
        self._frame_blur = np.zeros((2, 2))
        # Coordinates centred on the target, in units of half its longer side, keep the normal equations
        # well-conditioned, and parameters alike at every scale.
        self._scale = 2.0 / max(w, h)
        left, top = -self._scale * ((np.array(size) - 1) / 2 + beyond)
        self._to_unit = np.array([[self._scale, 0, left], [0, self._scale, top], [0, 0, 1.0]])
        self._from_unit = np.linalg.inv(self._to_unit)
        self._standard_pixel = 2.0 / standard_side  # in unit coordinates
        self._pixels_per_error = MODEL.pixels_per_error * self._per_standard_pixel**2
        self.corners = self.motion(transform(self._from_unit, square(1) * 2 * size / max(w, h)))
        y, x = (np.mgrid[: self.cells, : self.cells] + 0.5) / self.cells
        self._centres = np.stack([x * self.width, y * self.height], -1) - 0.5
        self._most_points = most_points
        whole = np.full(frame.levels[0].shape[:2], 255, np.uint8) if usable is None else usable
        shown = cv2.warpPerspective(whole, self.to_template, (self.width, self.height), flags=cv2.WARP_INVERSE_MAP)
        self.shown: Mask = shown == 255
        self._take_template(self.raw)

    def matched(self, covariance: Array) -> "Level":
        """This level for frames that are blurrier than the template by so much, (2, 2) px^2 of the standard crop."""
        level = copy.copy(self)
        of_template, level._frame_blur = equalising_blurs(covariance * self._per_standard_pixel**2)
        level._take_template(blurred(self.raw, of_template))
        # A streak of length l has a variance of l^2 / 12; pixels along it share their errors.
        apart = np.sqrt(self._pixels_per_error)
        streaks = np.sqrt(12 * np.abs(np.linalg.eigvalsh(covariance))) * self._per_standard_pixel
        level._pixels_per_error = float(np.prod(apart + streaks))
        return level

    def with_template(self, raw: Grey, shown: Mask) -> "Level":
        """This level with another template (h, w), grey levels, of which the pixels shown (h, w) may be compared."""
        level = copy.copy(self)
        level.raw, level.shown = raw, shown
        level._take_template(raw)
        return level

    def _take_template(self, raw: Grey) -> None:
        """Takes a template (h, w), grey, and makes its steepest-descent images."""
        self.template, deviation = self._normalised(raw)
        self._whole = Cells(self.template, self.cells)
        gy, gx = (np.asarray(g, np.float32) for g in np.gradient(self.template))
        # Only the pixels with the strongest gradients of each part say anything; fewer make it faster.
        strength = gx**2 + gy**2
        blocks = self.cells // MODEL.cells_per_block
        chosen = strength >= _local_threshold(strength, min(1.0, self._most_points / strength.size), blocks)
        beyond = cv2.erode(self.shown.astype(np.uint8), np.ones((2 * MODEL.margin_px + 1,) * 2, np.uint8)) == 0
        chosen[beyond] = False
        margin = MODEL.margin_px
        chosen[:margin], chosen[-margin:], chosen[:, :margin], chosen[:, -margin:] = False, False, False, False
        y, x = np.nonzero(chosen)
        self._points = np.stack([x, y, np.ones_like(x)], 1).astype(np.float32)
        self._values, self._at = self.template[y, x], (y, x)
        # Normalising amplifies the noise of what has little contrast.
        self._certainty = 1 / np.sqrt(MODEL.mismatch**2 + np.square(MODEL.noise_grey / deviation[y, x]))
        dx, dy = gx[y, x] / self._scale, gy[y, x] / self._scale
        u, v, _ = self._to_unit @ self._points.T
        self._jacobian = warp_jacobian(u, v, dx, dy).astype(np.float32)

    def crop(self, frame: Pyramid, homography: Array) -> Grey:
        """A grey frame rectified by a homography (3, 3), template to frame: (h, w) grey levels."""
        # Nothing outside the target and its margin is looked at: what lies there may move on its own.
        return frame.crop(homography @ self.to_template, self.width, self.height).astype(np.float32)

    def in_frame(self, frame: Pyramid, homography: Array) -> Mask:
        """Which of the cells (cells, cells) have their centre in a frame, by a pose (3, 3), template to frame."""
        return frame.shows(homography @ self.to_template, self._centres)

    def rectify(self, frame: Pyramid, homography: Array) -> Grey:
        """A frame (h, w) as it is compared with the template: rectified by a homography, blurred, normalised."""
        return self._normalised(blurred(self.crop(frame, homography), self._frame_blur))[0]

    def correlation(self, search: Grey) -> Floats:
        """Correlation (cells, cells) of the template's cells with those of a frame as `rectify` makes it."""
        return self._whole.correlation(search)

    def align(
        self,
        search: Grey,
        trust: Floats,
        prior_warp: Array,
        prior_covariance: Array,
        constraint: WarpConstraint = UNCONSTRAINED,
    ) -> Fit:
        """Aligns a rectified frame with the template.

        Args:
            search: (h, w) what `rectify` made.
            trust: (n, n) weights of parts of the crop, 0..1; n is any number.
            prior_warp: (3, 3) the warp that is likeliest without a look.
            prior_covariance: (8, 8) of its parameters, px^2 at the edge of the standard crop.
            constraint: what the target's border tells of the warp.
        """
        y, x = self._at
        trusted = trust[y * len(trust) // self.height, x * len(trust) // self.width]
        points, values, certainty, jacobian = self._points, self._values, self._certainty, self._jacobian
        counts = trusted > 0
        if counts.mean() < MODEL.worth_leaving_out:  # where much is hidden, what does not count is not looked at
            trusted = trusted[counts]
            points, values, certainty, jacobian = (a[counts] for a in (points, values, certainty, jacobian))
        tells_noise = trusted > MODEL.min_relative_trust * trusted.max(initial=0)
        if not tells_noise.any():
            unknown = np.eye(8) / MODEL.weak_prior
            return Fit(prior_warp, prior_covariance, unknown)
        prior = np.linalg.inv(prior_covariance) / self._standard_pixel**2
        information = prior + constraint.information
        weighted_mean = prior @ self._parameters(prior_warp) + constraint.weighted_mean
        warp = np.eye(3)
        noise_floor = MODEL.noise_floor * float(np.median(self._certainty))
        for _ in range(MODEL.max_steps):
            at = points @ warp.T.astype(np.float32)
            at = at[:, :2] / at[:, 2:]
            seen = cv2.remap(
                search, at[:, None], None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=MODEL.outside
            )
            error = seen[:, 0] - values
            certain = error * certainty
            noise = max(MAD_TO_DEVIATION * _median(np.abs(certain[tells_noise])), noise_floor)
            weight = tukey(certain / noise) * trusted * np.square(certainty)
            weighted = jacobian * weight[:, None]
            # What the visible part cannot tell stays near what is expected.
            scale = self._pixels_per_error * noise**2
            hessian = (weighted.T @ jacobian).astype(np.float64) + scale * information
            right = (weighted.T @ error).astype(np.float64)
            right += scale * (information @ self._parameters(warp) - weighted_mean)
            step = np.linalg.solve(hessian, right)
            increment = np.append(step, 0).reshape(3, 3) + np.eye(3)
            warp = normalised(warp @ self._from_unit @ np.linalg.inv(increment) @ self._to_unit)
            if np.abs(step).max() * max(self.width, self.height) / 2 < MODEL.still_px:
                break
        pixel = self._standard_pixel
        seen_only = hessian + scale * (MODEL.weak_prior / pixel**2 * np.eye(8) - prior)
        return Fit(warp, *(scale * np.linalg.inv(h) / pixel**2 for h in (hessian, seen_only)))

    def step(
        self,
        search: Grey,
        pose: Array,
        expected: Array,
        trust: Floats,
        covariance: Array,
        constraint: WarpConstraint = UNCONSTRAINED,
    ) -> tuple[Array, Fit]:
        """The pose (3, 3), template to frame, at which a frame fits the template, from one at which it was rectified.

        Args:
            search: (h, w) what `rectify` made of the frame at that pose.
            pose: (3, 3).
            expected: (3, 3) the pose that is likeliest without a look; covariance: (8, 8) of it, as `align` takes it.
            trust, constraint: as `align` takes them.
        """
        warp = self.from_template @ np.linalg.inv(pose) @ expected @ self.to_template
        fit = self.align(search, trust, warp, covariance, constraint)
        return normalised(pose @ self.to_template @ fit.warp @ self.from_template), fit

    def settle(
        self,
        frame: Pyramid,
        pose: Array,
        expected: Array,
        covariance: Array,
        weigh: Callable[[Grey, Array], Floats | None],
        steps: int,
        settled_px: float,
    ) -> tuple[Array, Fit] | None:
        """Steps, each with a grey frame rectified anew, until they move the pose no more.

        Args:
            pose, expected, covariance: as `step` takes them.
            weigh: the trust in parts of the crop, by the rectified frame and its pose; None ends it without a result.
            steps: at most.
            settled_px: px of the standard crop, motion of the crop's corners by a step under which it is the last.
        """
        for _ in range(steps):
            search = self.rectify(frame, pose)
            trust = weigh(search, pose)
            if trust is None:
                return None
            pose, fit = self.step(search, pose, expected, trust, covariance)
            if not np.isfinite(pose).all():
                return None
            if self.corner_motion(fit.warp) < settled_px:
                break
        return pose, fit

    @property
    def best_covariance(self) -> Array:
        """Covariance (8, 8), as `align` tells it, where all is seen in as much noise as frames may have."""
        certain = self._jacobian.astype(np.float64) * self._certainty[:, None]
        covariance = np.linalg.inv(certain.T @ certain + MODEL.ridge * np.eye(8))
        return np.asarray(self._pixels_per_error * covariance / self._standard_pixel**2)

    def corner_motion(self, warp: Array) -> float:
        """How far a warp (3, 3) moves the crop's corners along x or y, at most, px of the standard crop."""
        corners = outline(self.width, self.height)
        return float(np.abs(transform(warp, corners) - corners).max()) / self._per_standard_pixel

    def motion(self, points: Array) -> Array:
        """How points (N, 2) of the crop move with the eight parameters, (N, 2, 8); both in px of the standard crop."""
        u, v = transform(self._to_unit, points).T
        one, zero = np.ones(len(points)), np.zeros(len(points))
        return np.stack([warp_jacobian(u, v, one, zero), warp_jacobian(u, v, zero, one)], 1)

    def parameters(self, warp: Array) -> Array:
        """The eight parameters of a warp (3, 3) of the crop, px at the edge of the standard crop."""
        return self._parameters(warp) / self._standard_pixel

    def warp(self, parameters: Array) -> Array:
        """The warp (3, 3) of eight parameters: the inverse of `parameters`."""
        unit = np.append(parameters * self._standard_pixel, 0).reshape(3, 3) + np.eye(3)
        return normalised(self._from_unit @ unit @ self._to_unit)

    def _parameters(self, warp: Array) -> Array:
        """The eight parameters of a warp (3, 3), in centred and scaled coordinates: the difference to the identity."""
        return (normalised(self._to_unit @ warp @ self._from_unit) - np.eye(3)).ravel()[:8]

    def _normalised(self, crop: Grey) -> tuple[Grey, Grey]:
        return normalise(cv2.GaussianBlur(crop, (0, 0), self._blur), self.window)


def _median(values: Floats) -> float:
    """The upper one, of an even number of values; NumPy's own takes several times as long."""
    middle = len(values) // 2
    return float(np.partition(values, middle)[middle])


def _local_threshold(strength: Floats, share: float, blocks: int) -> Floats:
    """Per pixel, the strength that the strongest `share` of the pixels in its block, of blocks x blocks, exceed."""
    h, w = strength.shape
    threshold = np.empty_like(strength)
    rows, columns = (np.linspace(0, n, blocks + 1).astype(int) for n in (h, w))
    for top, bottom in itertools.pairwise(rows):
        for left, right in itertools.pairwise(columns):
            block = strength[top:bottom, left:right].ravel()
            weaker = min(int((1 - share) * block.size), block.size - 1)
            threshold[top:bottom, left:right] = np.partition(block, weaker)[weaker]
    return threshold
