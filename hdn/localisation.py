"""The search for a target in one frame: starts for the refinement from HDN, from motion and from keypoints.

Each start is refined and gives a candidate; the evidence says which of them shows the target.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from .alignment.agreement import CELLS
from .alignment.refinement import NO_BLUR, START_COVARIANCE, Alignment, as_cells
from .evidence import THRESHOLDS, Evidence, is_fix
from .imaging.arrays import Array, Floats, Mask
from .imaging.homography import normalised
from .imaging.observation import Observation
from .imaging.quads import side
from .plane.motion import Step, plane_step
from .plane.plane_map import MapPose
from .proposal import Proposal
from .target import PARTS, Pose, Target


@dataclass(frozen=True)
class SearchModel:
    """Constants of the search in one frame."""

    sure_support: float = 0.85  # from which no other start is tried
    support_margin: float = 0.02  # by which the candidate of an expected pose may fall short of HDN's and be taken
    measured_margin: float = 0.2  # the same of a pose that the plane's motion or its map measured
    measured_agreement: float = 0.75  # of such a measurement, from which it counts as one
    keypoint_interval: int = 2  # a lost target is looked for by keypoints once in so many frames, else by HDN

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


class Candidate(NamedTuple):
    """A pose that the target may have in a frame.

    Attributes:
        homography: (3, 3) reference frame to this one.
        evidence: what speaks for it.
        visibility: (8, 8) 0..1, which cells of the target are seen.
        covariance: (8, 8) of the pose, as its alignment tells it.
        alignment: the refinement that led to it; None where there was none, or where it went astray.
    """

    homography: Array
    evidence: Evidence
    visibility: Floats
    covariance: Array = START_COVARIANCE
    alignment: Alignment | None = None

    @property
    def support(self) -> float:
        """The share of the target that shows that it is there."""
        return self.evidence.support


class Expectation(NamedTuple):
    """Where a target is to be expected in a frame without a look at the target itself.

    Attributes:
        homography: (3, 3) reference frame to this one.
        covariance: (8, 8) of it, as `Alignment` tells it.
        is_measured: whether the plane's motion or its map was seen surely.
        by_map: where the surroundings have it; None where they do not tell.
        blur: (2, 2) px^2 of the standard crop, by which the frame is likely to be blurrier than the template.
    """

    homography: Array
    covariance: Array
    is_measured: bool
    by_map: MapPose | None
    blur: Array


class FrameSearch:
    """The search for a target in one frame, from its last pose.

    Attributes:
        is_lost: whether that pose says so little that nothing is to be expected from it.
        is_hard: whether the target was not found just like that.
    """

    def __init__(self, target: Target, pose: Pose, frame: Observation) -> None:
        self._target, self._pose, self._frame = target, pose, frame
        self._proposal: Proposal | None = None
        self.is_lost = not target.is_holdable(pose.homography, pose.covariance)
        self.is_hard = False

    @property
    def looks_at_plane(self) -> bool:
        """Whether the target's plane was looked at."""
        return self.is_hard and not self.is_lost

    def nearby(self) -> Candidate:
        """The best candidate about the last pose: HDN's stages, refined; where little supports that, expected poses."""
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
            candidate = self._aligned(expected.homography, proposal, expected.covariance, expected.blur, self.seen)
            margin = MODEL.measured_margin if expected.is_measured else MODEL.support_margin
            if candidate.support > best.support - margin:
                return self._or_by_keypoints(candidate)
        if best.support < THRESHOLDS.fix_support and proposal.score >= THRESHOLDS.trusted_score:
            # A large motion is found in two goes: the second starts where the first came to.
            again = self._propose(proposal.homography)
            best = max(best, self._aligned(again.homography, again), key=lambda candidate: candidate.support)
        for start in (self._pose.predicted, self._pose.homography) if self.looks_at_plane else ():
            candidate = self._aligned(start, proposal, blur=self.expectation.blur)
            if candidate.support > best.support - MODEL.support_margin:
                return self._or_by_keypoints(candidate)
        return self._or_by_keypoints(best)

    def _or_by_keypoints(self, candidate: Candidate) -> Candidate:
        """The candidate, or where it is unsure that of matched keypoints if more supports it."""
        if self._target.is_sharp(candidate.homography, candidate.covariance) and is_fix(candidate.evidence):
            return candidate
        found = self._target.redetector.find(self._frame)
        if found is None or not self._target.is_plausible(found) or self._proposal is None:
            return candidate
        blur = candidate.alignment.prior.blur if candidate.alignment else NO_BLUR
        seen = self._target.occlusion.seen(self._frame, found)
        matched = self._aligned(found, self._proposal, blur=blur, seen=seen)
        is_better = matched.support > candidate.support + MODEL.support_margin
        return matched if is_better and not self._is_unlikely(matched) else candidate

    def anywhere(self) -> Candidate:
        """The best candidate in the whole frame, for a lost target: by keypoints in some frames, else by HDN."""
        by_keypoints = self._pose.missed % MODEL.keypoint_interval == 0
        found = self._target.redetector.find(self._frame) if by_keypoints else None
        if found is not None and self._target.is_plausible(found):
            # The keypoints vouch for the pose as HDN would.
            proposal = Proposal(found, 1.0, 1.0, 0.0, np.ones((1, 1), np.float32))
        else:
            proposal = self._propose(self._target.proposer.survey(self._frame.colour, self._pose.homography))
        return self._aligned(proposal.homography, proposal)

    def is_found(self, candidate: Candidate) -> bool:
        """Whether a candidate shows the target; after frames without it, its corners have to be sure as well."""
        is_known = self._pose.missed == 0 or self._target.is_known(candidate.homography, candidate.covariance)
        return is_known and is_fix(candidate.evidence) and not self._is_unlikely(candidate)

    def _is_unlikely(self, candidate: Candidate) -> bool:
        """Whether a candidate is far from where the target has to be, and not supported well enough for that.

        Patterns that repeat agree in many places.
        """
        if not self.looks_at_plane or candidate.support >= MODEL.sure_support:
            return False
        expected = self.expectation
        corners = self._target.corners(expected.homography)
        distance = np.linalg.norm(self._target.corners(candidate.homography) - corners, axis=1).mean()
        deviation = self._target.refiner.deviation(expected.homography, expected.covariance)
        allowed = MODEL.likely_deviations * deviation + MODEL.likely_ratio * side(corners)
        return expected.is_measured and bool(distance > allowed)

    def finely_aligned(self, candidate: Candidate) -> Candidate:
        """The candidate that was chosen, aligned to the last fractions of a pixel."""
        if candidate.alignment is None:
            return candidate
        found = self._target.refiner.align_finely(self._frame, candidate.alignment)
        if not self._target.is_plausible(found.homography):
            return candidate
        return candidate._replace(homography=found.homography, covariance=found.covariance, alignment=found)

    @cached_property
    def step(self) -> Step | None:
        """The plane's motion from the frame before to this one; None where it cannot be measured."""
        target, pose = self._target, self._pose
        if pose.frame is None or pose.seen is None or pose.seen_around is None:
            return None
        trust = target.plane.trust(pose.seen_around, pose.seen)
        back = np.linalg.inv(pose.homography)
        starts = [pose.predicted, pose.homography] + ([self._proposal.homography] if self._proposal else [])
        motions = (normalised(start @ back) for start in starts)
        corners = target.corners(pose.homography)
        return plane_step(target.plane, pose.frame, self._frame.grey, corners, trust, motions)

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
        around = target.occlusion_around.seen(self._frame, homography)
        found = target.plane.align(self._frame.grey, homography, covariance, around, blur)
        if found is not None and target.is_plausible(found.homography):
            is_measured |= found.agreement > MODEL.measured_agreement
            return Expectation(found.homography, found.covariance, is_measured, found, blur)
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

        best = min((self._pose.blur, refiner.spectral_blur(self._frame, homography)), key=lack)
        return best if lack(best) < MODEL.max_lack_left * lack(NO_BLUR) else NO_BLUR

    def _propose(self, start: Array) -> Proposal:
        return self._target.proposer.propose(self._frame.colour, start)

    def _aligned(
        self,
        start: Array,
        proposal: Proposal,
        covariance: Array = START_COVARIANCE,
        blur: Array = NO_BLUR,
        seen: Floats | None = None,
    ) -> Candidate:
        """Photometric alignment from a start, judged together with what a proposal says of the frame.

        Args:
            start: (3, 3) the pose that is expected.
            proposal: HDN's, for its scores and for what is visible.
            covariance: (8, 8) of the start.
            blur: (2, 2) px^2 of the standard crop, by which the frame is expected to be blurrier than the template.
            seen: (PARTS, PARTS) what the matte network sees; None, or too little, leaves that to HDN.
        """
        parts, offset = as_cells(proposal.visible), MODEL.visibility_offset
        if seen is not None and seen.mean() > MODEL.min_matte:
            parts, offset = seen, MODEL.matte_offset
        weights = np.clip(MODEL.visibility_gain * parts - offset, MODEL.min_visibility, 1)
        found = self._target.refiner.align_roughly(self._frame, start, weights, covariance, blur)
        agreement, visible = found.agreement, as_cells(parts)
        evidence = Evidence(proposal.score, proposal.polar_score, proposal.residual, float(visible.mean()))
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
            return np.zeros((PARTS, PARTS), np.float32)
        agreement = candidate.alignment.agreement
        agrees = agreement.agrees_surely & agreement.textured
        if not self.is_hard:
            return _parts(agrees | ~agreement.textured)
        seen = self.seen if self.looks_at_plane else self._target.occlusion.seen(self._frame, candidate.homography)
        surely = np.clip(MODEL.visibility_gain * seen - MODEL.matte_offset, 0, 1)
        return _parts(agrees & agreement.in_frame) * surely


def _unrefined(proposal: Proposal) -> Candidate:
    """A proposal taken as it is, judged by its scores alone."""
    visible = float(proposal.visible.mean())
    is_scored = min(proposal.score, proposal.polar_score) >= THRESHOLDS.trusted_score
    found = float(is_scored and visible >= THRESHOLDS.min_visible)
    evidence = Evidence(proposal.score, proposal.polar_score, proposal.residual, visible, found, found)
    return Candidate(proposal.homography, evidence, as_cells(proposal.visible))


def _parts(cells: Mask) -> Floats:
    """Cells (8, 8) of the target, true or false, as parts (PARTS, PARTS)."""
    return np.repeat(np.repeat(cells.astype(np.float32), PARTS // CELLS, 0), PARTS // CELLS, 1)
