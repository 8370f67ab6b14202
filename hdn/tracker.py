"""Tracking of one planar target: HDN, then photometric refinement, then a judgement of what was found."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, NamedTuple

import cv2
import numpy as np

from .alignment.agreement import CELLS
from .alignment.refinement import LOOSE, Alignment, Refiner
from .evidence import FIX, SEEN, TRUSTED_SCORE, Evidence, calibrated, is_fix, is_hint, is_shown, is_sure_fix
from .imaging.arrays import Array, Floats, Image
from .imaging.homography import normalised, transform
from .imaging.observation import Observation
from .imaging.pyramid import Pyramid
from .imaging.quads import area, check_quad, is_convex, side
from .networks.engine import Engine
from .networks.loading import load_engine
from .proposal import Proposal, Proposer, Stage
from .redetection import Redetector
from .surroundings import surrounding_motion

State = Literal["tracked", "held", "lost"]

SURE = 0.85  # support beyond which no other start is tried
# How far a target's step may differ from that of its surroundings for it to be taken as fixed among them: mean over the
# corners, px, or as a share of the step's length.
ATTACHED_PX, ATTACHED_SHARE = 1.5, 0.15
# Covariance that a step with the surroundings adds: 0.3 px at the crop's edge, half of it for perspective.
CARRIED = np.diag(np.square([0.3, 0.3, 0.3, 0.3, 0.3, 0.3, 0.15, 0.15]))
# Standard deviation of the corners up to which a target counts as tracked: px, or as a share of its size. With what
# `is_shown` asks for, it drops one good pose in forty of the drawn clips of `hdn-analyse states`, seeds 1 and 21, and
# more than half of the wrong ones.
KNOWN_PX, KNOWN_SHARE = 1.0, 0.025
HOLD_FRAMES = 20  # frames without a fix after which a held target counts as lost


@dataclass(frozen=True)
class Estimate:
    """The tracker's answer for one frame.

    Attributes:
        homography: (3, 3) reference-frame pixels to this frame's pixels; while lost, the last one known.
        corners: (4, 2) the target's corners in this frame, px.
        state: 'tracked'; 'held': too little is seen to say surely where the target is, for some frames, the pose being
            measured all the same, carried on, or left; or 'lost'.
        confidence: 0..1, the share of the target's area in the frame that agrees with the template.
        deviation: px, standard deviation of the corners: small where all is seen, some px where half is hidden,
            infinite where nothing tells where the target is.
        visibility: (8, 8) 0..1, which cells of the target are seen, row by row in its own reading order.
        evidence: what the judgement rests on.
        blur: (2, 2) px^2, covariance of the Gaussian by which this frame blurs the target more than the reference frame
            did (negative: less), about its middle; 0 where it makes no difference.
    """

    homography: Array
    corners: Array
    state: State
    confidence: float
    deviation: float
    visibility: Floats
    evidence: Evidence
    blur: Array = field(default_factory=lambda: np.zeros((2, 2)))


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
        self.engine = engine or load_engine(weights_path, device)
        self.stages = stages

    def init(self, frame: Image | Observation, quad: Array) -> None:
        """Takes the target: its quad (4, 2), px, in an RGB frame (H, W, 3).

        Trackers of several targets may share one `Observation` of a frame, and what it has computed.

        Raises:
            InputError: the quad is not convex, too small, or not wholly inside the frame.
        """
        self.quad = np.asarray(quad, np.float64)
        seen = _observed(frame)
        check_quad(self.quad, *seen.colour.size)
        self.proposer = Proposer(self.engine, seen, self.quad, self.stages)
        self.refiner = Refiner(seen, self.quad)
        self.redetector = Redetector(seen, self.quad)
        self.place(np.eye(3))
        self._seen: tuple[Pyramid, ...] = (seen.grey,)  # the last frame and the one before

    def place(self, homography: Array) -> None:
        """Goes on from a known pose: (3, 3), reference-frame pixels to those of the frame before the next."""
        self.homography = self.previous = normalised(homography)
        self.missed, self.covariance = 0, CARRIED
        self._seen = ()
        self._carried_to: tuple[Pyramid, Array | None] | None = None  # the frame last asked about, and the pose in it
        self._attached: bool | None = None  # to what surrounds the target; None where that is not known

    def lose(self) -> None:
        """Counts the target as lost, as after a cut: the next frame is searched as a whole."""
        self.missed = HOLD_FRAMES

    def propose(self, frame: Image | Observation) -> Proposal:
        """HDN's three stages from the last pose, and no more; the tracker does not move."""
        return self.proposer.propose(_observed(frame).colour, self.homography)

    def track(self, frame: Image | Observation) -> Estimate:
        """Finds the target in the next RGB frame (H, W, 3)."""
        seen = _observed(frame)
        finding = self._locate(seen)
        found, self._is_measured = self._is_found(finding), True
        if not found and self.missed >= 2:
            elsewhere = self._search(seen)
            if self._is_found(elsewhere) and is_sure_fix(elsewhere.evidence):
                finding, found = elsewhere, True
        if found:
            finding = self._settled(seen, finding)
            self.previous = self.homography if self.missed == 0 else finding.homography
            self.homography, self.covariance, self.missed = finding.homography, finding.covariance, 0
            if finding.evidence.support >= SURE:
                self._attached = None  # to be looked at anew when next something hides it
        else:
            if is_hint(finding.evidence) and self.missed < HOLD_FRAMES:
                self.homography, self.covariance = finding.homography, finding.covariance
                self.previous = self.homography
            else:
                self._carry_on(seen.grey)
            self.missed += 1
        self._seen = (seen.grey, *self._seen[:1])
        shown = found and is_shown(finding.evidence)
        known = shown and self._is_known(self.homography, self.covariance)
        state: State = "tracked" if known else "held" if self.missed <= HOLD_FRAMES else "lost"
        confidence = calibrated(finding.evidence.agreement) * (1.0 if found else 0.5)
        corners = transform(self.homography, self.quad)
        visibility = finding.visibility * found
        deviation = self.refiner.deviation(self.homography, self.covariance) if self._is_measured else np.inf
        blur = np.zeros((2, 2))
        if found and finding.alignment is not None:
            blur = self.refiner.frame_blur(finding.alignment)
        return Estimate(self.homography, corners, state, confidence, deviation, visibility, finding.evidence, blur)

    def _is_found(self, finding: "_Finding") -> bool:
        """Whether it shows the target; one that was hidden has to be seen well enough to say where it is."""
        known = self.missed == 0 or self._is_known(finding.homography, finding.covariance)
        return known and is_fix(finding.evidence)

    def _is_known(self, homography: Array, covariance: Array) -> bool:
        """Whether the corners of a pose are as sure as 'tracked' promises; HDN alone does not say how sure they are."""
        if "refinement" not in self.stages:
            return True
        known = max(KNOWN_PX, KNOWN_SHARE * side(transform(homography, self.quad)))
        return self.refiner.deviation(homography, covariance) <= known

    def _carry_on(self, grey: Pyramid) -> None:
        """Moves the pose of a hidden target with its surroundings, if that is what it does."""
        carried = self._carried(grey) if self.missed < HOLD_FRAMES else None  # known already, of `_expected`
        self._is_measured = carried is not None
        if carried is not None:
            self.homography, self.covariance = carried, self.covariance + CARRIED
        self.previous = self.homography

    def _carried(self, grey: Pyramid) -> Array | None:
        """The last pose, moved as its surroundings have since; None where they did not move alike while it was seen."""
        if self._carried_to is None or self._carried_to[0] is not grey:
            self._carried_to = grey, self._follow_surroundings(grey)
        return self._carried_to[1]

    def _follow_surroundings(self, grey: Pyramid) -> Array | None:
        if self._attached is None:
            self._attached = self._moved_with_surroundings()
        if not self._attached or not self._seen:
            return None
        step = surrounding_motion(self._seen[0], grey, transform(self.homography, self.quad))
        if step is None:
            return None
        carried = normalised(step @ self.homography)
        return carried if self._plausible(carried) else None

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

    def _locate(self, seen: Observation) -> "_Finding":
        """HDN's three stages from the last pose, refined; where that does not convince, refinement alone."""
        proposal = self.propose(seen)
        if "refinement" not in self.stages:
            return _unrefined(proposal)
        best = self._refine(seen, proposal.homography, proposal)
        if best.evidence.support < FIX and proposal.score >= TRUSTED_SCORE:
            # A large motion is found in two goes: the second starts where the first came to.
            again = self.proposer.propose(seen.colour, proposal.homography)
            best = max(best, self._refine(seen, again.homography, again), key=_support)
        if best.evidence.support < SURE:
            # Where much is hidden, what the visible part leaves open had better follow the motion so far.
            for start, covariance in self._expected(seen.grey):
                other = self._refine(seen, start, proposal, covariance)
                if _support(other) > _support(best) - 0.02:
                    return other
        return best

    def _search(self, seen: Observation) -> "_Finding":
        """Looks for a lost target anywhere in the frame: by keypoints, in every other frame, else by HDN."""
        found = self.redetector.find(seen) if self.missed % 2 == 0 else None
        if found is not None and self._plausible(found):
            # Keypoints vouch for it as HDN would.
            proposal = Proposal(found, 1.0, 1.0, 0.0, np.ones((1, 1), np.float32))
        else:
            proposal = self.proposer.propose(seen.colour, self.proposer.survey(seen.colour, self.homography))
        return self._refine(seen, proposal.homography, proposal)

    def _refine(self, frame: Observation, start: Array, proposal: Proposal, covariance: Array = LOOSE) -> "_Finding":
        """Photometric alignment from a start, and what it says of it together with a proposal."""
        seen = _cells(proposal.visible)
        found = self.refiner.approach(frame, start, np.clip(4 * seen - 0.6, 0.01, 1), covariance)
        homography, agreement = found.homography, found.agreement
        evidence = Evidence(proposal.score, proposal.polar_score, proposal.residual, float(proposal.visible.mean()))
        if not self._plausible(homography):
            return _Finding(start, evidence, np.zeros((CELLS, CELLS), np.float32))
        evidence = replace(evidence, agreement=agreement.share, cohesion=agreement.cohesion, border=found.border)
        # Where there is no texture to compare, the network's word for it.
        visibility = np.where(agreement.textured, agreement.agrees, seen).astype(np.float32) * agreement.in_frame
        return _Finding(homography, evidence, visibility, found.covariance, found)

    def _settled(self, frame: Observation, finding: "_Finding") -> "_Finding":
        """The finding that was chosen, to the last fractions of a pixel."""
        if finding.alignment is None:
            return finding
        found = self.refiner.settle(frame, finding.alignment)
        if not self._plausible(found.homography):
            return finding
        return finding._replace(homography=found.homography, covariance=found.covariance, alignment=found)

    def _expected(self, grey: Pyramid) -> list[tuple[Array, Array]]:
        """Poses to be expected without a look at the target, likeliest first, and their covariances (8, 8)."""
        predicted = normalised(self.homography @ np.linalg.inv(self.previous) @ self.homography)
        poses = [(predicted, LOOSE), (self.homography, LOOSE)]
        carried = self._carried(grey)
        return poses if carried is None else [(carried, self.covariance + CARRIED), *poses]

    def _plausible(self, homography: Array) -> bool:
        """Whether the pose is one that a camera can see: convex, not mirrored, neither vast nor tiny."""
        if not np.isfinite(homography).all():
            return False
        corners = transform(homography, self.quad)
        w = self.quad @ homography[2, :2] + homography[2, 2]
        ratio = area(corners) / area(self.quad)
        return bool((w > 0).all()) and is_convex(corners) and 0.01 < ratio < 50


class _Finding(NamedTuple):
    """A pose (3, 3), what speaks for it, which cells (8, 8) are seen, 0..1, its covariance (8, 8) and alignment."""

    homography: Array
    evidence: Evidence
    visibility: Floats
    covariance: Array = LOOSE
    alignment: Alignment | None = None


def _support(finding: _Finding) -> float:
    return finding.evidence.support


def _unrefined(proposal: Proposal) -> _Finding:
    """A proposal taken as it is, judged by its scores alone."""
    visible = float(proposal.visible.mean())
    found = min(proposal.score, proposal.polar_score) >= TRUSTED_SCORE and visible >= SEEN
    evidence = Evidence(proposal.score, proposal.polar_score, proposal.residual, visible, float(found), float(found))
    return _Finding(proposal.homography, evidence, _cells(proposal.visible))


def _cells(visible: Floats) -> Floats:
    """A map of the target at any resolution as (8, 8)."""
    return np.asarray(cv2.resize(visible, (CELLS, CELLS), interpolation=cv2.INTER_AREA), np.float32)


def _observed(frame: Image | Observation) -> Observation:
    return frame if isinstance(frame, Observation) else Observation(frame)
