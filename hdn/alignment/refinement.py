"""Photometric refinement: sub-pixel alignment of the rectified target to the template, from coarse to fine.

It is anchored to the template: errors do not add up over frames. How the crops are aligned, `lucas_kanade` says.
"""

from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ..imaging.arrays import Array, Grey
from ..imaging.blur import between
from ..imaging.homography import derivative, from_corners, normalised, transform
from ..imaging.observation import Observation
from ..imaging.quads import area, outline, side
from .agreement import CELLS, Agreement, cell_means
from .border import NOTHING, Border
from .lucas_kanade import Level

ALIGNED = 0.7  # correlation that the best cells reach once the crop is nearly aligned
EVERYWHERE: Grey = np.ones((CELLS, CELLS), np.float32)
USUAL = 160  # px of the longer side of the crop that is judged, at most; less where the target is smaller
FINEST = 2  # times as large is the crop that settles the last fractions of a pixel, where the frame shows as much
SETTLED = 0.3  # px of the usual crop that an alignment moves the corners by, under which the next would not tell more
ALIKE = 0.97  # correlation of the cells, from which template and frame are taken to be equally sharp
BLURRED, COARSE = 0.3, 4.0  # px^2 of the usual crop: blur that is matched; and that leaves nothing finer to see
LESS = 0.75  # of what a typical cell's correlation lacks to 1 must be left after matching: noise gains a little as well
# Deviation of the corners, as a share of the target's size, that its texture leaves even where all of it is seen, from
# which its border counts as well: three times that of usual prints.
VAGUE = 0.005
# How far off a start may be where nothing better is known: covariance of the eight parameters, px^2 at the edge of the
# usual crop; affine four, translation free, perspective.
LOOSE = np.diag(np.square([5.0, 5, 100, 5, 5, 100, 2, 2]))


@dataclass(frozen=True)
class Expectation:
    """What is known before a look: a pose (3, 3), its covariance (8, 8), and which cells (8, 8) may be looked at."""

    homography: Array
    covariance: Array
    seen: Grey


@dataclass(frozen=True)
class Alignment:
    """Where a frame fits the template.

    Attributes:
        homography: (3, 3) template to frame.
        agreement: how well it fits there, but for the last `moved` px.
        covariance: (8, 8) of the warp's parameters, px^2 at the edge of the usual crop: what is seen, and what was
            expected, leave them open by so much.
        moved: how far the last step moved the corners, px of the usual crop.
        expected: what it started from.
        blur: (2, 2) px^2 of the usual crop, covariance by which the frame is blurred more than the template; negative
            where less; 0 where it makes no difference.
        border: share of the target's border that is there, where its texture is too little to place it; else 0.
    """

    homography: Array
    agreement: Agreement
    covariance: Array
    moved: float
    expected: Expectation
    blur: Array = field(default_factory=lambda: np.zeros((2, 2)))
    border: float = 0.0


