"""A picture of a plane from a whole clip: rectified, larger than the target, and better than any of its views.

Views are taken from frames in which the target's corners are known, as they are after a whole clip was solved for.
They are aligned with each other; cell by cell the largest group of those that agree is found, so that what hides the
plane in some of them falls away; and of these each pixel takes a robust mean, in which the sharpest count most. The
first view is aligned with it like any other, the picture being blurred alike, and tells where the reference frame has
it: so it does not drift.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from ..alignment.agreement import CELLS
from ..alignment.refinement import Alignment, Refiner
from ..imaging.arrays import Array, Floats, Image, Mask
from ..imaging.blur import blurred, equalising_blurs
from ..imaging.homography import from_corners, transform
from ..imaging.observation import Observation
from ..imaging.quads import outline, side
from .plane_map import margin_around, target_size
from .stacking import Merged, Stack, sharpness_of


@dataclass(frozen=True)
class PictureModel:
    """Constants of the choice of views, and of what is made of them; px are those of the picture."""

    # The target's longer side in the picture: as the frames show it at its largest, within these.
    longest_px: int = 256
    least_px: int = 64

    # Views.
    max_views: int = 32  # kept, beside the first
    min_views: int = 3  # beside the first; with fewer that is all there is
    max_deviation: float = 0.04  # of the corners, as a share of the target's size: less certain views are not used
    min_agreement: float = 0.3  # share of a view that has to agree with the others' picture, for it to be used
    sharp_views: int = 6  # the sharpest; those that are blurrier than these are not used,
    blurrier_px2: float = 3.0  # by a sum of the variances along x and y, px^2 of the refiner's standard crop
    rounds: int = 2  # of aligning all views with what they make together

    # The first view.
    anchor_steps: int = 3  # of estimating its blur and its pose in turn
    least_trust: float = 0.01  # weight of cells that views do not agree about, where they are aligned
    min_anchored: float = 0.4  # share of the cells that the others agree about, that it has to show as well

    # Cells.
    sharpest_power: int = 4  # of a view's sharpness to the sharpest one's, by which it counts
    min_members: int = 3  # views that have to agree about a cell
    min_agreeing: float = 0.5  # share of the views that show a cell, that have to agree about it
    min_on_plane: float = 0.7  # the same, for it to be taken to lie on the plane
    clear_ratio: float = 1.3  # to the first view's sharpness, from which a cell is seen clearly better
    dim_grey_per_px: float = 2.0  # sharpness up to which a cell shows next to nothing
    # Share of the target that the first view shows clearly worse, from which the picture is better than that.
    min_gained: float = 0.2

    unsure_brightness: float = 0.25  # of cells that do not prove to lie on the plane, where the picture is drawn


MODEL = PictureModel()


@dataclass(frozen=True)
class PlanePicture:
    """What a clip shows of a plane, rectified, the target in its middle.

    Attributes:
        texture: (h, w, 3) RGB, grey levels, in the light of one of the views; 0 where nothing is known.
        count: (h, w) how many views a pixel rests on.
        spread: (h, w) grey levels, standard deviation of those views about the texture, robust.
        agreement: (n, n) 0..1, share of the views that show a cell, that agree about it; row by row. Little where
            something does not move with the target, changes, or is mostly hidden.
        to_reference: (3, 3) pixels of the picture to those of the reference frame.
        quad: (4, 2) the target's corners in the picture, px.
        deviation: standard deviation of the corners, px of the reference frame.
        gained: share of the target that the reference frame shows clearly worse, 0..1.
        views: how many it was made of; 1 where it is the first view alone.
        index: of the frame that shows the target best. corners: (4, 2) the target's there, px.
    """

    texture: Floats
    count: Floats
    spread: Floats
    agreement: Floats
    to_reference: Array
    quad: Array
    deviation: float
    gained: float
    views: int
    index: int
    corners: Array

    @property
    def is_better(self) -> bool:
        """Whether it shows the target clearly better than the reference frame does."""
        return self.gained >= MODEL.min_gained

    @property
    def on_plane(self) -> Image:
        """(h, w) 255 where it shows the target's plane as far as is known, else 0."""
        agreement = cv2.resize(self.agreement, self.count.shape[::-1], interpolation=cv2.INTER_NEAREST)
        least = min(MODEL.min_members, self.views)
        return np.where((self.count >= least) & (agreement >= MODEL.min_on_plane), 255, 0).astype(np.uint8)

    @property
    def image(self) -> Image:
        """The texture (h, w, 3) in whole grey levels, carried on smoothly where nothing is known."""
        known = self.count > 0
        return _rounded(np.where(known[..., None], self.texture, _carried_on(self.texture, known)))

    @property
    def drawn(self) -> Image:
        """The texture (h, w, 3), dim where it does not prove to show the target's plane, black where it is unknown."""
        brightness = np.where(self.on_plane > 0, 1, MODEL.unsure_brightness)[..., None]
        return _rounded(self.texture * brightness.astype(np.float32))


