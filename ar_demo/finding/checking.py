"""Whether a frame truly shows a picture where keypoints have it, and where exactly: by HDN and refinement."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from hdn import Observation, Tracker
from hdn.imaging.arrays import Array
from hdn.imaging.homography import from_corners, transform
from hdn.imaging.quads import mean_size, outline
from hdn.imaging.regions import Region
from hdn.networks.engine import Engine
from hdn.plane.keypoints import covariance_of_matches

from .matching import Place
from .pictures import Picture


@dataclass(frozen=True)
class CheckModel:
    """What has to agree, for a picture to be there."""

    min_agreement: float = 0.5  # share of the picture's cells in the frame that agree
    min_cohesion: float = 0.2  # share of the picture that agrees and hangs together
    same_pose: float = 15.5  # squared Mahalanobis distance of two poses, up to which they are one: 95 % of those are
    min_weight: float = 0.01  # of a part that is not seen
    sharpness_side_px: int = 160  # of the rectified view whose sharpness is told
    sharpness_blur_px: float = 0.8  # standard deviation of the Gaussian over it, against noise
    unsure_deviation: float = 0.1  # of the corners, as a share of the size: more is no place


MODEL = CheckModel()


class Checked(NamedTuple):
    """A place, once it was looked at.

    Attributes:
        corners: (4, 2) px of the frame.
        deviation: of them, px.
        score: 0..1, share of the picture's cells in the frame that agree.
        is_there: whether that is enough.
        sharpness: mean square slope of the rectified view, to its variance, px^-2; 0 where it is not there.
    """

    corners: Array
    deviation: float
    score: float
    is_there: bool
    sharpness: float


class Checker:
    """Compares frames with pictures; each picture is prepared when it is first needed."""

    def __init__(self, pictures: Sequence[Picture], load: Callable[[], Engine]) -> None:
        """Args: load: gives the networks, which is put off until something is to be looked at."""
        self._pictures, self._load = pictures, load
        self._engine: Engine | None = None
        self._trackers: dict[int, Tracker] = {}

    def check(self, frame: Observation, place: Place) -> Checked:
        """Looks whether a frame shows a picture at a place, and aligns the two."""
        tracker, quad = self._tracker(place.picture), self._pictures[place.picture].quad
        tracker.place(place.homography)
        estimate = tracker.track(frame)
        evidence, refiner = estimate.evidence, tracker.target.refiner
        is_there = evidence.agreement >= MODEL.min_agreement and evidence.cohesion >= MODEL.min_cohesion
        corners, deviation = estimate.corners, estimate.deviation
        # Keypoints tell where the picture has little texture, or looks otherwise in this light; alignment tells finely.
        matched = covariance_of_matches(refiner, place.homography, place.source, place.target)
        _, _, apart = refiner.combined(estimate.homography, tracker.pose.covariance, place.homography, matched)
        if is_there and apart < MODEL.same_pose:
            weights = np.maximum(estimate.visibility, np.float32(MODEL.min_weight))
            both = refiner.align(frame, place.homography, weights, matched)
            if tracker.target.is_plausible(both.homography):
                corners = transform(both.homography, quad)
                deviation = refiner.deviation(both.homography, both.covariance)
        size = float(np.linalg.norm(np.roll(corners, -1, 0) - corners, axis=1).mean())
        is_there = is_there and deviation < MODEL.unsure_deviation * size
        sharpness = self._sharpness(frame, from_corners(quad, corners), quad) if is_there else 0.0
        return Checked(corners, deviation, evidence.agreement, is_there, sharpness)

    def _sharpness(self, frame: Observation, homography: Array, quad: Array) -> float:
        """How sharp a frame shows what is at a pose (3, 3) of a picture with corners (4, 2)."""
        width, height = np.ceil(mean_size(quad) * MODEL.sharpness_side_px / mean_size(quad).max()).astype(int).tolist()
        view = frame.grey.crop(homography @ from_corners(outline(width, height), quad), width, height)
        smooth = cv2.GaussianBlur(view.astype(np.float32), (0, 0), MODEL.sharpness_blur_px)
        slopes = np.square(np.diff(smooth, axis=0)).mean() + np.square(np.diff(smooth, axis=1)).mean()
        return float(slopes / max(float(smooth.var()), 1.0))

    def _tracker(self, number: int) -> Tracker:
        if number not in self._trackers:
            picture = self._pictures[number]
            if self._engine is None:
                self._engine = self._load()
            tracker = self._trackers[number] = Tracker(engine=self._engine)
            # The region keeps it from learning what is around the picture, which is another thing in every place.
            tracker.init(Observation(picture.image), picture.quad, Region(picture.quad), picture.opaque)
        return self._trackers[number]