class Refiner:
    """Aligns frames to one template."""

    def __init__(self, frame: Observation, quad: Array) -> None:
        """Args:
        frame: the reference frame.
        quad: (4, 2) the target's corners in it.
        """
        self._quad = quad
        sides = np.linalg.norm(np.roll(quad, -1, 0) - quad, axis=1)
        size = np.array([sides[0] + sides[2], sides[1] + sides[3]]) / 2
        longest = max(24.0, min(USUAL, size.max()))
        usual, finest = (_size(size, longest * times) for times in (1, np.clip(size.max() / longest, 1, FINEST)))
        self._coarse, self._usual, self._finest = (
            Level(frame.grey, quad, longer, blur, max(usual), points)
            for longer, blur, points in ((_size(size, longest / 2), 1.0, 2000), (usual, 0.8, 4000), (finest, 0.8, 8000))
        )
        is_vague = self.deviation(np.eye(3), self._usual.uncertainty) > VAGUE * side(quad)
        borders = [Border(frame.colour, v.to_template, v.width, v.height) for v in (self._coarse, self._usual)]
        self._borders = borders if is_vague and all(border.exists for border in borders) else []
        y, x = np.mgrid[:CELLS, :CELLS]
        self._cell_centres = transform(from_corners(outline(CELLS, CELLS), quad), np.stack([x, y], -1))
        raw = frame.grey.crop(self._usual.to_template, *usual).astype(np.float32)
        energy = cell_means(np.abs(raw - cv2.GaussianBlur(raw, (0, 0), max(usual) / 14)))
        typical = float(np.median(energy))
        # Texture that is not mere noise: two grey levels of deviation, or a fair share of the target's own.
        self.textured = energy > min(2.0, 0.5 * typical)
        # Less than that, and light that moves over it may pass for something that hides it.
        self._telling = self.textured & (energy > 0.5 * typical)

    def align(self, frame: Observation, start: Array, seen: Grey = EVERYWHERE, covariance: Array = LOOSE) -> Alignment:
        """Finds the pose at which the frame fits the template, as far as what is expected allows.

        Args:
            start: (3, 3) template to frame, the pose that is expected.
            seen: (8, 8) 0..1, which cells of the target may be looked at.
            covariance: (8, 8) of the expectation, as an alignment tells it.
        """
        return self.settle(frame, self.approach(frame, start, seen, covariance))

    def approach(
        self, frame: Observation, start: Array, seen: Grey = EVERYWHERE, covariance: Array = LOOSE
    ) -> Alignment:
        """As `align`, but for the last fractions of a pixel: enough to judge by, and far cheaper."""
        expected = Expectation(start, covariance, seen)
        alignment = self._step(self._coarse, frame, start, expected)
        for _ in range(3):
            alignment = self._step(self._usual, frame, alignment.homography, expected)
            if alignment.moved < SETTLED:
                break
        if self._borders:
            alignment = replace(alignment, border=self._borders[-1].share(frame.colour, alignment.homography))
        return alignment

    def settle(self, frame: Observation, alignment: Alignment) -> Alignment:
        """The last fractions of a pixel of what `approach` found, at the size and the blur at which the frame shows it.

        The blurrier of template and frame sets how blurred both are compared, if that makes them agree clearly better.
        """
        blur = self._blur(frame, alignment)
        variance = float(np.abs(np.linalg.eigvalsh(blur)).max())
        shown = side(transform(alignment.homography, self._quad))
        is_fine = shown > 0.7 * np.sqrt(self._finest.width * self._finest.height) and variance < COARSE
        level = self._finest if is_fine else self._usual
        if variance > BLURRED:
            found = self._step(self._usual.matched(blur), frame, alignment.homography, alignment.expected)
            if 1 - _typical(found.agreement) < LESS * (1 - _typical(alignment.agreement)):
                found = self._step(level.matched(blur), frame, found.homography, alignment.expected)
                return replace(found, blur=blur)
        return self._step(level, frame, alignment.homography, alignment.expected) if is_fine else alignment

    def frame_blur(self, alignment: Alignment) -> Array:
        """The blur of an alignment in the frame about the target's middle: (2, 2) px^2."""
        to_frame = alignment.homography @ self._usual.to_template
        middle = np.array([(self._usual.width - 1) / 2, (self._usual.height - 1) / 2])
        stretch = derivative(to_frame, middle)
        return np.asarray(stretch @ alignment.blur @ stretch.T)

    def _blur(self, frame: Observation, alignment: Alignment) -> Array:
        """How much more the frame blurs the target than the template, (2, 2) px^2 of the usual crop; 0 where alike."""
        if self._best(alignment.agreement.correlation) < ALIGNED or _typical(alignment.agreement) > ALIKE:
            return np.zeros((2, 2))
        trust = self._trust(alignment.agreement.correlation) * alignment.expected.seen
        level = self._usual
        trusted = cv2.resize(trust, (level.width, level.height), interpolation=cv2.INTER_NEAREST)
        return between(level.raw, level.look(frame.grey, alignment.homography), trusted, level.window)

    def deviation(self, homography: Array, covariance: Array) -> float:
        """Standard deviation of the corners, px of the frame: the root of its mean square over them."""
        level = self._usual
        spread = np.einsum("cij,jk,cik->", level.corners, covariance, level.corners) / 4
        size = area(transform(homography, self._quad)) / (level.width * level.height)
        return float(np.sqrt(spread * abs(size)))

    def agreement(self, frame: Observation, homography: Array) -> Agreement:
        """Compares the frame, rectified by a homography, with the template."""
        return self._compare(self._usual, frame, homography)[1]

    def _step(self, level: Level, frame: Observation, homography: Array, expected: Expectation) -> Alignment:
        """One alignment at one level, from a pose that the steps before led to."""
        search, agreement = self._compare(level, frame, homography)
        expected_warp = level.from_template @ np.linalg.inv(homography) @ expected.homography @ level.to_template
        trust = self._trust(agreement.correlation) * expected.seen
        pull = NOTHING
        if self._borders:
            pull = self._borders[level is not self._coarse].pull(frame.colour, homography, expected.seen)
        warp, posterior = level.align(search, trust, expected_warp, expected.covariance, pull)
        found = normalised(homography @ level.to_template @ warp @ level.from_template)
        return Alignment(found, agreement, posterior, level.moved(warp), expected)

    def _compare(self, level: Level, frame: Observation, homography: Array) -> tuple[Grey, Agreement]:
        search = level.rectify(frame.grey, homography)
        return search, Agreement(level.correlation(search), self._in_frame(frame, homography), self.textured)

    def _trust(self, correlation: Grey) -> Grey:
        """Weights (8, 8) of the cells for alignment; where hardly any agrees, all count: it is not aligned yet."""
        best = self._best(correlation)
        if best < ALIGNED:
            return np.ones_like(correlation)
        agree = np.clip((correlation / best - 0.75) / 0.15, 0, 1)
        # Beside an occluder a cell is half its, even where it agrees.
        clear = agree * cv2.erode(np.where(self._telling, agree, 1), np.ones((3, 3), np.uint8))
        for trust in (clear, agree):
            if trust.sum() > 0.1 * trust.size:
                return np.asarray(trust, np.float32)
        return np.ones_like(correlation)

    def _best(self, correlation: Grey) -> float:
        """How well a clear cell agrees, in this frame's blur and noise: the best cells show it."""
        return float(np.quantile(correlation[self.textured], 0.9)) if self.textured.any() else 0.0

    def _in_frame(self, frame: Observation, homography: Array) -> NDArray[np.bool_]:
        seen = transform(homography, self._cell_centres)
        w, h = frame.colour.size
        return np.asarray(((seen > -0.5) & (seen < [w - 0.5, h - 0.5])).all(-1))


def _typical(agreement: Agreement) -> float:
    """Correlation of the typical cell that can be judged."""
    return float(np.median(agreement.correlation[agreement.visible])) if agreement.visible.any() else 0.0


def _size(sides: Array, longest: float) -> tuple[int, int]:
    """Width and height of a crop, px, whose longer side is about so many: whole numbers of pixels to a cell."""
    width, height = (CELLS * max(3, round(side * longest / sides.max() / CELLS)) for side in sides.tolist())
    return width, height
