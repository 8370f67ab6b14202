"""Weights on disk: safetensors that name their configuration."""

from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from ..errors import InputError
from .config import COMPACT, PAPER, Config
from .paper import PaperResidual
from .residual import ResidualNetwork
from .similarity import SimilarityNetwork

CONFIGS = {config.name: config for config in (COMPACT, PAPER)}
FILE_NAME = "hdn_compact.safetensors"


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
    if not path.is_file():
        raise InputError(f"weights file {path} is missing: name an existing one with --weights, or leave it out")
    try:
        with safe_open(path, framework="pt") as file:
            name = (file.metadata() or {}).get("config", "")
            tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as error:
        raise InputError(
            f"{path} is not a safetensors file ({error}): give weights written by hdn-train or hdn-import"
        ) from error
    if name not in CONFIGS:
        raise InputError(f"{path} holds weights of configuration '{name}': this version knows {', '.join(CONFIGS)}")
    with torch.device("meta"):  # no time goes into initial values
        network = Hdn(CONFIGS[name])
    expected = network.state_dict()
    shapes = {key: tuple(value.shape) for key, value in tensors.items()}
    wrong = [key for key in expected if shapes.get(key) != tuple(expected[key].shape)] + list(
        set(shapes) - set(expected)
    )
    if wrong:
        raise InputError(
            f"{path} does not fit configuration '{name}' ({len(wrong)} tensors, first {wrong[0]}): make it anew"
        )
    network.load_state_dict({key: value.to(expected[key].dtype) for key, value in tensors.items()}, assign=True)
    return network.eval().requires_grad_(False)


def shipped() -> Path:
    """The weights that come with the project: inside the installed package, or beside it in a checkout."""
    here = Path(__file__).parents[1]
    installed = here / "assets" / FILE_NAME
    return installed if installed.exists() else here.parent / "assets" / FILE_NAME
