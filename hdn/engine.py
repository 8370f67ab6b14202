"""Runs the networks on single crops: OpenVINO on a CPU, PyTorch on CUDA.

Both engines run the same three functions of crops; the tracker does not know which it has.
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from .errors import InputError
from .homography import dlt, square
from .residual import standardise
from .sampling import Image
from .weights import Hdn

Floats = NDArray[np.float32]


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
        distance_before: mean |E(search) - E(template)|.
        distance_after: mean |E(search) - E(template warped by the offsets' homography)|.
    """

    offsets: NDArray[np.float64]
    distance_before: float
    distance_after: float


class _TemplateEncoder(nn.Module):
    def __init__(self, network: Hdn) -> None:
        super().__init__()
        self.network = network.similarity

    def forward(self, crop: Tensor, polar: Tensor) -> tuple[Tensor, Tensor]:
        n = self.network
        return n.encode_template(n.backbone(crop)), n.encode_polar_template(n.backbone(polar))


class _Translation(nn.Module):
    def __init__(self, network: Hdn) -> None:
        super().__init__()
        self.network = network.similarity

    def forward(self, template: Tensor, crop: Tensor) -> tuple[Tensor, Tensor]:
        n = self.network
        return n.translation(template, n.encode_search(n.backbone(crop)))


class _Polar(nn.Module):
    def __init__(self, network: Hdn) -> None:
        super().__init__()
        self.network = network.similarity

    def forward(self, template: Tensor, crop: Tensor) -> tuple[Tensor, Tensor]:
        n = self.network
        return n.polar(template, n.encode_polar_search(n.backbone(crop)))


class _Offsets(nn.Module):
    """Residual network on raw crops, with the feature distances before and after the warp it predicts."""

    def __init__(self, network: Hdn) -> None:
        super().__init__()
        self.network = network.residual

    def forward(self, template: Tensor, search: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        return self.network(standardise(template), standardise(search))


Function = Callable[..., list[Floats]]


def _torch_function(module: nn.Module, device: torch.device) -> Function:
    module = module.to(device)

    def run(*inputs: Floats) -> list[Floats]:
        with torch.inference_mode(), torch.autocast("cuda", torch.float16, enabled=device.type == "cuda"):
            outputs = module(*(torch.from_numpy(x).to(device) for x in inputs))
        return [o.float().cpu().numpy() for o in outputs]

    return run


def _openvino_function(module: nn.Module, *shapes: tuple[int, ...]) -> Function:
    import openvino as ov

    examples = tuple(torch.zeros(shape) for shape in shapes)
    model = ov.convert_model(module, example_input=examples, input=list(shapes))
    options = {"PERFORMANCE_HINT": "LATENCY", "INFERENCE_PRECISION_HINT": "f32"}
    request = ov.Core().compile_model(model, "CPU", options).create_infer_request()

    def run(*inputs: Floats) -> list[Floats]:
        request.infer(list(inputs))
        return [request.get_output_tensor(i).data.copy() for i in range(len(model.outputs))]

    return run


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
        c = self.config = network.config
        modules = _TemplateEncoder(network), _Translation(network), _Polar(network), _Offsets(network)
        if library == "openvino" or (library == "auto" and chosen.type == "cpu"):
            self.description = "OpenVINO on the CPU"
            t, p, r = c.template_size, c.polar_size, c.residual_size
            kernel, cells = c.template_cells - 2, p // c.stride - 2
            shapes: tuple[tuple[tuple[int, ...], ...], ...] = (
                ((1, 3, t, t), (1, 3, p, p)),
                ((1, c.channels, kernel, kernel), (1, 3, c.search_size, c.search_size)),
                ((1, c.channels, cells, cells), (1, 3, p, p)),
                ((1, 3, r, r), (1, 3, r, r)),
            )
            functions = [_openvino_function(m, *s) for m, s in zip(modules, shapes, strict=True)]
        else:
            self.description = f"PyTorch on {chosen.type}"
            functions = [_torch_function(m, chosen) for m in modules]
        self._encode, self._translation, self._polar, self._offsets = functions

    def encode_template(self, crop: Image, polar: Image) -> tuple[Floats, Floats]:
        """Template crop and its log-polar crop to the kernels of the two branches; once a target."""
        kernel, polar_kernel = self._encode(_tensor(crop), _tensor(polar))
        return kernel, polar_kernel

    def translation(self, kernel: Floats, crop: Image) -> Shift:
        """Where the target's centre is in the search crop, px from the crop's centre."""
        logits, offsets = self._translation(kernel, _tensor(crop))
        return _decode(logits, offsets, self.config.stride)

    def polar(self, kernel: Floats, crop: Image) -> Shift:
        """Shift of the log-polar crop: log-scale along x, rotation along y, in its pixels."""
        logits, offsets = self._polar(kernel, _tensor(crop))
        return _decode(logits, offsets, self.config.stride)

    def residual(self, template: Image, search: Image) -> Residual:
        """Corner offsets between two rectified crops, and whether they bring them closer."""
        offsets, e_template, e_search = self._offsets(_tensor(template), _tensor(search))
        corners = torch.from_numpy(square(self.config.residual_size))
        matrix = dlt(torch.from_numpy(offsets.astype(np.float64)), corners)[0].numpy()
        before = np.abs(e_search - e_template)[0, 0]
        return Residual(
            offsets[0].astype(np.float64), float(before.mean()), _warped_distance(e_template, e_search, matrix)
        )


def _warped_distance(template: Floats, search: Floats, matrix: NDArray[np.float64]) -> float:
    n = template.shape[-1]
    # The maps have half the crop's resolution: cell (i, j) is centred on pixel (2 i, 2 j).
    half = np.diag([0.5, 0.5, 1.0])
    warped = cv2.warpPerspective(
        template[0, 0], half @ matrix @ np.linalg.inv(half), (n, n), borderMode=cv2.BORDER_REPLICATE
    )
    return float(np.abs(search[0, 0] - warped).mean())


def _tensor(crop: Image) -> Floats:
    """RGB (n, n, 3) to (1, 3, n, n), 0..255."""
    return np.ascontiguousarray(crop.transpose(2, 0, 1)[None], np.float32)


def _decode(logits: Floats, offsets: Floats, stride: int) -> Shift:
    """The shift at the most probable cell, refined by its neighbours' votes; see `losses.grid_points` for the grid."""
    score = 1 / (1 + np.exp(logits[0, 0] - logits[0, 1]))  # softmax of two
    n = score.shape[0]
    row, column = divmod(int(score.argmax()), n)
    rows, columns = slice(max(row - 1, 0), row + 2), slice(max(column - 1, 0), column + 2)
    weight = score[rows, columns] ** 4
    grid = (np.arange(n) - n // 2) * float(stride)
    x = grid[None, columns] - offsets[0, 0, rows, columns] * stride
    y = grid[rows, None] - offsets[0, 1, rows, columns] * stride
    total = weight.sum()
    return Shift(float((x * weight).sum() / total), float((y * weight).sum() / total), float(score[row, column]))
