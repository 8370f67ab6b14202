"""Outlines of what may lie on a surface or before it, as signed distances: hands, blobs, polygons, bars, silhouettes.

They are drawn on a coarse grid over a crop's square, -1..1 along x and y, and enlarged: a distance is smooth.
"""

import math
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from .photos import Photos, pixel_grid, random_photos
from .views import placed, random_view, uniform

COARSE = 64  # cells along a side of the grid that outlines are drawn on
FINGERS = 5


@dataclass(frozen=True)
class OutlineShares:
    """What outlines are of, as shares of them."""

    hands: float = 0.4
    blobs: float = 0.15
    polygons: float = 0.15
    bars: float = 0.15
    silhouettes: float = 0.15
    ragged: float = 0.2  # of all, have a ragged edge, as cloth and hair


SHARES = OutlineShares()


class Outlines:
    """A stock of outlines, all of the kinds above, of which many are taken for one batch, flipped and turned anew."""

    def __init__(self, photos: Photos, count: int) -> None:
        """Draws about so many, the kinds by their shares."""
        device = photos.device
        points = pixel_grid(COARSE, device) * (2 / COARSE)  # (N, 2)
        numbers = [math.ceil(count * share) for share in (SHARES.hands, SHARES.blobs, SHARES.polygons, SHARES.bars)]
        kinds = [draw(n, points) for draw, n in zip((hands, blobs, polygons, bars), numbers, strict=True)]
        kinds.append(silhouettes(photos, math.ceil(count * SHARES.silhouettes)))
        distance = torch.cat(kinds).reshape(-1, 1, COARSE, COARSE)
        ragged = torch.where(torch.rand(len(distance), 1, 1, 1, device=device) < SHARES.ragged, 0.04, 0.0)
        self.stock = distance + ragged * torch.randn_like(distance)

    def take(self, batch: int, size: int) -> Tensor:
        """Signed distances (B, 1, size, size) in px of such crops, negative inside, to one random outline each."""
        stock = self.stock if torch.rand(()) < 0.5 else self.stock.transpose(2, 3)
        if torch.rand(()) < 0.5:
            stock = stock.flip(3)
        distance = stock[torch.randint(len(stock), (batch,), device=stock.device)]
        return F.interpolate(distance, (size, size), mode="bilinear", align_corners=False) * (size / 2)


def hands(batch: int, points: Tensor) -> Tensor:
    """Distances (B, N) to arms that reach in from the border, each with up to five fingers of two joints.

    Args: points: (N, 2), or (B, N, 2) for each arm its own.
    """
    device = points.device
    angle = uniform((batch, 1), 0, 2 * math.pi, device)  # the way that the arm points
    finger = uniform((batch, 1), 0.06, 0.19, device)  # radius
    count = torch.randint(0, FINGERS + 1, (batch, 1), device=device)
    # From beyond the border to the knuckles, past the crop's middle at most by half.
    aside = uniform((batch, 1), -0.9, 0.9, device)
    reach = uniform((batch, 1), -1.0, 0.5, device)
    base = _turned(torch.stack([reach, aside], -1), angle)  # (B, 1, 2)
    start = _turned(torch.stack([torch.full_like(reach, -2.2), aside + uniform((batch, 1), -1, 1, device)], -1), angle)
    palm = finger * torch.where(count > 0, count.clamp_min(1) * 0.75 + 0.4, uniform((batch, 1), 1, 3, device))

    place = torch.arange(FINGERS, device=device) - (count - 1) / 2  # (B, FINGERS)
    there = torch.arange(FINGERS, device=device) < count
    spread = uniform((batch, 1), 0.0, 0.25, device)
    turn = angle + spread * place + 0.08 * torch.randn(batch, FINGERS, device=device)
    bend = turn + uniform((batch, 1), -0.8, 0.8, device)
    length = finger * uniform((batch, 1), 2, 5, device) * uniform((batch, FINGERS), 0.7, 1.1, device)
    gap = uniform((batch, 1), 1.6, 2.3, device)
    knuckle = base + _turned(torch.stack([torch.zeros_like(place), place * finger * gap], -1), angle)
    joint = knuckle + length[..., None] * torch.stack([turn.cos(), turn.sin()], -1)
    tip = joint + 0.8 * length[..., None] * torch.stack([bend.cos(), bend.sin()], -1)

    starts = torch.cat([start, knuckle, joint], 1)  # (B, 1 + 2 FINGERS, 2)
    ends = torch.cat([base, joint, tip], 1)
    radius = torch.cat([palm, finger.expand(-1, FINGERS), finger.expand(-1, FINGERS) * 0.92], 1)
    radius = torch.where(torch.cat([torch.ones_like(count).bool(), there, there], 1), radius, -9.0)
    way = ends - starts
    along = points @ way.transpose(1, 2) - (starts * way).sum(2)[:, None]  # (B, N, S)
    along = (along / way.square().sum(2).clamp_min(1e-6)[:, None]).clamp(0, 1)
    x = points[..., :1] - starts[:, None, :, 0] - along * way[:, None, :, 0]
    y = points[..., 1:] - starts[:, None, :, 1] - along * way[:, None, :, 1]
    return ((x.square() + y.square()).sqrt() - radius[:, None]).amin(2)


