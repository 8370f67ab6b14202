"""PyTorch modules to functions that OpenVINO runs on the CPU.

`openvino.convert_model` does as much, but runs each module four times to convert it, which takes longer than all else
at the tracker's start, and reports to its makers. So the modules are traced here and given to its front end.
"""

import warnings
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import openvino as ov
import torch
from numpy.typing import NDArray
from openvino.frontend import FrontEndManager
from openvino.frontend.pytorch.ts_decoder import TorchScriptPythonDecoder
from torch import Tensor, nn

Floats = NDArray[np.float32]
Function = Callable[..., list[Floats]]


def convert(module: nn.Module, *examples: Tensor) -> ov.Model:
    """A module in evaluation mode as an OpenVINO model; its inputs have the examples' dimensions, at any size."""
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


def join(backbone: ov.Model, head: ov.Model, crop_size: int, *kernels: Tensor) -> ov.Model:
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


@cache
def _core() -> ov.Core:
    """One for the process, for good: a core gives the thread a stack for signals, which goes with it.

    The next Ctrl-C would then end in a segmentation fault (seen with OpenVINO 2026.4).
    """
    return ov.Core()


def compiled(model: ov.Model, threads: int | None = None) -> Function:
    """The model as a function of arrays, in single precision, on so many threads or all there are."""
    options: dict[str, str | int] = {"PERFORMANCE_HINT": "LATENCY", "INFERENCE_PRECISION_HINT": "f32"}
    if threads:
        options["INFERENCE_NUM_THREADS"] = threads
    request = _core().compile_model(model, "CPU", options).create_infer_request()
    outputs = len(model.outputs)

    def run(*inputs: NDArray[Any]) -> list[Floats]:
        for i, value in enumerate(inputs):
            request.set_input_tensor(i, ov.Tensor(value, shared_memory=True))
        request.infer()
        return [request.get_output_tensor(i).data.copy() for i in range(outputs)]

    return run
