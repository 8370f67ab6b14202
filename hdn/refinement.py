"""Photometric refinement: sub-pixel alignment of the rectified target to the template.

Inverse-compositional Lucas-Kanade (Baker and Matthews, 2004) over the eight parameters of a homography, on locally
normalised grey levels (free of gain and bias, so of uneven light too), with robust weights, so that an occluder or a
glare does not pull. It is anchored to the template: errors do not add up over frames.
"""

import itertools
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from .homography import Array, area, from_corners, normalised, square, transform
from .sampling import Pyramid

Grey = NDArray[np.float32]

CELLS = 8  # the target is judged on a grid of CELLS x CELLS
AGREES = 0.5  # correlation from which a cell is taken to show the template
SURELY = 0.6  # and from which it hardly does so by chance
ALIGNED = 0.7  # correlation that the best cells reach once the crop is nearly aligned
EVERYWHERE: Grey = np.ones((CELLS, CELLS), np.float32)
SETTLED = 0.3  # px of the crop that an alignment moves the corners by, under which the next would not tell more
# How far off a start may be where nothing better is known: covariance of the eight parameters, px^2 at the crop's edge;
# affine four, translation free, perspective.
LOOSE = np.diag(np.square([5.0, 5, 100, 5, 5, 100, 2, 2]))
CORRELATED = 50  # neighbouring pixels share their errors: this many count as one


@dataclass(frozen=True)
class Agreement:
    """How well a rectified frame shows the template, cell by cell.

    Attributes:
        correlation: (8, 8) normalised cross-correlation of each cell with the template's.
        in_frame: (8, 8) cells that lie in the frame.
        textured: (8, 8) cells that have texture to compare, in the frame or not.
    """

    correlation: Grey
    in_frame: NDArray[np.bool_]
    textured: NDArray[np.bool_]

    @property
    def visible(self) -> NDArray[np.bool_]:
        """(8, 8) cells that can be judged."""
        return self.in_frame & self.textured

    @property
    def agrees(self) -> NDArray[np.bool_]:
        """(8, 8) cells that show the template."""
        return np.asarray(self.correlation > AGREES)

    @property
    def share(self) -> float:
        """Share of the visible cells that agree with the template; 0 where next to nothing is visible."""
        if self.visible.sum() < max(2, 0.1 * self.textured.sum()):
            return 0.0
        return float(self.agrees[self.visible].mean())

    @property
    def cohesion(self) -> float:
        """The largest patch of adjoining cells that surely agree, as a share of the target.

        Cells that agree by chance lie scattered; what an occluder leaves of the target hangs together.
        """
        agree = ((self.correlation > SURELY) & self.visible).astype(np.uint8)
        _, _, patches, _ = cv2.connectedComponentsWithStats(agree, connectivity=4)
        return float(patches[1:, cv2.CC_STAT_AREA].max(initial=0)) / agree.size


@dataclass(frozen=True)
class Alignment:
    """Where a frame fits the template.

    Attributes:
        homography: (3, 3) template to frame.
        agreement: how well it fits there, but for the last `moved` px.
        covariance: (8, 8) of the warp's parameters, px^2 at the edge of the rectified crop: what is seen, and what was
            expected, leave them open by so much.
        moved: how far the last step moved the corners, px of the rectified crop.
    """

    homography: Array
    agreement: Agreement
    covariance: Array
    moved: float


