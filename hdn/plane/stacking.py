"""Views of one plane laid on each other: which of them agree, cell by cell, and what they show together."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..alignment.agreement import cell_means
from ..imaging.arrays import Floats, Image, Mask
from ..imaging.photometry import MAD_TO_DEVIATION, normalise, tukey


@dataclass(frozen=True)
class StackModel:
    """Constants of the comparison of views, and of their robust mean."""

    # Which views agree about a cell.
    cell_px: int = 12  # of the crops that are compared
    blur_px: float = 1.0  # standard deviation of the Gaussian over them
    window_cells: int = 2  # of the local normalisation
    agreeing: float = 0.6  # correlation from which two views agree
    flat: float = 0.02  # variance of a normalised cell, up to which it has no texture to compare
    min_shown: float = 0.99  # share of a cell that a view has to show

    # Sharpness.
    sharpness_cell_px: int = 16  # of the crop on which it is measured
    sharpness_blur_px: float = 1.0  # deviation of the Gaussian over that crop, against noise

    # Light: of cells that two views agree about.
    light_cells: float = 1.5  # standard deviation of the Gaussian over its gain, which is smooth
    prior_weight: float = 0.1  # of the gain over all of them, to that of a cell with its neighbours
    least_grey: float = 0.01  # grey levels, added to both lights: the gain of black is 1
    max_gain: float = 8.0  # either way

    # The robust mean.
    least_spread_grey: float = 4.0  # grey levels, standard deviation that is granted to the views at least
    steps: int = 2  # of reweighting
    rows: int = 16  # that are worked on at a time


MODEL = StackModel()
LUMA = np.array([0.299, 0.587, 0.114], np.float32)  # ITU-R BT.601, as OpenCV makes grey of RGB


@dataclass(frozen=True)
class Merged:
    """What views show together.

    Attributes:
        texture: (h, w, 3) RGB, grey levels; 0 where no view shows anything.
        count: (h, w) how many views a pixel rests on.
        spread: (h, w) grey levels, standard deviation of those views about the texture, robust.
    """

    texture: Floats
    count: Floats
    spread: Floats


class Stack:
    """Views (k, h, w, 3) of a plane, laid on each other.

    Attributes:
        images: (k, h, w, 3) RGB.
        shown: (k, n, n) which cells a view shows wholly.
        correlation: (n, n, k, k) of the views with each other, cell by cell; that of two without texture is 1.
    """

    def __init__(self, images: Image, inside: Image, cells: int) -> None:
        """Args:
        images: (k, h, w, 3) RGB, rectified alike. They are changed.
        inside: (k, h, w) 255 where a view shows something, else 0.
        cells: along either side.
        """
        self.images, self._inside, self._cells = images, inside, cells
        self.shown: Mask = np.array([cell_means(view.astype(np.float32), cells) for view in inside]) > (
            255 * MODEL.min_shown
        )
        self.correlation = self._correlate()

    def groups(self, sharpness: Floats) -> Mask:
        """Which views (k, n, n) are of the largest group that agrees about a cell.

        Args:
            sharpness: (k, n, n), which decides among groups of the same size.
        """
        agree = self.agreeing()
        size = agree.sum(1) + sharpness / (sharpness.max() + 1)
        best = np.expand_dims(size.argmax(0), (0, 1))
        return np.asarray(np.take_along_axis(agree, best, 0)[0])

    def agreeing(self) -> Mask:
        """Which views agree with which others (k, k, n, n), cell by cell; one with itself wherever it shows it."""
        both = self.shown[:, None] & self.shown[None]
        return (self.correlation > MODEL.agreeing).transpose(2, 3, 0, 1) & both

    def light_alike(self, members: Mask, standard: int) -> None:
        """Gives all views the light of one of them, by the cells (k, n, n) that show the same in both."""
        height, width = self.images.shape[1:3]
        means = np.array([cell_means(view.astype(np.float32), self._cells) for view in self.images])
        for view, mean, member in zip(self.images, means, members, strict=True):
            common = (member & members[standard])[..., None].astype(np.float32)
            if not common.any() or view is self.images[standard]:
                continue
            own, other = (
                _smooth(common * m) + MODEL.prior_weight * (common * m).sum((0, 1)) / common.sum() + MODEL.least_grey
                for m in (mean, means[standard])
            )
            gain = np.clip(other / own, 1 / MODEL.max_gain, MODEL.max_gain)
            gain = cv2.resize(gain, (width, height), interpolation=cv2.INTER_LINEAR)
            view[:] = np.clip(view * gain + 0.5, 0, 255)

    def merged(self, weights: Floats) -> Merged:
        """The robust mean of the views.

        Args:
            weights: (k, n, n) 0..1, of their cells.
        """
        count, height, width = self._inside.shape
        weight: Image = np.empty((count, height, width), np.uint8)
        for k in range(count):
            fine = cv2.resize(weights[k], (width, height), interpolation=cv2.INTER_LINEAR)
            weight[k] = np.where(self._inside[k] == 255, 255 * fine + 0.5, 0)
        parts = [
            _robust_mean(
                self.images[:, top : top + MODEL.rows].astype(np.float32),
                weight[:, top : top + MODEL.rows].astype(np.float32) / np.float32(255),
            )
            for top in range(0, height, MODEL.rows)
        ]
        return Merged(*(np.concatenate(rows) for rows in zip(*parts, strict=True)))

    def _correlate(self) -> Floats:
        n, c = self._cells, MODEL.cell_px
        patches = []
        for image in self.images:
            grey = cv2.cvtColor(cv2.resize(image, (n * c, n * c), interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY)
            soft = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), MODEL.blur_px)
            even = normalise(soft, 2 * (MODEL.window_cells * c // 2) + 1)[0]
            patches.append(even.reshape(n, c, n, c).transpose(0, 2, 1, 3).reshape(n, n, c * c))
        cells = np.stack(patches, 2)  # (n, n, k, c * c)
        cells -= cells.mean(-1, keepdims=True)
        variance = np.square(cells).mean(-1)
        flat = variance < MODEL.flat
        cells /= np.sqrt(c * c * np.maximum(variance, MODEL.flat))[..., None]
        return np.asarray(np.where(flat[..., None] & flat[..., None, :], 1, cells @ cells.swapaxes(2, 3)), np.float32)


def sharpness_of(image: Image, inside: Image, cells: int) -> Floats:
    """(4, n, n) root mean square gradient of each cell of an RGB image along four directions, grey levels per px.

    The px are those of a crop of `MODEL.sharpness_cell_px` to a cell; cells that are not wholly inside have none.
    """
    side = cells * MODEL.sharpness_cell_px
    grey = cv2.cvtColor(cv2.resize(image, (side, side), interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY)
    soft = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), MODEL.sharpness_blur_px)
    # Sobel's first derivatives come out eight times too large.
    dx, dy = (cv2.Sobel(soft, cv2.CV_32F, *order, scale=1 / 8) for order in ((1, 0), (0, 1)))
    xx, xy, yy = (cell_means(product, cells) for product in (dx * dx, dx * dy, dy * dy))
    energy = np.array([xx, (xx + yy) / 2 + xy, yy, (xx + yy) / 2 - xy])
    whole = cell_means(inside.astype(np.float32), cells) > 255 * MODEL.min_shown
    return np.asarray(np.sqrt(np.maximum(energy, 0)) * whole, np.float32)


def _robust_mean(values: Floats, weight: Floats) -> tuple[Floats, Floats, Floats]:
    """The mean of values (k, h, w, 3) by weights (k, h, w), without those unlike most; the three of `Merged`."""
    grey = values @ LUMA
    used = weight > 0
    number = used.sum(0)
    middle = np.maximum(number - 1, 0) // 2
    centre = _ranked(np.where(used, grey, np.inf), middle)
    centre[number == 0] = 0
    for _ in range(MODEL.steps):
        off = np.abs(grey - centre)
        spread = MAD_TO_DEVIATION * _ranked(np.where(used, off, np.inf), middle)
        spread[number == 0] = 0
        robust = weight * tukey(off / np.maximum(spread, MODEL.least_spread_grey))
        total = np.maximum(robust.sum(0), 1e-6)
        colour = np.einsum("khw,khwc->hwc", robust, values) / total[..., None]
        centre = colour @ LUMA
    return colour, (robust > 0).sum(0).astype(np.float32), spread.astype(np.float32)


def _ranked(values: Floats, rank: NDArray[np.intp]) -> Floats:
    """The values (h, w) of a rank, from 0 on, of those (k, h, w) in each pixel."""
    if (rank == rank[0, 0]).all():
        return np.asarray(np.partition(values, rank[0, 0], 0)[rank[0, 0]])
    return np.asarray(np.take_along_axis(np.sort(values, 0), rank[None], 0)[0])


def _smooth(cells: Floats) -> Floats:
    """Values (n, n, c) blurred over their neighbours; nothing lies beyond them."""
    return np.asarray(cv2.GaussianBlur(cells, (0, 0), MODEL.light_cells, borderType=cv2.BORDER_CONSTANT), np.float32)
