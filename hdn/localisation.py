"""The search for a target in one frame: starts for the refinement from HDN, from motion and from keypoints.

Each start is refined and gives a candidate; the evidence says which of them shows the target.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from .alignment.agreement import CELLS
from .alignment.refinement import NO_BLUR, START_COVARIANCE, Alignment, as_cells
from .evidence import THRESHOLDS, Evidence, is_fix, is_sure_fix
from .imaging.arrays import Array, Floats, Mask
from .imaging.homography import normalised
from .imaging.observation import Observation
from .imaging.quads import side
from .plane.keypoints import KeypointPose
from .plane.motion import Step, StepSearch
from .proposal import Proposal
from .target import PARTS, Pose, Rest, Target


@dataclass(frozen=True)
class SearchModel:
    """Constants of the search in one frame."""

    # A target that moves steadily and is seen well is looked for where it goes on as it moved, without HDN: px of the
    # standard crop between where it was expected and where it was in the last frame, at most; the deviation of its
    # corners then, as a share of its size, at most, which is more where the frame is not as sharp as the template; and
    # the share of it that the last frame showed, and that has to agree in this one.
    steady_px: float = 2.0
    steady_deviation: float = 0.0035
    steady_share: float = 0.95
    followed_share: float = 0.7  # of what is seen of the target, that has to agree where its plane leads without HDN
    sure_support: float = 0.85  # from which no other start is tried
    support_margin: float = 0.02  # by which the candidate of an expected pose may fall short of HDN's and be taken
    measured_margin: float = 0.2  # the same of a pose that the plane's motion or its map measured
    measured_agreement: float = 0.75  # of such a measurement, from which it counts as one
    keypoint_interval: int = 2  # a lost target is looked for by keypoints once in so many frames, else by HDN
    # Squared Mahalanobis distance of two poses, up to which they are the same: 95 % of those that are.
    same_pose: float = 15.5
    sure_matches: int = 20  # that agree on a pose, from which keypoints alone place a target
    longest_rest: int = 3  # frames for which keypoints are left alone after they told nothing, again and again

    # A cell's weight in the refinement, by the share of it that the residual network sees: gain * share - offset, which
    # is nothing below 0.15 and all above 0.4. A cell that it takes for hidden keeps some weight, since it may err.
    visibility_gain: float = 4.0
    visibility_offset: float = 0.6
    min_visibility: float = 0.01
    # The same by the matte network, which tells more finely and surely: nothing below 0.5, all above 0.75.
    matte_offset: float = 2.0
    min_matte: float = 0.1  # share of the target that it sees, below which it tells nothing: the pose may be wrong

    # How far from an expected pose that was measured a target may be: standard deviations of it, and a share of its
    # size beyond. What lies farther has to be sure.
    likely_deviations: float = 3.0
    likely_ratio: float = 0.1

    # Of what the frame's likeness to the template lacks to 1, that may be left for a blur to be believed.
    max_lack_left: float = 0.85


MODEL = SearchModel()


UNSEEN: Floats = np.zeros((CELLS, CELLS), np.float32)


class Candidate(NamedTuple):
    """A pose that the target may have in a frame.

    Attributes:
        homography: (3, 3) reference frame to this one.
        evidence: what speaks for it.
        visibility: (8, 8) 0..1, which cells of the target are seen.
        covariance: (8, 8) of the pose, as its alignment tells it.
        alignment: the refinement that led to it; None where there was none, or where it went astray.
        matched: (8, 8) covariance of the pose by matched keypoints, where they were part of what it started from.
    """

    homography: Array
    evidence: Evidence
    visibility: Floats
    covariance: Array = START_COVARIANCE
    alignment: Alignment | None = None
    matched: Array | None = None

    @property
    def measured(self) -> Array | None:
        """Covariance (8, 8) of the pose by all that the frame shows, without what was expected; None where it is not
        aligned."""
        if self.alignment is None or self.matched is None:
            return None if self.alignment is None else self.alignment.measured
        return _together(self.alignment.measured, self.matched)

    @property
    def support(self) -> float:
        """The share of the target that shows that it is there."""
        return self.evidence.support


class Expectation(NamedTuple):
    """Where a target is to be expected in a frame without a look at the target itself.

    Attributes:
        homography: (3, 3) reference frame to this one.
        covariance: (8, 8) of it, as `Alignment` tells it.
        is_measured: whether the plane's motion, its map or its keypoints were seen surely.
        measured: (8, 8) covariance by what the frame alone shows, of the surroundings or keypoints; None for nothing.
        blur: (2, 2) px^2 of the standard crop, by which the frame is likely to be blurrier than the template.
    """

    homography: Array
    covariance: Array
    is_measured: bool
    measured: Array | None
    blur: Array


class FrameSearch:
    """The search for a target in one frame, from its last pose.

    Attributes:
        is_lost: whether that pose says so little that nothing is to be expected from it.
        is_hard: whether the target was not found just like that.
        rest: for how long keypoints are left alone from the next frame on.
    """

    def __init__(self, target: Target, pose: Pose, frame: Observation) -> None:
        self._target, self._pose, self._frame = target, pose, frame
        self._proposal: Proposal | None = None
        self._by_keypoints: Expectation | None = None
        self._sighted: Array | None = None  # (3, 3) where matches that cannot be mistaken have the target
        self.rest = replace(pose.rest, left=max(pose.rest.left - 1, 0))
        self.is_lost = not target.is_holdable(pose.homography, pose.covariance)
        self.is_hard = False

    @property
    def looks_at_plane(self) -> bool:
        """Whether the target's plane was looked at."""
        return self.is_hard and not self.is_lost

    def nearby(self) -> Candidate:
        """The best candidate about the last pose: HDN's stages, refined; where little supports that, expected poses."""
        if self._pose.was_hard and self._target.is_refined and not self.is_lost:
            followed = self._followed()
            if followed is not None:
                return followed
        elif self._is_steady:
            steady = self._aligned(self._pose.predicted, None, seen=self._pose.seen)
            if steady.support >= MODEL.steady_share:
                return steady
        proposal = self._proposal = self._propose(self._pose.homography)
        if not self._target.is_refined:
            return _unrefined(proposal)
        best = self._aligned(proposal.homography, proposal)
        if best.support >= MODEL.sure_support:
            return best
        self.is_hard = True
        if self.looks_at_plane:
            # Where much is hidden, what the visible part leaves open had better follow its plane.
            expected = self.expectation
            candidate = self._expected
            margin = MODEL.measured_margin if expected.is_measured else MODEL.support_margin
            if candidate.support > best.support - margin:
                return self._with_keypoints(candidate)
        if best.support < THRESHOLDS.fix_support and proposal.score >= THRESHOLDS.trusted_score:
            # A large motion is found in two goes: the second starts where the first came to.
            again = self._proposed(proposal.homography)
            best = max(best, again, key=lambda candidate: candidate.support)
        for start in self._smooth_starts if self.looks_at_plane else ():
            candidate = self._aligned(start, proposal, blur=self.expectation.blur)
            if candidate.support > best.support - MODEL.support_margin:
                return self._with_keypoints(candidate)
        return self._with_keypoints(best)

    @property
    def _is_steady(self) -> bool:
        """Whether the target was seen well, surely and where it was expected, in the last frame.

        Never where its template is vague: what little it tells agrees with wrong poses, too.
        """
        target, pose = self._target, self._pose
        if not target.is_refined or target.refiner.is_vague or pose.seen is None:
            return False
        most = MODEL.steady_deviation * side(target.corners(pose.homography))
        return (
            bool(pose.seen.mean() >= MODEL.steady_share)
            and pose.surprise <= MODEL.steady_px
            and target.refiner.deviation(pose.homography, pose.covariance) <= most
        )

    def _followed(self) -> Candidate | None:
        """The candidate that the plane's motion leads to, where that is sure and the target agrees; else None.

        HDN's stages, which would have to find the target beside what hides it, are spared then.
        """
        if self._smooth_step is None or not self._smooth_step.is_sure or self.seen.mean() < MODEL.min_matte:
            return None
        candidate = self._expected
        if not is_fix(candidate.evidence) or candidate.support < MODEL.followed_share * candidate.evidence.visible:
            return None
        self.is_hard = candidate.support < MODEL.sure_support
        return self._with_keypoints(candidate) if self.is_hard else candidate

    @cached_property
    def _expected(self) -> Candidate:
        """The candidate at the pose that is expected."""
        expected = self.expectation
        return self._aligned(expected.homography, self._proposal, expected.covariance, expected.blur, self.seen)

    def _with_keypoints(self, candidate: Candidate) -> Candidate:
        """The candidate, or where it is unsure that to which matched keypoints lead.

        They are joined with what is expected, where they agree with it; else they have to be clearly better.
        """
        target, frame = self._target, self._frame
        is_sure = target.is_holdable(candidate.homography, candidate.covariance) and is_fix(candidate.evidence)
        if is_sure or self.is_lost or self._pose.rest.left:
            return candidate
        expected = self.expectation
        near = (expected.homography, self._likely_distance) if expected.is_measured else None
        found = target.keypoints.find(frame, target.refiner, near)
        self.rest = self._pose.rest.longer(MODEL.longest_rest)
        if found is None or not target.is_plausible(found.homography):
            return candidate
        start, margin, seen = self._joined(found, candidate), 0.0, self.seen
        is_placed = start is not None or (not expected.is_measured and found.matches >= MODEL.sure_matches)
        if start is None:
            start = Expectation(found.homography, found.covariance, is_placed, found.covariance, expected.blur)
            margin, seen = MODEL.support_margin, target.occlusion.seen(frame, found.homography)
        matched = self._aligned(start.homography, self._proposal, start.covariance, start.blur, seen)
        is_better = matched.support >= candidate.support + margin and (is_placed or is_fix(matched.evidence))
        if not is_better or self._is_unlikely(matched):
            return candidate
        self._by_keypoints, self.rest = (start if is_placed else None), Rest()
        return matched._replace(matched=found.covariance)

    def _joined(self, found: KeypointPose, candidate: Candidate) -> Expectation | None:
        """What is expected, joined with a pose by keypoints; None where that is another, or nothing was measured.

        Where the target itself was aligned, that tells better than what was expected whether they agree.
        """
        expected, combined = self.expectation, self._target.refiner.combined
        if not expected.is_measured:
            return None
        homography, covariance, distance = combined(expected.homography, expected.covariance, *found[:2])
        if is_fix(candidate.evidence):
            distance = max(distance, combined(candidate.homography, candidate.covariance, *found[:2])[2])
        if distance > MODEL.same_pose or not self._target.is_plausible(homography):
            return None
        measured = found.covariance
        if expected.measured is not None:
            measured = _together(expected.measured, measured)
        return Expectation(homography, covariance, True, measured, expected.blur)

    def anywhere(self) -> Candidate:
        """The best candidate in the whole frame, for a lost target: by keypoints in some frames, else by HDN."""
        target, found = self._target, None
        if self._pose.missed % MODEL.keypoint_interval == 0:
            found = target.keypoints.find(self._frame, target.refiner)
        if found is None or not target.is_plausible(found.homography):
            return self._proposed(target.proposer.survey(self._frame.colour, self._pose.homography))
        if found.distinct >= MODEL.sure_matches:
            self._sighted = found.homography
        seen = target.occlusion.seen(self._frame, found.homography)
        near = self._aligned(found.homography, None, _together(found.covariance, START_COVARIANCE), seen=seen)
        # Where little is seen they may be too far off for the matte; they vouch for the pose as HDN would then.
        free = self._aligned(found.homography, Proposal(found.homography, 1.0, 1.0, 0.0, np.ones((1, 1), np.float32)))
        tries = near._replace(matched=found.covariance), free
        sure = [one for one in tries if is_sure_fix(one.evidence)]
        candidate = min(sure or tries, key=lambda one: target.refiner.deviation(one.homography, one.covariance))
        is_sure = found.matches >= MODEL.sure_matches and candidate.evidence.cohesion >= THRESHOLDS.fix_patch
        if is_sure and self.placed is None and target.is_holdable(found.homography, found.covariance):
            self._by_keypoints = Expectation(found.homography, found.covariance, True, found.covariance, NO_BLUR)
        return candidate

    @property
    def placed(self) -> Expectation | None:
        """Where the target is by what was measured beside it, or by its keypoints alone; None where nothing was."""
        if self._by_keypoints is not None and self._by_keypoints.is_measured:
            return self._by_keypoints
        return self.expectation if self.looks_at_plane and self.expectation.is_measured else None

    def is_found(self, candidate: Candidate) -> bool:
        """Whether a candidate shows the target; after frames without it, its corners have to be sure as well."""
        is_known = self._pose.missed == 0 or self._target.is_known(candidate.homography, candidate.covariance)
        return is_known and is_fix(candidate.evidence) and not self._is_unlikely(candidate)

    def _is_unlikely(self, candidate: Candidate) -> bool:
        """Whether a candidate is far from where the target has to be, and not supported well enough for that.

        Patterns that repeat agree in many places. Where matches that cannot be mistaken have the candidate, what is
        expected has to be sharp to stand against them: it may have gone with something in front.
        """
        if not self.looks_at_plane or candidate.support >= MODEL.sure_support or not self.expectation.is_measured:
            return False
        expected, target = self.expectation, self._target
        if self._sighted is not None and not target.is_sharp(expected.homography, expected.covariance):
            size = side(target.corners(self._sighted))
            if self._apart(candidate.homography, self._sighted) < MODEL.likely_ratio * size:
                return False
        return self._apart(candidate.homography, expected.homography) > self._likely_distance

    def _apart(self, one: Array, other: Array) -> float:
        """Mean distance of the target's corners by two poses (3, 3), px."""
        apart = self._target.corners(one) - self._target.corners(other)
        return float(np.linalg.norm(apart, axis=1).mean())

    @property
    def _likely_distance(self) -> float:
        """How far from where it is expected a target may be, px."""
        expected = self.expectation
        deviation = self._target.refiner.deviation(expected.homography, expected.covariance)
        size = side(self._target.corners(expected.homography))
        return MODEL.likely_deviations * deviation + MODEL.likely_ratio * size

    def finely_aligned(self, candidate: Candidate) -> Candidate:
        """The candidate that was chosen, aligned to the last fractions of a pixel."""
        if candidate.alignment is None:
            return candidate
        found = self._target.refiner.align_finely(self._frame, candidate.alignment)
        if not self._target.is_plausible(found.homography):
            return candidate
        return candidate._replace(homography=found.homography, covariance=found.covariance, alignment=found)

    @cached_property
    def _steps(self) -> StepSearch | None:
        """The search for the plane's motion since the frame before; None where that is not known."""
        target, pose = self._target, self._pose
        if pose.frame is None or pose.seen is None or pose.seen_around is None:
            return None
        trust = target.plane.trust(pose.seen_around, pose.seen)
        return StepSearch(target.plane, pose.frame, self._frame.grey, target.corners(pose.homography), trust)

    @cached_property
    def _smooth_step(self) -> Step | None:
        """The plane's motion, where it goes on as before or stops."""
        return None if self._steps is None else self._steps.best(map(self._motion_to, self._smooth_starts))

    @cached_property
    def step(self) -> Step | None:
        """The plane's motion from the frame before to this one; None where it cannot be measured."""
        if self._steps is None or self._proposal is None:
            return self._smooth_step
        return self._steps.best([self._motion_to(self._proposal.homography)], self._smooth_step)

    @property
    def _smooth_starts(self) -> tuple[Array, Array]:
        """Poses (3, 3) of a target that goes on as it moved, or stops."""
        return self._pose.predicted, self._pose.homography

    def _motion_to(self, homography: Array) -> Array:
        """The motion (3, 3) since the frame before that leads to a pose (3, 3)."""
        return normalised(homography @ np.asarray(np.linalg.inv(self._pose.homography)))

    @property
    def carried(self) -> Array:
        """The last pose (3, 3), moved by the step; there has to be one."""
        assert self.step is not None
        return normalised(self.step.homography @ self._pose.homography)

    @cached_property
    def expectation(self) -> Expectation:
        """Where the target is to be expected by its plane: by the motion of what was seen of it, then by its map."""
        target, pose = self._target, self._pose
        homography, covariance, is_measured = pose.predicted, START_COVARIANCE, False
        if self.step is not None and target.is_plausible(self.carried):
            homography, covariance = self.carried, pose.prior_covariance + self.step.covariance
            is_measured = self.step.agreement > MODEL.measured_agreement
        elif pose.missed:
            homography, covariance = pose.homography, pose.blind_covariance
        blur = self._likeliest_blur(homography)
        found = None
        if target.plane.tells:
            around = target.occlusion_around.seen(self._frame, homography)
            found = target.plane.align(self._frame.grey, homography, covariance, around, blur)
        if found is not None and target.is_plausible(found.homography):
            is_measured |= found.agreement > MODEL.measured_agreement
            return Expectation(found.homography, found.covariance, is_measured, found.measured, blur)
        return Expectation(homography, covariance, is_measured, None, blur)

    @cached_property
    def seen(self) -> Floats:
        """How probably each part (PARTS, PARTS) of the target is seen, at the pose that is expected."""
        return self._target.occlusion.seen(self._frame, self.expectation.homography)

    def _likeliest_blur(self, homography: Array) -> Array:
        """The blur (2, 2) by which the frame is likest to the template at a pose (3, 3): the last one's, or its own."""
        refiner, seen = self._target.refiner, self._pose.seen
        visibility = np.ones((CELLS, CELLS), np.float32) if seen is None else as_cells(seen)

        def lack(blur: Array) -> float:
            return 1 - refiner.likeness(self._frame, homography, visibility, blur)

        likely = [blur for blur in (self._pose.blur, refiner.spectral_blur(self._frame, homography)) if blur.any()]
        if not likely:
            return NO_BLUR
        least, best = min(((lack(blur), blur) for blur in likely), key=lambda pair: pair[0])
        return best if least < MODEL.max_lack_left * lack(NO_BLUR) else NO_BLUR

    def _proposed(self, start: Array) -> Candidate:
        """The candidate to which HDN's stages lead from a pose (3, 3)."""
        proposal = self._propose(start)
        return self._aligned(proposal.homography, proposal)

    def _propose(self, start: Array) -> Proposal:
        return self._target.proposer.propose(self._frame.colour, start)

    def _aligned(
        self,
        start: Array,
        proposal: Proposal | None,
        covariance: Array = START_COVARIANCE,
        blur: Array = NO_BLUR,
        seen: Floats | None = None,
    ) -> Candidate:
        """Photometric alignment from a start, judged together with what a proposal says of the frame.

        Args:
            start: (3, 3) the pose that is expected.
            proposal: HDN's, for its scores and for what is visible; None leaves that to the matte network.
            covariance: (8, 8) of the start.
            blur: (2, 2) px^2 of the standard crop, by which the frame is expected to be blurrier than the template.
            seen: (PARTS, PARTS) what the matte network sees; None, or too little, leaves that to HDN.
        """
        visible, offset = UNSEEN if proposal is None else proposal.visible, MODEL.visibility_offset
        parts = as_cells(visible)
        if seen is not None and (seen.mean() > MODEL.min_matte or proposal is None):
            parts, offset = seen, MODEL.matte_offset
        weights = np.clip(MODEL.visibility_gain * parts - offset, MODEL.min_visibility, 1)
        found = self._target.refiner.align_roughly(self._frame, start, weights, covariance, blur)
        agreement, visible = found.agreement, as_cells(parts)
        evidence = Evidence(visible=float(visible.mean()))
        if proposal is not None:
            evidence = replace(
                evidence, score=proposal.score, polar_score=proposal.polar_score, residual=proposal.residual
            )
        if not self._target.is_plausible(found.homography):
            return Candidate(start, evidence, np.zeros((CELLS, CELLS), np.float32))
        evidence = replace(evidence, agreement=agreement.share, cohesion=agreement.cohesion, border=found.border)
        # Where there is no texture to compare, the network's word for it.
        visibility = np.where(agreement.textured, agreement.agrees, visible).astype(np.float32) * agreement.in_frame
        return Candidate(found.homography, evidence, visibility, found.covariance, found)

    def shown_parts(self, candidate: Candidate | None) -> Floats:
        """Which parts (PARTS, PARTS) of the target, 0..1, the frame is known to show where it was found.

        Args:
            candidate: what was found; None where the target was not.
        """
        if candidate is None or candidate.alignment is None:
            placed = self._by_keypoints
            if placed is None or not placed.is_measured:
                return np.zeros((PARTS, PARTS), np.float32)
            return _surely(self._target.occlusion.seen(self._frame, placed.homography))
        agreement = candidate.alignment.agreement
        agrees = agreement.agrees_surely & agreement.textured
        if not self.is_hard:
            return _parts(agrees | ~agreement.textured)
        seen = self.seen if self.looks_at_plane else self._target.occlusion.seen(self._frame, candidate.homography)
        return _parts(agrees & agreement.in_frame) * _surely(seen)


def _unrefined(proposal: Proposal) -> Candidate:
    """A proposal taken as it is, judged by its scores alone."""
    visible = float(proposal.visible.mean())
    is_scored = min(proposal.score, proposal.polar_score) >= THRESHOLDS.trusted_score
    found = float(is_scored and visible >= THRESHOLDS.min_visible)
    evidence = Evidence(proposal.score, proposal.polar_score, proposal.residual, visible, found, found)
    return Candidate(proposal.homography, evidence, as_cells(proposal.visible))


def _together(one: Array, other: Array) -> Array:
    """Covariance (8, 8) of two estimates of a pose together, by those of each."""
    return np.asarray(np.linalg.inv(np.linalg.inv(one) + np.linalg.inv(other)))


def _surely(seen: Floats) -> Floats:
    """Weights (n, n) of parts that are seen so probably: nothing below a half."""
    return np.asarray(np.clip(MODEL.visibility_gain * seen - MODEL.matte_offset, 0, 1), np.float32)


def _parts(cells: Mask) -> Floats:
    """Cells (8, 8) of the target, true or false, as parts (PARTS, PARTS)."""
    return np.repeat(np.repeat(cells.astype(np.float32), PARTS // CELLS, 0), PARTS // CELLS, 1)
