"""HDN's networks on single crops, whatever runs them: `openvino` on a CPU, `torch_engine` on CUDA."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..imaging.arrays import Array, Floats, Image
from .config import Config


@dataclass(frozen=True)
class Shift:
    """What a correlation branch says: a shift in px of its crop, and the score of its best cell in 0..1."""

    x: float
    y: float
    score: float


@dataclass(frozen=True)
class Residual:
    """What the residual network says.

    Attributes:
        offsets: (4, 2) px of the residual crop, from its corners to the target's.
        visible: (m, m) probability that each part of the target is seen; the paper's network has one for the whole.
    """

    offsets: Array
    visible: Floats


Function = Callable[..., list[Floats]]  # of arrays; crops are uint8 (1, h, w, 3)


@dataclass(frozen=True)
class Functions:
    """The networks' parts, as functions.

    Attributes:
        encode, encode_polar: a template crop, or its log-polar crop, to the branch's correlation kernel.
        translation, polar: a kernel and a search crop of the configuration's size to score logits (1, 2, n, n) and
            offsets (1, 2 or 4, n, n) in cells.
        survey: as `translation`, of a crop of any size.
        describe: a residual crop of the template to what `compare` needs of it.
        compare: that and a residual crop of the search to what `conclude` takes.
        conclude: to the offsets and visibility of a `Residual`.
    """

    encode: Function
    encode_polar: Function
    translation: Function
    polar: Function
    describe: Function
    compare: Function
    survey: Function
    conclude: Callable[..., tuple[Array, Floats]]


class Engine:
    """The networks as functions of RGB crops (n, n, 3)."""

    def __init__(self, config: Config, functions: Functions, description: str, device: str = "cpu") -> None:
        """Args: description: what runs them, as the log says it; device: 'cpu' or 'cuda', for the matte network."""
        self.config, self.functions, self.description, self.device = config, functions, description, device

    def encode_template(self, crop: Image, polar: Image) -> tuple[Floats, Floats]:
        """Template crop and its log-polar crop to the kernels of the two branches; once a target."""
        return self.functions.encode(crop[None])[0], self.functions.encode_polar(polar[None])[0]

    def translation(self, kernel: Floats, crop: Image) -> Shift:
        """Where the target's centre is in a search crop, px from the crop's centre.

        Args: crop: (n, n, 3) of the configuration's size; or (h, w, 3) of other ones that `survey_size` makes.
        """
        usual = crop.shape[:2] == (self.config.search_size,) * 2
        logits, offsets = (self.functions.translation if usual else self.functions.survey)(kernel, crop[None])
        return _decode(logits, offsets, self.config.stride)

    def polar(self, kernel: Floats, crop: Image) -> Shift:
        """Shift of the log-polar crop: log-scale along x, rotation along y, in its pixels."""
        logits, offsets = self.functions.polar(kernel, crop[None])
        return _decode(logits, offsets, self.config.stride)

    def describe(self, crop: Image) -> Floats:
        """What `residual` needs of the template's crop; once a target."""
        return self.functions.describe(crop[None])[0]

    def residual(self, template: Floats, crop: Image) -> Residual:
        """Corner offsets from a described template's crop to another, and which parts of the target are seen in it."""
        outputs = self.functions.compare(template, crop[None])
        return Residual(*self.functions.conclude(*outputs))

    def matte(self, frame: Image, template: Image, valid: Image | None = None, around: Image | None = None) -> Floats:
        """How probably each pixel of a rectified frame crop shows the surface, see `Matte`; (128, 128), 0 to 1.

        Its network, the shipped one whatever the weights of the others, is read when first asked for.
        """
        from .loading import shared_matte

        return shared_matte(self.device)(frame, template, valid, around)


def survey_size(length: float) -> int:
    """Width or height of a search crop, px, in which the target's centre is found anywhere along a length about its
    middle: of those with a cell there."""
    step, least = 16, 63  # two cells; one that takes in the template's centre alone, however it lies on the cells
    return least + step * int(np.ceil(max(length, 1) / step))


def _decode(logits: Floats, offsets: Floats, stride: int) -> Shift:
    """The shift at the most probable cell, refined by its neighbours' votes; see `losses.grid_points` for the grid."""
    offsets = offsets[:, :: offsets.shape[1] // 2]  # of four, the first and the third count
    score = 1 / (1 + np.exp(np.minimum(logits[0, 0] - logits[0, 1], 20)))  # softmax of two, never quite zero
    row, column = divmod(int(score.argmax()), score.shape[1])
    rows, columns = slice(max(row - 1, 0), row + 2), slice(max(column - 1, 0), column + 2)
    weight = score[rows, columns] ** 4
    down, across = ((np.arange(n) - n // 2) * float(stride) for n in score.shape)
    x = across[None, columns] - offsets[0, 0, rows, columns] * stride
    y = down[rows, None] - offsets[0, 1, rows, columns] * stride
    total = weight.sum()
    return Shift(float((x * weight).sum() / total), float((y * weight).sum() / total), float(score[row, column]))
