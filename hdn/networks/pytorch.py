"""The whole of HDN as a PyTorch module, and its way into weights files and out of them."""

from pathlib import Path
from typing import Any

import torch
from safetensors import safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from ..errors import InputError
from .config import COMPACT, Config
from .paper import PaperResidual
from .residual import ResidualNetwork
from .similarity import SimilarityNetwork
from .weights import configuration


class Hdn(nn.Module):
    """Both components of one configuration."""

    def __init__(self, config: Config = COMPACT) -> None:
        super().__init__()
        self.config = config
        self.similarity = SimilarityNetwork(config)
        self.residual: Any = ResidualNetwork(config) if config.residual == "matching" else PaperResidual(config)


def save(network: Hdn, path: Path, notes: dict[str, str]) -> None:
    """Writes the weights with the configuration's name and the notes (where they come from).

    They are fp16 where the configuration allows it, which halves the file.
    """
    tensors: dict[str, Tensor] = {
        name: value.half() if network.config.half and value.is_floating_point() else value
        for name, value in network.state_dict().items()
    }
    save_file(tensors, path, {"config": network.config.name, **notes})


def load(path: Path) -> Hdn:
    """Reads weights; the networks come in evaluation mode, single precision.

    Raises:
        InputError: no such file, not a safetensors file, or weights of another architecture.
    """
    config = configuration(path)
    with safe_open(path, framework="pt") as file:
        tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118
    with torch.device("meta"):  # no time goes into initial values
        network = Hdn(config)
    expected = network.state_dict()
    shapes = {key: tuple(value.shape) for key, value in tensors.items()}
    wrong = [key for key in expected if shapes.get(key) != tuple(expected[key].shape)] + list(
        set(shapes) - set(expected)
    )
    if wrong:
        raise InputError(
            f"{path} does not fit configuration '{config.name}' ({len(wrong)} tensors, first {wrong[0]}): make it anew"
        )
    network.load_state_dict({key: value.to(expected[key].dtype) for key, value in tensors.items()}, assign=True)
    return network.eval().requires_grad_(False)
