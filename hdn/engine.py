"""Runs the networks on single crops: OpenVINO on a CPU, PyTorch on CUDA.

Both engines run the same functions of crops; the tracker does not know which it has.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from .errors import InputError
from .homography import square, transform
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


class _Joined(nn.Module):
    """A head on the backbone's maps of the last input."""

    def __init__(self, backbone: nn.Module, head: nn.Module) -> None:
        super().__init__()
        self.backbone, self.head = backbone, head

    def forward(self, *inputs: Tensor) -> tuple[Tensor, ...]:
        *kernels, crop = inputs
        return self.head(*kernels, *self.backbone(crop))


class _Offsets(nn.Module):
    """Residual network on raw crops."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network: Any = network

    def forward(self, template: Tensor, search: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        n = self.network
        return n(n.prepare(template), n.prepare(search))


Function = Callable[..., list[Floats]]


def _torch_functions(network: Hdn, device: torch.device) -> list[Function]:
    s = network.similarity
    heads = _Encode(s.translation), _Encode(s.polar), _Correlate(s.translation), _Correlate(s.polar)
    half = network.config.half and device.type == "cuda"

    def function(module: nn.Module) -> Function:
        module = module.to(device).eval()

        def run(*inputs: Floats) -> list[Floats]:
            with torch.inference_mode(), torch.autocast("cuda", torch.float16, enabled=half):
                outputs = module(*(torch.from_numpy(x).to(device) for x in inputs))
            return [o.float().cpu().numpy() for o in outputs]

        return run

    return [function(m) for m in (*(_Joined(s.backbone, head) for head in heads), _Offsets(network.residual))]


def _openvino_functions(network: Hdn) -> list[Function]:
    from .compilation import compiled, convert, join

    c, s = network.config, network.similarity
    crop, residual = torch.zeros(1, 3, c.template_size, c.template_size), torch.zeros(1, 3, *[c.residual_size] * 2)
    backbone = convert(s.backbone, crop)
    with torch.inference_mode():
        maps = s.backbone(crop)
        kernel, polar_kernel = s.encode_template(maps), s.encode_polar_template(maps)
    models = (
        join(backbone, convert(_Encode(s.translation), *maps), c.template_size),
        join(backbone, convert(_Encode(s.polar), *maps), c.polar_size),
        join(backbone, convert(_Correlate(s.translation), kernel, *maps), c.search_size, kernel),
        join(backbone, convert(_Correlate(s.polar), polar_kernel, *maps), c.polar_size, polar_kernel),
        convert(_Offsets(network.residual), residual, residual),
    )
    models[-1].reshape(dict(enumerate([list(residual.shape)] * 2)))
    return [compiled(model) for model in models]


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
        self._encode, self._encode_polar, self._translation, self._polar, self._offsets = functions
        self._homography = network.residual.homography

    def encode_template(self, crop: Image, polar: Image) -> tuple[Floats, Floats]:
        """Template crop and its log-polar crop to the kernels of the two branches; once a target."""
        return self._encode(_tensor(crop))[0], self._encode_polar(_tensor(polar))[0]

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
        matrix = self._homography(torch.from_numpy(offsets.astype(np.float64)))[0].numpy()
        corners = square(self.config.residual_size)
        # The maps may be coarser than the crop: their cell (i, j) is centred on pixel (i / ratio, j / ratio).
        ratio = np.diag([e_search.shape[-1] / search.shape[0]] * 2 + [1.0])
        after = _warped_distance(e_template, e_search, ratio @ matrix @ np.linalg.inv(ratio))
        return Residual(transform(matrix, corners) - corners, float(np.abs(e_search - e_template).mean()), after)


def _warped_distance(template: Floats, search: Floats, matrix: NDArray[np.float64]) -> float:
    """Mean |search - template|, maps (1, 1, n, n), once the template is warped by a homography."""
    n = template.shape[-1]
    warped = cv2.warpPerspective(template[0, 0], matrix, (n, n), borderMode=cv2.BORDER_REPLICATE)
    return float(np.abs(search[0, 0] - warped).mean())


def _tensor(crop: Image) -> Floats:
    """RGB (n, n, 3) to (1, 3, n, n), 0..255."""
    return np.ascontiguousarray(crop.transpose(2, 0, 1)[None], np.float32)


def _decode(logits: Floats, offsets: Floats, stride: int) -> Shift:
    """The shift at the most probable cell, refined by its neighbours' votes; see `losses.grid_points` for the grid."""
    offsets = offsets[:, :: offsets.shape[1] // 2]  # of four, the first and the third count
    score = 1 / (1 + np.exp(np.minimum(logits[0, 0] - logits[0, 1], 20)))  # softmax of two, never quite zero
    n = score.shape[0]
    row, column = divmod(int(score.argmax()), n)
    rows, columns = slice(max(row - 1, 0), row + 2), slice(max(column - 1, 0), column + 2)
    weight = score[rows, columns] ** 4
    grid = (np.arange(n) - n // 2) * float(stride)
    x = grid[None, columns] - offsets[0, 0, rows, columns] * stride
    y = grid[rows, None] - offsets[0, 1, rows, columns] * stride
    total = weight.sum()
    return Shift(float((x * weight).sum() / total), float((y * weight).sum() / total), float(score[row, column]))
