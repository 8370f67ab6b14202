"""The trackers that can be compared: ours, and peers made of OpenCV's well-known parts.

A tracker takes the target with `init` and answers for each frame after with `track`. A variant is one line in OURS or
in PEERS.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple, Protocol

import cv2
import numpy as np

from ..errors import InputError
from ..evidence import THRESHOLDS
from ..imaging.arrays import Array, Image
from ..imaging.homography import from_corners
from ..imaging.homography import transform as through
from ..imaging.quads import is_convex
from ..networks import weights
from ..networks.config import COMPACT, PAPER
from ..networks.engine import Engine
from ..proposal import Stage
from ..state import State
from ..tracker import Tracker


class Answer(NamedTuple):
    """Corners (4, 2) px, or None where the tracker has no idea, and what it says of them."""

    corners: Array | None
    state: State


LOST = Answer(None, "lost")


class PlanarTracker(Protocol):
    """What runs over a sequence; frames are RGB uint8 (H, W, 3)."""

    def init(self, frame: Image, quad: Array) -> None:
        """Takes the target: its quad (4, 2), px, in the first frame. Raises InputError where it cannot be tracked."""

    def track(self, frame: Image) -> Answer:
        """Finds the target in the next frame."""


class Hdn:
    """Our whole tracker."""

    def __init__(self, engine: Engine) -> None:
        self.tracker = Tracker(engine=engine)

    def init(self, frame: Image, quad: Array) -> None:
        self.tracker.init(frame, quad)

    def track(self, frame: Image) -> Answer:
        estimate = self.tracker.track(frame)
        return Answer(estimate.corners, estimate.state)


class Stages:
    """Some of HDN's stages and nothing of ours: no refinement, no second start, no search for what is lost.

    As in the paper, errors add up. Scores alone judge; without the similarity stage there are none.
    """

    def __init__(self, engine: Engine, *stages: Stage) -> None:
        self.tracker = Tracker(engine=engine, stages=frozenset(stages))

    def init(self, frame: Image, quad: Array) -> None:
        self.tracker.init(frame, quad)
        self.corners = quad

    def track(self, frame: Image) -> Answer:
        proposal = self.tracker.propose(frame)
        corners = through(proposal.homography, self.tracker.quad)
        if not (np.isfinite(corners).all() and is_convex(corners)):
            return Answer(self.corners, "held")  # nowhere to go on from
        self.tracker.place(proposal.homography)
        self.corners = corners
        return Answer(corners, "tracked" if proposal.score >= THRESHOLDS.trusted_score else "held")


class Authors:
    """The authors' released tracker, which never says that it has lost the target."""

    def __init__(self, path: Path) -> None:
        from ..networks.authors import AuthorsTracker  # PyTorch, which no other tracker needs
        from ..networks.pytorch import load

        self.tracker = AuthorsTracker(load(path))

    def init(self, frame: Image, quad: Array) -> None:
        self.quad = quad
        self.tracker.init(frame, quad)

    def track(self, frame: Image) -> Answer:
        return Answer(through(self.tracker.track(frame), self.quad), "tracked")


@cache
def _engine(path: Path) -> Engine:
    """Networks loaded once a process: loading takes longer than tracking a short clip."""
    return Tracker(path).engine


@dataclass(frozen=True)
class MatchingSettings:
    """When matched points make a homography."""

    max_distance_ratio: float = 0.8  # of the nearest descriptor's distance to the second nearest's (Lowe, 2004)
    tolerance_px: float = 3.0  # from a homography, within which a match agrees with it
    min_inliers: int = 8  # matches


MATCHING = MatchingSettings()


class Keypoints:
    """Keypoints of the first frame's target matched to each frame anew (ratio test), and a robust homography.

    It keeps nothing from frame to frame: it cannot drift, and never stays lost.
    """

    def __init__(self, detector: cv2.Feature2D, norm: int, method: int) -> None:
        """Args: norm: cv2.NORM_*, of descriptors; method: cv2.RANSAC or cv2.USAC_*, of cv2.findHomography."""
        self.detector, self.method = detector, method
        self.matcher = cv2.BFMatcher(norm)

    def init(self, frame: Image, quad: Array) -> None:
        mask = np.zeros(frame.shape[:2], np.uint8)
        cv2.fillConvexPoly(mask, np.round(quad).astype(np.int32), 255)
        self.quad = quad
        self.points, self.descriptors = self._detect(frame, mask)

    def track(self, frame: Image) -> Answer:
        points, descriptors = self._detect(frame)
        if min(len(points), len(self.points)) < MATCHING.min_inliers:
            return LOST
        pairs = self.matcher.knnMatch(self.descriptors, descriptors, k=2)
        good = [p[0] for p in pairs if len(p) == 2 and p[0].distance < MATCHING.max_distance_ratio * p[1].distance]
        source = self.points[[m.queryIdx for m in good]]
        target = points[[m.trainIdx for m in good]]
        return _robust(self.quad, source, target, self.method)

    def _detect(self, frame: Image, mask: Image | None = None) -> tuple[Array, np.ndarray]:
        keypoints, descriptors = self.detector.detectAndCompute(_grey(frame), mask)
        return np.array([k.pt for k in keypoints], np.float64).reshape(-1, 2), descriptors


