"""Import of the authors' released checkpoint: its names and shapes, to ours."""

import logging
import pickle
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from torch import Tensor

from ..commandline import DONE, Parser, run
from ..errors import InputError, RunError
from .config import PAPER
from .pytorch import Hdn, save

log = logging.getLogger(__name__)

# The authors' names to ours; the first pattern that fits counts. Batch norms and ResNets are named alike.
NAMES = [
    (r"backbone\.", "similarity.backbone."),
    (r"neck\.downsample(\d)\.downsample\.", r"similarity.translation.necks.\1."),
    (r"neck_lp\.downsample(\d)\.downsample\.", r"similarity.polar.necks.\1."),
    (r"head\.box(\d)\.(cls|loc)\.conv_kernel\.", r"similarity.translation.\2.\1.template."),
    (r"head\.box(\d)\.(cls|loc)\.conv_search\.", r"similarity.translation.\2.\1.search."),
    (r"head\.box(\d)\.(cls|loc)\.head\.", r"similarity.translation.\2.\1.head."),
    (r"head\.(cls|loc)_", r"similarity.translation.\1_"),
    (r"head_lp\.box(\d)\.(cls|loc)\.conv_kernel\.", r"similarity.polar.\2.\1.template."),
    (r"head_lp\.box(\d)\.(cls|loc)\.conv_search\.", r"similarity.polar.\2.\1.search."),
    (r"head_lp\.box(\d)\.(cls|loc)\.head\.", r"similarity.polar.\2.\1.head."),
    (r"head_lp\.(cls|loc)_", r"similarity.polar.\1_"),
    (r"hm_net\.ShareFeature\.ShareFeature\.", "residual.extractor."),
    (r"hm_net\.", "residual."),
]


def our_name(theirs: str) -> str:
    """Our name for one of the authors' tensors; one that fits no pattern stays as it is."""
    for pattern, replacement in NAMES:
        ours, hits = re.subn("^" + pattern, replacement, theirs)
        if hits:
            return ours
    return theirs


def read_checkpoint(path: Path) -> dict[str, Tensor]:
    """The tensors of a checkpoint by the authors' names, out of their `state_dict` and `module.` wrappings.

    Raises:
        InputError: no such file, not a PyTorch file, one that holds more than tensors, or no state dict.
    """
    if not path.is_file():
        raise InputError(f"checkpoint {path} is missing: name the authors' released .pth file")
    try:
        content: Any = torch.load(path, map_location="cpu", weights_only=True)
    except (RuntimeError, OSError, EOFError, ValueError, pickle.UnpicklingError) as error:
        raise InputError(
            f"{path} cannot be read as a PyTorch file of tensors alone: give the authors' released .pth file"
        ) from error
    if isinstance(content, dict):
        content = content.get("state_dict", content)
    if not isinstance(content, dict) or not all(isinstance(value, Tensor) for value in content.values()):
        raise InputError(f"{path} holds no state dict: give the authors' released .pth file")
    return {str(name).removeprefix("module."): value for name, value in content.items()}


def to_network(checkpoint: dict[str, Tensor]) -> Hdn:
    """The paper's networks with the weights of a checkpoint, in evaluation mode.

    Tensors that the networks do not have are left out, with a warning that names them.

    Raises:
        InputError: tensors are missing or of another shape.
    """
    with torch.device("meta"):  # no time goes into initial values
        network = Hdn(PAPER)
    expected = network.state_dict()
    theirs = {our_name(name): name for name in checkpoint}
    unexpected = [name for ours, name in theirs.items() if ours not in expected]
    missing = [name for name in expected if name not in theirs]
    if missing:
        raise InputError(
            f"the checkpoint lacks {len(missing)} of {len(expected)} tensors ({_some(missing)})"
            + (f" and has {len(unexpected)} others ({_some(unexpected)})" if unexpected else "")
            + ": give the authors' full HDN checkpoint"
        )
    tensors = {name: checkpoint[theirs[name]] for name in expected}
    misshapen = [
        f"{theirs[name]} {tuple(value.shape)}, not {tuple(expected[name].shape)}"
        for name, value in tensors.items()
        if value.shape != expected[name].shape
    ]
    if misshapen:
        raise InputError(f"{len(misshapen)} tensors have another shape ({_some(misshapen)}): this is another network")
    if unexpected:
        log.warning("left out %d tensors that the networks do not have (%s)", len(unexpected), _some(unexpected))
    network.load_state_dict({name: v.to(expected[name].dtype) for name, v in tensors.items()}, assign=True)
    return network.eval().requires_grad_(False)


def convert(checkpoint: Path, output: Path) -> None:
    """Writes the authors' checkpoint as weights of the paper's configuration.

    Raises:
        InputError: the checkpoint is not theirs, or the output's folder is missing.
        RunError: the output cannot be written.
    """
    if not output.parent.is_dir():
        raise InputError(f"folder {output.parent} is missing: make it, or name another file with -o")
    network = to_network(read_checkpoint(checkpoint))
    try:
        save(network, output, {"made": f"imported from {checkpoint.name}"})
    except (OSError, SafetensorError) as error:
        raise RunError(f"{output} cannot be written ({error}): name another file with -o") from error


def _some(names: list[str]) -> str:
    return ", ".join(names[:4]) + (" ..." if len(names) > 4 else "")


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of hdn-import."""
    sys.exit(run(_command, arguments, "nothing was written"))


def _command(arguments: Sequence[str] | None) -> int:
    parser = Parser(
        "hdn-import",
        "Turn the HDN authors' released checkpoint into weights for ar-replace --weights.",
        "Exit status: 0 done, 1 failed while working, 2 wrong input.",
    )
    parser.add_argument("checkpoint", type=Path, help="the released .pth file")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FILE", help="safetensors file to write")
    options = parser.parse_args(arguments)
    logging.basicConfig(format="%(levelname)s: %(message)s")
    convert(options.checkpoint, options.output)
    return DONE


if __name__ == "__main__":
    main()
