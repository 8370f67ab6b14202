"""From a weights file to the networks on a device, without PyTorch wherever that is not needed."""

import ctypes
import logging
import sys
import threading
from importlib.util import find_spec
from pathlib import Path
from typing import cast

from ..errors import TORCH_MISSING, InputError
from . import openvino
from .engine import Engine
from .lighting import Lighting
from .matte import Matte
from .weights import LIGHT, LIGHT_FILE_NAME, MATTE, MATTE_FILE_NAME, architecture, configuration, shipped

log = logging.getLogger(__name__)

_of_thread = threading.local()  # its matte networks, by their device


def load_engine(weights: Path | str | None = None, device: str = "auto") -> Engine:
    """The networks, ready to run: on a CPU by OpenVINO, on CUDA by PyTorch.

    On a CPU, PyTorch is only needed for weights that no OpenVINO IR lies beside (see `hdn-train pack`).

    Args:
        weights: safetensors file; None takes the shipped one.
        device: 'auto' takes CUDA where PyTorch is installed and has it, or else the CPU.

    Raises:
        InputError: weights missing, damaged or of another architecture; no such device; PyTorch needed and missing.
    """
    path = Path(weights or shipped())
    config, chosen = configuration(path), choose_device(device)
    if (models := _packed(path, chosen)) is not None:
        return openvino.engine(config, models)
    from . import pytorch, torch_engine

    network = pytorch.load(path)
    if chosen == "cuda":
        return torch_engine.engine(network, "cuda")
    log.info("%s is converted by PyTorch: 'hdn-train pack --weights' does it for good", path)
    return torch_engine.converted(network)


def load_matte(weights: Path | str | None = None, device: str = "auto") -> Matte:
    """The matte network, ready to run: on a CPU by OpenVINO, on CUDA by PyTorch; see `load_engine`.

    Args:
        weights: safetensors file; None takes the shipped one.

    Raises:
        InputError: weights missing, damaged or of another architecture; no such device; PyTorch needed and missing.
    """
    path = Path(weights or shipped(MATTE_FILE_NAME))
    architecture(path, [MATTE])
    chosen = choose_device(device)
    if (models := _packed(path, chosen)) is not None:
        return Matte(openvino.compiled(models[MATTE]), openvino.DESCRIPTION)
    from . import matte_network, torch_engine

    network = matte_network.load(path)
    if chosen == "cuda":
        return torch_engine.matte(network, "cuda")
    log.info("%s is converted by PyTorch: 'hdn-train pack --weights' does it for good", path)
    return torch_engine.converted_matte(network)


def load_lighting(weights: Path | str | None = None) -> Lighting:
    """The light network, ready to run, on the CPU: it runs but once a clip.

    Args:
        weights: safetensors file; None takes the shipped one.

    Raises:
        InputError: weights missing, damaged or of another architecture; PyTorch needed and missing.
    """
    path = Path(weights or shipped(LIGHT_FILE_NAME))
    architecture(path, [LIGHT])
    if (models := _packed(path, "cpu")) is None:
        from . import light_network
        from .conversion import light_models

        log.info("%s is converted by PyTorch: 'hdn-train pack --weights' does it for good", path)
        models = light_models(light_network.load(path))
    return Lighting(openvino.compiled(models[LIGHT]), openvino.DESCRIPTION)


def shared_matte(device: str = "auto") -> Matte:
    """The shipped matte network, which is loaded once in each thread: one is not to be run by two at a time.

    Raises:
        InputError: see `load_matte`.
    """
    chosen, mattes = choose_device(device), _of_thread.__dict__
    if chosen not in mattes:
        mattes[chosen] = load_matte(device=chosen)
    return cast(Matte, mattes[chosen])


def _packed(path: Path, device: str) -> openvino.Models | None:
    """The networks beside a weights file, for a CPU; None where PyTorch is to run or to convert them.

    Raises:
        InputError: that takes PyTorch, which is not installed.
    """
    models = openvino.read_ir(path) if device == "cpu" else None
    if models is None and find_spec("torch") is None:
        raise InputError(
            f"{path} has no OpenVINO networks of these weights beside it, and to make them takes {TORCH_MISSING}"
        )
    return models


def choose_device(name: str) -> str:
    """'auto', 'cpu' or 'cuda' to one of the latter two.

    Raises:
        InputError: 'cuda' where there is none, or another name.
    """
    if name not in ("auto", "cpu", "cuda"):
        raise InputError(f"unknown device '{name}': choose auto, cpu or cuda")
    if name == "cuda" and find_spec("torch") is None:
        raise InputError(f"--device cuda takes {TORCH_MISSING}")
    if name == "cpu" or (name == "auto" and not _may_have_cuda()):
        return "cpu"
    import torch

    if torch.cuda.is_available():
        return "cuda"
    if name == "cuda":
        raise InputError("no CUDA device is available: use --device cpu or auto")
    return "cpu"


def _may_have_cuda() -> bool:
    """Whether PyTorch and a driver of CUDA are there: without them, importing PyTorch for an answer is spared."""
    if find_spec("torch") is None:
        return False
    try:
        ctypes.CDLL("nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1")
    except OSError:
        return False
    return True
