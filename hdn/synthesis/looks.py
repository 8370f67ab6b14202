"""How a camera shows it: blur, low resolution, light, noise and compression."""

from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from .jpeg import compress
from .photos import pixel_grid
from .views import uniform


def blur(crops: Tensor, share: float, reach: int) -> Tensor:
    """Motion blur in a share of crops (B, 3, n, n): a box along a random line of up to `reach` (odd) px."""
    device = crops.device
    rows = (torch.rand(len(crops), device=device) < share).nonzero()[:, 0]
    if not len(rows):
        return crops
    b, (_, c, h, w) = len(rows), crops.shape
    length = uniform((b, 1), 1.5, reach, device)
    angle = uniform((b, 1), 0, np.pi, device)
    grid = pixel_grid(reach, device)
    along = grid[:, 0] * angle.cos() + grid[:, 1] * angle.sin()  # (B, reach*reach)
    across = grid[:, 1] * angle.cos() - grid[:, 0] * angle.sin()
    kernel = (length / 2 - along.abs() + 0.5).clamp(0, 1) * (1 - across.abs()).clamp(0, 1)
    kernel = (kernel / kernel.sum(1, keepdim=True)).reshape(b, 1, reach, reach).repeat_interleave(c, 0)
    padded = F.pad(crops[rows], [reach // 2] * 4, mode="replicate").reshape(1, b * c, h + reach - 1, w + reach - 1)
    crops = crops.clone()
    crops[rows] = F.conv2d(padded, kernel, groups=b * c).reshape(b, c, h, w)
    return crops


def coarsen(crops: Tensor, share: float) -> Tensor:
    """A share of crops (B, 3, n, n) seen at a lower resolution, as small targets are."""
    device = crops.device
    rows = (torch.rand(len(crops), device=device) < share).nonzero()[:, 0]
    if not len(rows):
        return crops
    size = int(crops.shape[-1] / float(uniform(1, 1.3, 4, device)))
    small = F.interpolate(crops[rows], (size, size), mode="bilinear", antialias=True, align_corners=False)
    crops = crops.clone()
    crops[rows] = F.interpolate(small, crops.shape[-2:], mode="bilinear", align_corners=False)
    return crops


def relight(crops: Tensor, strength: float = 1.0, darkened: float = 0.1) -> Tensor:
    """Gain, bias, gamma, colour cast, a ramp of light, sensor noise, and darkness of some: crops (B, 3, n, n), 0..1."""
    device, (b, _, size, _) = crops.device, crops.shape
    curve = uniform((b, 1, 1, 1), -0.5, 0.5, device) * strength  # as a gamma bends the tones, but cheap
    gain = (uniform((b, 1, 1, 1), -0.4, 0.4, device) * strength).exp()
    cast = (uniform((b, 3, 1, 1), -0.12, 0.12, device) * strength).exp()
    is_dark = torch.rand(b, 1, 1, 1, device=device) < darkened * strength
    dark = torch.where(is_dark, uniform((b, 1, 1, 1), 0.15, 0.5, device), 1.0)
    bias = uniform((b, 1, 1, 1), -0.1, 0.1, device) * strength * dark
    angle = uniform((b, 1), 0, 2 * np.pi, device)
    steepness = uniform((b, 1), 0, 0.8, device) * strength / size
    grid = pixel_grid(size, device)
    ramp = 1 + grid[:, 0] * (angle.cos() * steepness) + grid[:, 1] * (angle.sin() * steepness)
    sigma = uniform((b, 1, 1, 1), 0, 1, device) ** 3 * 0.05 * strength
    x = torch.addcmul(crops, crops, (1 - crops).mul_(curve)).mul_(ramp.reshape(b, 1, size, size))
    x = x.mul_(gain * cast * dark).add_(bias)
    return x.add_(torch.randn_like(x).mul_(sigma)).clamp_(0, 1)


def code(crops: Tensor, share: float) -> Tensor:
    """A share of crops (B, 3, n, n) in 0..1 as lossy compression of qualities 20 to 80 leaves them."""
    device = crops.device
    rows = (torch.rand(len(crops), device=device) < share).nonzero()[:, 0]
    if not len(rows):
        return crops
    left, top = (int(v) for v in torch.randint(8, (2,)))
    crops = crops.clone()
    crops[rows] = compress(crops[rows], uniform(len(rows), 20, 80, device), (left, top))
    return crops


@dataclass(frozen=True)
class Look:
    """What happens to the search crops' look besides light and noise, each in a share of them; templates get less."""

    blurred: float = 0.25
    reach: int = 15  # px of the longest motion blur, odd
    coarse: float = 0.2
    darkened: float = 0.1
    compressed: float = 0.0

    def search(self, crops: Tensor) -> Tensor:
        """Search crops (B, 3, n, n), 0..1, as a camera shows them."""
        crops = relight(coarsen(blur(crops, self.blurred, self.reach), self.coarse), 1.0, self.darkened)
        return code(crops, self.compressed)

    def template(self, crops: Tensor) -> Tensor:
        """Template crops (B, 3, n, n), 0..1: chosen by somebody, and so better to see."""
        crops = relight(coarsen(blur(crops, self.blurred / 5, 7), self.coarse / 2), 0.6, self.darkened)
        return code(crops, self.compressed)


DEFAULT_LOOK = Look()
