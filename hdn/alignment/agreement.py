"""How well a rectified frame shows the template, cell by cell."""

from dataclasses import dataclass

import cv2
import numpy as np

from ..imaging.arrays import Floats, Grey, Mask

CELLS = 8  # the target is judged on a grid of CELLS x CELLS


@dataclass(frozen=True)
class AgreementThresholds:
    """When a cell shows the template, and when enough cells are there to judge by."""

    correlation: float = 0.5  # from which a cell is taken to show the template
    sure_correlation: float = 0.6  # from which it hardly does so by chance
    min_visible_cells: int = 2  # with fewer in the frame, no share of them is told
    min_visible_share: float = 0.1  # of the textured cells; the same
    min_variance: float = 1e-9  # of a product of variances; less is no texture


THRESHOLDS = AgreementThresholds()


@dataclass(frozen=True)
class Agreement:
    """How well a rectified frame shows the template, cell by cell.

    Attributes:
        correlation: (8, 8) normalised cross-correlation of each cell with the template's.
        in_frame: (8, 8) cells that lie in the frame.
        textured: (8, 8) cells that have texture to compare, in the frame or not.
    """

    correlation: Floats
    in_frame: Mask
    textured: Mask

    @property
    def visible(self) -> Mask:
        """(8, 8) cells that can be judged."""
        return self.in_frame & self.textured

    @property
    def agrees(self) -> Mask:
        """(8, 8) cells that show the template."""
        return np.asarray(self.correlation > THRESHOLDS.correlation)

    @property
    def agrees_surely(self) -> Mask:
        """(8, 8) cells that show the template, and hardly so by chance."""
        return np.asarray(self.correlation > THRESHOLDS.sure_correlation)

    @property
    def share(self) -> float:
        """Share of the visible cells that agree with the template; 0 where next to nothing is visible."""
        fewest = max(THRESHOLDS.min_visible_cells, THRESHOLDS.min_visible_share * self.textured.sum())
        if self.visible.sum() < fewest:
            return 0.0
        return float(self.agrees[self.visible].mean())

    @property
    def cohesion(self) -> float:
        """The largest patch of adjoining cells that surely agree, as a share of the target.

        Cells that agree by chance lie scattered; what an occluder leaves of the target hangs together.
        """
        agree = (self.agrees_surely & self.visible).astype(np.uint8)
        _, _, patches, _ = cv2.connectedComponentsWithStats(agree, connectivity=4)
        return float(patches[1:, cv2.CC_STAT_AREA].max(initial=0)) / agree.size


class Cells:
    """An image, to be correlated with others cell by cell; whole numbers of pixels to a cell make it fast."""

    def __init__(self, image: Grey, cells: int = CELLS) -> None:
        """Args: image: (h, w) grey. cells: it is taken as a grid of so many along either side."""
        self._cells = cells
        self._image, self._mean = image, cell_means(image, cells)
        self._variance = cell_means(image * image, cells) - np.square(self._mean)

    def correlation(self, other: Grey) -> Floats:
        """Normalised cross-correlation (cells, cells) with another image of the same size."""
        mean = cell_means(other, self._cells)
        variance = cell_means(other * other, self._cells) - np.square(mean)
        product = cell_means(self._image * other, self._cells) - self._mean * mean
        scale = np.sqrt(np.maximum(self._variance * variance, THRESHOLDS.min_variance))
        return np.asarray(product / scale, np.float32)


def cell_means(image: Grey, cells: int = CELLS) -> Floats:
    """Mean (cells, cells) of each cell of an image."""
    return np.asarray(cv2.resize(image, (cells, cells), interpolation=cv2.INTER_AREA), np.float32)
