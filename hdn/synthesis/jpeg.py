"""What JPEG and the like do to a picture, as an augmentation: batched, on the training device."""

import functools
import math

import torch
import torch.nn.functional as F
from torch import Tensor

# The standard's example table for luminance (ITU-T T.81, table K.1): steps of an 8 x 8 block's frequencies.
QUANTISATION = [
    [16, 11, 10, 16, 24, 40, 51, 61],
    [12, 12, 14, 19, 26, 58, 60, 55],
    [14, 13, 16, 24, 40, 57, 69, 56],
    [14, 17, 22, 29, 51, 87, 80, 62],
    [18, 22, 37, 56, 68, 109, 103, 77],
    [24, 35, 55, 64, 81, 104, 113, 92],
    [49, 64, 78, 87, 103, 121, 120, 101],
    [72, 92, 95, 98, 112, 100, 103, 99],
]
# RGB to luminance and two colour differences, as JFIF has them.
COLOUR = [[0.299, 0.587, 0.114], [-0.168736, -0.331264, 0.5], [0.5, -0.418688, -0.081312]]


@functools.lru_cache
def _cosines(device: torch.device) -> Tensor:
    """The orthonormal cosine transform (8, 8) of 8 values: a row for each frequency."""
    n = torch.arange(8, dtype=torch.float32)
    basis = torch.cos((2 * n + 1) * n[:, None] * math.pi / 16) / 2
    basis[0] /= math.sqrt(2)
    return basis.to(device)


def compress(crops: Tensor, quality: Tensor, phase: tuple[int, int] = (0, 0)) -> Tensor:
    """Crops (B, 3, n, n), 0..1, coded in blocks of 8 x 8 at qualities (B,) of 1 to 100, as libjpeg counts them.

    Args:
        phase: columns and rows of the blocks that lie beyond the crop's left and upper edge, 0..7 each.
    """
    b, _, h, w = crops.shape
    colour = torch.tensor(COLOUR, device=crops.device)
    basis, steps = _cosines(crops.device), torch.tensor(QUANTISATION, device=crops.device)
    scale = torch.where(quality < 50, 50 / quality, 2 - quality / 50)
    steps = (steps * scale[:, None, None]).round().clamp_min(1)[:, None, None, None]  # (B, 1, 1, 1, 8, 8)

    left, top = phase
    padded = F.pad(crops, (left, -(w + left) % 8, top, -(h + top) % 8), mode="replicate")
    planes = torch.einsum("dc,bchw->bdhw", colour, padded * 255)
    planes[:, 0] -= 128
    rows, columns = padded.shape[2] // 8, padded.shape[3] // 8
    blocks = planes.reshape(b, 3, rows, 8, columns, 8).transpose(3, 4)  # (B, 3, rows, columns, 8, 8)
    coded = (basis @ blocks @ basis.T / steps).round() * steps
    planes = (basis.T @ coded @ basis).transpose(3, 4).reshape(padded.shape)
    planes[:, 0] += 128
    decoded = torch.einsum("dc,bchw->bdhw", torch.linalg.inv(colour), planes) / 255
    return decoded[:, :, top : top + h, left : left + w].clamp(0, 1)
