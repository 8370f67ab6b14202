"""Things in front of a surface: what they look like, and how they lie over it."""

from dataclasses import astuple, dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from .drawings import colours
from .lighting import soft
from .looks import blur
from .photos import Photos, pixel_grid, random_photos
from .shapes import smooth_noise
from .views import placed, random_view, uniform

SKIN = ((0.95, 0.80, 0.71), (0.76, 0.53, 0.42), (0.26, 0.16, 0.12))  # RGB, from light to dark


@dataclass(frozen=True)
class LookShares:
    """What occluders look like, as shares of them."""

    skin: float = 0.28
    flat: float = 0.2
    striped: float = 0.07
    photograph: float = 0.17
    alike: float = 0.13  # of one colour, much like the mean of the surface beneath
    akin: float = 0.15  # of a photograph's texture about such a colour


LOOKS = LookShares()


def edges(batch: int, device: torch.device) -> Tensor:
    """Widths (B, 1, 1, 1), px, over which occluders end: most are sharp."""
    sharp = torch.rand(batch, 1, 1, 1, device=device) < 0.7
    return torch.where(sharp, 1.0, uniform((batch, 1, 1, 1), 1.5, 8, device))


def laid_over(photos: Photos, crops: Tensor, distance: Tensor, edge: Tensor, there: Tensor) -> tuple[Tensor, Tensor]:
    """Something in front of crops (B, 3, n, n), moving or not, with its contact shadow beside it.

    Args:
        distance: (B, 1, n, n) px, signed, negative inside its outline.
        edge: (B, 1, 1, 1) px, over which it ends.
        there: (B, 1, 1, 1) bool, whether it is there at all.

    Returns:
        The crops, and how much of each pixel (B, 1, n, n) it hides.
    """
    device, (b, _, size, _) = crops.device, crops.shape
    alpha = soft(distance, edge) * there

    # The shadow that it casts beside itself does not hide the surface.
    across, down = (int(v) for v in torch.randint(-8, 9, (2,)))
    aside = F.pad(distance, [8] * 4, mode="replicate")[:, :, 8 + down :, 8 + across :][:, :, :size, :size]
    shadow = soft(aside, uniform((b, 1, 1, 1), 3, 30, device)) * there
    crops = crops * (1 - uniform((b, 1, 1, 1), -0.3, 0.6, device).clamp_min(0) * shadow)

    look = torch.cat([appearance(photos, crops, alpha, distance) * alpha, alpha], 1)
    look = blur(look, 0.2, 15)  # it moves, the surface does not
    colour, alpha = look[:, :3], look[:, 3:]
    return crops * (1 - alpha) + colour, alpha


def appearance(photos: Photos, crops: Tensor, alpha: Tensor, distance: Tensor) -> Tensor:
    """What occluders look like, (B, 3, n, n), 0..1: skin, flat, striped, of photographs, or of the surface's colour."""
    device, (b, _, size, _) = crops.device, crops.shape
    tones = torch.tensor(SKIN, device=device)
    tone = uniform(b, 0, 1.999, device)
    lower = tone.long()
    skin = torch.lerp(tones[lower], tones[lower + 1], (tone - lower)[:, None])[..., None, None]
    skin = skin * (1 + 0.12 * torch.randn(b, 3, 1, 1, device=device))
    skin = skin * (1 + 0.08 * smooth_noise(b, 1, 9, size, device))

    flat = colours(b, device).expand(-1, 3, size, size)
    grid = pixel_grid(size, device)
    angle = uniform((b, 1), 0, 3.1416, device)
    wave = (grid[:, 0] * angle.cos() + grid[:, 1] * angle.sin()) * uniform((b, 1), 0.1, 1.2, device)
    striped = torch.lerp(flat, colours(b, device), (wave.sin() * 3 + 0.5).clamp(0, 1).reshape(b, 1, size, size))
    photo = photos.sample(random_photos(photos, b), placed(random_view(b, device, 0.4, 1.8)), size)
    beneath = (crops * alpha).sum((2, 3), keepdim=True) / alpha.sum((2, 3), keepdim=True).clamp_min(1)
    sign = torch.where(torch.rand(b, 3, 1, 1, device=device) < 0.5, 1.0, -1.0)
    alike = (beneath + sign * uniform((b, 3, 1, 1), 0.03, 0.2, device)).expand(-1, 3, size, size)

    akin = alike + (photo - photo.mean((2, 3), keepdim=True)) * uniform((b, 1, 1, 1), 0.3, 1, device)
    kinds = torch.stack([skin, flat, striped, photo, alike, akin], 1)
    chance = torch.tensor(astuple(LOOKS), device=device)
    look = kinds[torch.arange(b, device=device), torch.multinomial(chance, b, replacement=True)]
    # Round things darken towards their outline; light falls from one side.
    depth = (-distance / uniform((b, 1, 1, 1), 3, 25, device)).clamp(0, 1)
    look = look * (1 - uniform((b, 1, 1, 1), -0.3, 0.6, device).clamp_min(0) * (1 - depth))
    gain = (0.25 * smooth_noise(b, 1, 3, size, device) + uniform((b, 1, 1, 1), -0.5, 0.3, device)).exp()
    return (look * torch.where(torch.rand(b, 1, 1, 1, device=device) < 0.7, gain, 1.0)).clamp(0, 1.2)
