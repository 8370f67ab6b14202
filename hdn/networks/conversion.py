"""Networks from PyTorch to OpenVINO's models, for running them on a CPU and for shipping them.

`openvino.convert_model` does as much, but runs each module four times to convert it, and reports to its makers. So the
modules are traced here and given to its front end.
"""

import warnings
from pathlib import Path
from typing import Any

import torch
from openvino.passes import ConstantFolding, Manager
from torch import Tensor, nn

from ..errors import InputError, RunError
from . import light_network, matte_network
from .config import CONFIGS, LIGHT_SIZE, MATTE_SIZE, PAPER
from .lighting import INPUTS
from .openvino import Models, ov, write_ir
from .parts import Compare, Correlate, Describe, Encode, OfImage
from .pytorch import Hdn, load
from .weights import LIGHT, MATTE, architecture


def pack_ir(weights: Path) -> Path:
    """Writes the networks of a weights file as OpenVINO IR beside it, for machines without PyTorch.

    Returns:
        The file written.

    Raises:
        InputError: it is no weights file, or of the paper's configuration.
        RunError: the file cannot be written.
    """
    name = architecture(weights, [*CONFIGS, MATTE, LIGHT])
    if name == PAPER.name:
        raise InputError(f"{weights} is of the paper's configuration, which runs with PyTorch alone: leave it as it is")
    if name == LIGHT:
        made = light_models(light_network.load(weights))
    else:
        made = matte_models(matte_network.load(weights)) if name == MATTE else models(load(weights))
    try:
        return write_ir(made, weights)
    except OSError as error:
        raise RunError(f"networks beside {weights} cannot be written ({error}): make its folder writable") from error


def models(network: Hdn) -> Models:
    """The networks' parts, by the names of `Functions`."""
    c, s = network.config, network.similarity
    template, residual = (torch.zeros(1, n, n, 3, dtype=torch.uint8) for n in (c.template_size, c.residual_size))
    seeing, describe = OfImage(s.backbone), OfImage(Describe(network.residual))
    backbone = convert(seeing, template)
    with torch.inference_mode():
        maps = seeing(template)
        kernel, polar_kernel = s.encode_template(maps), s.encode_polar_template(maps)
        (described,) = describe(residual)
    found = {
        "encode": join(backbone, convert(Encode(s.translation), *maps), c.template_size),
        "encode_polar": join(backbone, convert(Encode(s.polar), *maps), c.polar_size),
        "translation": join(backbone, convert(Correlate(s.translation), kernel, *maps), c.search_size, kernel),
        "polar": join(backbone, convert(Correlate(s.polar), polar_kernel, *maps), c.polar_size, polar_kernel),
        "describe": convert(describe, residual),
        "compare": convert(OfImage(Compare(network.residual)), described, residual),
    }
    found["describe"].reshape({0: list(residual.shape)})
    found["compare"].reshape({0: list(described.shape), 1: list(residual.shape)})
    found["survey"] = found["translation"].clone()
    found["survey"].reshape({0: list(kernel.shape), 1: [1, -1, -1, 3]})
    for model in found.values():
        fold(model)
    return found


def matte_models(network: matte_network.MatteNetwork) -> Models:
    """The matte network, of crops of its size."""
    n = MATTE_SIZE
    crop, known = torch.zeros(1, n, n, 3, dtype=torch.uint8), torch.zeros(1, n, n, dtype=torch.uint8)
    model = convert(matte_network.OfCrops(network), crop, crop, known, known)
    model.reshape({i: list(x.shape) for i, x in enumerate((crop, crop, known, known))})
    fold(model)
    return {MATTE: model}


def light_models(network: light_network.LightNetwork) -> Models:
    """The light network, of one clip's summary."""
    inputs = torch.zeros(1, INPUTS, LIGHT_SIZE, LIGHT_SIZE)
    model = convert(network, inputs)
    model.reshape({0: list(inputs.shape)})
    fold(model)
    return {LIGHT: model}


def fold(model: Any) -> None:
    """Computes what does not depend on the inputs."""
    model.validate_nodes_and_infer_types()
    folding = Manager()
    folding.register_pass(ConstantFolding())
    folding.run_passes(model)


def convert(module: nn.Module, *examples: Tensor) -> Any:
    """A module in evaluation mode as an OpenVINO model; its inputs have the examples' dimensions, at any size."""
    from openvino.frontend import FrontEndManager
    from openvino.frontend.pytorch.ts_decoder import TorchScriptPythonDecoder

    with torch.inference_mode(), warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of tracing, which OpenVINO's front end needs
        traced = torch.jit.trace(module.eval(), examples, check_trace=False)
    front_end = FrontEndManager().load_by_framework("pytorch")
    decoder = TorchScriptPythonDecoder(traced, example_input=examples)  # to be kept until all is converted
    source = front_end.load(decoder)
    for place, example in zip(source.get_inputs(), examples, strict=True):
        source.set_element_type(place, ov.Type(example.numpy().dtype))
        source.set_partial_shape(place, ov.PartialShape([-1] * example.ndim))
    return front_end.convert(source)


def join(backbone: Any, head: Any, crop_size: int, *kernels: Tensor) -> Any:
    """One model of a crop's backbone and a head on its maps.

    Args:
        head: takes the kernels, then the maps; it is used up.
        kernels: examples of those inputs of the head that stay inputs of the whole, before the crop.
    """
    backbone = backbone.clone()
    backbone.reshape([1, crop_size, crop_size, 3])
    inputs = head.get_parameters()
    for parameter, kernel in zip(inputs, kernels, strict=False):
        parameter.set_partial_shape(ov.PartialShape(list(kernel.shape)))
    for parameter, result in zip(inputs[len(kernels) :], backbone.get_results(), strict=True):
        parameter.output(0).replace(result.input_value(0))
    return ov.Model(head.get_results(), inputs[: len(kernels)] + backbone.get_parameters())
