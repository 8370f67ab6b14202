"""A better template than the first view: the pieces of a target that were seen more clearly later on.

While a tracker works, `Views` keeps the few frames that show the target clearly better than its first view did. From
them a template is put together: the views are aligned with each other, each piece is taken from those that show it
best and agree about it, and the whole is aligned with the first view. For that it is blurred as the first view is, so
that both show the same; this keeps it from drifting. It is an image like a frame: trackers are initialised on it.
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from .alignment.agreement import CELLS, SURELY
from .alignment.refinement import Alignment, Refiner
from .imaging.arrays import Array, Grey, Image
from .imaging.blur import blurred
from .imaging.homography import from_corners, transform
from .imaging.observation import Observation
from .imaging.pyramid import Pyramid
from .imaging.quads import side, square
from .tracker import Estimate

LONGEST = 320  # px of the template's longer side; trackers compare no more
MEASURED = 128  # px of the square crop on which sharpness is measured
CLEARLY = 1.6  # ratio of gradients, from which a piece is seen clearly better
DIM = 2.0  # grey levels per px: fainter gradients are as good as none
SOME, MUCH = 0.1, 0.25  # share of the target seen clearly better that makes a view worth keeping, and learning from
MOST = 6  # views kept
FEWEST = 3  # views that have to agree about a piece
CERTAIN = 0.04  # of the target's size: the largest deviation of a view
ANCHORED = 0.4  # share of the first view that the template has to agree with
BLURS = (1.0, 2.0, 4.0, 6.0, 8.0, 11.0)  # px of the template, standard deviations


@dataclass(frozen=True)
class Learnt:
    """A template put together from later views.

    Attributes:
        image: RGB (h, w, 3), a magnification of the reference frame about the target.
        quad: (4, 2) the target's corners in it, px.
        index: of the frame that shows the target best; corners: (4, 2) the target's there, px.
    """

    image: Image
    quad: Array
    index: int
    corners: Array


class Views:
    """The views of a target that are clearly better than its first, a few of them."""

    def __init__(self, frame: Observation, quad: Array) -> None:
        """Args: quad: (4, 2) the target in the reference frame, px."""
        self._quad = quad
        low, high = quad.min(0), quad.max(0)
        longest = float((high - low).max())
        scale = LONGEST / longest
        width, height = np.ceil((high - low + longest) * scale)  # with its surroundings, at which trackers look as well
        self._size = int(width), int(height)
        left, top = low - longest / 2
        self._to_reference = np.array([[1 / scale, 0, left], [0, 1 / scale, top], [0, 0, 1]])
        self._outline = transform(np.linalg.inv(self._to_reference), quad)
        self._square = from_corners(square(MEASURED), quad)
        self._first = self._view(0, frame, np.eye(3), self._sharpness(frame, np.eye(3)))
        self._later: list[_View] = []

    def offer(self, index: int, frame: Observation, estimate: Estimate) -> None:
        """Keeps a frame if it shows the target clearly better than the first view, and adds to those kept."""
        if estimate.state != "tracked" or estimate.deviation > CERTAIN * side(estimate.corners):
            return
        homography = from_corners(self._quad, estimate.corners)
        sharpness = self._sharpness(frame, homography)
        if self._better(sharpness) < SOME:
            return
        if len(self._later) == MOST:
            kept = [view.sharpness for view in self._later]
            # The best two count for each piece, so that there is one to compare the best with.
            worth = [np.sort([*kept[:i], *kept[i + 1 :], sharpness], 0)[-2:].sum() for i in range(MOST)]
            least = int(np.argmax(worth))
            if worth[least] <= np.sort(kept, 0)[-2:].sum():
                return
            del self._later[least]
        self._later.append(self._view(index, frame, homography, sharpness))

    def learn(self) -> Learnt | None:
        """The template that the views make together.

        None where it would not be clearly better than the first view, or where that does not confirm it.
        """
        if len(self._later) < FEWEST or self._better(np.max([view.sharpness for view in self._later], 0)) < MUCH:
            return None
        best = max(self._later, key=lambda view: float(view.sharpness.sum()))
        warps = self._aligned(best)
        images = [Pyramid(view.image).crop(warp, *self._size) for view, warp in zip(self._later, warps, strict=True)]
        consensus = np.median(images, 0).astype(np.uint8)
        sharpness = self._agreed(images, consensus)
        if self._better(sharpness.max(0)) < MUCH:
            return None
        strength = sharpness.mean(1)
        better = (strength.max(0) > self._first.sharpness.mean(0)).astype(np.float32)
        weights = np.square(np.square(strength / np.maximum(strength.max(0), 1e-6))) * better
        later = self._mixed([consensus, *images], [1 - better, *weights])

        # The views were tracked to slightly different places, the middle of which is likeliest before a closer look.
        place = np.median([transform(np.asarray(np.linalg.inv(warp)), self._outline) for warp in warps], 0)
        alignment = self._anchored(later, place, (strength > 0).any(0))
        if alignment is None:
            return None
        # A piece has to agree with the first view, unless that shows nothing there.
        kept = better * (alignment.agreement.agrees | ~alignment.agreement.textured)
        if self._better(sharpness.max(0) * kept) < MUCH:
            return None
        quad = transform(alignment.homography, self._outline)
        first = Pyramid(self._first.image).crop(np.asarray(np.linalg.inv(alignment.homography)), *self._size)
        return Learnt(self._mixed([first, later], [1 - kept, kept]), quad, best.number, transform(best.pose, quad))

    def _better(self, sharpness: Grey) -> float:
        """Share of the target that is seen clearly better than at first, in whichever direction."""
        clearer = sharpness > CLEARLY * np.maximum(self._first.sharpness, DIM)
        return float(clearer.any(0).mean())

    def _aligned(self, best: "_View") -> list[Array]:
        """Where the views show what the best one does: homographies (3, 3) from its image to theirs."""
        refiner = Refiner(Observation(best.image), self._outline)
        return [
            np.eye(3) if view is best else refiner.align(Observation(view.image), np.eye(3)).homography
            for view in self._later
        ]

    def _agreed(self, images: list[Image], consensus: Image) -> Grey:
        """Sharpness (n, 4, 8, 8) of the views' pieces; 0 where a view does not show what enough of them do."""
        judge = Refiner(Observation(consensus), self._outline)
        agrees = np.array([judge.agreement(Observation(image), np.eye(3)).correlation > SURELY for image in images])
        agrees &= agrees.sum(0) >= FEWEST
        return np.array([view.sharpness for view in self._later]) * agrees[:, None]

    def _anchored(self, template: Image, place: Array, sure: NDArray[np.bool_]) -> Alignment | None:
        """Aligns a template, where it is sure (8, 8), with the first view, after blurring it alike.

        Args: place: (4, 2) where the target is expected in it.
        Returns: None where it agrees too little, is too uncertain, or lies elsewhere than tracking said: it drifted.
        """
        anchor = Refiner(Observation(self._first.image), self._outline)
        trust = np.maximum(sure, 0.01).astype(np.float32)  # else nothing might be left to align by
        pose = from_corners(self._outline, place)
        for _ in range(3):  # blur and pose depend on each other
            alignment = anchor.align(_blurred(template, _blur(anchor, template, pose)), pose, trust)
            pose = alignment.homography
        off = float(np.sqrt(np.square(transform(pose, self._outline) - place).sum(-1).mean()))
        uncertain = max(off, anchor.deviation(pose, alignment.covariance)) > CERTAIN * LONGEST
        return None if uncertain or alignment.agreement.share < ANCHORED else alignment

    def _mixed(self, images: list[Image], weights: list[Grey]) -> Image:
        """The mean of images by the weights (8, 8) of their pieces, which go over into each other."""
        from_cells = from_corners(square(CELLS), self._outline)
        shares = np.array(
            [cv2.warpPerspective(w, from_cells, self._size, borderMode=cv2.BORDER_REPLICATE) for w in weights]
        )[..., None]
        return np.clip((shares * images).sum(0) / shares.sum(0) + 0.5, 0, 255).astype(np.uint8)

    def _sharpness(self, frame: Observation, homography: Array) -> Grey:
        """(4, 8, 8) root mean square gradient of each piece, along four directions, grey levels per px of a fixed crop.

        Pieces that are not wholly in the frame count as not seen.
        """
        to_frame = homography @ self._square
        crop = cv2.GaussianBlur(frame.grey.crop(to_frame, MEASURED, MEASURED), (0, 0), 1.0)
        dx, dy = (cv2.Sobel(crop, cv2.CV_32F, *order, scale=1 / 8) for order in ((1, 0), (0, 1)))
        xx, xy, yy = (
            cv2.resize(product, (CELLS, CELLS), interpolation=cv2.INTER_AREA) for product in (dx * dx, dx * dy, dy * dy)
        )
        energy = np.array([xx, (xx + yy) / 2 + xy, yy, (xx + yy) / 2 - xy])
        y, x = np.mgrid[: CELLS + 1, : CELLS + 1] * (MEASURED / CELLS) - 0.5
        at = transform(to_frame, np.stack([x, y], -1))
        inside = np.asarray(((at > -1) & (at < frame.colour.size)).all(-1))
        whole = inside[1:, 1:] & inside[1:, :-1] & inside[:-1, 1:] & inside[:-1, :-1]
        return np.asarray(np.sqrt(np.maximum(energy, 0)) * whole, np.float32)

    def _view(self, index: int, frame: Observation, homography: Array, sharpness: Grey) -> "_View":
        pose = homography @ self._to_reference
        return _View(index, pose, frame.colour.crop(pose, *self._size), sharpness)


class _View(NamedTuple):
    """What one frame shows: its number, where its image (h, w, 3) lies in it (3, 3), and its sharpness (4, 8, 8)."""

    number: int
    pose: Array
    image: Image
    sharpness: Grey


def _blur(anchor: Refiner, template: Image, pose: Array) -> Array:
    """Covariance (2, 2), px^2, of the Gaussian that makes a template, at a pose, most like the first view.

    Tried out, since the first view may be blurred by far more than what `blur.between` linearises.
    """

    def likeness(covariance: Array) -> float:
        return float(np.maximum(anchor.agreement(_blurred(template, covariance), pose).correlation, 0).mean())

    none = np.zeros((2, 2))
    steps = [s**2 * np.outer(d, d) for s in BLURS for d in ((np.cos(a), np.sin(a)) for a in np.arange(8) * np.pi / 8)]
    best = max([none, *(s**2 * np.eye(2) for s in BLURS), *steps], key=likeness)
    return max([best, *(best + s**2 * np.eye(2) for s in BLURS)], key=likeness)


def _blurred(image: Image, covariance: Array) -> Observation:
    return Observation(np.asarray(blurred(image.astype(np.float32), covariance) + 0.5, np.uint8))
