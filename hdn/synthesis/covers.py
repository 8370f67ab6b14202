"""What hides a target: things in front of it, and the frame's border."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from .occluders import edges, laid_over
from .photos import Photos, pixel_grid, random_photos
from .shapes import hands
from .views import placed, random_view, uniform


def inside(quad: Tensor, points: Tensor, size: int) -> Tensor:
    """Masks (B, 1, size, size), soft over a pixel, of the points (B, size*size, 2) in convex clockwise quads."""
    edge = quad.roll(-1, 1) - quad
    normal = torch.stack([-edge[..., 1], edge[..., 0]], -1) / edge.norm(dim=-1, keepdim=True)
    level = (normal * quad).sum(-1)
    distance = torch.baddbmm(-level[:, None], points, normal.transpose(1, 2))  # (B, N, 4)
    return distance.amin(2).add_(0.5).clamp_(0, 1).reshape(-1, 1, size, size)


@dataclass(frozen=True)
class Hiding:
    """How many of the pairs have something before the target, by what it is; each has one of the first four at most."""

    quads: float = 0.0  # from a small patch to a wide bar, of a photograph or of one colour
    bars: float = 0.0  # across all of the target, and about two thirds as wide
    slivers: float = 0.0  # all of the target is hidden but for a sliver
    hands: float = 0.0  # hands and arms
    border: float = 0.0  # of all search crops, part of the target is beyond the frame's border
    template: float = 0.0  # of all templates, have a quad before the target as well

    def kinds(self, batch: int, device: torch.device) -> Tensor:
        """What hides each target (B,): 0 a quad, 1 a bar, 2 all but a sliver, 3 a hand, 4 nothing."""
        shares = torch.tensor([self.quads, self.bars, self.slivers, self.hands], device=device)
        return torch.bucketize(torch.rand(batch, device=device), shares.cumsum(0), right=True)

    def some_templates(self, batch: int, device: torch.device) -> Tensor:
        """Before which templates' targets a quad is, (B,) bool."""
        if not self.template:
            return torch.zeros(batch, dtype=torch.bool, device=device)
        return torch.rand(batch, device=device) < self.template


NOTHING = Hiding()


@dataclass(frozen=True)
class Covers:
    """Ranges of what hides a target, as shares of the target's width or, of the frame's border, of the crop's."""

    half_side: tuple[float, float] = (0.06, 0.6)  # half the width and half the height of an occluder
    near_edge: tuple[float, float] = (-0.3, 0.5)  # from the target's middle; farther in, less than a fifth is left
    aside: float = 0.4  # how far its middle is to either side
    plain: float = 0.3  # share of occluders that are of one colour
    bar_width: tuple[float, float] = (0.5, 0.75)
    bar_aside: float = 0.5  # how far a bar's middle is to either side of the target's
    sliver_width: tuple[float, float] = (0.12, 0.3)
    sliver_aside: float = 0.35  # the same of a sliver's middle
    sliver_turn: float = 0.35  # rad, from along the target's sides, of bars and slivers
    border: tuple[float, float] = (0.1, 0.45)  # from the crop's middle to the frame's border


COVERS = Covers()


def hide(
    photos: Photos, crops: Tensor, kinds: Tensor, about: Tensor, extent: float, turn: Tensor
) -> tuple[Tensor, Tensor]:
    """Lays a bar, all but a sliver, or a hand over crops (B, 3, n, n), 0..1.

    Args:
        kinds: (B,) see `Hiding.kinds`; of the others nothing is hidden here.
        about: (B, 2) where the targets are, px from the crops' centres; extent: how wide they are, px.
        turn: (B,) rad, by which the targets are turned.

    Returns:
        The crops, and masks (B, 1, n, n) of what is hidden.
    """
    device, size = crops.device, crops.shape[-1]
    hidden = torch.zeros_like(crops[:, :1])
    rows = ((kinds >= 1) & (kinds <= 3)).nonzero()[:, 0]
    if not len(rows):
        return crops, hidden
    b, kind = len(rows), kinds[rows, None]
    points = (pixel_grid(size, device) - about[rows, None]) / extent  # (B, N, 2)
    sides = torch.randint(2, (b,), device=device) * (np.pi / 2) + turn[rows]
    angle = sides + uniform(b, -COVERS.sliver_turn, COVERS.sliver_turn, device)
    normal = torch.stack([angle.cos(), angle.sin()], 1)
    level = (points @ normal[:, :, None])[..., 0]

    def band(width: tuple[float, float], aside: float) -> Tensor:
        """Signed distances (B, N) from bands across the targets, in units of the targets' width."""
        return (level - uniform((b, 1), -aside, aside, device)).abs() - uniform((b, 1), *width, device) / 2

    bar, sliver = band(COVERS.bar_width, COVERS.bar_aside), band(COVERS.sliver_width, COVERS.sliver_aside)
    hand = hands(b, 2 * points) / 2
    distance = torch.where(kind == 1, bar, torch.where(kind == 2, -sliver, hand)) * extent
    there = torch.ones((b, 1, 1, 1), dtype=torch.bool, device=device)
    crops, look = crops.clone(), (distance.reshape(b, 1, size, size), edges(b, device), there)
    crops[rows], hidden[rows] = laid_over(photos, crops[rows], *look)
    return crops.clamp_(0, 1), hidden


def occlude(photos: Photos, crops: Tensor, chosen: Tensor, about: Tensor, extent: float) -> tuple[Tensor, Tensor]:
    """Lays a quad over some of the crops (B, 3, n, n): patches to wide bars, of a photograph or of one colour.

    Args:
        chosen: (B,) bool, over which.
        about: (B, 2) where the targets are, px from the crops' centres; extent: how wide they are, px.

    Returns:
        The crops, and masks (B, 1, n, n) of what is hidden.
    """
    device, size = photos.device, crops.shape[-1]
    hidden = torch.zeros_like(crops[:, :1])
    rows = chosen.nonzero()[:, 0]
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
