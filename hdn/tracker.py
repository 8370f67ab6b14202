"""Tracking of one planar target: HDN, then photometric refinement, then a judgement of what was found."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from .errors import InputError
from .evidence import Evidence, is_hint, is_shown, is_sure_fix, visible_share
from .imaging.arrays import Array, Floats, Image
from .imaging.observation import Observation
from .imaging.quads import check_quad
from .imaging.regions import EVERYWHERE, Region, check_region
from .localisation import MODEL as SEARCH
from .alignment.refinement import _finer
from .localisation import Candidate, FrameSearch
from .networks.engine import Engine
from .networks.loading import load_engine
from .proposal import Proposal, Stage
from .state import State
from .target import CARRIED_COVARIANCE, Pose, Target


@dataclass(frozen=True)
class TrackingModel:
    """Constants of what is done and told while a target is not found."""

    hold_frames: int = 20  # without a fix, after which a held target counts as lost
    search_after_frames: int = 2  # without a fix, after which the whole frame is searched
    unfound_confidence: float = 0.5  # factor on the confidence in a pose that is no fix


MODEL = TrackingModel()


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
        self._state: tuple[Target, Pose] | None = None

    @property
    def target(self) -> Target:
        """What is followed. Raises InputError before `init`."""
        return self._initialised()[0]

    @property
    def pose(self) -> Pose:
        """Where the target was last, and how surely. Raises InputError before `init`."""
        return self._initialised()[1]

    @property
    def quad(self) -> Array:
        """The target's corners (4, 2) in the reference frame, px. Raises InputError before `init`."""
        return self.target.quad

    @property
    def homography(self) -> Array:
        """The last pose (3, 3), reference-frame pixels to those of the last frame. Raises InputError before `init`."""
        return self.pose.homography

    def init(self, frame: Image | Observation, quad: Array, region: Region = EVERYWHERE) -> None:
        """Takes the target: its quad (4, 2), px, in an RGB frame (H, W, 3), and where on its plane to look.

        Trackers of several targets may share one `Observation` of a frame, and what it has computed.

        Raises:
            InputError: the quad is not convex, too small, or not wholly inside the frame; the region leaves nothing.
        """
        quad = np.asarray(quad, np.float64)
        seen = _observed(frame)
        check_quad(quad, *seen.colour.size)
        check_region(region, *seen.colour.size)
        target = Target.from_frame(self.engine, seen, quad, self.stages, region)
        cells = target.plane.level.cells
        self._state = target, replace(Pose.known(np.eye(3), (seen.grey,)), shown=np.ones((cells, cells), np.float32), visibility=np.ones((32, 32), np.float32))

    def place(self, homography: Array) -> None:
        """Goes on from a known pose: (3, 3), reference-frame pixels to those of the frame before the next.

        Raises:
            InputError: the tracker has no target yet.
        """
        cells = self.target.plane.level.cells
        self._state = self.target, replace(Pose.known(homography), shown=np.zeros((cells, cells), np.float32))

    def lose(self) -> None:
        """Counts the target as lost, as after a cut: the next frame is searched as a whole.

        Raises:
            InputError: the tracker has no target yet.
        """
        self._state = self.target, replace(self.pose, missed=MODEL.hold_frames)

    def propose(self, frame: Image | Observation) -> Proposal:
        """HDN's three stages from the last pose, and no more; the tracker does not move.

        Raises:
            InputError: the tracker has no target yet.
        """
        return self.target.proposer.propose(_observed(frame).colour, self.homography)

    def track(self, frame: Image | Observation) -> Estimate:
        """Finds the target in the next RGB frame (H, W, 3).

        Raises:
            InputError: the tracker has no target yet.
        """
        target, pose = self._initialised()
        seen = _observed(frame)
        search = FrameSearch(target, pose, seen)
        candidate, is_found = _found(search, pose)
        is_measured = True
        if is_found:
            pose = pose.found(candidate.homography, candidate.covariance, seen.grey)
        elif search.prior is not None and pose.missed < MODEL.hold_frames:
            pose = pose.not_found(*search.prior, seen.grey)
        elif pose.missed < MODEL.hold_frames and is_hint(candidate.evidence):
            pose = pose.not_found(candidate.homography, candidate.covariance, seen.grey)
        elif pose.missed < MODEL.hold_frames and search.carried is not None:
            pose = pose.not_found(search.carried, pose.covariance + CARRIED_COVARIANCE, seen.grey)
        else:
            pose = pose.not_found(pose.homography, pose.covariance, seen.grey)
            is_measured = False
        # Once nothing hides the target, whether it is attached is to be measured anew when next something does.
        is_clear = is_found and candidate.support >= SEARCH.sure_support
        if target.is_refined:
            shown = target.plane.look(seen.grey, pose.homography, is_clear)
            agreement = candidate.alignment.agreement if candidate.alignment is not None else None
            if is_clear:
                visibility = np.ones((32, 32), np.float32)
                visibility = _finer(np.where(agreement.textured, agreement.agrees_surely, 1).astype(np.float32), 32)
            elif agreement is not None and is_found:
                visibility = _finer((agreement.agrees_surely & agreement.visible).astype(np.float32), 32)
                if search.seen is not None:
                    visibility = visibility * np.clip(4 * search.seen - 2, 0, 1)
            else:
                visibility = np.zeros((32, 32), np.float32)
            pose = replace(pose, visibility=visibility, shown=shown)
            blur = candidate.alignment.blur if is_found and candidate.alignment is not None else pose.blur
        else:
            blur = pose.blur
        self._state = target, replace(pose, is_attached=None if is_clear else search.is_attached, blur=blur)
        return _estimate(target, pose, candidate, is_found, is_measured)

    def _initialised(self) -> tuple[Target, Pose]:
        if self._state is None:
            raise InputError("the tracker has no target yet: call init(frame, quad) first")
        return self._state


def _found(search: FrameSearch, pose: Pose) -> tuple[Candidate, bool]:
    """The best candidate of a frame, and whether it shows the target; if so, it is finely aligned."""
    candidate = search.nearby()
    is_found = search.is_found(candidate)
    if not is_found and pose.missed >= MODEL.search_after_frames:
        elsewhere = search.anywhere()
        if search.is_found(elsewhere) and is_sure_fix(elsewhere.evidence):
            candidate, is_found = elsewhere, True
    return search.finely_aligned(candidate) if is_found else candidate, is_found


def _estimate(target: Target, pose: Pose, candidate: Candidate, is_found: bool, is_measured: bool) -> Estimate:
    """What is told of a frame.

    Args:
        pose: after the frame.
        candidate: the best one in it.
        is_found: whether that shows the target.
        is_measured: whether anything in the frame tells where the target is.
    """
    is_sure = is_found and is_shown(candidate.evidence) and target.is_known(pose.homography, pose.covariance)
    state: State = "tracked" if is_sure else "held" if pose.missed <= MODEL.hold_frames else "lost"
    alignment = candidate.alignment if is_found else None
    return Estimate(
        homography=pose.homography,
        corners=target.corners(pose.homography),
        state=state,
        confidence=visible_share(candidate.evidence.agreement) * (1.0 if is_found else MODEL.unfound_confidence),
        deviation=target.refiner.deviation(pose.homography, pose.covariance) if is_measured else np.inf,
        visibility=candidate.visibility * is_found,
        evidence=candidate.evidence,
        blur=np.zeros((2, 2)) if alignment is None else target.refiner.frame_blur(alignment),
    )


def _observed(frame: Image | Observation) -> Observation:
    return frame if isinstance(frame, Observation) else Observation(frame)
