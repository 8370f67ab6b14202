"""Pairs for the matte network: a surface as template, and in a frame, with or without something in front of it."""

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from ..networks.config import MATTE_SURFACE
from ..networks.geometry import dlt, project
from .drawings import colours, paper, with_shapes
from .lighting import shine
from .looks import blur, coarsen, code, relight
from .occluders import edges, laid_over
from .photos import Photos, pixel_grid, random_photos
from .shapes import Outlines, smooth_noise
from .views import placed, random_view, rectified, uniform

CANVAS, SCALE = 192, 1.25  # px of the square that a surface is drawn on; of them for a pixel of the crop


@dataclass(frozen=True)
class MattePairs:
    """What the pairs are, as shares of them."""

    negative: float = 0.06  # shows another surface: all is hidden
    occluded: float = 0.75  # of the rest, has something in front
    second: float = 0.25  # of those, has another thing in front as well
    covered: float = 0.05  # of the rest, is covered altogether
    blurred: float = 0.35  # frames with motion blur, up to 21 px
    coarse: float = 0.25  # frames of a lower resolution
    darkened: float = 0.1  # frames down to 15 to 50 % of the light
    light: float = 1.0  # strength of the light that varies over the surface
    far: float = 0.2  # off by 1.2 to 4 px of the crop; the others by 0 to 1.2
    cut: float = 0.2  # partly beyond the frame's border, or not known in the template
    framed: float = 0.6  # the surface ends within the crop, and other things around it, of the frame alone, are seen


@dataclass
class MatteBatch:
    frame: Tensor  # (B, 3, n, n), 0..255
    template: Tensor  # (B, 3, n, n), 0..255
    valid: Tensor  # (B, 1, n, n), 0 or 1: frame and template are both known
    around: Tensor  # (B, 1, n, n), 0 or 1: beyond that, the frame is known
    seen: Tensor  # (B, 1, n, n), 0..1: share of the pixel that shows the surface


def matte_batch(photos: Photos, batch: int, size: int, pairs: MattePairs) -> MatteBatch:
    """Rectified frame and template crops, drawn; at least two, since another surface is another pair's."""
    device = photos.device
    shapes = Outlines(photos, 3 * batch)
    canvas = surfaces(photos, shapes, batch)
    template = resampled(canvas, motion(batch, size, torch.full((batch,), 0.7, device=device)), size)
    far = torch.rand(batch, device=device) < pairs.far
    off = torch.where(far, uniform(batch, 1.2, 4, device), uniform(batch, 0, 1.2, device))
    negative = torch.rand(batch, 1, 1, 1, device=device) < pairs.negative
    framed = torch.rand(batch, 1, 1, 1, device=device) < pairs.framed
    shown = torch.where(negative, canvas.roll(1, 0), canvas)
    beside = framed & ~inner(CANVAS, SCALE * MATTE_SURFACE * size, device)
    shown = torch.where(beside, surroundings(photos, canvas), shown)
    frame = resampled(shown, motion(batch, size, off), size)

    frame = blur(shine(photos, shapes, frame, pairs.light).clamp(0, 1.5), pairs.blurred / 2, 21)
    hidden = negative.float().expand(-1, 1, size, size)
    frame, hidden = occlude(photos, shapes, frame, hidden, pairs.occluded, pairs.covered)
    frame, hidden = occlude(photos, shapes, frame, hidden, pairs.second * pairs.occluded, 0)

    both = torch.cat([frame, hidden], 1)
    both = coarsen(blur(both, pairs.blurred / 2, 21), pairs.coarse)
    frame, hidden = both[:, :3].clamp(0, 1), both[:, 3:].clamp(0, 1)
    frame = code(relight(frame, 0.8, pairs.darkened), 0.4)
    template = shine(photos, shapes, template, 0.4 * pairs.light).clamp(0, 1)
    template = coarsen(blur(template, pairs.blurred / 3, 15), 0.2)
    template = code(relight(template, 0.5), 0.3)
    in_frame, known = cut(shapes, batch, size, pairs.cut, device)
    known = in_frame & known & (inner(size, MATTE_SURFACE * size, device) | ~framed)
    around = in_frame & ~known & framed
    return MatteBatch(frame * 255, template * 255, known.float(), around.float(), 1 - hidden)


def inner(size: int, side: float, device: torch.device) -> Tensor:
    """The pixels (1, 1, size, size) of a square of so many px in the middle."""
    at = (torch.arange(size, device=device) + 0.5 - size / 2).abs() < side / 2
    return (at[:, None] & at)[None, None]


