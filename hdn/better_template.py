"""A better template than the first view: from the pieces of a target that were seen more clearly later on.

While a tracker works, a `TemplateBuilder` keeps the few frames that show the target clearly better than its first view
did. From them a template is put together: the views are aligned with each other, each piece is taken from those that
show it best and agree about it, and the whole is aligned with the first view. For that it is blurred as the first view
is, so that both show the same; this keeps it from drifting. It is an image like a frame, for a tracker's `init`.
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from .alignment.agreement import CELLS
from .alignment.refinement import Alignment, Refiner
from .imaging.arrays import Array, Floats, Image, Mask
from .imaging.blur import blurred
from .imaging.homography import from_corners, transform
from .imaging.observation import Observation
from .imaging.pyramid import Pyramid
from .imaging.quads import side, square
from .tracker import Estimate


@dataclass(frozen=True)
class TemplateModel:
    """Constants of the choice of views and of what is made of them."""

    longest_px: int = 320  # the target's longer side in the template; trackers compare no more
    margin_ratio: float = 0.5  # of surroundings about the target, to its longer side: trackers look at them as well

    # Sharpness: root mean square gradient of a piece.
    sharpness_crop_px: int = 128  # side of the square crop on which it is measured
    sharpness_blur_px: float = 1.0  # deviation of the Gaussian over that crop, against noise
    clear_ratio: float = 1.6  # to the first view's sharpness, from which a piece is seen clearly better
    dim_grey_per_px: float = 2.0  # sharpness up to which a piece shows next to nothing

    # Views.
    max_deviation: float = 0.04  # of the corners, as a share of the target's size: less certain views are not used
    min_clearer: float = 0.1  # share of the target seen clearly better that makes a view worth keeping
    min_clearer_in_all: float = 0.25  # the same for all views together to make a template
    max_views: int = 6  # kept
    best_views: int = 2  # that count for each piece, so that there is one to compare the best with
    min_agreeing_views: int = 3  # about a piece

    # Alignment with the first view.
    # Weight of the pieces that no view vouches for, else nothing might be left to align by.
    min_trust: float = 0.01
    anchor_steps: int = 3  # of estimating blur and pose in turn
    min_anchored: float = 0.4  # share of the first view that the template has to agree with
    blurs_px: tuple[float, ...] = (1.0, 2.0, 4.0, 6.0, 8.0, 11.0)  # of the template, deviations that are tried
    blur_directions: int = 8  # that are tried


MODEL = TemplateModel()


@dataclass(frozen=True)
class BetterTemplate:
    """A template put together from later views.

    Attributes:
        image: RGB (h, w, 3), a magnification of the reference frame about the target.
        quad: (4, 2) the target's corners in it, px.
        index: of the frame that shows the target best.
        corners: (4, 2) the target's in that frame, px.
    """

    image: Image
    quad: Array
    index: int
    corners: Array


class TemplateBuilder:
    """Keeps a few views of a target that are clearly better than its first, and makes a template of them."""

    def __init__(self, frame: Observation, quad: Array) -> None:
        """Args:
        frame: the reference frame, which shows the first view.
        quad: (4, 2) the target in it, px.
        """
        self._quad = quad
        low, high = quad.min(0), quad.max(0)
        longest = float((high - low).max())
        scale = MODEL.longest_px / longest
        margin = longest * MODEL.margin_ratio
        width, height = np.ceil((high - low + 2 * margin) * scale)
        self._size = int(width), int(height)
        left, top = low - margin
        self._to_reference = np.array([[1 / scale, 0, left], [0, 1 / scale, top], [0, 0, 1]])
        self._outline = transform(np.linalg.inv(self._to_reference), quad)
        self._square = from_corners(square(MODEL.sharpness_crop_px), quad)
        self._first = self._view(0, frame, np.eye(3), self._sharpness(frame, np.eye(3)))
        self._later: list[_View] = []

    def offer(self, index: int, frame: Observation, estimate: Estimate) -> None:
        """Keeps a frame if it shows the target clearly better than the first view, and adds to those kept.

        Args:
            index: of the frame.
            frame: the frame.
            estimate: the tracker's answer for it.
        """
        if estimate.state != "tracked" or estimate.deviation > MODEL.max_deviation * side(estimate.corners):
            return
        homography = from_corners(self._quad, estimate.corners)
        sharpness = self._sharpness(frame, homography)
        if self._clearer_share(sharpness) < MODEL.min_clearer:
            return
        if len(self._later) == MODEL.max_views:
            kept = [view.sharpness for view in self._later]
            worth = [_worth([*kept[:i], *kept[i + 1 :], sharpness]) for i in range(len(kept))]
            least = int(np.argmax(worth))
            if worth[least] <= _worth(kept):
                return
            del self._later[least]
        self._later.append(self._view(index, frame, homography, sharpness))

    def build(self) -> BetterTemplate | None:
        """The template that the views make together.

        Returns:
            None where it would not be clearly better than the first view, or where that does not confirm it.
        """
        if len(self._later) < MODEL.min_agreeing_views:
            return None
        if not self._is_much_clearer(np.max([view.sharpness for view in self._later], 0)):
            return None
        best = max(self._later, key=lambda view: float(view.sharpness.sum()))
        warps = self._aligned(best)
        images = [Pyramid(view.image).crop(warp, *self._size) for view, warp in zip(self._later, warps, strict=True)]
        consensus = np.median(images, 0).astype(np.uint8)
        sharpness = self._agreed_sharpness(images, consensus)
        if not self._is_much_clearer(sharpness.max(0)):
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
        if not self._is_much_clearer(sharpness.max(0) * kept):
            return None
        quad = transform(alignment.homography, self._outline)
        first = Pyramid(self._first.image).crop(np.asarray(np.linalg.inv(alignment.homography)), *self._size)
        image = self._mixed([first, later], [1 - kept, kept])
        return BetterTemplate(image, quad, best.frame_index, transform(best.pose, quad))

    def _clearer_share(self, sharpness: Floats) -> float:
        """Share of the target that is seen clearly better than at first, in whichever direction (4, 8, 8)."""
        clearer = sharpness > MODEL.clear_ratio * np.maximum(self._first.sharpness, MODEL.dim_grey_per_px)
        return float(clearer.any(0).mean())

    def _is_much_clearer(self, sharpness: Floats) -> bool:
        """Whether enough of the target is seen clearly better than at first to make a template."""
        return self._clearer_share(sharpness) >= MODEL.min_clearer_in_all

    def _aligned(self, best: "_View") -> list[Array]:
        """Where the views show what the best one does: homographies (3, 3) from its image to theirs."""
        refiner = Refiner(Observation(best.image), self._outline)
        return [
            np.eye(3) if view is best else refiner.align(Observation(view.image), np.eye(3)).homography
            for view in self._later
        ]

    def _agreed_sharpness(self, images: list[Image], consensus: Image) -> Floats:
        """Sharpness (n, 4, 8, 8) of the views' pieces; 0 where a view does not show what enough of them do."""
        judge = Refiner(Observation(consensus), self._outline)
        agrees = np.array([judge.agreement(Observation(image), np.eye(3)).agrees_surely for image in images])
        agrees &= agrees.sum(0) >= MODEL.min_agreeing_views
        return np.array([view.sharpness for view in self._later]) * agrees[:, None]

    def _anchored(self, template: Image, place: Array, sure: Mask) -> Alignment | None:
        """Aligns a template with the first view, after blurring it alike.

        Args:
            template: RGB, of the builder's size.
            place: (4, 2) where the target is expected in it, px.
            sure: (8, 8) the pieces that views agree about.

        Returns:
            None where it agrees too little, is too uncertain, or lies elsewhere than tracking said: it drifted.
        """
        anchor = Refiner(Observation(self._first.image), self._outline)
        trust = np.maximum(sure, MODEL.min_trust).astype(np.float32)
        pose = from_corners(self._outline, place)
        for _ in range(MODEL.anchor_steps):  # blur and pose depend on each other
            alignment = anchor.align(_blurred(template, _equalising_blur(anchor, template, pose)), pose, trust)
            pose = alignment.homography
        drift = float(np.sqrt(np.square(transform(pose, self._outline) - place).sum(-1).mean()))
        uncertainty = max(drift, anchor.deviation(pose, alignment.covariance))
        is_sure = uncertainty <= MODEL.max_deviation * MODEL.longest_px
        return alignment if is_sure and alignment.agreement.share >= MODEL.min_anchored else None

    def _mixed(self, images: list[Image], weights: list[Floats]) -> Image:
        """The mean of images by the weights (8, 8) of their pieces, interpolated between the pieces."""
        from_cells = from_corners(square(CELLS), self._outline)
        shares = np.array(
            [cv2.warpPerspective(w, from_cells, self._size, borderMode=cv2.BORDER_REPLICATE) for w in weights]
        )[..., None]
        return np.clip((shares * images).sum(0) / shares.sum(0) + 0.5, 0, 255).astype(np.uint8)

    def _sharpness(self, frame: Observation, homography: Array) -> Floats:
        """(4, 8, 8) root mean square gradient of each piece, along four directions, grey levels per px of a fixed crop.

        Pieces that are not wholly in the frame count as not seen: 0.
        """
        size = MODEL.sharpness_crop_px
        to_frame = homography @ self._square
        crop = cv2.GaussianBlur(frame.grey.crop(to_frame, size, size), (0, 0), MODEL.sharpness_blur_px)
        # Sobel's first derivatives come out eight times too large.
        dx, dy = (cv2.Sobel(crop, cv2.CV_32F, *order, scale=1 / 8) for order in ((1, 0), (0, 1)))
        xx, xy, yy = (
            cv2.resize(product, (CELLS, CELLS), interpolation=cv2.INTER_AREA) for product in (dx * dx, dx * dy, dy * dy)
        )
        energy = np.array([xx, (xx + yy) / 2 + xy, yy, (xx + yy) / 2 - xy])
        y, x = np.mgrid[: CELLS + 1, : CELLS + 1] * (size / CELLS) - 0.5
        at = transform(to_frame, np.stack([x, y], -1))
        inside = np.asarray(((at > -1) & (at < frame.colour.size)).all(-1))
        whole = inside[1:, 1:] & inside[1:, :-1] & inside[:-1, 1:] & inside[:-1, :-1]
        return np.asarray(np.sqrt(np.maximum(energy, 0)) * whole, np.float32)

    def _view(self, index: int, frame: Observation, homography: Array, sharpness: Floats) -> "_View":
        pose = homography @ self._to_reference
        return _View(index, pose, frame.colour.crop(pose, *self._size), sharpness)


