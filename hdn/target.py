"""A planar target: what is kept of it from the reference frame on, and where it was last."""

from dataclasses import dataclass, field, replace

import numpy as np

from .alignment.agreement import CELLS
from .alignment.refinement import NO_BLUR, Refiner
from .imaging.arrays import Array, Floats, Image, Mask
from .imaging.homography import normalised, transform
from .imaging.observation import Observation
from .imaging.pyramid import Pyramid
from .imaging.quads import area, is_convex, side
from .imaging.regions import EVERYWHERE, Region
from .networks.engine import Engine
from .plane.keypoints import PlaneKeypoints
from .plane.occlusion import Occlusion
from .plane.plane_map import PlaneMap
from .proposal import Proposer, Stage
from .state import BOUNDS

PARTS = 4 * CELLS  # along either side of a target, that are told to be seen or hidden


@dataclass(frozen=True)
class PoseModel:
    """Constants of what a pose may be, and of how its uncertainty grows."""

    min_magnification: float = 0.01  # area of a target in a frame, to that in the reference frame
    max_magnification: float = 50.0
    # Standard deviations of the eight parameters of a pose, px at the edge of the standard crop: affine four,
    # translation, perspective. Of one that is given:
    given_deviation_px: tuple[float, ...] = (0.3, 0.3, 0.3, 0.3, 0.3, 0.3, 0.15, 0.15)
    # By which a target at rest moves in a frame in which nothing tells how; so many times more at a speed in px of the
    # standard crop per frame, and once:
    drift_deviation_px: tuple[float, ...] = (0.4, 0.4, 1.0, 0.4, 0.4, 1.0, 0.2, 0.2)
    # Growth of a measured pose's variance to the next frame: errors of neighbouring frames are much the same, so that
    # many of them make a pose less sure than they would if each erred on its own.
    forgetting: float = 1.6


MODEL = PoseModel()
GIVEN_COVARIANCE = np.diag(np.square(MODEL.given_deviation_px))
DRIFT_COVARIANCE = np.diag(np.square(MODEL.drift_deviation_px))


@dataclass(frozen=True)
class Target:
    """What is made of a target once, in the reference frame.

    Attributes:
        quad: (4, 2) its corners in the reference frame, px.
        proposer: HDN's stages.
        refiner: photometric refinement.
        plane: what surrounds it on the same plane; it learns.
        keypoints: of both.
        occlusion, occlusion_around: what is seen of the target, and of the plane.
        region: where on its plane tracking may look.
        frame_side: longer side of the frames, px.
    """

    quad: Array
    proposer: Proposer
    refiner: Refiner
    plane: PlaneMap
    keypoints: PlaneKeypoints
    occlusion: Occlusion
    occlusion_around: Occlusion
    region: Region
    frame_side: int

    @classmethod
    def from_frame(
        cls,
        engine: Engine,
        frame: Observation,
        quad: Array,
        stages: frozenset[Stage],
        region: Region = EVERYWHERE,
        known: Image | None = None,
    ) -> "Target":
        """Takes a target (4, 2) in the reference frame, of which (H, W) is known where it is 255; None is all."""
        width, height = frame.colour.size
        usable = None if region.is_everywhere else region.mask(width, height)
        refiner = Refiner(frame, quad, usable)
        plane = PlaneMap(frame, quad, refiner.standard_side, region, known)
        around = Occlusion(engine.matte, frame, plane.corners, plane.level.cells)
        if known is not None:
            around.take(plane.texture.picture, plane.texture.known)
            usable = known if usable is None else usable & known
        return cls(
            quad,
            Proposer(engine, frame, quad, stages),
            refiner,
            plane,
            PlaneKeypoints(frame, quad, plane, usable),
            Occlusion(engine.matte, frame, quad, PARTS, framed=True),
            around,
            region,
            max(width, height),
        )

    @property
    def is_refined(self) -> bool:
        """Whether photometric refinement is among the stages."""
        return "refinement" in self.proposer.stages

    def look_around(self, frame: Observation, homography: Array, learn: bool, blur: Array) -> Mask:
        """Which cells (n, n) of its plane a frame shows at a pose (3, 3); see `PlaneMap.look`, which may learn."""
        texture = self.plane.texture
        known = texture.takes
        shown = self.plane.look(frame, homography, learn, blur)
        if texture.takes > known:
            self.occlusion_around.take(texture.picture, texture.known)
            self.keypoints.take()
        return shown

    def corners(self, homography: Array) -> Array:
        """The target's corners (4, 2), px of the frame, by a pose (3, 3)."""
        return transform(homography, self.quad)

    def distance(self, before: Array, after: Array) -> float:
        """How far the corners are from one pose (3, 3) to another, the mean over them, px of the standard crop."""
        corners = self.corners(after)
        moved = np.linalg.norm(corners - self.corners(before), axis=1).mean()
        return float(moved * self.refiner.standard_side / max(side(corners), 1.0))

    def is_plausible(self, homography: Array) -> bool:
        """Whether a pose (3, 3) is one that a camera can see: convex, not mirrored, neither vast nor tiny."""
        if not np.isfinite(homography).all():
            return False
        corners = self.corners(homography)
        w = self.quad @ homography[2, :2] + homography[2, 2]
        magnification = area(corners) / area(self.quad)
        is_sized = MODEL.min_magnification < magnification < MODEL.max_magnification
        return bool((w > 0).all()) and is_convex(corners) and is_sized

    def is_known(self, homography: Array, covariance: Array) -> bool:
        """Whether the corners of a pose (3, 3) are sure, by its covariance (8, 8), for a target of their size.

        Without refinement nothing tells how sure they are, and any are.
        """
        return self._is_within(BOUNDS.known(side(self.corners(homography))), homography, covariance)

    def is_sharp(self, homography: Array, covariance: Array) -> bool:
        """Whether a pose that is known is as sure as 'tracked' promises: whether its error is hardly seen."""
        return self._is_within(BOUNDS.sharp(self.frame_side), homography, covariance)

    def is_holdable(self, homography: Array, covariance: Array) -> bool:
        """Whether a pose is sure enough to be held."""
        return self._is_within(BOUNDS.held(side(self.corners(homography)), self.frame_side), homography, covariance)

    def _is_within(self, most: Array | float, homography: Array, covariance: Array) -> bool:
        """Whether the corners' standard deviation is at most so many px; without refinement nothing tells it."""
        return not self.is_refined or bool(self.refiner.deviation(homography, covariance) <= most)


