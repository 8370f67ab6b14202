"""Surfaces that are drawn: flat shapes on one colour, as screens, signs and labels are; often of little texture."""

import torch
import torch.nn.functional as F
from torch import Tensor

from .lighting import soft
from .photos import SIDE, Photos
from .shapes import Outlines, smooth_noise
from .views import uniform

CANVAS = 152  # px of the square that a screen is drawn on


def screens(shapes: Outlines, batch: int) -> Photos:
    """So many pictures of little texture: up to three flat shapes on one colour, most of them faint."""
    device = shapes.stock.device
    empty = paper(batch, CANVAS, device)
    drawn = with_shapes(shapes, empty, 3)
    strength = uniform((batch, 1, 1, 1), 0.1, 1, device)
    drawn = F.interpolate(torch.lerp(empty, drawn, strength), (SIDE, SIDE), mode="bilinear", align_corners=False)
    return Photos((drawn.clamp(0, 1) * 255).round().to(torch.uint8), device)


def paper(batch: int, size: int, device: torch.device) -> Tensor:
    """Pictures (B, 3, size, size) of about one colour each; not cut to 0..1."""
    return colours(batch, device) + 0.02 * smooth_noise(batch, 3, 12, size, device)


def with_shapes(shapes: Outlines, pictures: Tensor, count: int) -> Tensor:
    """Pictures (B, 3, n, n) with up to so many flat shapes on each."""
    device, (b, _, size, _) = pictures.device, pictures.shape
    for _ in range(count):
        there = (torch.rand(b, 1, 1, 1, device=device) < 0.7).float()
        mask = soft(shapes.take(b, size), uniform((b, 1, 1, 1), 1, 2, device))
        pictures = torch.lerp(pictures, colours(b, device), mask * there)
    return pictures


def colours(batch: int, device: torch.device) -> Tensor:
    """Colours (B, 3, 1, 1), 0..1, a third of them near white, near black or near grey."""
    any_colour = uniform((batch, 3, 1, 1), 0, 1, device)
    level = torch.tensor([0.97, 0.03, 0.5], device=device)[torch.randint(3, (batch,), device=device)]
    plain = level[:, None, None, None] + uniform((batch, 3, 1, 1), -0.06, 0.06, device)
    return torch.where(torch.rand(batch, 1, 1, 1, device=device) < 0.35, plain, any_colour).clamp(0, 1)
