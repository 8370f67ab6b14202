"""Checkpoints to weights files: of the three components of HDN to one, of each other network to its own."""

from pathlib import Path
from typing import Any

import torch

from ..errors import InputError
from ..networks import light_network, matte_network
from ..networks.config import CONFIGS, PAPER
from ..networks.conversion import pack_ir
from ..networks.light_network import LightNetwork
from ..networks.matte_network import MatteNetwork
from ..networks.pytorch import Hdn, save
from ..networks.weights import LIGHT, LIGHT_FILE_NAME, MATTE, MATTE_FILE_NAME
from .checkpoint import read_checkpoint


def pack(translation: Path, polar: Path, residual: Path, path: Path) -> Path:
    """Writes a weights file that names its configuration, and how each component was trained.

    Beside it lie its networks for OpenVINO, but for the paper's configuration, which takes PyTorch anyhow.

    Args: path: the file, or a folder, in which it is hdn_CONFIG.safetensors.

    Returns:
        The file written.

    Raises:
        InputError: a checkpoint is missing or damaged, or they are of different configurations or backbones.
    """
    parts = {"translation": translation, "polar": polar, "residual": residual}
    states = {component: _read(checkpoint, component) for component, checkpoint in parts.items()}
    config = states["translation"]["config"]
    for component, state in states.items():
        if state["config"] != config:
            raise InputError(f"{parts[component]} is of configuration {state['config']}, {translation} of {config}")
    similarity, other = states["translation"]["network"], states["polar"]["network"]
    for name, value in similarity.items():
        # As much as half precision, in which they are kept, makes no other backbone.
        if name.startswith("backbone.") and not torch.allclose(value, other[name], rtol=1e-3, atol=1e-6):
            raise InputError(
                f"{polar} stands on another backbone than {translation}: train both with the same --backbone or --start"
            )
    network = Hdn(CONFIGS[config])
    network.similarity.load_state_dict({n: (other if n.startswith("polar.") else similarity)[n] for n in similarity})
    network.residual.load_state_dict(states["residual"]["network"])
    if path.is_dir():
        path = path / f"hdn_{config}.safetensors"
    save(network, path, {component: _history(state) for component, state in states.items()})
    if network.config is not PAPER:
        pack_ir(path)
    return path


def pack_matte(checkpoint: Path, path: Path) -> Path:
    """Writes the weights file of the matte network, and beside it its network for OpenVINO.

    Args: path: the file, or a folder, in which it is hdn_matte.safetensors.

    Returns:
        The file written.

    Raises:
        InputError: the checkpoint is missing or damaged, or of another component.
    """
    state = _read(checkpoint, MATTE)
    network = MatteNetwork()
    network.load_state_dict(state["network"])
    path = path / MATTE_FILE_NAME if path.is_dir() else path
    matte_network.save(network, path, {MATTE: _history(state)})
    pack_ir(path)
    return path


def pack_light(checkpoint: Path, path: Path) -> Path:
    """Writes the weights file of the light network, and beside it its network for OpenVINO; see `pack_matte`."""
    state = _read(checkpoint, LIGHT)
    network = LightNetwork()
    network.load_state_dict(state["network"])
    path = path / LIGHT_FILE_NAME if path.is_dir() else path
    light_network.save(network, path, {LIGHT: _history(state)})
    pack_ir(path)
    return path


def _read(checkpoint: Path, component: str) -> dict[str, Any]:
    state = read_checkpoint(checkpoint, component)
    if state is None:
        raise InputError(f"{checkpoint} is missing: run hdn-train {component} --out {checkpoint.parent} first")
    return state


def _history(state: dict[str, Any]) -> str:
    """How a component was trained, in a few words."""
    start = state.get("start")
    return f"{state['step']} steps, seed {state['seed']}" + (f", begun with {Path(start).name}" if start else "")
