"""What hides a target: things in front of it, and the frame's border."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from .photos import Photos, pixel_grid, random_photos
from .views import placed, random_view, uniform


def inside(quad: Tensor, points: Tensor, size: int) -> Tensor:
    """Masks (B, 1, size, size), soft over a pixel, of the points (B, size*size, 2) in convex clockwise quads."""
    edge = quad.roll(-1, 1) - quad
    normal = torch.stack([-edge[..., 1], edge[..., 0]], -1) / edge.norm(dim=-1, keepdim=True)
    level = (normal * quad).sum(-1)
    distance = torch.baddbmm(-level[:, None], points, normal.transpose(1, 2))  # (B, N, 4)
    return distance.amin(2).add_(0.5).clamp_(0, 1).reshape(-1, 1, size, size)


@dataclass(frozen=True)
class Covers:
    """Ranges of what hides a target, as shares of the target's width or, of the frame's border, of the crop's."""

    half_side: tuple[float, float] = (0.06, 0.6)  # half the width and half the height of an occluder
    near_edge: tuple[float, float] = (-0.3, 0.5)  # from the target's middle; farther in, less than a fifth is left
    aside: float = 0.4  # how far its middle is to either side
    plain: float = 0.3  # share of occluders that are of one colour
    border: tuple[float, float] = (0.1, 0.45)  # from the crop's middle to the frame's border


COVERS = Covers()


def occlude(photos: Photos, crops: Tensor, share: float, about: Tensor, extent: float) -> tuple[Tensor, Tensor]:
    """Lays a quad over a share of the crops (B, 3, n, n): patches to wide bars, of a photograph or of one colour.

    Args:
        about: (B, 2) where the targets are, px from the crops' centres; extent: how wide they are, px.

    Returns:
        The crops, and masks (B, 1, n, n) of what is hidden.
    """
    device, size = photos.device, crops.shape[-1]
    hidden = torch.zeros_like(crops[:, :1])
    rows = (torch.rand(len(crops), device=device) < share).nonzero()[:, 0]
    if not len(rows):
        return crops, hidden
    b, (smallest, largest) = len(rows), COVERS.half_side
    half = uniform((b, 2), float(np.log(smallest)), float(np.log(largest)), device).exp() * extent
    angle = uniform(b, 0, 2 * np.pi, device)
    axes = torch.stack([angle.cos(), angle.sin()], 1)
    across = torch.stack([-axes[:, 1], axes[:, 0]], 1)
    sign = torch.tensor([[-1.0, -1], [1, -1], [1, 1], [-1, 1]], device=device)
    quad = sign[None, :, :1] * (axes * half[:, :1])[:, None] + sign[None, :, 1:] * (across * half[:, 1:])[:, None]
    near = uniform((b, 1), *COVERS.near_edge, device) * extent + half[:, :1]
    centre = about[rows] + axes * near + across * uniform((b, 1), -COVERS.aside, COVERS.aside, device) * extent
    quad = quad + centre[:, None]
    grid = pixel_grid(size, device).expand(b, -1, -1)
    other = photos.sample(random_photos(photos, b), placed(random_view(b, device, 0.4, 1.6)), size)
    plain = uniform((b, 3, 1, 1), 0, 1, device)
    other = torch.where(torch.rand(b, 1, 1, 1, device=device) < COVERS.plain, plain, other)
    mask = inside(quad, grid, size)
    crops = crops.clone()
    crops[rows] = torch.lerp(crops[rows], other, mask)
    hidden[rows] = mask
    return crops, hidden


def cut_by_border(crops: Tensor, share: float) -> tuple[Tensor, Tensor]:
    """Fills what lies beyond a straight frame border with the crop's mean colour, in a share of crops (B, 3, n, n).

    Returns:
        The crops, and masks (B, 1, n, n) of what is beyond.
    """
    device, (b, _, size, _) = crops.device, crops.shape
    side = torch.randint(4, (b, 1), device=device)
    reach = uniform((b, 1), *COVERS.border, device) * size
    grid = pixel_grid(size, device)
    axis = torch.stack([grid[:, 0], -grid[:, 0], grid[:, 1], -grid[:, 1]])[side[:, 0]]  # (B, n*n)
    beyond = ((axis > reach) & (torch.rand(b, 1, device=device) < share)).reshape(b, 1, size, size)
    return torch.where(beyond, crops.mean((2, 3), keepdim=True), crops), beyond.float()
