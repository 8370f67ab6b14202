"""Inverse-compositional Lucas-Kanade (Baker and Matthews, 2004) over the eight parameters of a homography.

It compares locally normalised grey levels, which are free of gain and bias, so of uneven light too, and weighs them
robustly, so that an occluder or a glare does not pull.
"""

import copy
import itertools

import cv2
import numpy as np

from ..imaging.arrays import Array, Grey
from ..imaging.blur import blurred, normalise, shares, tukey
from ..imaging.homography import from_corners, normalised, parameter_rows, transform
from ..imaging.pyramid import Pyramid
from ..imaging.quads import outline, square
from .agreement import CELLS, Cells
from .border import NOTHING, Pull

STILL = 0.02  # px of the crop that a step moves its edge by, under which the steps end
STEPS = 6  # at most; after them the frame is rectified anew
NOISE = 2.0  # grey levels, of a frame of usual contrast
MISMATCH = 0.15  # of normalised grey levels, that light and blur leave even where there is no noise
OUTSIDE = 1e3  # of normalised grey levels: what lies outside the crop is taken for an outlier
SAME = 50  # pixels that share their errors, and count as one, on a crop of the usual size


class Level:
    """One scale of the template with its steepest-descent images.

    Attributes:
        width, height: of the crop, px.
        to_template, from_template: (3, 3) the crop's pixels to the template's, and back.
        raw, template: (h, w) the template at this scale, grey and as it is compared.
        window: px that it is normalised over.
        corners: (4, 2, 8) how the corners move with the eight parameters, px.
    """

    def __init__(
        self, frame: Pyramid, quad: Array, size: tuple[int, int], blur: float, usual: int, most_points: int
    ) -> None:
        """Args:
        frame: grey pyramid of the reference frame; quad: (4, 2) the target's corners in it.
        size: width and height of the crop, px, multiples of CELLS.
        blur: standard deviation of the Gaussian that template and frames are blurred by, px.
        usual: px of the longer side of the crop in whose pixels covariances are told.
        most_points: that are compared.
        """
        self.width, self.height = w, h = size
        self.to_template = from_corners(outline(w, h), quad)
        self.from_template = np.linalg.inv(self.to_template)
        self._blur, self.window = blur, 2 * round(max(w, h) / 10) + 1
        self.raw = self.look(frame, np.eye(3))
        self._usual_pixel = max(w, h) / usual
        self._frame_blur = np.zeros((2, 2))
        # Centred, scaled coordinates keep the normal equations well-conditioned, and parameters alike at every scale.
        self._scale = 2.0 / max(w, h)
        left, top = -self._scale * np.array([(w - 1) / 2, (h - 1) / 2])
        self._to_unit = np.array([[self._scale, 0, left], [0, self._scale, top], [0, 0, 1.0]])
        self._from_unit = np.linalg.inv(self._to_unit)
        self._pixel = 2.0 / usual  # of the usual crop, in unit coordinates
        self._same = SAME * self._usual_pixel**2
        a, b = (square(1) * 2 * [w, h] / max(w, h)).T
        one, zero = np.ones(4), np.zeros(4)
        self.corners = np.stack([parameter_rows(a, b, one, zero), parameter_rows(a, b, zero, one)], 1)
        self._most_points = most_points
        self._learn(self.raw)

    def matched(self, covariance: Array) -> "Level":
        """This level for frames blurred more than the template by so much, (2, 2) px^2 of the usual crop."""
        level = copy.copy(self)
        of_template, level._frame_blur = shares(covariance * self._usual_pixel**2)
        level._learn(blurred(self.raw, of_template))
        return level

    def _learn(self, raw: Grey) -> None:
        """Takes a template (h, w), grey, and makes its steepest-descent images."""
        self.template, deviation = self._normalised(raw)
        self._whole = Cells(self.template)
        gy, gx = (np.asarray(g, np.float32) for g in np.gradient(self.template))
        # Only the pixels with the strongest gradients of each part say anything; fewer make it faster.
        strength = gx**2 + gy**2
        chosen = strength >= _local_threshold(strength, min(1.0, self._most_points / strength.size))
        chosen[:2], chosen[-2:], chosen[:, :2], chosen[:, -2:] = False, False, False, False
        y, x = np.nonzero(chosen)
        self._points = np.stack([x, y, np.ones_like(x)], 1).astype(np.float32)
        self._values, self._cells = self.template[y, x], (y * CELLS // self.height, x * CELLS // self.width)
        # Normalising amplifies the noise of what has little contrast.
        self._certainty = 1 / np.sqrt(MISMATCH**2 + np.square(NOISE / deviation[y, x]))
        dx, dy = gx[y, x] / self._scale, gy[y, x] / self._scale
        u, v, _ = self._to_unit @ self._points.T
        self._jacobian = parameter_rows(u, v, dx, dy).astype(np.float32)

    def look(self, frame: Pyramid, homography: Array) -> Grey:
        """A frame rectified by a homography, (h, w) grey."""
        # Nothing outside the quad is looked at: what lies there may move on its own.
        return frame.crop(homography @ self.to_template, self.width, self.height).astype(np.float32)

    def rectify(self, frame: Pyramid, homography: Array) -> Grey:
        """A frame (h, w) as it is compared with the template: rectified by a homography, blurred, normalised."""
        return self._normalised(blurred(self.look(frame, homography), self._frame_blur))[0]

    def correlation(self, search: Grey) -> Grey:
        """Of each cell (8, 8) of the template with that of a frame as `rectify` makes it."""
        return self._whole.correlation(search)

    def align(
        self, search: Grey, trust: Grey, expected: Array, covariance: Array, pull: Pull = NOTHING
    ) -> tuple[Array, Array]:
        """Warp (3, 3), template pixels to pixels of the search crop, and its covariance (8, 8), px^2 at the edge.

        Args:
            search: (h, w) what `rectify` made.
            trust: (8, 8) weights of the target's cells, 0..1.
            expected: (3, 3) the warp that is likeliest without a look; covariance: (8, 8) how surely.
            pull: what the target's border says.
        """
        trusted = trust[self._cells]
        counts = trusted > 0.5 * trusted.max()
        likely = np.linalg.inv(covariance) / self._pixel**2
        information = likely + pull.information
        weighted_mean = likely @ self._parameters(expected) + pull.weighted
        warp = np.eye(3)
        least = 0.05 * float(np.median(self._certainty))
        for _ in range(STEPS):
            at = self._points @ warp.T.astype(np.float32)
            at = at[:, :2] / at[:, 2:]
            seen = cv2.remap(
                search, at[:, None], None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=OUTSIDE
            )
            error = seen[:, 0] - self._values
            certain = error * self._certainty
            noise = max(1.4826 * _median(np.abs(certain[counts])), least)
            weight = tukey(certain / noise) * trusted * np.square(self._certainty)
            weighted = self._jacobian * weight[:, None]
            # What the visible part cannot tell stays near what is expected.
            scale = self._same * noise**2
            hessian = (weighted.T @ self._jacobian).astype(np.float64) + scale * information
            right = (weighted.T @ error).astype(np.float64)
            right += scale * (information @ self._parameters(warp) - weighted_mean)
            step = np.linalg.solve(hessian, right)
            increment = np.append(step, 0).reshape(3, 3) + np.eye(3)
            warp = normalised(warp @ self._from_unit @ np.linalg.inv(increment) @ self._to_unit)
            if np.abs(step).max() * max(self.width, self.height) / 2 < STILL:
                break
        return warp, self._same * noise**2 * np.linalg.inv(hessian) / self._pixel**2

    @property
    def uncertainty(self) -> Array:
        """Covariance (8, 8), as `align` tells it, where all is seen in as much noise as frames may have."""
        certain = self._jacobian.astype(np.float64) * self._certainty[:, None]
        return np.asarray(self._same * np.linalg.inv(certain.T @ certain + 1e-6 * np.eye(8)) / self._pixel**2)

    def moved(self, warp: Array) -> float:
        """How far a warp (3, 3) moves the crop's corners, px of the usual crop."""
        corners = outline(self.width, self.height)
        return float(np.abs(transform(warp, corners) - corners).max()) / self._usual_pixel

    def _parameters(self, warp: Array) -> Array:
        """The eight parameters of a warp (3, 3), in centred and scaled coordinates: the difference to the identity."""
        return (normalised(self._to_unit @ warp @ self._from_unit) - np.eye(3)).ravel()[:8]

    def _normalised(self, crop: Grey) -> tuple[Grey, Grey]:
        return normalise(cv2.GaussianBlur(crop, (0, 0), self._blur), self.window)


def _median(values: Grey) -> float:
    """The upper one, of an even number of values; NumPy's own takes several times as long."""
    middle = len(values) // 2
    return float(np.partition(values, middle)[middle])


def _local_threshold(strength: Grey, share: float) -> Grey:
    """Per pixel, the strength that the strongest `share` of the pixels around it exceed."""
    h, w = strength.shape
    threshold = np.empty_like(strength)
    rows, columns = (np.linspace(0, n, 5).astype(int) for n in (h, w))
    for top, bottom in itertools.pairwise(rows):
        for left, right in itertools.pairwise(columns):
            block = strength[top:bottom, left:right]
            threshold[top:bottom, left:right] = np.quantile(block, 1 - share)
    return threshold
