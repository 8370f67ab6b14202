"""Clips for the light network: one surface in many views, under light that moves over it or stays, drawn."""

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from ..networks.config import LIGHT_SIZE, LIGHT_SURFACE
from ..networks.lighting import summary
from .drawings import paper, with_shapes
from .lighting import soft
from .photos import Photos, random_photos
from .shapes import Outlines, smooth_noise
from .views import placed, random_view, rectified, uniform

SKY = 96  # px of the square that light is drawn on, of which a view sees a part as large as itself
ROOM = (SKY - LIGHT_SIZE) // 2  # px by which light may move to each side


@dataclass(frozen=True)
class LitClips:
    """What the clips are, as shares of them."""

    views: int = 10  # number of each
    shadowed: float = 0.65  # have shadows
    still_shadows: float = 0.3  # of those, that stay on the surface
    mirroring: float = 0.5  # have a lamp mirrored in the surface
    still_lamps: float = 0.25  # of those, that stay on the surface
    rooms: float = 0.15  # have something larger mirrored in them, faintly
    uneven: float = 0.4  # have smooth light that differs from place to place
    exposed_anew: float = 0.25  # are of cameras that keep changing the exposure
    shining: float = 0.08  # shine by themselves: only what is mirrored adds to that
    on_wall: float = 0.5  # have surroundings in their own plane
    hidden: float = 0.25  # of the views, in which something hides part of it ...
    missed: float = 0.15  # ... of which nothing is known in these


@dataclass
class LightBatch:
    inputs: Tensor  # (B, INPUTS, n, n), see `summary`
    log_gain: Tensor  # (B, 1, n, n) of the light on the first view
    glare: Tensor  # (B, 1, n, n) that is mirrored in it, light
    known: Tensor  # (B, 1, n, n), 0 or 1: where that is asked


def light_batch(photos: Photos, batch: int, kinds: LitClips) -> LightBatch:
    """Clips, as the network sees them, and the light on their first views."""
    device, n, t = photos.device, LIGHT_SIZE, kinds.views
    shapes = Outlines(photos, 2 * batch)
    inner = round(LIGHT_SURFACE * n)
    border = (n - inner) // 2

    def some(share: float) -> Tensor:
        return torch.rand(batch, 1, 1, 1, device=device) < share

    # The plane, and what lies behind it, which is another in each view.
    surface = F.interpolate(_prints(photos, shapes, batch), (inner, inner), mode="bilinear", antialias=True)
    wall = torch.where(some(0.5), paper(batch, n, device), paper(batch, n, device).mean((2, 3), keepdim=True))
    wall = (wall + 0.04 * smooth_noise(batch, 1, 24, n, device)).clamp(0.02, 1)
    wall[:, :, border : border + inner, border : border + inner] = surface.clamp(0, 1)
    street = photos.sample(random_photos(photos, batch), placed(random_view(batch, device, 0.5, 1.6)), SKY)
    on_plane = torch.zeros(batch, 1, n, n, device=device)
    on_plane[..., border : border + inner, border : border + inner] = 1
    on_plane = torch.maximum(on_plane, some(kinds.on_wall).float())

    # Light, drawn on a larger square, over which the views move.
    shade = torch.ones(batch, 1, SKY, SKY, device=device)
    for share in (1.0, 0.5, 0.3):
        width = uniform((batch, 1, 1, 1), -0.7, 2.7, device).exp()
        there = (some(kinds.shadowed) if share == 1.0 else some(share * kinds.shadowed)).float()
        shade = shade * (1 - there * soft(shapes.take(batch, SKY), width))
    ambient = uniform((batch, 1, 1, 1), 0.2, 0.8, device)
    shade = ambient + (1 - ambient) * shade
    uneven = (
        uniform((batch, 1, 1, 1), 0, 0.35, device) * some(kinds.uneven) * smooth_noise(batch, 1, 5, SKY, device)
    ).exp()
    lamp = _lamps(shapes, batch, device) * some(kinds.mirroring)
    room = photos.sample(random_photos(photos, batch), placed(random_view(batch, device, 0.4, 1.2)), SKY)
    mirrored = lamp + room.mean(1, keepdim=True).square() * uniform((batch, 1, 1, 1), 0.02, 0.25, device) * some(
        kinds.rooms
    )
    of_shade = _seen(shade * uneven, _ways(batch, t, kinds.still_shadows, device))  # (B, T, n, n)
    of_lamp = _seen(mirrored, _ways(batch, t, kinds.still_lamps, device))
    behind = _seen(street, _ways(batch, t, 0.0, device))  # (B, T, 3, n, n)

    steady = 0.12 * torch.randn(batch, 1, 1, 1, 1, device=device)
    swing = torch.where(some(kinds.exposed_anew), 0.4, 0.1)[:, None] * torch.randn(batch, t, 1, 1, 1, device=device)
    exposure = (steady + swing - swing[:, :1] * uniform((batch, 1, 1, 1, 1), 0, 1, device)).exp()
    colour = (
        0.06 * torch.randn(batch, 1, 3, 1, 1, device=device) + 0.02 * torch.randn(batch, t, 3, 1, 1, device=device)
    ).exp()
    shining = some(kinds.shining)[:, None].float() * on_plane[:, None]
    gain = exposure * (of_shade[:, :, :1] * (1 - shining) + shining)  # (B, T, 1, n, n)
    glare = exposure * of_lamp[:, :, :1]

    views = (
        torch.lerp(behind, _jittered(wall, t), on_plane[:, None]).square() * colour * gain + glare * on_plane[:, None]
    )
    known = torch.ones(batch, t, 1, n, n, device=device)
    views, known = _hide(shapes, views, known, kinds)
    noise = uniform((batch, 1, 1, 1, 1), 0.003, 0.03, device) * torch.randn_like(views)
    views = (_softened(views.clamp_min(0)).sqrt() + noise).clamp(0, 1)
    inputs = torch.from_numpy(summary(views.cpu().numpy(), known.cpu().numpy())).to(device)
    asked = torch.zeros(batch, 1, n, n, device=device)
    asked[..., border : border + inner, border : border + inner] = 1
    return LightBatch(inputs, gain[:, 0].log(), glare[:, 0], asked)