@dataclass(frozen=True)
class FlowSettings:
    """How points are followed."""

    points: int = 300  # at most
    min_points: int = 60  # fewer, and new ones are taken
    min_quality: float = 0.01  # of a corner, share of the best one's
    apart_px: float = 5  # between two points
    window_px: int = 21  # side of the patch around a point
    levels: int = 4  # of the pyramid, beside the frame itself
    max_return_px: float = 1.0  # between a point and where it comes back to when followed backward


FLOW = FlowSettings()


class Flow:
    """Pyramidal Lucas-Kanade from frame to frame, checked backward, and RANSAC; errors add up."""

    def init(self, frame: Image, quad: Array) -> None:
        self.grey, self.corners = _grey(frame), quad
        self.points = self._detect()

    def track(self, frame: Image) -> Answer:
        before, self.grey = self.grey, _grey(frame)
        if len(self.points) < MATCHING.min_inliers:
            return LOST
        window = {"winSize": (FLOW.window_px,) * 2, "maxLevel": FLOW.levels}
        there, found, _ = cv2.calcOpticalFlowPyrLK(before, self.grey, self.points, None, **window)
        back, returned, _ = cv2.calcOpticalFlowPyrLK(self.grey, before, there, None, **window)
        near = np.linalg.norm(back - self.points, axis=-1).ravel() < FLOW.max_return_px
        good = near & (found.ravel() == 1) & (returned.ravel() == 1)
        source, target = self.points[good].reshape(-1, 2), there[good].reshape(-1, 2)
        answer = _robust(self.corners, source, target, cv2.RANSAC)
        if answer.corners is None:
            return LOST  # the points stay where they were: the target may come to rest there again
        self.corners, self.points = answer.corners, target.reshape(-1, 1, 2)
        if len(self.points) < FLOW.min_points:
            self.points = self._detect()
        return answer

    def _detect(self) -> np.ndarray:
        mask = np.zeros(self.grey.shape, np.uint8)
        cv2.fillConvexPoly(mask, np.round(self.corners).astype(np.int32), 255)
        points = cv2.goodFeaturesToTrack(self.grey, FLOW.points, FLOW.min_quality, FLOW.apart_px, mask=mask)
        return np.empty((0, 1, 2), np.float32) if points is None else points


@dataclass(frozen=True)
class EccSettings:
    """How the first view is aligned."""

    longest_px: int = 200  # of the target's sides; frames are shrunk to that
    smoothing_px: float = 1.0  # of the shrunken frame, standard deviation
    iterations: int = 40
    min_gain: float = 1e-4  # of the correlation in an iteration; with less, it is done


ECC = EccSettings()


class Ecc:
    """Enhanced correlation coefficient (Evangelidis and Psarakis, 2008): the first view aligned from the last pose."""

    def init(self, frame: Image, quad: Array) -> None:
        sides = np.linalg.norm(np.roll(quad, -1, 0) - quad, axis=1)
        across = np.array([max(sides[0], sides[2]), max(sides[1], sides[3])])
        whole = np.array([frame.shape[1], frame.shape[0]])
        self.size = np.maximum(1, np.round(whole * min(1.0, ECC.longest_px / across.max()))).astype(int)
        self.scale = self.size / whole
        w, h = (max(8, round(s)) for s in across * self.scale)
        self.outline = np.array([[0.0, 0], [w - 1, 0], [w - 1, h - 1], [0, h - 1]])
        self.pose = from_corners(self.outline, (quad + 0.5) * self.scale - 0.5)  # rectified template to shrunken frame
        inward = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        self.template = cv2.warpPerspective(self._shrunk(frame), self.pose, (w, h), flags=inward)

    def track(self, frame: Image) -> Answer:
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, ECC.iterations, ECC.min_gain)
        start, image = self.pose.astype(np.float32), self._shrunk(frame)
        try:
            _, found = cv2.findTransformECC(self.template, image, start, cv2.MOTION_HOMOGRAPHY, criteria, None, 1)
        except cv2.error:  # its way of saying that it did not converge
            return LOST
        pose = found.astype(np.float64)
        corners = through(pose, self.outline)
        if not (np.isfinite(corners).all() and is_convex(corners)):
            return LOST
        self.pose = pose
        return Answer((corners + 0.5) / self.scale - 0.5, "tracked")

    def _shrunk(self, frame: Image) -> Image:
        """Grey, at the working size, smoothed.

        OpenCV's own smoothing would take the template's edge for the image's, which shrinks the pose by half a pixel.
        """
        small = cv2.resize(_grey(frame), self.size.tolist(), interpolation=cv2.INTER_AREA)
        return np.asarray(cv2.GaussianBlur(small, (0, 0), ECC.smoothing_px), np.uint8)


