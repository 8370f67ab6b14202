"""The search for a target in one frame: starts for the refinement from HDN, from motion and from keypoints.

Each start is refined and gives a candidate; the evidence says which of them shows the target.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np

from .alignment.agreement import CELLS
from .alignment.refinement import NO_BLUR, START_COVARIANCE, Alignment, as_cells
from .evidence import THRESHOLDS, Evidence, is_fix
from .imaging.arrays import Array, Floats
from .imaging.homography import normalised, transform
from .imaging.observation import Observation
from .plane_motion import plane_motion
from .proposal import Proposal
from .surroundings import surrounding_motion
from .target import CARRIED_COVARIANCE, Pose, Target


@dataclass(frozen=True)
class SearchModel:
    """Constants of the search in one frame."""

    sure_support: float = 0.85  # from which no other start is tried
    forgetting: float = 1.6
    measured_margin: float = 0.2
    support_margin: float = 0.02  # by which the candidate of an expected pose may fall short of HDN's and be taken
    keypoint_interval: int = 2  # a lost target is looked for by keypoints once in so many frames, else by HDN

    # A cell's weight in the refinement, by the share of it that the residual network sees: gain * share - offset, which
    # is nothing below 0.15 and all above 0.4. A cell that it takes for hidden keeps some weight, since it may err.
    visibility_gain: float = 4.0
    visibility_offset: float = 0.6
    min_visibility: float = 0.01

    # How far a target's step may differ from that of its surroundings for it to be taken as fixed among them: mean over
    # the corners, px, or as a share of the step's length, whichever is more.
    attached_px: float = 1.5
    attached_ratio: float = 0.15


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


class FrameSearch:
    """The search for a target in one frame, from its last pose.

    Attributes:
        is_attached: whether the target moves as its surroundings do; None while there was no need to measure that.
    """

    def __init__(self, target: Target, pose: Pose, frame: Observation) -> None:
        self._target, self._pose, self._frame = target, pose, frame
        self.is_attached = pose.is_attached
        self.by_map = None
        self.prior = None
        self.seen = None

    def nearby(self) -> Candidate:
        """The best candidate about the last pose: HDN's stages, refined; where little supports that, expected poses."""
        proposal = self._propose(self._pose.homography)
        if not self._target.is_refined:
            return _unrefined(proposal)
        best = self._aligned(proposal.homography, proposal)
        if best.support < THRESHOLDS.fix_support and proposal.score >= THRESHOLDS.trusted_score:
            # A large motion is found in two goes: the second starts where the first came to.
            again = self._propose(proposal.homography)
            best = max(best, self._aligned(again.homography, again), key=lambda candidate: candidate.support)
        if best.support < MODEL.sure_support:
            # Where much is hidden, what the visible part leaves open had better follow the motion so far.
            prior, covariance, is_measured = self.expected(proposal)
            blur = self.blur
            self.seen = seen = self._target.occlusion.seen(self._frame, prior)
            other = self._aligned(prior, proposal, covariance, blur, seen)
            margin = MODEL.measured_margin if is_measured else MODEL.support_margin
            if other.support > best.support - margin:
                return other
            for start in (self._predicted, self._pose.homography):
                other = self._aligned(start, proposal, START_COVARIANCE, blur)
                if other.support > best.support - MODEL.support_margin:
                    return other
        return best

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
        return is_known and is_fix(candidate.evidence)

    def finely_aligned(self, candidate: Candidate) -> Candidate:
        """The candidate that was chosen, aligned to the last fractions of a pixel."""
        if candidate.alignment is None:
            return candidate
        found = self._target.refiner.align_finely(self._frame, candidate.alignment)
        if not self._target.is_plausible(found.homography):
            return candidate
        return candidate._replace(homography=found.homography, covariance=found.covariance, alignment=found)

    @cached_property
    def carried(self) -> Array | None:
        """The last pose (3, 3), moved as its surroundings have since.

        None where the target did not move as they did while it was seen, or where they cannot be followed.
        """
        if self.is_attached is None:
            self.is_attached = self._moved_with_surroundings()
        if not self.is_attached or not self._pose.frames:
            return None
        corners = self._target.corners(self._pose.homography)
        step = surrounding_motion(self._pose.frames[0], self._frame.grey, corners)
        if step is None:
            return None
        carried = normalised(step @ self._pose.homography)
        return carried if self._target.is_plausible(carried) else None

    def _moved_with_surroundings(self) -> bool:
        """Whether the target's last step, between the last two frames, was that of what surrounds it."""
        if len(self._pose.frames) < 2:
            return False
        last, before = self._pose.frames
        corners, corners_before = (self._target.corners(h) for h in (self._pose.homography, self._pose.previous))
        step = surrounding_motion(before, last, corners_before)
        if step is None:
            return False
        difference = np.linalg.norm(transform(step, corners_before) - corners, axis=1).mean()
        length = np.linalg.norm(corners - corners_before, axis=1).mean()
        return bool(difference < max(MODEL.attached_px, MODEL.attached_ratio * length))

    @property
    def _predicted(self):
        last = self._pose.homography
        return normalised(last @ np.linalg.inv(self._pose.previous) @ last)

    def expected(self, proposal: Proposal):
        """The pose (3, 3) to be expected without a look at the target, its covariance (8, 8), and whether it was measured."""
        last = self._pose.homography
        prior, covariance, is_measured = self._predicted, START_COVARIANCE, False
        step = self.step(proposal)
        if step is not None:
            carried = normalised(step.homography @ last)
            if self._target.is_plausible(carried):
                prior, covariance, is_measured = carried, self._pose.covariance * (MODEL.forgetting if self._pose.missed == 0 else 1) + step.covariance, step.agreement > 0.75
                self.prior = prior, covariance
        elif self.carried is not None:
            prior, covariance = self.carried, self._pose.covariance + CARRIED_COVARIANCE
        self.blur = self.likeliest_blur(prior)
        self.around = self._target.plane_occlusion.seen(self._frame, prior)
        self.by_map = self._target.plane.align(self._frame.grey, prior, covariance, self.around, self.blur)
        if self.by_map is not None and self._target.is_plausible(self.by_map.homography):
            prior, covariance = self.by_map.homography, self.by_map.covariance
            is_measured |= self.by_map.agreement > 0.75
            self.prior = prior, covariance
        return prior, covariance, is_measured

    def likeliest_blur(self, pose):
        refiner = self._target.refiner
        guesses = [np.zeros((2, 2)), self._pose.blur, refiner.spectral_blur(self._frame, pose)]
        return max(guesses, key=lambda blur: refiner.likeness(self._frame, pose, self._pose.visibility, blur))

    def step(self, proposal):
        if not self._pose.frames:
            return None
        last = self._pose.homography
        inverse = np.linalg.inv(last)
        predicted = normalised(last @ np.linalg.inv(self._pose.previous) @ last)
        starts = [normalised(p @ inverse) for p in (predicted, last, proposal.homography)]
        plane = self._target.plane
        return plane_motion(
            self._pose.frames[0], self._frame.grey, self._target.corners(last), plane.lengths,
            plane.trust(self._pose.shown, self._pose.visibility), plane.margin, self._target.refiner.standard_side, starts, START_COVARIANCE,
        )

    def _propose(self, start: Array) -> Proposal:
        return self._target.proposer.propose(self._frame.colour, start)

    def _aligned(self, start: Array, proposal: Proposal, covariance: Array = START_COVARIANCE, blur=NO_BLUR, seen=None) -> Candidate:
        """Photometric alignment from a start, judged together with what a proposal says of the frame.

        Args:
            start: (3, 3) the pose that is expected.
            proposal: HDN's, for its scores and for what is visible.
            covariance: (8, 8) of the start.
        """
        visible = _cells(proposal.visible)
        if seen is not None and seen.mean() > 0.1:
            weights = np.clip(MODEL.visibility_gain * seen - 2, MODEL.min_visibility, 1)
            visible = as_cells(seen)
        else:
            seen = None
            weights = np.clip(MODEL.visibility_gain * visible - MODEL.visibility_offset, MODEL.min_visibility, 1)
        found = self._target.refiner.align_roughly(self._frame, start, weights, covariance, blur)
        agreement = found.agreement
        evidence = Evidence(proposal.score, proposal.polar_score, proposal.residual, float(visible.mean()))
        if not self._target.is_plausible(found.homography):
            return Candidate(start, evidence, np.zeros((CELLS, CELLS), np.float32))
        evidence = replace(evidence, agreement=agreement.share, cohesion=agreement.cohesion, border=found.border)
        # Where there is no texture to compare, the network's word for it.
        visibility = np.where(agreement.textured, agreement.agrees, visible).astype(np.float32) * agreement.in_frame
        return Candidate(found.homography, evidence, visibility, found.covariance, found)


def _unrefined(proposal: Proposal) -> Candidate:
    """A proposal taken as it is, judged by its scores alone."""
    visible = float(proposal.visible.mean())
    is_scored = min(proposal.score, proposal.polar_score) >= THRESHOLDS.trusted_score
    found = float(is_scored and visible >= THRESHOLDS.min_visible)
    evidence = Evidence(proposal.score, proposal.polar_score, proposal.residual, visible, found, found)
    return Candidate(proposal.homography, evidence, _cells(proposal.visible))


def _cells(visible: Floats) -> Floats:
    """A map (m, m) of the target, of any resolution, as (8, 8)."""
    return np.asarray(cv2.resize(visible, (CELLS, CELLS), interpolation=cv2.INTER_AREA), np.float32)