class Refiner:
    """Aligns frames to one template."""

    def __init__(self, frame: Pyramid, quad: Array, longest: int = 160) -> None:
        """Args:
        frame: grey pyramid of the reference frame.
        quad: (4, 2) the target's corners in it.
        longest: px of the rectified template's longer side, at most; less where the target is smaller.
        """
        sides = np.linalg.norm(np.roll(quad, -1, 0) - quad, axis=1)
        width, height = (sides[0] + sides[2]) / 2, (sides[1] + sides[3]) / 2
        scale = min(1.0, longest / max(width, height))
        self.width, self.height = (max(24, round(float(s) * scale)) for s in (width, height))
        self.outline = square(1.0) * [self.width, self.height] + [(self.width - 1) / 2, (self.height - 1) / 2]
        self.crop_to_template = from_corners(self.outline, quad)
        y, x = np.mgrid[:CELLS, :CELLS] + 0.5
        self.cell_centres = np.stack([x * self.width / CELLS, y * self.height / CELLS], -1) - 0.5
        self.sigma = max(self.width, self.height) / 14
        raw = self._crop(frame, np.eye(3))
        self.levels = [_Level(_normalise(cv2.GaussianBlur(raw, (0, 0), blur), self.sigma), blur) for blur in (2.0, 0.8)]
        energy = _cell_means(_deviation(raw, self.sigma))
        # Texture that is not mere noise: two grey levels of deviation, or a fair share of the target's own.
        self.textured = energy > min(2.0, 0.5 * float(np.median(energy)))

    def _crop(self, frame: Pyramid, homography: Array) -> Grey:
        # Nothing outside the quad is looked at: what lies there may move on its own.
        return frame.crop(homography @ self.crop_to_template, self.width, self.height).astype(np.float32)

    def align(self, frame: Pyramid, start: Array, seen: Grey = EVERYWHERE, covariance: Array = LOOSE) -> Alignment:
        """Finds the pose at which the frame fits the template, as far as what is expected allows.

        Args:
            start: (3, 3) template to frame, the pose that is expected.
            seen: (8, 8) 0..1, which cells of the target may be looked at.
            covariance: (8, 8) of the expectation, as an alignment tells it.
        """
        coarse, fine = self.levels
        alignment = self._step(coarse, frame, start, start, seen, covariance)
        for _ in range(3):
            alignment = self._step(fine, frame, alignment.homography, start, seen, covariance)
            if alignment.moved < SETTLED:
                break
        return alignment

    def deviation(self, homography: Array, covariance: Array) -> float:
        """Standard deviation of the corners, px of the frame: the root of its mean square over them."""
        spread = np.einsum("cij,jk,cik->", self.levels[-1].corners, covariance, self.levels[-1].corners) / 4
        size = area(transform(homography @ self.crop_to_template, self.outline)) / (self.width * self.height)
        return float(np.sqrt(spread * abs(size)))

    def _step(
        self, level: "_Level", frame: Pyramid, homography: Array, expected: Array, seen: Grey, covariance: Array
    ) -> Alignment:
        """One alignment at one level, from a pose that the steps before led to."""
        search, agreement = self._compare(level, frame, homography)
        to_crop, from_crop = self.crop_to_template, np.linalg.inv(self.crop_to_template)
        expected_warp = from_crop @ np.linalg.inv(homography) @ expected @ to_crop
        trust = self._trust(agreement.correlation) * seen
        warp, posterior = level.align(search, trust, expected_warp, covariance)
        moved = float(np.abs(transform(warp, self.outline) - self.outline).max())
        return Alignment(normalised(homography @ to_crop @ warp @ from_crop), agreement, posterior, moved)

    def _compare(self, level: "_Level", frame: Pyramid, homography: Array) -> tuple[Grey, Agreement]:
        search = _normalise(cv2.GaussianBlur(self._crop(frame, homography), (0, 0), level.blur), self.sigma)
        correlation = _correlation(level.template, search)
        return search, Agreement(correlation, self._in_frame(frame, homography), self.textured)

    def _trust(self, correlation: Grey) -> Grey:
        """Weights (8, 8) of the cells for alignment; where hardly any agrees, all count: it is not aligned yet."""
        # How well a clear cell agrees, in this frame's blur and noise, the best cells show.
        best = float(np.quantile(correlation[self.textured], 0.9)) if self.textured.any() else 0.0
        if best < ALIGNED:
            return np.ones_like(correlation)
        agree = np.clip((correlation / best - 0.75) / 0.15, 0, 1)
        # Beside an occluder a cell is half its, even where it agrees.
        clear = agree * cv2.erode(np.where(self.textured, agree, 1), np.ones((3, 3), np.uint8))
        for trust in (clear, agree):
            if trust.sum() > 0.1 * trust.size:
                return np.asarray(trust, np.float32)
        return np.ones_like(correlation)

    def agreement(self, frame: Pyramid, homography: Array) -> Agreement:
        """Compares the frame, rectified by a homography, with the template."""
        return self._compare(self.levels[-1], frame, homography)[1]

    def _in_frame(self, frame: Pyramid, homography: Array) -> NDArray[np.bool_]:
        seen = transform(homography @ self.crop_to_template, self.cell_centres)
        w, h = frame.size
        return np.asarray(((seen > -0.5) & (seen < [w - 0.5, h - 0.5])).all(-1))


