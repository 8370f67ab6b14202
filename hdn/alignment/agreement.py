"""How well a rectified frame shows the template, cell by cell."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..imaging.arrays import Grey

CELLS = 8  # the target is judged on a grid of CELLS x CELLS
AGREES = 0.5  # correlation from which a cell is taken to show the template
SURELY = 0.6  # and from which it hardly does so by chance


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


class Cells:
    """An image, to be correlated with others cell by cell; its sides are multiples of CELLS, which makes it fast."""

    def __init__(self, image: Grey) -> None:
        self._image, self._mean = image, cell_means(image)
        self._variance = cell_means(image * image) - np.square(self._mean)

    def correlation(self, other: Grey) -> Grey:
        """Normalised cross-correlation (8, 8) with another image of the same size."""
        mean = cell_means(other)
        variance = cell_means(other * other) - np.square(mean)
        product = cell_means(self._image * other) - self._mean * mean
        return np.asarray(product / np.sqrt(np.maximum(self._variance * variance, 1e-9)), np.float32)


def cell_means(image: Grey) -> Grey:
    """Mean (8, 8) of each cell of an image."""
    return np.asarray(cv2.resize(image, (CELLS, CELLS), interpolation=cv2.INTER_AREA), np.float32)
