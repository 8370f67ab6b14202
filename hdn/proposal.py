"""HDN's three stages on one frame: where the target has gone from a given pose.

Paper, eqs. 1 and 2: H = H_start . H_similarity . H_residual. Crops are sampled straight from the frame.
"""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from .evidence import THRESHOLDS
from .imaging.arrays import Array, Floats, Image
from .imaging.homography import derivative, from_corners, normalised, similarity, transform, translation
from .imaging.observation import Observation
from .imaging.pyramid import Pyramid
from .imaging.quads import is_convex, square
from .networks.engine import Engine, survey_size
from .networks.polar import polar_points

Stage = Literal["similarity", "residual", "refinement"]


@dataclass(frozen=True)
class ProposalModel:
    """Constants of how the stages are run; what the networks rest on is their `Config`."""

    second_look_px: float = 4.0  # mean offset of the residual crop's corners, from which a second look is worth it
    unhidden: float = 0.8  # share of the target that is visible, from which nothing hides it
    survey_sizes: tuple[float, ...] = (1.0, 0.6, 1.6)  # of the last pose's, in which a lost target is looked for
    max_survey_pixels: int = 600_000  # of a crop that shows the whole frame
    colour_sampling: int = 97  # one pixel of so many tells the reference frame's mean colour


MODEL = ProposalModel()


@dataclass(frozen=True)
class Proposal:
    """Where the networks find the target.

    Attributes:
        homography: (3, 3) reference-frame pixels to the frame's.
        score, polar_score: classification scores of the two similarity branches, 0..1.
        residual: mean length of the residual's corner offsets, px of its crop; negatives pull it to zero.
        visible: (m, m) probability that each part of the target is seen; negatives pull it to zero too.
    """

    homography: Array
    score: float
    polar_score: float
    residual: float
    visible: Floats