class _Level:
    """One scale of the template with its steepest-descent images."""

    def __init__(self, template: Grey, blur: float, most_points: int = 4000) -> None:
        self.template, self.blur = template, blur
        h, w = template.shape
        gy, gx = (np.asarray(g, np.float32) for g in np.gradient(template))
        # Only the pixels with the strongest gradients of each cell say anything; fewer make it faster.
        strength = gx**2 + gy**2
        chosen = strength >= _local_threshold(strength, min(1.0, most_points / (h * w)))
        chosen[:2], chosen[-2:], chosen[:, :2], chosen[:, -2:] = False, False, False, False
        y, x = np.nonzero(chosen)
        self.points = np.stack([x, y], 1).astype(np.float64)
        # Centred, scaled coordinates keep the normal equations well-conditioned.
        self.scale = 2.0 / max(w, h)
        self.centre = np.array([(w - 1) / 2, (h - 1) / 2])
        left, top = -self.scale * self.centre
        self.to_unit = np.array([[self.scale, 0, left], [0, self.scale, top], [0, 0, 1.0]])
        self.from_unit = np.linalg.inv(self.to_unit)
        u, v = ((self.points - self.centre) * self.scale).T
        dx, dy = gx[y, x].astype(np.float64), gy[y, x].astype(np.float64)
        radial = u * dx + v * dy
        jacobian = np.stack([u * dx, v * dx, dx, u * dy, v * dy, dy, -u * radial, -v * radial], 1) / self.scale
        self.jacobian = jacobian.astype(np.float32)
        # How the corners move with the eight parameters, (4, 2, 8).
        self.corners = np.array(
            [
                [[a, b, 1, 0, 0, 0, -a * a, -a * b], [0, 0, 0, a, b, 1, -a * b, -b * b]]
                for a, b in (square(1) * 2) * [w, h] * self.scale / 2
            ]
        )
        self.values = template[y, x]
        self.cells = y * CELLS // h, x * CELLS // w

    def align(
        self, search: Grey, trust: Grey, expected: Array, covariance: Array, iterations: int = 12
    ) -> tuple[Array, Array]:
        """Warp (3, 3), template pixels to pixels of the search crop, and its covariance (8, 8), px^2 at the edge.

        Args:
            trust: (8, 8) weights of the target's cells, 0..1.
            expected: (3, 3) the warp that is likeliest without a look; covariance: (8, 8) how surely.
        """
        trusted = trust[self.cells]
        counts = trusted > 0.5 * trusted.max()
        information = np.linalg.inv(covariance) / self.scale**2
        mean = self._parameters(expected)
        warp = np.eye(3)
        for _ in range(iterations):
            at = transform(warp, self.points).astype(np.float32)
            inside = ((at >= 0) & (at <= [search.shape[1] - 1, search.shape[0] - 1])).all(1)
            seen = cv2.remap(search, at[:, None, 0], at[:, None, 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            error = seen[:, 0] - self.values
            noise = max(1.4826 * float(np.median(np.abs(error[counts]))), 0.05)
            weight = _tukey(error / noise) * trusted * inside
            weighted = self.jacobian * weight[:, None]
            # What the visible part cannot tell stays near what is expected.
            prior = CORRELATED * noise**2 * information
            hessian = (weighted.T @ self.jacobian).astype(np.float64) + prior
            right = (weighted.T @ error).astype(np.float64) + prior @ (self._parameters(warp) - mean)
            step = np.linalg.solve(hessian, right)
            increment = np.array(
                [[1 + step[0], step[1], step[2]], [step[3], 1 + step[4], step[5]], [step[6], step[7], 1.0]]
            )
            warp = normalised(warp @ self.from_unit @ np.linalg.inv(increment) @ self.to_unit)
            if np.abs(step[[2, 5]]).max() / self.scale < 0.01 and np.abs(step).max() / self.scale < 0.02:
                break
        return warp, CORRELATED * noise**2 * np.linalg.inv(hessian) / self.scale**2

    def _parameters(self, warp: Array) -> Array:
        """The eight parameters of a warp (3, 3), in centred and scaled coordinates: the difference to the identity."""
        return (normalised(self.to_unit @ warp @ self.from_unit) - np.eye(3)).ravel()[:8]


def _tukey(error: Grey) -> Grey:
    """Tukey's biweight of residuals in units of their deviation."""
    return np.square(np.maximum(1 - np.square(error / 4.685), 0))


def _normalise(image: Grey, sigma: float) -> Grey:
    """Local mean taken off and local deviation divided out, over a square neighbourhood."""
    window = (2 * round(1.4 * sigma) + 1,) * 2
    centred = image - cv2.blur(image, window)
    variance = np.maximum(cv2.blur(centred * centred, window), 0)  # running sums may round to just below zero
    return np.asarray(centred / (np.sqrt(variance) + 2.0), np.float32)


def _deviation(image: Grey, sigma: float) -> Grey:
    centred = image - cv2.GaussianBlur(image, (0, 0), sigma)
    return np.abs(centred)


def _correlation(a: Grey, b: Grey) -> Grey:
    """Normalised cross-correlation (8, 8) of two images, cell by cell."""
    product = _cell_means(a * b) - _cell_means(a) * _cell_means(b)
    return np.asarray(product / np.sqrt(np.maximum(_cell_variance(a) * _cell_variance(b), 1e-9)), np.float32)


def _cell_means(image: Grey) -> Grey:
    return np.asarray(cv2.resize(image, (CELLS, CELLS), interpolation=cv2.INTER_AREA), np.float32)


def _cell_variance(image: Grey) -> Grey:
    return _cell_means(image * image) - np.square(_cell_means(image))


def _local_threshold(strength: Grey, share: float) -> Grey:
    """Per pixel, the strength that the strongest `share` of its cell's pixels exceed."""
    h, w = strength.shape
    threshold = np.empty_like(strength)
    rows, columns = (np.linspace(0, n, 5).astype(int) for n in (h, w))
    for top, bottom in itertools.pairwise(rows):
        for left, right in itertools.pairwise(columns):
            block = strength[top:bottom, left:right]
            threshold[top:bottom, left:right] = np.quantile(block, 1 - share)
    return threshold
