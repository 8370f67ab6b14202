"""Light on a surface that varies over it: smooth gains, shadows from sharp to soft, glare, reflections, haze."""

import torch
from torch import Tensor

from .photos import Photos, random_photos
from .shapes import Outlines, smooth_noise
from .views import placed, random_view, uniform


def soft(distance: Tensor, width: Tensor) -> Tensor:
    """Masks 0..1 of signed distances (B, 1, n, n), px; from one to zero over a width (B, 1, 1, 1), px."""
    return (0.5 - distance / width).clamp(0, 1)


def shine(photos: Photos, shapes: Outlines, crops: Tensor, strength: float) -> Tensor:
    """Crops (B, 3, n, n), 0..1, under light of their own each; not cut to that range.

    Args: strength: 0 to 1, scales how strong each part is and how many crops have it.
    """
    device, (b, _, size, _) = crops.device, crops.shape

    def some(share: float) -> Tensor:
        return (torch.rand(b, 1, 1, 1, device=device) < share * strength).float()

    def edge(sharpest: float, softest: float) -> Tensor:
        low, high = torch.tensor([sharpest, softest]).log().tolist()
        return uniform((b, 1, 1, 1), low, high, device).exp()

    cells = int(torch.randint(2, 5, ()))
    gain = smooth_noise(b, 1, cells, size, device) + 0.15 * smooth_noise(b, 3, cells, size, device)
    x = crops * (gain * uniform((b, 1, 1, 1), 0, 0.35, device) * strength).exp()

    for share in (0.5, 0.2):  # shadows, of hands as well
        dark = uniform((b, 1, 1, 1), 0.15, 0.65, device) * some(share)
        tint = 1 + uniform((b, 3, 1, 1), -0.1, 0.1, device)
        x = x * (1 - (dark * tint).clamp(0, 0.9) * soft(shapes.take(b, size), edge(1, 60)))

    # Glare, soft, up to what blinds a camera; then a reflection of something bright or of a room, edges and all.
    white = 1 + uniform((b, 3, 1, 1), -0.12, 0.08, device)
    x = x + white * uniform((b, 1, 1, 1), 0.1, 1.1, device) * some(0.3) * soft(shapes.take(b, size), edge(15, 90))
    lamp = soft(shapes.take(b, size), edge(1, 12))
    room = photos.sample(random_photos(photos, b), placed(random_view(b, device, 0.4, 1.6)), size)
    reflected = torch.where(torch.rand(b, 1, 1, 1, device=device) < 0.5, lamp * white, room)
    x = x + reflected * uniform((b, 1, 1, 1), 0.05, 0.3, device) * some(0.25)

    haze = uniform((b, 1, 1, 1), 0, 0.45, device) * some(0.25)
    return torch.lerp(x, uniform((b, 3, 1, 1), 0.3, 1, device), haze)
