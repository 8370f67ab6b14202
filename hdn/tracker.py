"""Tracking of one planar target: HDN, then photometric refinement, then a judgement of what was found."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from . import weights
from .engine import Engine
from .errors import InputError
from .evidence import FIX, SEEN, TRUSTED_SCORE, Evidence, is_fix
from .homography import Array, area, from_corners, is_convex, normalised, similarity, square, transform, translation
from .observation import Observation
from .polar import polar_points
from .redetection import Redetector
from .refinement import Agreement, Refiner
from .sampling import Image, Pyramid
from .surroundings import surrounding_motion

State = Literal["tracked", "held", "lost"]
Stage = Literal["similarity", "residual", "refinement"]

SURE = 0.85  # agreement beyond which no other start is tried
# How far a target's step may differ from that of its surroundings for it to be taken as fixed among them: mean over the
# corners, px, or as a share of the step's length.
ATTACHED_PX, ATTACHED_SHARE = 1.5, 0.15
SCALES = (1.0, 0.6, 1.6)  # of the last pose, at which a lost target is looked for
MOST_WINDOWS = 16  # looked at in one frame
MIN_SIDE = 16  # px: a smaller target shows too little to track
HOLD_FRAMES = 20  # frames without a fix after which a held target counts as lost


@dataclass(frozen=True)
class Estimate:
    """The tracker's answer for one frame.

    Attributes:
        homography: (3, 3) reference-frame pixels to this frame's pixels; while held or lost, the last one found.
        corners: (4, 2) the target's corners in this frame, px.
        state: 'tracked', 'held' (no fix for some frames: the pose is the last one) or 'lost'.
        confidence: 0..1, the share of the target's visible area that agrees with the template.
        evidence: what the judgement rests on.
    """

    homography: Array
    corners: Array
    state: State
    confidence: float
    evidence: Evidence


class Tracker:
    """Follows a planar target from frame to frame.

    Example:
        tracker = Tracker()
        tracker.init(first_frame, quad)
        for frame in frames:
            estimate = tracker.track(frame)
    """

    def __init__(
        self,
        weights_path: Path | str | None = None,
        device: str = "auto",
        engine: Engine | None = None,
        stages: frozenset[Stage] = frozenset({"similarity", "residual", "refinement"}),
    ) -> None:
        """Args:
            weights_path: safetensors file; None takes the shipped weights.
            device: 'auto', 'cpu' or 'cuda'.
            engine: networks already loaded, to be shared between trackers.
            stages: what is done, to learn what each is worth; without refinement HDN's own evidence decides.

        Raises:
            InputError: weights missing or of another architecture, no such device.
        """
        self.engine = engine or Engine(weights.load(Path(weights_path or weights.shipped())), device)
        self.config = self.engine.config
        self.stages = stages
        self._points = polar_points(self.config)

    def init(self, frame: Image | Observation, quad: Array) -> None:
        """Takes the target: its quad (4, 2), px, in an RGB frame (H, W, 3).

        Trackers of several targets may share one `Observation` of a frame, and what it has computed.

        Raises:
            InputError: the quad is not convex, too small, or not wholly inside the frame.
        """
        self.quad = np.asarray(quad, np.float64)
        seen = _observed(frame)
        check_quad(self.quad, *seen.colour.size)
        colour = seen.colour
        c = self.config

        low, high = self.quad.min(0), self.quad.max(0)
        width, height = high - low
        margin = c.context * (width + height)
        window = float(np.sqrt((width + margin) * (height + margin)))
        self.centre = self.quad.mean(0)
        self.unit = window / c.template_size  # template px per crop px
        self.fill = tuple(float(v) for v in seen.image.reshape(-1, 3)[::97].mean(0))

        template = colour.crop(self._window(c.template_size), c.template_size, c.template_size, self.fill)
        self.kernels = self.engine.encode_template(template, self._polar_crop(template))
        view = self.quad if c.residual_rectified else self.centre + square(1) * np.sqrt(width * height)
        self.outline = from_corners(square(c.residual_size), view)  # residual crop to template
        self.residual_template = self.engine.describe(colour.crop(self.outline, c.residual_size, c.residual_size))
        self.refiner = Refiner(seen.grey, self.quad)
        self.redetector = Redetector(seen, self.quad)
        self.place(np.eye(3))
        self._seen: tuple[Pyramid, ...] = (seen.grey,)  # the last frame and the one before

    def place(self, homography: Array) -> None:
        """Goes on from a known pose: (3, 3), reference-frame pixels to those of the frame before the next."""
        self.homography = self.previous = normalised(homography)
        self.missed = 0
        self._seen = ()
        self._attached = False  # to what surrounds the target

    def lose(self) -> None:
        """Counts the target as lost, as after a cut: the next frame is searched as a whole."""
        self.missed = HOLD_FRAMES

    def propose(self, frame: Observation) -> tuple[Array, Evidence]:
        """HDN's three stages from the last pose, and no more: (3, 3) reference frame to this one, with evidence."""
        return self._hdn(frame.colour, self.homography)

    def track(self, frame: Image | Observation) -> Estimate:
        """Finds the target in the next RGB frame (H, W, 3)."""
        seen = _observed(frame)
        homography, evidence = self._locate(seen.colour, seen.grey)
        found = is_fix(evidence)
        if not found and self.missed >= 2:
            homography, evidence = self._search(seen)
            found = is_fix(evidence)
        if found:
            self.previous = self.homography if self.missed == 0 else homography
            self.homography, self.missed = homography, 0
        else:
            self._carry_on(seen.grey)
            self.missed += 1
        self._seen = (seen.grey, *self._seen[:1])
        state: State = "tracked" if found else "held" if self.missed <= HOLD_FRAMES else "lost"
        confidence = evidence.agreement if found else 0.5 * evidence.agreement
        return Estimate(self.homography, transform(self.homography, self.quad), state, confidence, evidence)

    def _carry_on(self, grey: Pyramid) -> None:
        """Moves the pose of a hidden target with its surroundings, if it did move with them while it was seen."""
        if self.missed == 0:
            self._attached = self._moved_with_surroundings()
        step = None
        if self._attached and self.missed < HOLD_FRAMES and self._seen:
            step = surrounding_motion(self._seen[0], grey, transform(self.homography, self.quad))
        moved = self.homography if step is None else normalised(step @ self.homography)
        self._attached = step is not None and self._plausible(moved)
        if self._attached:
            self.homography = moved
        self.previous = self.homography

    def _moved_with_surroundings(self) -> bool:
        """Whether the target's last step, between the last two frames, was that of what surrounds it."""
        if len(self._seen) < 2:
            return False
        corners, before = transform(self.homography, self.quad), transform(self.previous, self.quad)
        step = surrounding_motion(self._seen[1], self._seen[0], before)
        if step is None:
            return False
        difference = np.linalg.norm(transform(step, before) - corners, axis=1).mean()
        return bool(difference < max(ATTACHED_PX, ATTACHED_SHARE * np.linalg.norm(corners - before, axis=1).mean()))

    def _locate(self, colour: Pyramid, grey: Pyramid) -> tuple[Array, Evidence]:
        """HDN's three stages from the last pose, refined; where that does not convince, refinement alone."""
        homography, evidence = self._hdn(colour, self.homography)
        if "refinement" not in self.stages:
            found = evidence.score >= TRUSTED_SCORE or "similarity" not in self.stages
            return homography, replace(evidence, agreement=float(found))
        best, agreement = self._refine(grey, homography)
        if agreement.share < FIX and evidence.score >= TRUSTED_SCORE:
            # A large motion is found in two goes: the second starts where the first came to.
            homography, again = self._hdn(colour, homography)
            other, other_agreement = self._refine(grey, homography)
            if other_agreement.share > agreement.share:
                best, agreement, evidence = other, other_agreement, again
        if agreement.share < SURE:
            # Where much is hidden, what the visible part leaves open had better follow the motion so far.
            for start in (self._predicted(), self.homography):
                other, other_agreement = self._refine(grey, start)
                if other_agreement.share > agreement.share - 0.02:
                    best, agreement = other, other_agreement
                    break
        if not self._plausible(best):
            return best, evidence
        return best, replace(evidence, agreement=agreement.share, cohesion=agreement.cohesion)

    def _search(self, seen: Observation) -> tuple[Array, Evidence]:
        """Looks for a lost target anywhere in the frame: by keypoints in one frame, by HDN's windows in the next."""
        if self.missed % 2 == 0:
            found = self.redetector.find(seen)
            if found is None or not self._plausible(found):
                return self.homography, Evidence()
            start, evidence = found, Evidence(1.0, 1.0, 0.0, 1.0)  # keypoints vouch for it as HDN would
        else:
            start, evidence = self._hdn(seen.colour, self._sweep(seen.colour))
        homography, agreement = self._refine(seen.grey, start)
        if not self._plausible(homography):
            return homography, evidence
        return homography, replace(evidence, agreement=agreement.share, cohesion=agreement.cohesion)

    def _sweep(self, colour: Pyramid) -> Array:
        """The last pose, moved to the window of the frame whose translation score is best, at one scale a frame."""
        n = self.config.search_size
        here = transform(self.homography, self.centre[None])[0]
        scale = SCALES[self.missed // 2 % len(SCALES)]
        size = scale * np.sqrt(abs(area(transform(self.homography, self.quad)) / area(self.quad)))
        reach = (n - self.config.template_size) * self.unit * size  # px of the frame that one window searches
        columns, rows = (max(1, round(side / reach)) for side in colour.size)
        if columns * rows > MOST_WINDOWS:
            return self.homography
        best, best_score = self.homography, 0.0
        for x in (np.arange(columns) + 0.5) * (colour.size[0] / columns):
            for y in (np.arange(rows) + 0.5) * (colour.size[1] / rows):
                moved = translation(x, y) @ similarity(scale, 0, 0, 0) @ translation(*-here) @ self.homography
                crop = colour.crop(moved @ self._window(n), n, n, self.fill)
                score = self.engine.translation(self.kernels[0], crop).score
                if score > best_score:
                    best, best_score = moved, score
        return best

    def _hdn(self, colour: Pyramid, start: Array) -> tuple[Array, Evidence]:
        """H_start . H_similarity . H_residual (paper, eq. 1 and 2)."""
        homography, evidence = start, Evidence(1.0, 1.0)
        if "similarity" in self.stages:
            homography, evidence = self._similarity(colour, homography)
        if "residual" in self.stages:
            homography, length, visible = self._residual(colour, homography)
            evidence = replace(evidence, residual=length, visible=visible)
        return normalised(homography), evidence

    def _similarity(self, colour: Pyramid, start: Array) -> tuple[Array, Evidence]:
        """Translation, then rotation and scale on a log-polar crop about where it led."""
        c = self.config
        n = c.search_size
        search = colour.crop(start @ self._window(n), n, n, self.fill)
        shift = self.engine.translation(self.kernels[0], search)
        at = np.array([shift.x, shift.y])
        if shift.score < TRUSTED_SCORE:
            at = np.zeros(2)
        window = start @ translation(*(at * self.unit)) @ self._window(c.template_size)
        around = colour.crop(window, c.template_size, c.template_size, self.fill)
        polar = self.engine.polar(self.kernels[1], self._polar_crop(around))
        trusted = min(shift.score, polar.score) >= TRUSTED_SCORE
        scale = float(np.exp(polar.x * c.log_scale_per_pixel)) if trusted else 1.0
        rotation = polar.y * c.radians_per_pixel if trusted else 0.0
        to_centre = translation(*self.centre)
        moved = similarity(scale, rotation, *(at * self.unit))
        return start @ to_centre @ moved @ np.linalg.inv(to_centre), Evidence(shift.score, polar.score)

    def _residual(self, colour: Pyramid, start: Array) -> tuple[Array, float, float]:
        """Corner offsets of what is left; also their mean length, px of the crop, and the share that is seen."""
        n = self.config.residual_size
        crop = colour.crop(start @ self.outline, n, n)
        residual = self.engine.residual(self.residual_template, crop)
        corners, visible = square(n), float(residual.visible.mean())
        length = float(np.linalg.norm(residual.offsets, axis=1).mean())
        if visible < SEEN or not is_convex(corners + residual.offsets):
            return start, length, visible
        step = from_corners(corners, corners + residual.offsets)
        return start @ self.outline @ step @ np.linalg.inv(self.outline), length, visible

    def _refine(self, grey: Pyramid, start: Array) -> tuple[Array, Agreement]:
        homography = self.refiner.align(grey, start)
        if not np.isfinite(homography).all():
            return start, self.refiner.agreement(grey, start)
        return homography, self.refiner.agreement(grey, homography)

    def _predicted(self) -> Array:
        """The pose that the last frame's motion leads to."""
        return normalised(self.homography @ np.linalg.inv(self.previous) @ self.homography)

    def _plausible(self, homography: Array) -> bool:
        """Whether the pose is one that a camera can see: convex, not mirrored, neither vast nor tiny."""
        corners = transform(homography, self.quad)
        w = self.quad @ homography[2, :2] + homography[2, 2]
        ratio = area(corners) / area(self.quad)
        return bool((w > 0).all()) and is_convex(corners) and 0.01 < ratio < 50

    def _window(self, size: int) -> Array:
        """Crop pixels to template pixels for a crop of this size about the target's centre."""
        middle = (size - 1) / 2
        return np.array(
            [
                [self.unit, 0, self.centre[0] - middle * self.unit],
                [0, self.unit, self.centre[1] - middle * self.unit],
                [0, 0, 1.0],
            ]
        )

    def _polar_crop(self, crop: Image) -> Image:
        """Log-polar crop about a crop's centre."""
        points = self._points + np.float32((crop.shape[0] - 1) / 2)
        return np.asarray(cv2.remap(crop, points, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.uint8)


def check_quad(quad: Array, width: int, height: int) -> None:
    """Raises InputError unless the quad (4, 2) is convex, inside a width x height frame and at least 16 px wide."""
    if quad.shape != (4, 2) or not np.isfinite(quad).all():
        raise InputError(f"the quad has {len(quad)} points: give four corners x,y, top-left first, clockwise")
    if ((quad < -1) | (quad > [width, height])).any():  # corners on the frame's very edge are fine
        raise InputError(f"the quad lies outside the {width}x{height} frame: give corners inside it")
    sides = np.linalg.norm(np.roll(quad, -1, 0) - quad, axis=1)
    if not is_convex(quad):
        raise InputError(
            "the quad crosses itself, bends inward or is flat: give the corners in order around the surface"
        )
    if sides.min() < MIN_SIDE or abs(area(quad)) < MIN_SIDE**2:
        raise InputError(f"the quad is under {MIN_SIDE} px wide or high: choose a frame where the surface is larger")


def _observed(frame: Image | Observation) -> Observation:
    return frame if isinstance(frame, Observation) else Observation(frame)