def _robust(quad: Array, source: Array, target: Array, method: int) -> Answer:
    """The quad (4, 2) through the homography on which enough of the matches (M, 2) agree."""
    if len(source) < MATCHING.min_inliers:
        return LOST
    homography, inliers = cv2.findHomography(source, target, method, MATCHING.tolerance_px)
    if homography is None or int(inliers.sum()) < MATCHING.min_inliers:
        return LOST
    corners = through(homography, quad)
    if not (np.isfinite(corners).all() and is_convex(corners)):
        return LOST
    return Answer(corners, "tracked")


def _grey(frame: Image) -> Image:
    return np.asarray(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), np.uint8)


def _sift() -> cv2.Feature2D:
    return cv2.SIFT_create(nfeatures=2000)


def _orb() -> cv2.Feature2D:
    return cv2.ORB_create(nfeatures=2000, fastThreshold=10)


def _akaze() -> cv2.Feature2D:
    if not hasattr(cv2, "AKAZE_create"):
        raise InputError(f"OpenCV {cv2.__version__} has no AKAZE: leave it out, or install OpenCV 4")
    return cv2.AKAZE_create()


class Ours(NamedTuple):
    """One of ours: the configuration whose weights it takes, and how it is made of a file of them."""

    config: str
    make: Callable[[Path], PlanarTracker]


OURS: dict[str, Ours] = {
    "hdn": Ours(COMPACT.name, lambda path: Hdn(_engine(path))),
    "hdn-raw": Ours(COMPACT.name, lambda path: Stages(_engine(path), "similarity", "residual")),
    "hdn-similarity": Ours(COMPACT.name, lambda path: Stages(_engine(path), "similarity")),
    "hdn-residual": Ours(COMPACT.name, lambda path: Stages(_engine(path), "residual")),
    "hdn-paper": Ours(PAPER.name, lambda path: Hdn(_engine(path))),
    "hdn-authors": Ours(PAPER.name, Authors),
}

PEERS: dict[str, Callable[[], PlanarTracker]] = {
    "sift": lambda: Keypoints(_sift(), cv2.NORM_L2, cv2.USAC_MAGSAC),
    "sift-ransac": lambda: Keypoints(_sift(), cv2.NORM_L2, cv2.RANSAC),
    "orb": lambda: Keypoints(_orb(), cv2.NORM_HAMMING, cv2.USAC_MAGSAC),
    "orb-ransac": lambda: Keypoints(_orb(), cv2.NORM_HAMMING, cv2.RANSAC),
    "akaze": lambda: Keypoints(_akaze(), cv2.NORM_HAMMING, cv2.USAC_MAGSAC),
    "akaze-ransac": lambda: Keypoints(_akaze(), cv2.NORM_HAMMING, cv2.RANSAC),
    "ecc": Ecc,
    "flow": Flow,
}

TRACKERS = (*OURS, *PEERS)


def weights_of(name: str, files: Sequence[Path]) -> Path | None:
    """The weights that a tracker takes: of the files given, the one of its configuration, else the shipped one.

    None for a peer, which takes none.

    Raises:
        InputError: a file is no weights file, or the tracker's configuration ships without weights and none is given.
    """
    return _weights_of_ours(name, files) if name in OURS else None


def make_tracker(name: str, path: Path | None = None) -> PlanarTracker:
    """A tracker of TRACKERS.

    Args: path: its weights, see `weights_of`; None takes the shipped ones.

    Raises:
        InputError: no such tracker, or what it is made of is not there.
    """
    if name in PEERS:
        return PEERS[name]()
    if name in OURS:
        return OURS[name].make(path or _weights_of_ours(name, ()))
    raise InputError(f"there is no tracker '{name}': choose from {', '.join(TRACKERS)}")


def _weights_of_ours(name: str, files: Sequence[Path]) -> Path:
    wanted = OURS[name].config
    for path in files:
        if _configuration(path) == wanted:
            return path
    if wanted != COMPACT.name:
        raise InputError(
            f"{name} needs weights of the configuration '{wanted}': give a file of hdn-import's by --weights"
        )
    return weights.shipped()


@cache
def _configuration(path: Path) -> str:
    return weights.configuration(path).name
