"""What was laid on a frame, taken apart from it again: a layer that makes the same picture when it is laid over it.

`over` (Porter and Duff, 1984) makes C + (1 - a) B of a premultiplied layer (C, a) and the frame B. For the frame A that
came out, every alpha from some least one up has a colour that gives exactly A: C = A - (1 - a) B. So the alpha is how
much of the inserts is seen, where that is enough, and the least that is elsewhere, as where colours were blended. Under
an occluder the alpha is small, and its colours are not in the layer.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdn.imaging.arrays import Box, Floats, Grey, Picture

from .layer import in_float

Deep = NDArray[np.uint16]
Light = Callable[[Deep], Floats]
"""Of coded values (h, w, 3) in full scale."""


@dataclass(frozen=True)
class SeparationModel:
    """When two pixels are one."""

    same: float = 0.25 / 255  # of white: so much the result may be off by; what is dark would need an alpha for less


MODEL = SeparationModel()


@dataclass(frozen=True)
class Insert:
    """All that was laid on a frame.

    Attributes:
        box: the rows and columns of the frame that it takes.
        before, after: (h, w, 3) the frame there, without and with it; in full scale.
        cover: (h, w) 0..1, how much of each pixel what was laid on it takes.
        size: width and height of the frame, px.
    """

    box: Box
    before: Deep
    after: Deep
    cover: Grey
    size: tuple[int, int]

    @staticmethod
    def of(before: Deep, after: Deep, cover: Grey, drawn: Sequence[Box]) -> "Insert":
        """Of a whole frame (H, W, 3), before and after; how much of it (H, W) is covered, and where it was drawn."""
        box = _around(drawn)
        return Insert(box, before[box], after[box].copy(), cover[box], (after.shape[1], after.shape[0]))

    def layer(self, levels: int, light: Light | None = None) -> Floats:
        """The layer (h, w, 4) in the box, premultiplied; alpha 0..1, colours from 0 to alpha times white.

        Args:
            levels: of alpha above 0, that a file can hold.
            light: of coded values, where the layer is to be laid over in linear light; None for values as they are
                coded.
        """
        seen = light or in_float
        white = seen(np.full((1, 1, 3), 65535, np.uint16)).max()
        before, coded = seen(self.before), self.after.astype(np.int32)
        same = round(MODEL.same * 65535)
        low, high = (seen(np.clip(coded + by, 0, 65535).astype(np.uint16)) for by in (-same, same))
        darker = np.divide(before - high, before, out=np.zeros_like(before), where=before > high)
        brighter = np.divide(low - before, white - before, out=np.zeros_like(before), where=low > before)
        least = np.maximum(darker, brighter).max(2)
        alpha = np.maximum(np.rint(self.cover * levels), np.ceil(least * levels)).clip(0, levels) / np.float32(levels)
        alpha = alpha[..., None].astype(np.float32)
        return np.concatenate([np.clip(seen(self.after) - (1 - alpha) * before, 0, alpha * white), alpha], axis=2)

    def framed(self, part: Picture) -> Picture:
        """A picture of the box (h, w, ...) in one of the whole frame, clear around it."""
        whole = np.zeros((self.size[1], self.size[0], *part.shape[2:]), part.dtype)
        whole[self.box] = part
        return whole


def _around(boxes: Sequence[Box]) -> Box:
    """The box of a frame that holds all of these; an empty one of none."""
    rows, columns = (
        slice(min((box[axis].start for box in boxes), default=0), max((box[axis].stop for box in boxes), default=0))
        for axis in (0, 1)
    )
    return rows, columns


def straight(layer: Floats) -> Floats:
    """A premultiplied layer (h, w, 4) with its colours as they are, not times alpha."""
    colour, alpha = layer[..., :3], layer[..., 3:]
    return np.concatenate([np.divide(colour, alpha, out=np.zeros_like(colour), where=alpha > 0), alpha], axis=2)
