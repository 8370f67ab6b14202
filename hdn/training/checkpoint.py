"""Checkpoints of a training: tensors and plain values, so that they load without running anything."""

import pickle
from pathlib import Path
from typing import Any

import torch

from ..errors import InputError
from ..networks.config import Config


def write_checkpoint(path: Path, state: dict[str, Any]) -> None:
    """Writes it in one go: an interruption leaves the last one."""
    torch.save(state, path.with_suffix(".tmp"))
    path.with_suffix(".tmp").replace(path)


def read_checkpoint(
    path: Path, component: str, config: Config | None = None, start: Path | None = None
) -> dict[str, Any] | None:
    """The checkpoint of a component, and where given of a configuration; None where there is no such file.

    Args: start: the weights that it must have begun with, if any are named.

    Raises:
        InputError: it is damaged, of another component or configuration, or began with other weights.
    """
    if not path.exists():
        return None
    try:
        state: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
        found, configured = state.get("component", component), state["config"]
    except (RuntimeError, OSError, EOFError, KeyError, AttributeError, pickle.UnpicklingError) as error:
        raise InputError(f"{path} is not a checkpoint of hdn-train: remove it, or name another folder") from error
    wanted = config.name if config else configured
    if (found, configured) != (component, wanted):
        raise InputError(
            f"{path} is of the {found} component, configuration {configured}: "
            f"give another --out for the {component} component, configuration {wanted}"
        )
    if start is not None and state.get("start") != str(start):
        raise InputError(
            f"{path} began with {state.get('start') or 'new weights'}, not with {start}: "
            f"leave --start out to go on from there, or give another --out"
        )
    return state