class PictureBuilder:
    """Keeps the views of a plane that are worth most, and makes a picture of them."""

    def __init__(self, index: int, reference: Observation, quad: Array, shown_px: float) -> None:
        """Args:
        index: of the reference frame.
        reference: the reference frame, which shows the first view.
        quad: (4, 2) the target's corners in it, px.
        shown_px: the target's longer side in the frame that shows it largest.
        """
        width, height = target_size(quad, int(np.clip(shown_px, MODEL.least_px, MODEL.longest_px)))
        margin = margin_around(quad, width, height)
        beyond = np.array([width, height]) * margin // CELLS
        self._size = width + 2 * int(beyond[0]), height + 2 * int(beyond[1])
        self._outline = outline(width, height) + beyond
        self._cells = CELLS + 2 * margin
        self._inner = np.s_[..., margin : margin + CELLS, margin : margin + CELLS]
        self._views = [self._view(index, reference, quad)]

    def offer(self, index: int, frame: Observation, corners: Array, deviation: float) -> None:
        """Keeps a frame, if it shows the plane better than another that was kept.

        Args:
            index: of the frame.
            frame: the frame.
            corners: (4, 2) the target's in it, px; deviation: of them, px.
        """
        if not deviation <= MODEL.max_deviation * side(corners):
            return
        self._views.append(self._view(index, frame, corners))
        if len(self._views) > MODEL.max_views + 1:
            energy = np.square([view.sharpness for view in self._views])
            share = (energy / np.maximum(energy.sum(0), 1e-6)).sum((1, 2, 3))
            del self._views[1 + int(share[1:].argmin())]

    def build(self) -> PlanePicture:
        """The picture that the views make together; the first alone where it does not confirm what they show."""
        return self._of_all() or self._of_first()

    def _of_all(self) -> PlanePicture | None:
        views = self._views
        if len(views) <= MODEL.min_views:
            return None
        typical = self._most_typical()
        template, known, sure = views[typical].image, views[typical].inside == 255, np.ones((CELLS, CELLS), bool)
        for _ in range(MODEL.rounds):
            refiner, trust = Refiner(Observation(template), self._outline), np.maximum(sure, MODEL.least_trust)
            found = [self._anchored(refiner, template, known, trust)]
            found += [refiner.align(Observation(view.image), np.eye(3), trust) for view in views[1:]]
            shares = [_agreeing(alignment, sure) for alignment in found]
            blurs = [float(np.trace(alignment.blur)) for alignment in found]
            most = sorted(blurs[1:])[: MODEL.sharp_views][-1] + MODEL.blurrier_px2
            used = [
                k
                for k, (share, blur) in enumerate(zip(shares, blurs, strict=True))
                if k == 0 or (share >= MODEL.min_agreement and blur <= most)
            ]
            views, found = [views[k] for k in used], [found[k] for k in used]
            if len(views) <= MODEL.min_views:
                return None
            layers = self._layers(views, [alignment.homography for alignment in found])
            template, known = _rounded(layers.merged.texture), layers.merged.count > 0
            sure = layers.sure[self._inner]
        deviation = refiner.deviation(found[0].homography, found[0].covariance)
        is_sure = deviation <= MODEL.max_deviation * side(self._outline)
        if not is_sure or shares[0] < MODEL.min_anchored:
            return None
        return self._finished(views, [alignment.homography for alignment in found], layers, deviation)

    def _finished(
        self, views: Sequence["_View"], poses: Sequence[Array], layers: "_Layers", deviation: float
    ) -> PlanePicture:
        """The picture, with the first view where the others do not agree.

        Args:
            views, poses: pixels of the picture to theirs (3, 3); the first view at first.
            deviation: of the first view's corners, px of the picture.
        """
        members, merged, sure = layers.members, layers.merged, layers.sure
        share = cv2.resize(np.float32(sure | ~layers.shown[0]), self._size, interpolation=cv2.INTER_LINEAR)[..., None]
        texture = share * merged.texture + (1 - share) * layers.first
        known = np.where(merged.count > 0, 255, 0).astype(np.uint8)
        sharpness = sharpness_of(_rounded(texture), known, self._cells)
        clear = sharpness > MODEL.clear_ratio * np.maximum(views[0].sharpness, MODEL.dim_grey_per_px)
        is_new = (sharpness.max(0) > MODEL.dim_grey_per_px) & ~members[0]
        gained = sure & (clear.any(0) | is_new)

        quad = views[0].corners
        to_reference = views[0].to_frame @ poses[0]
        in_picture = transform(np.asarray(np.linalg.inv(to_reference)), quad)
        strength = (members * [view.sharpness.mean(0) for view in views])[self._inner].sum((1, 2))
        best = 1 + int(strength[1:].argmax())
        return PlanePicture(
            texture.astype(np.float32),
            merged.count,
            merged.spread,
            layers.agreement,
            to_reference,
            in_picture,
            deviation * side(quad) / side(self._outline),
            float(gained[self._inner].mean()),
            len(views),
            views[best].index,
            transform(views[best].to_frame @ poses[best], in_picture),
        )

    def _of_first(self) -> PlanePicture:
        first = self._views[0]
        inside = (first.inside == 255).astype(np.float32)
        return PlanePicture(
            first.image * inside[..., None],
            inside,
            np.zeros_like(inside),
            cv2.resize(inside, (self._cells, self._cells), interpolation=cv2.INTER_AREA),
            first.to_frame,
            self._outline,
            0.0,
            0.0,
            1,
            first.index,
            first.corners,
        )

    def _most_typical(self) -> int:
        """Which view agrees with the most others about the most cells of the target."""
        stack = self._stack(self._views, [np.eye(3)] * len(self._views))
        return int(stack.agreeing()[self._inner].mean((1, 2, 3)).argmax())

    def _anchored(self, refiner: Refiner, picture: Image, known: Mask, trust: Floats) -> Alignment:
        """Where the first view lies on a picture, which for that is blurred alike, with what lies around the target.

        Args:
            refiner: of the picture as it is.
            picture: (h, w, 3) RGB, of which the pixels (h, w) are known.
            trust: (8, 8) weights of the target's cells.
        """
        frame = Observation(self._views[0].image)
        per_standard = float(np.ptp(self._outline, 0).max()) / refiner.standard_side  # px of the picture
        best = refiner.align(frame, np.eye(3), trust)
        covariance = refiner.spectral_blur(frame, np.eye(3)) * per_standard**2
        for _ in range(MODEL.anchor_steps):
            soft = Refiner(Observation(_blurred(picture, known, covariance)), self._outline)
            found = soft.align(frame, best.homography, trust)
            best = max(best, found, key=_likeness)
            covariance = equalising_blurs(covariance + found.blur * per_standard**2)[0]
        return best

    def _layers(self, views: Sequence["_View"], poses: Sequence[Array]) -> "_Layers":
        """What views show together, by their poses (3, 3), pixels of the picture to theirs."""
        stack = self._stack(views, poses)
        strength = np.array([view.sharpness.mean(0) for view in views])
        members = stack.groups(strength)
        stack.light_alike(members, int((members * strength)[self._inner].sum((1, 2)).argmax()))
        worth = members * (strength + MODEL.dim_grey_per_px)
        weights = (worth / np.maximum(worth.max(0), 1e-6)) ** MODEL.sharpest_power
        first = stack.images[0].astype(np.float32)
        return _Layers(members, stack.shown, first, stack.merged(weights.astype(np.float32)))

    def _stack(self, views: Sequence["_View"], poses: Sequence[Array]) -> Stack:
        images, inside = (
            [
                picture
                if np.array_equal(pose, np.eye(3))
                else cv2.warpPerspective(
                    picture, pose, self._size, flags=flags | cv2.WARP_INVERSE_MAP, borderMode=border
                )
                for picture, pose in zip(pictures, poses, strict=True)
            ]
            for pictures, flags, border in (
                ([view.image for view in views], cv2.INTER_CUBIC, cv2.BORDER_REPLICATE),
                ([view.inside for view in views], cv2.INTER_LINEAR, cv2.BORDER_CONSTANT),
            )
        )
        return Stack(np.array(images), np.array(inside), self._cells)

    def _view(self, index: int, frame: Observation, corners: Array) -> "_View":
        to_frame = from_corners(self._outline, corners)
        image = frame.colour.crop(to_frame, *self._size)
        if frame.colour.shows(to_frame, outline(*self._size), margin=1).all():
            inside = np.full(self._size[::-1], 255, np.uint8)
        else:
            whole = np.full(frame.image.shape[:2], 255, np.uint8)
            flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
            inside = np.asarray(cv2.warpPerspective(whole, to_frame, self._size, flags=flags), np.uint8)
        return _View(index, corners, to_frame, image, inside, sharpness_of(image, inside, self._cells))


