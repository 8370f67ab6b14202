"""Checkpoints of both components to one weights file."""

from pathlib import Path

from .. import weights
from ..errors import InputError
from .checkpoint import read_checkpoint


def pack(similarity: Path, residual: Path, path: Path) -> Path:
    """Writes a weights file that names its configuration, and how each component was trained.

    Args: path: the file, or a folder, in which it is hdn_CONFIG.safetensors.

    Returns:
        The file written.

    Raises:
        InputError: a checkpoint is missing or damaged, or they are of different configurations.
    """
    network, notes, config = None, {}, ""
    for component, checkpoint in (("similarity", similarity), ("residual", residual)):
        state = read_checkpoint(checkpoint, component)
        if state is None:
            raise InputError(f"{checkpoint} is missing: run hdn-train {component} --out {checkpoint.parent} first")
        if network is None:
            config = state["config"]
            network = weights.Hdn(weights.CONFIGS[config])
        elif state["config"] != config:
            raise InputError(f"{checkpoint} is of configuration {state['config']}, {similarity} of {config}")
        getattr(network, component).load_state_dict(state["network"])
        notes[component] = f"{state['step']} steps, seed {state['seed']}"
    assert network is not None
    if path.is_dir():
        path = path / f"hdn_{config}.safetensors"
    weights.save(network, path, notes)
    return path
