"""Tracking of one planar target: HDN, then photometric refinement, then a judgement of what was found."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .alignment.refinement import NO_BLUR, START_COVARIANCE
from .errors import InputError
from .evidence import Evidence, is_hint, is_shown, is_sure_fix, visible_share
from .imaging.arrays import Array, Floats, Image
from .imaging.observation import Observation
from .imaging.quads import check_quad
from .imaging.regions import EVERYWHERE, Region, check_region
from .localisation import Candidate, FrameSearch
from .networks.engine import Engine
from .networks.loading import load_engine
from .proposal import Proposal, Stage
from .state import State
from .target import PARTS, Pose, Target


@dataclass(frozen=True)
class TrackingModel:
    """Constants of what is done and told while a target is not found."""

    search_after_frames: int = 2  # without a fix, after which the whole frame is searched
    # While the plane tells where the target is, that is done once in so many frames: an odd number, since what searches
    # changes from frame to frame.
    placed_interval: int = 3
    unfound_confidence: float = 0.5  # factor on the confidence in a pose that is no fix
    lost_variance_ratio: float = 100.0  # to that of a start of which nothing is known: of a pose after a cut


MODEL = TrackingModel()


class PlaneStep(NamedTuple):
    """The motion of a target's plane since the frame seen before.

    Attributes:
        homography: (3, 3) pixels of that frame to this one's.
        covariance: (8, 8) px^2 of the target's corners x0, y0, x1, y1 ... moved by it.
    """

    homography: Array
    covariance: Array


@dataclass(frozen=True)
class Estimate:
    """The tracker's answer for one frame.

    Attributes:
        homography: (3, 3) reference-frame pixels to this frame's pixels; while lost, the last one known.
        corners: (4, 2) the target's corners in this frame, px.
        state: 'tracked'; 'held': too little is seen of the target itself, but its pose is known to some px, by what
            surrounds it or by its motion so far; or 'lost'.
        confidence: 0..1, the share of the target's area in the frame that agrees with the template.
        deviation: px, standard deviation of the corners by all that is known: small where all is seen, some px where
            half is hidden, infinite while lost.
        visibility: (8, 8) 0..1, which cells of the target are seen, row by row in its own reading order.
        evidence: what the judgement rests on.
        blur: (2, 2) px^2, covariance of the Gaussian by which this frame blurs the target more than the reference frame
            did (negative: less), about its middle; 0 where it makes no difference.
        covariance: (8, 8) px^2, of the corners x0, y0, x1, y1 ... by what this frame alone tells; None where it tells
            nothing.
        step: how the plane moved since the frame before; None where that was not looked at, since the target is well
            seen, or where it cannot be told.
    """

    homography: Array
    corners: Array
    state: State
    confidence: float
    deviation: float
    visibility: Floats
    evidence: Evidence
    blur: Array = field(default_factory=lambda: np.zeros((2, 2)))
    covariance: Array | None = None
    step: PlaneStep | None = None


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

    def map_picture(self) -> Image:
        """The map of the target's plane as it is known by now: RGB (h, w, 3), rectified. See `PlaneMap.picture`."""
        return self.target.plane.picture

    def init(
        self, frame: Image | Observation, quad: Array, region: Region = EVERYWHERE, known: Image | None = None
    ) -> None:
        """Takes the target: its quad (4, 2), px, in an RGB frame (H, W, 3), and where on its plane to look.

        Trackers of several targets may share one `Observation` of a frame, and what it has computed.

        Args:
            known: (H, W) 255 where the frame shows the target's plane, of a picture put together; None: maybe anywhere.

        Raises:
            InputError: the quad is not convex, too small, or not wholly inside the frame; the region leaves nothing.
        """
        quad = np.asarray(quad, np.float64)
        seen = _observed(frame)
        check_quad(quad, *seen.colour.size)
        check_region(region, *seen.colour.size)
        target = Target.from_frame(self.engine, seen, quad, self.stages, region, known)
        cells = target.plane.level.cells
        whole = np.ones((PARTS, PARTS), np.float32)
        pose = Pose.known(np.eye(3)).after(seen.grey, seen=whole, seen_around=np.ones((cells, cells), bool))
        self._state = target, pose

    def place(self, homography: Array) -> None:
        """Goes on from a known pose: (3, 3), reference-frame pixels to those of the frame before the next.

        Raises:
            InputError: the tracker has no target yet.
        """
        self._state = self.target, Pose.known(homography)

    def lose(self) -> None:
        """Counts the target as lost, as after a cut: the next frame is searched as a whole.

        Raises:
            InputError: the tracker has no target yet.
        """
        lost = MODEL.lost_variance_ratio * START_COVARIANCE
        pose = replace(self.pose, missed=MODEL.search_after_frames, covariance=lost, frame=None)
        self._state = self.target, pose

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
        blur = NO_BLUR
        measured: Array | None = None
        placed = None if is_found else search.placed
        if is_found:
            speed, surprise = (target.distance(p, candidate.homography) for p in (pose.homography, pose.predicted))
            pose = pose.found(candidate.homography, candidate.covariance, speed, surprise)
            measured = candidate.measured
            if candidate.alignment is not None:
                blur = candidate.alignment.blur
        elif placed is not None:
            pose, blur, measured = pose.not_found(placed.homography, placed.covariance), placed.blur, placed.measured
        elif search.is_lost:
            pose = pose.not_found(pose.homography, pose.covariance)
        elif is_hint(candidate.evidence):
            pose = pose.not_found(candidate.homography, pose.blind_covariance)
        else:
            pose = pose.not_found(pose.homography, pose.blind_covariance)
        if target.is_refined:
            around = target.look_around(seen, pose.homography, is_found and not search.is_hard, blur)
            pose = pose.after(seen.grey, blur, search.shown_parts(candidate if is_found else None), around)
            pose = replace(pose, was_hard=search.is_hard, rest=search.rest)
        self._state = target, pose
        return _estimate(target, pose, search, candidate, is_found, measured)

    def _initialised(self) -> tuple[Target, Pose]:
        if self._state is None:
            raise InputError("the tracker has no target yet: call init(frame, quad) first")
        return self._state