@dataclass(frozen=True)
class _View:
    """What one frame shows of the plane.

    Attributes:
        index: of the frame. corners: (4, 2) the target's in it, px.
        to_frame: (3, 3) pixels of the view to those of the frame.
        image: RGB (h, w, 3), rectified. inside: (h, w) 255 where that lies in the frame, else 0.
        sharpness: (4, n, n), see `sharpness_of`.
    """

    index: int
    corners: Array
    to_frame: Array
    image: Image
    inside: Image
    sharpness: Floats


class _Layers(NamedTuple):
    """Views laid on each other.

    Attributes:
        members, shown: (k, n, n) which cells a view agrees with the others about, and shows.
        first: (h, w, 3) the first view, in the light of the others.
        merged: what they show together.
    """

    members: Mask
    shown: Mask
    first: Floats
    merged: Merged

    @property
    def agreement(self) -> Floats:
        """(n, n) share of the views that show a cell, that agree about it."""
        return np.asarray(self.members.sum(0) / np.maximum(self.shown.sum(0), 1), np.float32)

    @property
    def sure(self) -> Mask:
        """(n, n) the cells that enough views agree about."""
        return (self.members.sum(0) >= MODEL.min_members) & (self.agreement >= MODEL.min_agreeing)


def _agreeing(found: Alignment, sure: Mask) -> float:
    """Share of the cells that show their texture, of those that are sure (8, 8) in the picture; 0 where none is."""
    agreement = found.agreement
    judged = sure & agreement.visible
    is_placed = bool(np.isfinite(found.homography).all())
    return float(agreement.agrees[judged].mean()) if judged.any() and is_placed else 0.0


