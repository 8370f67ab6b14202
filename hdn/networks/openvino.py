"""Running networks with OpenVINO on a CPU, from those that lie beside a weights file as OpenVINO IR.

The parts of HDN are the graphs of one IR, so that what they share, the backbone, is stored once. Its two files are in
one zip archive, NAME.openvino.zip beside NAME.safetensors; the IR names the digest of the weights that it is of.
"""

import sys
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ..imaging.arrays import Array, Floats
from .config import Config
from .corners import conclude
from .engine import Engine, Function, Functions
from .weights import digest


def _imported() -> Any:
    """OpenVINO without its converter of other formats, which comes when it is first asked for.

    The converter takes half the time of the import, and reports each import to its makers by the network.
    """
    name = "openvino.tools.ovc"
    if "openvino" in sys.modules:
        return sys.modules["openvino"]
    sys.modules[name] = None  # type: ignore[assignment]  # as if it were not installed, which OpenVINO provides for
    try:
        openvino = import_module("openvino")
    finally:
        del sys.modules[name]

    def converter(attribute: str) -> Any:
        if attribute == "convert_model":
            return import_module(name).convert_model
        raise AttributeError(f"module 'openvino' has no attribute '{attribute}'")

    openvino.__getattr__ = converter  # type: ignore[method-assign]
    return openvino


ov = _imported()

Models = Mapping[str, Any]  # openvino.Model by the names of `Functions`, or the matte network by its own

SUFFIX = ".openvino.zip"
XML, BIN = "hdn.xml", "hdn.bin"
DESCRIPTION = "OpenVINO on the CPU"
DIGEST = "weights_sha256"  # the entry of the IR's rt_info
OPTIONS = {"PERFORMANCE_HINT": "LATENCY", "INFERENCE_PRECISION_HINT": "f32"}


@cache
def core() -> Any:
    """One for the process, for good: a core gives the thread a stack for signals, which goes with it.

    The next Ctrl-C would then end in a segmentation fault (seen with OpenVINO 2026.4).
    """
    return ov.Core()


def compiled(model: Any, threads: int = 1) -> Function:
    """The model as a function of arrays, in single precision, on so many threads; 0 for all there are.

    Networks as small as ours take more processor time on several threads than on one, and the others have work.
    """
    options: dict[str, str | int] = {**OPTIONS, "INFERENCE_NUM_THREADS": threads}
    request = core().compile_model(model, "CPU", options).create_infer_request()
    outputs = len(model.outputs)

    def run(*inputs: NDArray[Any]) -> list[Floats]:
        for i, value in enumerate(inputs):
            request.set_input_tensor(i, ov.Tensor(value, shared_memory=True))
        request.infer()
        return [request.get_output_tensor(i).data.copy() for i in range(outputs)]

    return run


def engine(config: Config, models: Models, conclusion: Callable[..., tuple[Array, Floats]] | None = None) -> Engine:
    """The models, compiled.

    Args: conclusion: of `Functions`, where it is another than the compact configuration's.
    """

    @cache
    def surveying() -> Function:
        return compiled(models["survey"], threads=0)  # of a whole frame

    functions = {name: compiled(model) for name, model in models.items() if name != "survey"}
    functions["survey"] = lambda *inputs: surveying()(*inputs)  # compiled only where a target is lost
    conclusion = conclusion or partial(conclude, config.residual_size)
    return Engine(config, Functions(**functions, conclude=conclusion), DESCRIPTION)


def read_ir(weights: Path) -> Models | None:
    """The networks beside a weights file, None where there are none, or those of other weights."""
    path = weights.with_suffix(SUFFIX)
    if not path.is_file():
        return None
    with zipfile.ZipFile(path) as archive:
        whole = core().read_model(archive.read(XML), archive.read(BIN))
    if not whole.has_rt_info(DIGEST) or whole.get_rt_info(DIGEST).astype(str) != digest(weights):
        return None
    graphs: dict[str, tuple[list[Any], list[Any]]] = {}
    for kind, nodes in enumerate((whole.get_results(), whole.get_parameters())):
        for node in sorted(nodes, key=lambda n: n.get_friendly_name()):
            name, _ = node.get_friendly_name().split("/")
            graphs.setdefault(name, ([], []))[kind].append(node)
    return {name: ov.Model(*graph, name) for name, graph in graphs.items()}


def write_ir(models: Models, weights: Path) -> Path:
    """Writes networks beside the weights file that they are of, and returns where."""
    results, parameters = [], []
    for name, model in models.items():
        for kind, nodes in (("out", model.get_results()), ("in", model.get_parameters())):
            for i, node in enumerate(nodes):
                node.set_friendly_name(f"{name}/{kind}{i}")
        results += model.get_results()
        parameters += model.get_parameters()
    whole = ov.Model(results, parameters, "hdn")
    for node in whole.get_ops():
        if node.get_type_name() != "Result":
            for output in node.outputs():
                output.get_tensor().set_names(set())
    whole.set_rt_info(digest(weights), DIGEST)
    path = weights.with_suffix(SUFFIX)
    with tempfile.TemporaryDirectory() as folder:
        xml, data = Path(folder, XML), Path(folder, BIN)
        ov.serialize(whole, xml, data)
        with zipfile.ZipFile(path, "w") as archive:
            for file in (xml, data):
                info = zipfile.ZipInfo(file.name)  # without the time
                archive.writestr(info, file.read_bytes(), zipfile.ZIP_DEFLATED, 9)
    return path