def _prints(photos: Photos, shapes: Outlines, batch: int) -> Tensor:
    """Surfaces (B, 3, 72, 72), 0..1: photographs, half of them with flat shapes on them, or on one colour instead."""
    size, device = 72, photos.device
    index = random_photos(photos, batch)
    prints = photos.sample(index, rectified(photos, index, size), size)
    rows = (torch.rand(batch, device=device) < 0.5).nonzero()[:, 0]
    if len(rows):
        blank = torch.rand(len(rows), 1, 1, 1, device=device) < 0.5
        drawn = torch.where(blank, paper(len(rows), size, device), prints[rows])
        prints[rows] = with_shapes(shapes, drawn, int(torch.randint(1, 5, ())))
    return prints.clamp(0, 1)


def _ways(batch: int, views: int, still: float, device: torch.device) -> Tensor:
    """Where views (B, T, 2) lie on a larger square, px from its middle: along a line, the first anywhere on it."""
    reach = uniform((batch, 1, 1), 0.05, 1, device) * ROOM * (torch.rand(batch, 1, 1, device=device) >= still)
    angle = uniform((batch, 1, 1), 0, 6.2832, device)
    time = uniform((batch, views, 1), -1, 1, device)
    time = torch.where(torch.rand(batch, 1, 1, device=device) < 0.3, (time + 1) / 2 * time[:, :1].sign(), time)
    way = time * reach * torch.cat([angle.cos(), angle.sin()], 2)
    begin = uniform((batch, 1, 2), -1, 1, device) * (ROOM - reach)
    return way + begin + 0.01 * reach * torch.randn(batch, views, 2, device=device)