def _likeness(found: Alignment) -> float:
    """Mean correlation of the cells that have texture."""
    agreement = found.agreement
    return float(np.maximum(agreement.correlation, 0)[agreement.textured].mean()) if agreement.textured.any() else 0.0


def _blurred(image: Image, known: Mask, covariance: Array) -> Image:
    """An image (h, w, 3) blurred by a Gaussian (2, 2), px^2; what is not known of it, (h, w), has no part in that."""
    share = np.maximum(blurred(known.astype(np.float32), covariance), np.float32(1e-3))[..., None]
    seen = blurred(np.where(known[..., None], image, 0).astype(np.float32), covariance)
    return _rounded(np.asarray(seen / share, np.float32))


def _carried_on(image: Floats, known: Mask) -> Floats:
    """An image (h, w, 3) with what is known of it, (h, w), carried on over the rest: by ever coarser means."""
    height, width = known.shape
    weight = known.astype(np.float32)[..., None]
    if known.all() or min(height, width) < 2:
        return image * weight
    half = (width + 1) // 2, (height + 1) // 2
    share = cv2.resize(weight, half, interpolation=cv2.INTER_AREA)[..., None]
    means = cv2.resize(image * weight, half, interpolation=cv2.INTER_AREA) / np.maximum(share, 1e-6)
    coarse = cv2.resize(_carried_on(means, share[..., 0] > 0), (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(image * weight + (1 - weight) * coarse, np.float32)


def _rounded(texture: Floats) -> Image:
    return np.clip(texture + 0.5, 0, 255).astype(np.uint8)