@dataclass(frozen=True)
class Rest:
    """For how many frames keypoints are left alone, since they told nothing lately: they take long.

    Attributes:
        left: from the next frame on.
        length: of this rest, when it began.
    """

    left: int = 0
    length: int = 0

    def longer(self, most: int) -> "Rest":
        """The rest after one more frame in which they told nothing."""
        length = min(2 * self.length + 1, most)
        return Rest(length, length)


@dataclass(frozen=True)
class Pose:
    """Where a target was last, and what the next frame is searched with. Methods return the pose after that frame.

    Attributes:
        homography: (3, 3) reference-frame pixels to those of the last frame.
        previous: (3, 3) the same of the frame before, for the motion so far; that of the last where it is not known.
        covariance: (8, 8) of the homography's parameters, as `Alignment` tells it.
        missed: frames in a row in which the target was not found.
        speed: px of the standard crop per frame, the mean over the corners, when that was last known.
        surprise: px of the standard crop, the mean over the corners, between where the target was expected to go on to
            and where it was; infinite where nothing was expected.
        frame: grey, the last one; None where it is not known.
        blur: (2, 2) px^2 of the standard crop, by which the last frame was blurrier than the reference frame.
        seen: (PARTS, PARTS) 0..1, which parts of the target the last frame is known to show.
        seen_around: (n, n) the same of the cells of the plane map; None where that was not looked at.
        was_hard: whether the target was not found just like that in the last frame.
        rest: for how long keypoints are left alone.
    """

    homography: Array
    previous: Array
    covariance: Array
    missed: int = 0
    speed: float = 0.0
    surprise: float = np.inf
    frame: Pyramid | None = None
    blur: Array = field(default_factory=lambda: NO_BLUR)
    seen: Floats | None = None
    seen_around: Mask | None = None
    was_hard: bool = False
    rest: Rest = Rest()

    @classmethod
    def known(cls, homography: Array) -> "Pose":
        """The pose of a target that is at a homography (3, 3), with nothing known of its motion."""
        pose = normalised(homography)
        return cls(pose, pose, GIVEN_COVARIANCE)

    @property
    def predicted(self) -> Array:
        """The pose (3, 3) in the next frame if the target goes on as it moved."""
        return normalised(self.homography @ np.linalg.inv(self.previous) @ self.homography)

    @property
    def prior_covariance(self) -> Array:
        """Covariance (8, 8) of the pose as what the next frame's is expected from, without its motion."""
        return self.covariance * (MODEL.forgetting if self.missed == 0 else 1)

    @property
    def blind_covariance(self) -> Array:
        """Covariance (8, 8) of the pose in the next frame if nothing tells there how the target moved."""
        return self.covariance + DRIFT_COVARIANCE * (1 + self.speed) ** 2

    def found(self, homography: Array, covariance: Array, speed: float, surprise: float) -> "Pose":
        """The target was found, having moved at a speed, px of the standard crop, if it was found before as well."""
        if self.missed:
            pose = replace(self, homography=homography, previous=homography, covariance=covariance, missed=0)
            return replace(pose, surprise=np.inf)
        pose = replace(self, homography=homography, previous=self.homography, covariance=covariance)
        return replace(pose, speed=speed, surprise=surprise)

    def not_found(self, homography: Array, covariance: Array) -> "Pose":
        """The target was not found; the pose is taken as given, and its motion as unknown."""
        missed = self.missed + 1
        pose = replace(self, homography=homography, previous=homography, covariance=covariance, missed=missed)
        return replace(pose, surprise=np.inf)

    def after(
        self, frame: Pyramid, blur: Array = NO_BLUR, seen: Floats | None = None, seen_around: Mask | None = None
    ) -> "Pose":
        """The pose with what the frame it is in, grey, shows; see the attributes."""
        return replace(self, frame=frame, blur=blur, seen=seen, seen_around=seen_around)
