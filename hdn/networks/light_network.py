"""The light network as a PyTorch module, and its way into weights files and out of them."""

from itertools import pairwise
from pathlib import Path

import torch
import torch.nn.functional as F
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from ..errors import InputError
from .lighting import INPUTS
from .matte_network import Residual, conv
from .weights import LIGHT, architecture

WIDTHS = (32, 48, 64)  # channels at strides 1, 2, 4
LOG_GAIN = (-3.5, 1.0)  # least and most of the gain's logarithm
FAINT = -4.0  # from which the glare begins: none


class LightNetwork(nn.Module):
    """A U-Net (Ronneberger et al., MICCAI 2015) from what many views show to the light on the first one."""

    def __init__(self) -> None:
        super().__init__()
        steps = list(pairwise(WIDTHS))
        self.stem = conv(INPUTS, WIDTHS[0], 3)
        self.encode = nn.ModuleList([Residual(width) for width in WIDTHS])
        self.shrink = nn.ModuleList([conv(fine, coarse, 3, 2) for fine, coarse in steps])
        self.whole = nn.Linear(WIDTHS[-1], WIDTHS[-1])
        self.join = nn.ModuleList([conv(fine + coarse, fine, 1) for fine, coarse in steps])
        self.decode = nn.ModuleList([Residual(fine) for fine, _ in steps])
        self.draw = nn.Conv2d(WIDTHS[0], 2, 3, padding=1)

    def forward(self, inputs: Tensor) -> tuple[Tensor, Tensor]:
        """The light on the first view, of `summary`'s (B, INPUTS, n, n): log of the gain, and glare, (B, 1, n, n)."""
        x, skipped = self.stem(inputs), []  # (B, 32, n, n)
        for block, shrink in zip(self.encode, self.shrink, strict=False):
            x = block(x)
            skipped.append(x)
            x = shrink(x)
        x = self.encode[-1](x)  # (B, 64, n / 4, n / 4)
        x = x + self.whole(x.mean((2, 3)))[..., None, None]  # how bright the whole of it is
        for block, join, skip in zip(self.decode[::-1], self.join[::-1], skipped[::-1], strict=True):
            x = block(join(torch.cat([F.interpolate(x, scale_factor=2.0), skip], 1)))
        log_gain, glare = self.draw(x).split(1, 1)
        return log_gain.clamp(*LOG_GAIN), F.softplus(4 * (glare + FAINT / 4)) / 4


def save(network: nn.Module, path: Path, notes: dict[str, str]) -> None:
    """Writes the weights in half precision, with the notes (where they come from)."""
    tensors = {n: v.half().contiguous() if v.is_floating_point() else v for n, v in network.state_dict().items()}
    save_file(tensors, path, {"config": LIGHT, **notes})


def load(path: Path) -> LightNetwork:
    """Reads weights; the network comes in evaluation mode, single precision.

    Raises:
        InputError: no such file, not a safetensors file, or weights of another architecture.
    """
    architecture(path, [LIGHT])
    network = LightNetwork()
    tensors = {n: v.float() if v.is_floating_point() else v for n, v in load_file(path).items()}
    try:
        network.load_state_dict(tensors)
    except RuntimeError as error:
        raise InputError(f"{path} does not fit the light network of this version: make it anew") from error
    return network.eval().requires_grad_(False)
