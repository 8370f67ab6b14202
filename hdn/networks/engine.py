"""Runs the networks on single crops: OpenVINO on a CPU, PyTorch on CUDA.

Both engines run the same functions of crops; the tracker does not know which it has.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from ..errors import InputError
from ..imaging.arrays import Floats, Image
from .weights import Hdn


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

    offsets: NDArray[np.float64]
    visible: Floats


class _Encode(nn.Module):
    """A branch's correlation kernel from the maps of a template crop."""

    def __init__(self, branch: nn.Module) -> None:
        super().__init__()
        self.branch: Any = branch

    def forward(self, *maps: Tensor) -> tuple[Tensor]:
        return (self.branch.encode_template(maps),)


class _Correlate(nn.Module):
    """A branch's logits and offsets from its kernel and the maps of a search crop."""

    def __init__(self, branch: nn.Module) -> None:
        super().__init__()
        self.branch: Any = branch

    def forward(self, kernel: Tensor, *maps: Tensor) -> tuple[Tensor, Tensor]:
        return self.branch(kernel, self.branch.encode_search(maps))


class _OfImage(nn.Module):
    """A network whose last input is an image as it is kept, uint8 (1, n, n, 3), in place of floats (1, 3, n, n)."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = network

    def forward(self, *inputs: Tensor) -> tuple[Tensor, ...]:
        *others, image = inputs
        return self.network(*others, image.permute(0, 3, 1, 2).float())


class _Joined(nn.Module):
    """A head on the backbone's maps of the last input."""

    def __init__(self, backbone: nn.Module, head: nn.Module) -> None:
        super().__init__()
        self.backbone, self.head = backbone, head

    def forward(self, *inputs: Tensor) -> tuple[Tensor, ...]:
        *kernels, crop = inputs
        return self.head(*kernels, *self.backbone(crop))


class _Describe(nn.Module):
    """What the residual network keeps of a template crop."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network: Any = network

    def forward(self, crop: Tensor) -> tuple[Tensor]:
        return (self.network.describe(crop),)


class _Compare(nn.Module):
    """The residual network's part that runs once a frame."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network: Any = network

    def forward(self, template: Tensor, crop: Tensor) -> tuple[Tensor, ...]:
        return self.network.compare(template, crop)


Function = Callable[..., list[Floats]]


def _torch_functions(network: Hdn, device: torch.device) -> list[Function]:
    s = network.similarity
    heads = _Encode(s.translation), _Encode(s.polar), _Correlate(s.translation), _Correlate(s.polar)
    half = network.config.half and device.type == "cuda"

    def function(module: nn.Module) -> Function:
        module = _OfImage(module).to(device).eval()

        def run(*inputs: NDArray[Any]) -> list[Floats]:
            with torch.inference_mode(), torch.autocast("cuda", torch.float16, enabled=half):
                outputs = module(*(torch.from_numpy(x).to(device) for x in inputs))
            return [o.float().cpu().numpy() for o in outputs]

        return run

    residual = _Describe(network.residual), _Compare(network.residual)
    functions = [function(m) for m in (*(_Joined(s.backbone, head) for head in heads), *residual)]
    return [*functions, functions[2]]  # a survey is a translation in a larger crop


def _openvino_functions(network: Hdn) -> list[Function]:
    from .openvino import compiled, convert, join

    c, s = network.config, network.similarity
    template, residual = (torch.zeros(1, n, n, 3, dtype=torch.uint8) for n in (c.template_size, c.residual_size))
    seeing, describe = _OfImage(s.backbone), _OfImage(_Describe(network.residual))
    backbone = convert(seeing, template)
    with torch.inference_mode():
        maps = seeing(template)
        kernel, polar_kernel = s.encode_template(maps), s.encode_polar_template(maps)
        (described,) = describe(residual)
    models = (
        join(backbone, convert(_Encode(s.translation), *maps), c.template_size),
        join(backbone, convert(_Encode(s.polar), *maps), c.polar_size),
        join(backbone, convert(_Correlate(s.translation), kernel, *maps), c.search_size, kernel),
        join(backbone, convert(_Correlate(s.polar), polar_kernel, *maps), c.polar_size, polar_kernel),
        convert(describe, residual),
        convert(_OfImage(_Compare(network.residual)), described, residual),
    )
    models[-2].reshape({0: list(residual.shape)})
    models[-1].reshape({0: list(described.shape), 1: list(residual.shape)})
    survey = models[2].clone()
    survey.reshape({0: list(kernel.shape), 1: [1, -1, -1, 3]})

    @cache
    def surveying() -> Function:
        return compiled(survey)

    # Compiled only where a target is lost.
    return [*(compiled(model) for model in models), lambda *inputs: surveying()(*inputs)]


def choose_device(name: str) -> torch.device:
    """'auto', 'cpu' or 'cuda' to a device.

    Raises:
        InputError: 'cuda' where there is none, or another name.
    """
    if name not in ("auto", "cpu", "cuda"):
        raise InputError(f"unknown device '{name}': choose auto, cpu or cuda")
    if name == "cuda" and not torch.cuda.is_available():
        raise InputError("no CUDA device is available: use --device cpu or auto")
    return torch.device("cuda" if name == "cuda" or (name == "auto" and torch.cuda.is_available()) else "cpu")


class Engine:
    """The networks as functions of RGB crops (n, n, 3)."""

    def __init__(self, network: Hdn, device: str = "auto", library: str = "auto") -> None:
        """Args: library: 'openvino', 'torch', or 'auto': OpenVINO on a CPU, PyTorch on CUDA."""
        chosen = choose_device(device)
        self.config = network.config
        if library == "openvino" or (library == "auto" and chosen.type == "cpu"):
            self.description = "OpenVINO on the CPU"
            functions = _openvino_functions(network)
        else:
            self.description = f"PyTorch on {chosen.type}"
            functions = _torch_functions(network, chosen)
        (
            self._encode,
            self._encode_polar,
            self._translation,
            self._polar,
            self._describe,
            self._compare,
            self._survey,
        ) = functions
        self._conclude = network.residual.conclude

    def encode_template(self, crop: Image, polar: Image) -> tuple[Floats, Floats]:
        """Template crop and its log-polar crop to the kernels of the two branches; once a target."""
        return self._encode(crop[None])[0], self._encode_polar(polar[None])[0]

    def translation(self, kernel: Floats, crop: Image) -> Shift:
        """Where the target's centre is in a search crop, px from the crop's centre.

        Args: crop: (n, n, 3) of the configuration's size; or (h, w, 3) of other ones that `survey_size` makes.
        """
        usual = crop.shape[:2] == (self.config.search_size,) * 2
        logits, offsets = (self._translation if usual else self._survey)(kernel, crop[None])
        return _decode(logits, offsets, self.config.stride)

    def polar(self, kernel: Floats, crop: Image) -> Shift:
        """Shift of the log-polar crop: log-scale along x, rotation along y, in its pixels."""
        logits, offsets = self._polar(kernel, crop[None])
        return _decode(logits, offsets, self.config.stride)

    def describe(self, crop: Image) -> Floats:
        """What `residual` needs of the template's crop; once a target."""
        return self._describe(crop[None])[0]

    def residual(self, template: Floats, crop: Image) -> Residual:
        """Corner offsets from a described template's crop to another, and which parts of the target are seen in it."""
        outputs = self._compare(template, crop[None])
        with torch.inference_mode():
            offsets, visible = self._conclude(*(torch.from_numpy(x) for x in outputs))
        return Residual(offsets[0].double().numpy(), visible[0].numpy())


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