def _seen(maps: Tensor, ways: Tensor) -> Tensor:
    """Parts (B, T, c, n, n) of larger maps (B, c, SKY, SKY)."""
    (b, t, _), n = ways.shape, LIGHT_SIZE
    c = maps.shape[1]
    axis = torch.arange(n, device=maps.device) - (n - 1) / 2
    y, x = torch.meshgrid(axis, axis, indexing="ij")
    grid = (torch.stack([x, y], -1)[None] + ways.reshape(b * t, 1, 1, 2)) * (2 / SKY)
    # All views of a map at once, side by side.
    grid = grid.reshape(b, t * n, n, 2)
    seen = F.grid_sample(maps, grid, padding_mode="reflection", align_corners=False)  # (B, c, T n, n)
    return seen.reshape(b, c, t, n, n).transpose(1, 2)


def _jittered(plane: Tensor, views: int) -> Tensor:
    """Views (B, T, 3, n, n) of a plane (B, 3, n, n), off by a part of a pixel, some softer than others."""
    b, _, n, _ = plane.shape
    shift = 0.2 * torch.randn(b, views, 1, 2, device=plane.device) * uniform((b, 1, 1, 1), 0, 1.5, plane.device)
    shift[:, 0] = 0
    axis = torch.arange(n, device=plane.device) - (n - 1) / 2
    y, x = torch.meshgrid(axis, axis, indexing="ij")
    grid = (torch.stack([x, y], -1).reshape(1, 1, n * n, 2) + shift) * (2 / n)
    seen = F.grid_sample(plane, grid.reshape(b, views * n, n, 2), padding_mode="border", align_corners=False)
    return seen.reshape(b, 3, views, n, n).transpose(1, 2)


def _softened(views: Tensor) -> Tensor:
    """Views (B, T, 3, n, n), some out of focus."""
    b, t, c, n, _ = views.shape
    flat = views.reshape(b * t, c, n, n)
    soft_ones = F.avg_pool2d(F.pad(flat, [1] * 4, mode="replicate"), 3, 1).reshape(b, t, c, n, n)
    share = uniform((b, 1, 1, 1, 1), 0, 1, views.device) * uniform((b, t, 1, 1, 1), 0, 1, views.device)
    return torch.lerp(views, soft_ones, share)


def _lamps(shapes: Outlines, batch: int, device: torch.device) -> Tensor:
    """Lamps and windows that may be mirrored (B, 1, SKY, SKY): soft spots, up to blinding, and panes with edges."""
    axis = torch.arange(SKY, device=device) - SKY / 2
    y, x = torch.meshgrid(axis, axis, indexing="ij")
    total = torch.zeros(batch, 1, SKY, SKY, device=device)
    for share in (1.0, 0.3):
        centre = uniform((batch, 2, 1, 1), -0.2, 0.2, device) * SKY
        size = uniform((batch, 2, 1, 1), 0.6, 2.7, device).exp()
        spot = (-0.5 * (((x - centre[:, :1]) / size[:, :1]) ** 2 + ((y - centre[:, 1:]) / size[:, 1:]) ** 2)).exp()
        pane = soft(shapes.take(batch, SKY), uniform((batch, 1, 1, 1), -0.5, 2.2, device).exp())
        drawn = torch.where(torch.rand(batch, 1, 1, 1, device=device) < 0.75, spot, 0.5 * pane)
        strength = uniform((batch, 1, 1, 1), 0.05, 1, device) * (torch.rand(batch, 1, 1, 1, device=device) < share)
        total = total + strength * drawn
    return total


def _hide(shapes: Outlines, views: Tensor, known: Tensor, kinds: LitClips) -> tuple[Tensor, Tensor]:
    """Views (B, T, 3, n, n) with something in front of some but the first, and what is known of them."""
    b, t, _, n, _ = views.shape
    front = (shapes.take(b * t, n) < 0).reshape(b, t, 1, n, n)
    there = torch.rand(b, t, 1, 1, 1, device=views.device) < kinds.hidden
    there[:, 0] = False
    front = front & there
    colour = torch.rand(b, t, 3, 1, 1, device=views.device) ** 2
    missed = torch.rand(b, t, 1, 1, 1, device=views.device) < kinds.missed
    return torch.where(front, colour, views), known * (~(front & ~missed)).float()