class Proposer:
    """The networks, with their encodings of one target."""

    def __init__(self, engine: Engine, frame: Observation, quad: Array, stages: frozenset[Stage]) -> None:
        """Args:
        engine: the networks.
        frame: the reference frame.
        quad: (4, 2) the target in it, px.
        stages: those that are run.
        """
        self.engine, self.stages = engine, stages
        self.config = c = engine.config
        self._points = polar_points(c)
        low, high = quad.min(0), quad.max(0)
        width, height = high - low
        margin = c.context * (width + height)
        window = float(np.sqrt((width + margin) * (height + margin)))
        self.centre = quad.mean(0)
        self.unit = window / c.template_size  # template px per crop px
        self.fill = tuple(float(v) for v in frame.image.reshape(-1, 3)[:: MODEL.colour_sampling].mean(0))

        template = self._crop(frame.colour, self._window(c.template_size), c.template_size)
        self.kernels = engine.encode_template(template, self._polar_crop(template))
        # What a branch measures in the reference frame itself is its bias with this target; it is taken off again.
        self._zero_shift = self._zero_turn = np.zeros(2)
        if "similarity" in stages:
            self._zero_shift = self._shift(frame.colour, np.eye(3))[0]
            self._zero_turn = self._turn(frame.colour, np.eye(3))[0]
        view = quad if c.residual_rectified else self.centre + square(1) * np.sqrt(width * height)
        self.outline = from_corners(square(c.residual_size), view)  # residual crop to template
        self.template = engine.describe(frame.colour.crop(self.outline, c.residual_size, c.residual_size))

    def propose(self, frame: Pyramid, start: Array) -> Proposal:
        """Runs the stages on a colour frame, from a pose (3, 3), reference frame to this one."""
        homography, score, polar_score = start, 1.0, 1.0
        if "similarity" in self.stages:
            homography, score, polar_score = self._similarity(frame, homography)
        length, visible = 0.0, np.ones((1, 1), np.float32)
        if "residual" in self.stages:
            homography, length, visible = self._residual(frame, homography)
            if "similarity" in self.stages and visible.mean() < MODEL.unhidden:
                # An occluder draws the similarity off; the residual says whether the target is still where it was.
                there, its_length, its_visible = self._residual(frame, start)
                if its_visible.mean() > visible.mean():
                    homography, length, visible = there, its_length, its_visible
        return Proposal(normalised(homography), score, polar_score, length, visible)

    def survey(self, frame: Pyramid, last: Array) -> Array:
        """The pose (3, 3) at which a lost target is likeliest, wherever in the frame, turned as it was last.

        The translation branch looks at the frame as a single crop, once for each of a few sizes of the target; its
        score decides.

        Args:
            frame: colour pyramid.
            last: (3, 3) the pose before it was lost, in whose rotation and about whose size it is looked for.
        """
        rotation, size = _rotation_and_scale(last, self.centre)
        extent = np.array(frame.size, float)
        frame_centre = (extent - 1) / 2
        best, start = -1.0, last
        for scale in MODEL.survey_sizes:
            pixel = self.unit * size * scale  # of the crop, in the frame's
            turned = translation(*frame_centre) @ similarity(pixel, rotation, 0, 0)
            corners = transform(np.asarray(np.linalg.inv(turned)), frame_centre + square(1) * extent)
            width, height = (survey_size(2 * length) for length in np.abs(corners).max(0))
            if width * height > MODEL.max_survey_pixels:
                continue
            crop = frame.crop(turned @ translation(-(width - 1) / 2, -(height - 1) / 2), width, height, self.fill)
            shift = self.engine.translation(self.kernels[0], crop)
            if shift.score > best:
                to_crop = similarity(1 / self.unit, 0, 0, 0) @ translation(*-self.centre)
                best, start = shift.score, turned @ translation(shift.x, shift.y) @ to_crop
        return start

    def _similarity(self, frame: Pyramid, start: Array) -> tuple[Array, float, float]:
        """The similarity stage: translation, then rotation and scale on a log-polar crop about where that led.

        Returns:
            The pose (3, 3), and the scores of the two branches.
        """
        shift, score = self._shift(frame, start)
        moved = start @ translation(*(shift if score >= THRESHOLDS.trusted_score else np.zeros(2)))
        (log_scale, rotation), polar_score = self._turn(frame, moved)
        if min(score, polar_score) < THRESHOLDS.trusted_score:
            return moved, score, polar_score
        to_centre = translation(*self.centre)
        turned = similarity(np.exp(log_scale), rotation, 0, 0)
        return moved @ to_centre @ turned @ np.linalg.inv(to_centre), score, polar_score

    def _shift(self, frame: Pyramid, start: Array) -> tuple[Array, float]:
        """How far the target's centre is from where a pose has it, px of the reference frame, and the score."""
        n = self.config.search_size
        found = self.engine.translation(self.kernels[0], self._crop(frame, start @ self._window(n), n))
        return np.array([found.x, found.y]) * self.unit - self._zero_shift, found.score

    def _turn(self, frame: Pyramid, start: Array) -> tuple[Array, float]:
        """Log-scale and rotation, rad, by which the target differs from a pose with its centre, and the score."""
        c = self.config
        around = self._crop(frame, start @ self._window(c.template_size), c.template_size)
        found = self.engine.polar(self.kernels[1], self._polar_crop(around))
        return np.array([found.x * c.log_scale_per_pixel, found.y * c.radians_per_pixel]) - self._zero_turn, found.score

    def _residual(self, frame: Pyramid, start: Array) -> tuple[Array, float, Floats]:
        """The residual stage, a second time where the first look was far off.

        Returns:
            The pose (3, 3), the mean length of the corners' offsets at the first look, px of the residual crop, and
            the parts (m, m) that are visible.
        """
        homography, length, visible = self._run_residual(frame, start)
        if length > MODEL.second_look_px and visible.mean() >= THRESHOLDS.min_visible:
            # The corners lay outside the crop, or squeezed; from where they are now all is in view.
            again, less, its_visible = self._run_residual(frame, homography)
            if less < length:
                homography, visible = again, its_visible
        return homography, length, visible

    def _run_residual(self, frame: Pyramid, start: Array) -> tuple[Array, float, Floats]:
        """One run of the residual network, at a pose; returns as `_residual`."""
        n = self.config.residual_size
        residual = self.engine.residual(self.template, frame.crop(start @ self.outline, n, n))
        corners = square(n)
        length = float(np.linalg.norm(residual.offsets, axis=1).mean())
        if residual.visible.mean() < THRESHOLDS.min_visible or not is_convex(corners + residual.offsets):
            return start, length, residual.visible
        step = from_corners(corners, corners + residual.offsets)
        return start @ self.outline @ step @ np.linalg.inv(self.outline), length, residual.visible

    def _window(self, size: int) -> Array:
        """Crop pixels to template pixels for a crop of this size about the target's centre."""
        x, y = self.centre - (size - 1) / 2 * self.unit
        return np.array([[self.unit, 0, x], [0, self.unit, y], [0, 0, 1.0]])

    def _crop(self, frame: Pyramid, crop_to_frame: Array, size: int) -> Image:
        return frame.crop(crop_to_frame, size, size, self.fill)

    def _polar_crop(self, crop: Image) -> Image:
        """The log-polar crop about a crop's centre."""
        points = self._points + np.float32((crop.shape[0] - 1) / 2)
        return np.asarray(cv2.remap(crop, points, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.uint8)


def _rotation_and_scale(homography: Array, at: Array) -> tuple[float, float]:
    """Rotation, rad, and scale of the similarity that is nearest to a homography (3, 3) about a point (2,)."""
    (a, b), (c, d) = derivative(homography, at)
    return float(np.arctan2(c - b, a + d)), float(np.sqrt(abs(a * d - b * c)))