class _View(NamedTuple):
    """What one frame shows of the target and its surroundings.

    Attributes:
        frame_index: which frame.
        pose: (3, 3) pixels of the view's image to the frame's.
        image: RGB (h, w, 3), of the template's size.
        sharpness: (4, 8, 8).
    """

    frame_index: int
    pose: Array
    image: Image
    sharpness: Floats


def _worth(sharpness: list[Floats]) -> float:
    """What views are worth together: the best few of each piece, by their sharpness (4, 8, 8)."""
    return float(np.sort(sharpness, 0)[-MODEL.best_views :].sum())


def _equalising_blur(anchor: Refiner, template: Image, pose: Array) -> Array:
    """Covariance (2, 2), px^2, of the Gaussian that makes a template, at a pose, most like the first view.

    Tried out, since the first view may be blurred by far more than what `blur.relative_blur` linearises.
    """

    def likeness(covariance: Array) -> float:
        return float(np.maximum(anchor.agreement(_blurred(template, covariance), pose).correlation, 0).mean())

    none = np.zeros((2, 2))
    round_blurs = [s**2 * np.eye(2) for s in MODEL.blurs_px]
    angles = np.arange(MODEL.blur_directions) * np.pi / MODEL.blur_directions
    directions = [(np.cos(angle), np.sin(angle)) for angle in angles]
    streaks = [s**2 * np.outer(d, d) for s in MODEL.blurs_px for d in directions]
    best = max([none, *round_blurs, *streaks], key=likeness)
    return max([best, *(best + blur for blur in round_blurs)], key=likeness)


def _blurred(image: Image, covariance: Array) -> Observation:
    return Observation(np.asarray(blurred(image.astype(np.float32), covariance) + 0.5, np.uint8))
