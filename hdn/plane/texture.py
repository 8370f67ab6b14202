"""The texture of a plane: one rectified picture, put together from the frames that show its parts."""

from dataclasses import dataclass

import cv2
import numpy as np

from ..alignment.agreement import cell_means
from ..imaging.arrays import Floats, Grey, Image, Mask


@dataclass(frozen=True)
class LightModel:
    """Constants of the match of a frame's light to the texture's."""

    max_gain: float = 3.0  # contrast of the one to that of the other, either way
    min_contrast_grey: float = 1.0  # grey levels, added to both contrasts: the gain of what is flat is 1
    blur_cells: float = 1.5  # standard deviation of the Gaussian over differences in brightness, which are smooth
    prior_weight: float = 1e-3  # of their mean, to that of a cell that is compared: it counts far from all of them


MODEL = LightModel()


class Texture:
    """A rectified picture of a plane, and from which frame each of its pixels is.

    Attributes:
        picture: (h, w, 3) RGB, in the light of the first frame.
        known: (h, w) the pixels that some frame has shown.
        takes: how often new pixels were taken.
    """

    def __init__(self, picture: Image, grey: Grey, known: Mask, cells: int) -> None:
        """Args:
        picture: (h, w, 3) RGB, as the first frame shows the plane.
        grey: (h, w) the same, grey levels.
        known: (h, w) the pixels of it that show the plane.
        cells: along either side, in which light is compared.
        """
        self.picture, self.known, self.takes = picture.copy(), known.copy(), 0
        self._first_grey, self._cells = grey, cells
        self._source = np.where(known, 0, -1).astype(np.int32)  # which take a pixel is from; the first frame is 0

    def take(self, crop: Image, pixels: Mask, overlap: Mask) -> None:
        """Takes pixels (h, w) from another frame's crop (h, w, 3), in the light that the picture has beside them.

        Args:
            overlap: (h, w) the pixels of the picture that the crop shows as well, by whose light it is matched.
        """
        self.takes += 1
        self.picture[pixels] = self._in_its_light(crop, overlap)[pixels]
        self.known |= pixels
        self._source[pixels] = self.takes

    @property
    def grey(self) -> Grey:
        """The picture's grey levels (h, w)."""
        grey = cv2.cvtColor(self.picture, cv2.COLOR_RGB2GRAY).astype(np.float32)
        return np.where(self._source == 0, self._first_grey, grey)

    @property
    def comparable(self) -> Mask:
        """The known pixels (h, w) but for the seams between frames, where no texture of the plane's own may be."""
        source, seam = self._source, np.zeros(self.known.shape, bool)
        across, down = source[:, 1:] != source[:, :-1], source[1:] != source[:-1]
        seam[:, 1:] |= across
        seam[:, :-1] |= across
        seam[1:] |= down
        seam[:-1] |= down
        return np.asarray(self.known & ~seam)

    def _in_its_light(self, crop: Image, overlap: Mask) -> Image:
        """A crop (h, w, 3) in the picture's light: its contrast as a whole, and its brightness place by place."""
        if not overlap.any():
            return crop
        own, other = self.picture.astype(np.float32), crop.astype(np.float32)
        mask = overlap.astype(np.uint8)
        contrasts = [cv2.meanStdDev(image, mask=mask)[1][:, 0] + MODEL.min_contrast_grey for image in (own, other)]
        gain = np.clip(contrasts[0] / contrasts[1], 1 / MODEL.max_gain, MODEL.max_gain)
        matched = other * gain.astype(np.float32)
        weight = cell_means(overlap.astype(np.float32), self._cells)
        difference = cell_means((own - matched) * overlap[..., None], self._cells)  # (n, n, 3), times the weight
        mean = difference.sum((0, 1)) / weight.sum()
        smooth_weight, smooth = (_smooth(x) for x in (weight, difference))
        offset = (smooth + MODEL.prior_weight * mean) / (smooth_weight + MODEL.prior_weight)[..., None]
        height, width = overlap.shape
        offset = cv2.resize(offset, (width, height), interpolation=cv2.INTER_LINEAR)
        return np.asarray(np.clip(matched + offset + 0.5, 0, 255), np.uint8)


def _smooth(cells: Floats) -> Floats:
    """Values (n, n) or (n, n, c) blurred over their neighbours; nothing lies beyond them."""
    return np.asarray(cv2.GaussianBlur(cells, (0, 0), MODEL.blur_cells, borderType=cv2.BORDER_CONSTANT), np.float32)