def surroundings(photos: Photos, canvas: Tensor) -> Tensor:
    """What lies around surfaces (B, 3, n, n), as large: photographs, a third of them out of focus or of one colour."""
    device, (b, _, size, _) = canvas.device, canvas.shape
    photo = photos.sample(random_photos(photos, b), placed(random_view(b, device, 0.4, 1.8)), size)
    plain = colours(b, device) + 0.03 * smooth_noise(b, 1, 6, size, device)
    photo = torch.where(torch.rand(b, 1, 1, 1, device=device) < 0.35, plain, photo)
    return blur(photo.clamp(0, 1), 0.3, 21)


def surfaces(photos: Photos, shapes: Outlines, batch: int) -> Tensor:
    """Surfaces (B, 3, CANVAS, CANVAS), 0..1: photographs, some with flat shapes on them or on one colour instead."""
    device = photos.device
    index = random_photos(photos, batch)
    zoom = torch.diag(torch.tensor([1 / SCALE, 1 / SCALE, 1], device=device))
    canvas = photos.sample(index, rectified(photos, index, int(CANVAS / SCALE)) @ zoom, CANVAS)
    rows = (torch.rand(batch, device=device) < 0.4).nonzero()[:, 0]
    if len(rows):
        drawn = canvas[rows]
        blank = paper(len(rows), CANVAS, device)
        drawn = torch.where(torch.rand(len(rows), 1, 1, 1, device=device) < 0.6, blank, drawn)
        drawn = with_shapes(shapes, drawn, int(torch.randint(1, 6, ())))
        canvas[rows] = drawn
    return canvas.clamp(0, 1)


def motion(batch: int, size: int, off: Tensor) -> Tensor:
    """Homographies (B, 3, 3) about a crop's centre that move its corners by up to `off` (B,) px, half of it alike."""
    device = off.device
    corners = torch.tensor([[-1.0, -1], [1, -1], [1, 1], [-1, 1]], device=device) * size / 2
    common = uniform((batch, 1, 2), -0.7, 0.7, device)
    offsets = (common + 0.5 * uniform((batch, 4, 2), -1, 1, device)) * off[:, None, None]
    return dlt(offsets, corners)


def resampled(canvas: Tensor, crop_to_surface: Tensor, size: int) -> Tensor:
    """Crops (B, 3, size, size) of surfaces, through homographies (B, 3, 3) in px of the crop about its centre."""
    to_canvas = torch.diag(torch.tensor([2 * SCALE / CANVAS, 2 * SCALE / CANVAS, 1], device=canvas.device))
    grid = project(to_canvas @ crop_to_surface, pixel_grid(size, canvas.device)).reshape(-1, size, size, 2)
    return F.grid_sample(canvas, grid, padding_mode="reflection", align_corners=False)


def occlude(
    photos: Photos, shapes: Outlines, crops: Tensor, hidden: Tensor, share: float, covered: float
) -> tuple[Tensor, Tensor]:
    """Something in front of a share of the crops (B, 3, n, n), and of a further share, `covered`, over all of it.

    Returns:
        The crops, and how much of each pixel (B, 1, n, n) is hidden, by what hid it before as well.
    """
    device, (b, _, size, _) = crops.device, crops.shape
    distance = shapes.take(b, size)
    all_over = torch.rand(b, 1, 1, 1, device=device) < covered
    distance = torch.where(all_over, -float(size), distance)
    edge = edges(b, device)
    there = all_over | (torch.rand(b, 1, 1, 1, device=device) < share)
    crops, hides = laid_over(photos, crops, distance, edge, there)
    return crops, 1 - (1 - hidden) * (1 - hides)


def cut(shapes: Outlines, batch: int, size: int, share: float, device: torch.device) -> tuple[Tensor, Tensor]:
    """Which pixels (B, 1, n, n) are in the frame, and which are known of the template; of a share, not all are."""
    grid = pixel_grid(size, device)
    angle = uniform((batch, 1), 0, 6.2832, device)
    level = grid[:, 0] * angle.cos() + grid[:, 1] * angle.sin()
    inside = (level < uniform((batch, 1), 0.1, 0.5, device) * size).reshape(batch, 1, size, size)
    seen_once = shapes.take(batch, size) > 0
    is_cut = torch.rand(batch, 1, 1, 1, device=device) < share
    by_frame = torch.rand(batch, 1, 1, 1, device=device) < 0.6
    return inside | ~(is_cut & by_frame), seen_once | ~(is_cut & ~by_frame)
