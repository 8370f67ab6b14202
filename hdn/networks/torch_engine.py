"""Running networks from their PyTorch modules: on CUDA, and on a CPU where none for OpenVINO lie beside the weights."""

from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from ..imaging.arrays import Array, Floats
from . import corners, openvino
from .conversion import matte_models, models
from .engine import Engine, Function, Functions
from .matte import Matte
from .matte_network import MatteNetwork, OfCrops
from .paper import PaperResidual
from .parts import Compare, Correlate, Describe, Encode, Joined, OfImage
from .pytorch import Hdn
from .weights import MATTE


def converted(network: Hdn) -> Engine:
    """The networks converted to OpenVINO, on the CPU."""
    return openvino.engine(network.config, models(network), conclusion(network))


def engine(network: Hdn, device: str) -> Engine:
    """The networks in PyTorch on a device ('cpu' or 'cuda'), to which they are moved."""
    s = network.similarity

    def function(module: nn.Module) -> Function:
        return _function(OfImage(module), device, network.config.half)

    translation = function(Joined(s.backbone, Correlate(s.translation)))
    functions = Functions(
        encode=function(Joined(s.backbone, Encode(s.translation))),
        encode_polar=function(Joined(s.backbone, Encode(s.polar))),
        translation=translation,
        polar=function(Joined(s.backbone, Correlate(s.polar))),
        describe=function(Describe(network.residual)),
        compare=function(Compare(network.residual)),
        survey=translation,
        conclude=conclusion(network),
    )
    return Engine(network.config, functions, f"PyTorch on {device}", device)


def matte(network: MatteNetwork, device: str) -> Matte:
    """The matte network in PyTorch on a device ('cpu' or 'cuda'), to which it is moved."""
    return Matte(_function(OfCrops(network), device, half=True), f"PyTorch on {device}")


def converted_matte(network: MatteNetwork) -> Matte:
    """The matte network converted to OpenVINO, on the CPU."""
    return Matte(openvino.compiled(matte_models(network)[MATTE]), openvino.DESCRIPTION)


def _function(module: nn.Module, device: str, half: bool) -> Function:
    """A module on a device as a function of arrays; `half`: in half precision on CUDA."""
    place = torch.device(device)
    module = module.to(place).eval()

    def run(*inputs: NDArray[Any]) -> list[Floats]:
        with torch.inference_mode(), torch.autocast("cuda", torch.float16, enabled=half and place.type == "cuda"):
            outputs = module(*(torch.from_numpy(x).to(place) for x in inputs))
        return [o.float().cpu().numpy() for o in outputs]

    return run


def conclusion(network: Hdn) -> Any:
    """What concludes from the residual network's answer, see `Functions`."""
    if isinstance(network.residual, PaperResidual):
        return partial(_conclude, network.residual)
    return partial(corners.conclude, network.config.residual_size)


@torch.inference_mode()
def _conclude(residual: PaperResidual, *outputs: Floats) -> tuple[Array, Floats]:
    offsets, visible = residual.conclude(*(torch.from_numpy(x) for x in outputs))
    return offsets[0].numpy().astype(np.float64), visible[0].numpy()