def _found(search: FrameSearch, pose: Pose) -> tuple[Candidate, bool]:
    """The best candidate of a frame, and whether it shows the target; if so, it is finely aligned."""
    candidate = search.nearby()
    is_found = search.is_found(candidate)
    is_due = search.placed is None or pose.missed % MODEL.placed_interval == 0
    if not is_found and pose.missed >= MODEL.search_after_frames and is_due:
        elsewhere = search.anywhere()
        if search.is_found(elsewhere) and is_sure_fix(elsewhere.evidence):
            candidate, is_found = elsewhere, True
    return search.finely_aligned(candidate) if is_found else candidate, is_found


def _estimate(
    target: Target, pose: Pose, search: FrameSearch, candidate: Candidate, is_found: bool, measured: Array | None
) -> Estimate:
    """What is told of a frame.

    Args:
        pose: after the frame.
        search: in the frame.
        candidate: the best one in it.
        is_found: whether that shows the target.
        measured: (8, 8) covariance of the pose by what is seen in the frame alone; None where nothing was measured.
    """
    homography, covariance, refiner = pose.homography, pose.covariance, target.refiner
    is_known = target.is_known(homography, covariance) and target.is_sharp(homography, covariance)
    is_held = target.is_holdable(homography, covariance)
    state: State = (
        "tracked" if is_found and is_shown(candidate.evidence) and is_known else "held" if is_held else "lost"
    )
    alignment = candidate.alignment if is_found else None
    return Estimate(
        homography=homography,
        corners=target.corners(homography),
        state=state,
        confidence=visible_share(candidate.evidence.agreement) * (1.0 if is_found else MODEL.unfound_confidence),
        deviation=refiner.deviation(homography, covariance) if is_held or is_found else np.inf,
        visibility=candidate.visibility * is_found,
        evidence=candidate.evidence,
        blur=np.zeros((2, 2)) if alignment is None else refiner.frame_blur(alignment),
        covariance=None if measured is None else refiner.corner_covariance(homography, measured),
        step=_step(target, search) if search.looks_at_plane else None,
    )


def _step(target: Target, search: FrameSearch) -> PlaneStep | None:
    """The plane's motion that a search measured, with the covariance of the corners."""
    if search.step is None:
        return None
    covariance = target.refiner.corner_covariance(search.carried, search.step.covariance)
    return PlaneStep(search.step.homography, covariance)


def _observed(frame: Image | Observation) -> Observation:
    return frame if isinstance(frame, Observation) else Observation(frame)
