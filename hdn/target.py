"""A planar target: what is kept of it from the reference frame on, and where it was last."""

from dataclasses import dataclass, field, replace

import numpy as np

from .alignment.agreement import CELLS
from .alignment.refinement import Refiner
from .imaging.arrays import Array, Floats
from .imaging.homography import normalised, transform
from .imaging.observation import Observation
from .imaging.pyramid import Pyramid
from .imaging.quads import area, is_convex, outline, side
from .imaging.regions import EVERYWHERE, Region
from .networks.engine import Engine
from .occlusion import Occlusion
from .plane_map import PlaneMap
from .proposal import Proposer, Stage
from .redetection import Redetector


@dataclass(frozen=True)
class PoseModel:
    """Constants of what a pose may be, and of how its uncertainty grows."""

    min_magnification: float = 0.01  # area of a target in a frame, to that in the reference frame
    max_magnification: float = 50.0
    # Standard deviation of the corners up to which a pose counts as known: px, or as a share of the target's size,
    # whichever is more. With what `evidence.is_shown` asks for, it drops one good pose in forty of the drawn clips of
    # `hdn-analyse states`, seeds 1 and 21, and more than half of the wrong ones.
    known_px: float = 1.0
    known_ratio: float = 0.025
    # Standard deviation that a step with the surroundings adds to the eight parameters of a pose, px at the edge of the
    # standard crop: as much for affine and translation, half of it for perspective.
    carried_deviation_px: tuple[float, ...] = (0.3, 0.3, 0.3, 0.3, 0.3, 0.3, 0.15, 0.15)


MODEL = PoseModel()
CARRIED_COVARIANCE = np.diag(np.square(MODEL.carried_deviation_px))


@dataclass(frozen=True)
class Target:
    """What is made of a target once, in the reference frame.

    Attributes:
        quad: (4, 2) its corners in the reference frame, px.
        proposer: HDN's stages.
        refiner: photometric refinement.
        redetector: its keypoints.
        plane: what surrounds it on the same plane; it learns.
        region: where on its plane tracking may look.
    """

    quad: Array
    proposer: Proposer
    refiner: Refiner
    redetector: Redetector
    plane: PlaneMap
    occlusion: Occlusion
    plane_occlusion: Occlusion
    region: Region = EVERYWHERE

    @classmethod
    def from_frame(
        cls, engine: Engine, frame: Observation, quad: Array, stages: frozenset[Stage], region: Region = EVERYWHERE
    ) -> "Target":
        """Takes a target (4, 2) in the reference frame."""
        usable = None if region.is_everywhere else region.mask(*frame.colour.size)
        refiner = Refiner(frame, quad, usable)
        plane = PlaneMap(frame, quad, refiner.standard_side, region)
        return cls(
            quad, Proposer(engine, frame, quad, stages), refiner, Redetector(frame, quad), plane, Occlusion(engine, frame, quad),
            Occlusion(engine, frame, transform(plane.level.to_template, outline(plane.level.width, plane.level.height)), plane.level.cells), region
        )

    @property
    def is_refined(self) -> bool:
        """Whether photometric refinement is among the stages."""
        return "refinement" in self.proposer.stages

    def corners(self, homography: Array) -> Array:
        """The target's corners (4, 2), px of the frame, by a pose (3, 3)."""
        return transform(homography, self.quad)

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
        """Whether the corners of a pose (3, 3) are as sure, by its covariance (8, 8), as 'tracked' promises.

        Without refinement nothing tells how sure they are, and any are.
        """
        if not self.is_refined:
            return True
        most = max(MODEL.known_px, MODEL.known_ratio * side(self.corners(homography)))
        return self.refiner.deviation(homography, covariance) <= most


@dataclass(frozen=True)
class Pose:
    """Where a target was last, and what the next frame is searched with. Methods return the pose after that frame.

    Attributes:
        homography: (3, 3) reference-frame pixels to those of the last frame.
        previous: (3, 3) the same of the frame before, for the motion so far; that of the last where it is not known.
        covariance: (8, 8) of the homography's parameters, as `Alignment` tells it.
        missed: frames in a row in which the target was not found.
        frames: grey, the last one and the one before, as far as they are known.
        is_attached: whether the target moves as its surroundings do; None where that was not looked at yet.
    """

    homography: Array
    previous: Array
    covariance: Array
    missed: int = 0
    frames: tuple[Pyramid, ...] = ()
    is_attached: bool | None = None
    blur: Array = field(default_factory=lambda: np.zeros((2, 2)))
    visibility: Floats = field(default_factory=lambda: np.ones((CELLS, CELLS), np.float32))
    shown: Floats = field(default_factory=lambda: np.zeros((CELLS, CELLS), np.float32))

    @classmethod
    def known(cls, homography: Array, frames: tuple[Pyramid, ...] = ()) -> "Pose":
        """The pose of a target that is at a homography (3, 3), with nothing known of its motion."""
        pose = normalised(homography)
        return cls(pose, pose, CARRIED_COVARIANCE, frames=frames)

    def found(self, homography: Array, covariance: Array, frame: Pyramid) -> "Pose":
        """The target was found in a grey frame."""
        previous = self.homography if self.missed == 0 else homography
        return replace(self, homography=homography, previous=previous, covariance=covariance, missed=0)._after(frame)

    def not_found(self, homography: Array, covariance: Array, frame: Pyramid) -> "Pose":
        """The target was not found in a grey frame; the pose is taken as given, and its motion as unknown."""
        missed = self.missed + 1
        changed = replace(self, homography=homography, previous=homography, covariance=covariance, missed=missed)
        return changed._after(frame)

    def _after(self, frame: Pyramid) -> "Pose":
        return replace(self, frames=(frame, *self.frames[:1]))