def blobs(batch: int, points: Tensor) -> Tensor:
    """Distances (B, N) to ellipses with a wavy outline."""
    device = points.device
    offset = points - uniform((batch, 1, 2), -0.9, 0.9, device)
    radius = uniform((batch, 1), math.log(0.08), math.log(0.9), device).exp()
    stretch = uniform((batch, 1, 1), -0.6, 0.6, device).exp()
    offset = _turned(offset, uniform((batch, 1), 0, math.pi, device))
    offset = torch.cat([offset[..., :1] * stretch, offset[..., 1:] / stretch], 2)
    waves = smooth_noise(batch, 1, 6, COARSE, device).flatten(1)
    return offset.norm(dim=2) - radius * (1 + uniform((batch, 1), 0, 0.5, device) * waves)


def polygons(batch: int, points: Tensor) -> Tensor:
    """Distances (B, N) to convex polygons of three to six sides."""
    device = points.device
    centre = uniform((batch, 1, 2), -0.8, 0.8, device)
    sides = 6
    turn = torch.arange(sides, device=device) * (2 * math.pi / sides) + uniform((batch, sides), -0.5, 0.5, device)
    normal = torch.stack([turn.cos(), turn.sin()], -1)  # (B, sides, 2)
    radius = uniform((batch, 1), math.log(0.1), math.log(1.0), device).exp() * uniform((batch, sides), 0.6, 1.4, device)
    radius = torch.where(torch.rand(batch, sides, device=device) < 0.25, 9.0, radius)  # a side that is not there
    return (((points - centre) @ normal.transpose(1, 2)) - radius[:, None]).amax(2)


def bars(batch: int, points: Tensor) -> Tensor:
    """Distances (B, N) to bars and poles across the whole crop, from a wire to two thirds of its width."""
    device = points.device
    angle = uniform((batch, 1), 0, math.pi, device)
    normal = torch.stack([angle.cos(), angle.sin()], -1)  # (B, 1, 2)
    level = (points @ normal.transpose(1, 2))[..., 0] - uniform((batch, 1), -0.9, 0.9, device)
    return level.abs() - uniform((batch, 1), math.log(0.03), math.log(0.7), device).exp()


def silhouettes(photos: Photos, batch: int) -> Tensor:
    """Distances (B, N), roughly, to where a photograph is lighter than a level: outlines as things have them."""
    device = photos.device
    view = placed(random_view(batch, device, 1.0, 3.0))
    grey = photos.sample(random_photos(photos, batch), view, COARSE).mean(1, keepdim=True)
    grey = F.avg_pool2d(F.pad(grey, [3] * 4, mode="replicate"), 7, 1).flatten(1)
    sign = torch.where(torch.rand(batch, 1, device=device) < 0.5, 1.0, -1.0)
    grey = grey * sign
    level = torch.quantile(grey[:, ::7], 0.7, dim=1, keepdim=True)
    return (level - grey) / (grey.std(1, keepdim=True) + 0.02) * 0.5


def smooth_noise(batch: int, channels: int, cells: int, size: int, device: torch.device) -> Tensor:
    """Smooth noise (B, channels, size, size) of unit deviation, of so many cells along a side."""
    noise = torch.randn(batch, channels, cells, cells, device=device)
    return F.interpolate(noise, (size, size), mode="bicubic", align_corners=True)


def _turned(points: Tensor, angle: Tensor) -> Tensor:
    """Points (B, M, 2) turned by angles (B, 1) about the origin."""
    c, s = angle.cos(), angle.sin()
    x, y = points.unbind(2)
    return torch.stack([c * x - s * y, s * x + c * y], 2)
