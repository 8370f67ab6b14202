"""Weights that a training begins with: of the backbone, which is not trained here, or of the whole component."""

import pickle
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from torch import Tensor, nn
from torch.nn.functional import pad

from ..errors import InputError
from ..networks import light_network, matte_network
from ..networks.backbone import Backbone
from ..networks.config import Config
from ..networks.pytorch import load
from ..networks.similarity import SimilarityNetwork
from ..networks.weights import LIGHT, MATTE

FAILURES = (
    RuntimeError, ValueError, KeyError, OSError, EOFError, AttributeError, pickle.UnpicklingError, SafetensorError,
)  # fmt: skip
IMAGENET_MEAN, IMAGENET_DEVIATION = (
    (0.485, 0.456, 0.406),
    (0.229, 0.224, 0.225),
)  # of RGB in 0..1, as ImageNet's networks want it


def load_backbone(network: SimilarityNetwork, path: Path) -> None:
    """Takes the backbone's weights out of a weights file of ours, or a .pth file as its authors publish it.

    Those are efficientnet-lite0 (see `Backbone`), and for the paper's configuration a ResNet-50: SiamBAN's, or a usual
    one, which is adapted.

    Raises:
        InputError: the file is missing or holds something else.
    """
    needed = network.config.backbone
    if not path.is_file():
        raise InputError(f"backbone weights {path} are missing: name an existing file with --backbone")
    ours = network.backbone.state_dict()
    try:
        if path.suffix == ".safetensors":
            with safe_open(path, framework="pt") as file:  # its heads may be others than ours
                network.backbone.load_state_dict({n: file.get_tensor(f"similarity.backbone.{n}") for n in ours})
        elif isinstance(network.backbone, Backbone):
            network.backbone.load_imagenet(path)
        else:
            theirs = adapted(torch.load(path, map_location="cpu", weights_only=True))
            network.backbone.load_state_dict({name: theirs.get(name, value) for name, value in ours.items()})
    except FAILURES as error:
        reason = str(error).split("\n")[0]
        raise InputError(f"{path} does not fit the backbone {needed} ({reason}): name weights of that one") from error


def load_start(path: Path, component: str, config: Config) -> dict[str, Tensor]:
    """What a weights file of ours holds of the network that a component is part of, its backbone included.

    Raises:
        InputError: the file is missing, damaged, or of another configuration.
    """
    if not path.is_file():
        raise InputError(f"--start {path} is missing: name an existing weights file")
    if component == MATTE:
        return matte_network.load(path).state_dict()
    if component == LIGHT:
        return light_network.load(path).state_dict()
    network = load(path)
    if network.config != config:
        raise InputError(
            f"--start {path} is of configuration {network.config.name}: name weights of {config.name}, "
            f"or train with --config {network.config.name}"
        )
    part: nn.Module = network.residual if component == "residual" else network.similarity
    return part.state_dict()


def adapted(theirs: dict[str, Tensor]) -> dict[str, Tensor]:
    """A usual ResNet-50's weights as our dilated one takes them; those of one like ours stay as they are.

    Of strided and dilated stages, the shortcuts' 1x1 kernels become the middle of 3x3 ones. The first layer takes raw
    BGR in 0..255 instead of normalised RGB: what the kernels lose by it, the batch norm's means make up for.

    Raises:
        KeyError: it is no ResNet-50.
    """
    if theirs["layer2.0.downsample.0.weight"].shape[2:] == (3, 3):
        return theirs
    ours = dict(theirs)
    for stage in (2, 3, 4):
        name = f"layer{stage}.0.downsample.0.weight"
        ours[name] = pad(theirs[name], (1, 1, 1, 1))
    kernel = theirs["conv1.weight"] / torch.tensor(IMAGENET_DEVIATION)[:, None, None]  # (64, 3, 7, 7)
    lost = (kernel * torch.tensor(IMAGENET_MEAN)[:, None, None]).sum((1, 2, 3))
    ours["conv1.weight"] = kernel.flip(1) / 255
    ours["bn1.running_mean"] = theirs["bn1.running_mean"] + lost
    return ours
