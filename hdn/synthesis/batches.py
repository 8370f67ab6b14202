"""Batches of samples, put together from views, covers and looks."""

from dataclasses import dataclass, fields

import torch
from torch import Tensor

from ..networks.geometry import dlt, project
from .covers import cut_by_border, inside, occlude
from .looks import DEFAULT_LOOK, Look
from .photos import Photos, pixel_grid, random_photos
from .views import Motion, placed, random_motion, random_view, rectified, textured, uniform


@dataclass
class SimilarityBatch:
    template: Tensor  # (B, 3, 127, 127), 0..255
    search: Tensor  # (B, 3, 255, 255), 0..255
    target: Tensor  # (B, 2) half width and half height of the target's box in the template, px
    motion: Motion
    positive: Tensor  # (B,) bool: the search shows the template's target
    jitter: Tensor  # (B, 2) of unit deviation: how far off a guess of the shift is


def similarity_batch(
    photos: Photos, batch: int, template_size: int, search_size: int, context: float, negatives: float = 0.2,
    occluded: float = 0.3,
    gentle: float = 0.5, look: Look = DEFAULT_LOOK,
) -> SimilarityBatch:  # fmt: skip
    """Template and search crops for both branches of the similarity component."""
    device = photos.device
    index = random_photos(photos, batch)
    template_to_image = textured(photos, index, template_size, 0.4, 1.5)
    motion = random_motion(batch, device, gentle)

    # The target's box in the template: its window, box plus context, is the whole crop.
    aspect = (uniform(batch, -0.9, 0.9, device)).exp()
    w, h = aspect.sqrt(), 1 / aspect.sqrt()
    margin = context * (w + h)
    window = ((w + margin) * (h + margin)).sqrt()
    half = torch.stack([w, h], 1) * (template_size / 2 / window)[:, None]
    corner = torch.tensor([[-1.0, -1], [1, -1], [1, 1], [-1, 1]], device=device)
    quad = half[:, None] * corner * uniform((batch, 4, 2), 0.75, 1, device)

    template = photos.sample(index, template_to_image, template_size)
    search = photos.sample(index, template_to_image @ torch.linalg.inv(motion.matrix), search_size)

    # Half the targets lie on a background that does not move with them.
    rows = (torch.rand(batch, device=device) < 0.5).nonzero()[:, 0]
    if len(rows):
        back = random_photos(photos, len(rows))
        back_view = placed(random_view(len(rows), device, 0.4, 1.5))
        drift = random_motion(len(rows), device, 0.8).matrix
        for crops, to_back, to_template, size in (
            (template, back_view, None, template_size),
            (search, back_view @ drift, torch.linalg.inv(motion.matrix[rows]), search_size),
        ):
            grid = pixel_grid(size, device).expand(len(rows), -1, -1)
            points = grid if to_template is None else project(to_template, pixel_grid(size, device))
            mask = inside(quad[rows], points, size)
            crops[rows] = torch.lerp(photos.sample(back, to_back, size), crops[rows], mask)

    positive = torch.rand(batch, device=device) >= negatives
    search = torch.where(positive[:, None, None, None], search, search.roll(1, 0))
    search, _ = occlude(photos, search, occluded, motion.shift, template_size / 2)
    search, _ = cut_by_border(search, 0.1 if occluded else 0.0)
    template, search = look.template(template), look.search(search)
    return SimilarityBatch(template * 255, search * 255, half, motion, positive, torch.randn_like(motion.shift))


@dataclass
class ResidualBatch:
    template: Tensor  # (B, 3, n, n), 0..255
    search: Tensor  # (B, 3, n, n), 0..255
    offsets: Tensor  # (B, 4, 2) px: where the target's corners lie in the search crop, less the crop's corners
    positive: Tensor  # (B,) bool
    clear: Tensor  # (B, 1, n, n) 0..1: where nothing hides what the search crop would show
    labelled: Tensor  # (B,) bool: the offsets are known

    def __add__(self, other: "ResidualBatch") -> "ResidualBatch":
        """Both batches' samples in one."""
        pairs = ((getattr(self, f.name), getattr(other, f.name)) for f in fields(self))
        return ResidualBatch(*(torch.cat(pair) for pair in pairs))


def residual_batch(
    photos: Photos, batch: int, size: int, reach: float, negatives: float = 0.2, occluded: float = 0.3,
    gentle: float = 0.5, look: Look = DEFAULT_LOOK,
) -> ResidualBatch:  # fmt: skip
    """Rectified template and search crops for the residual component, corners off by up to `reach` px."""
    device = photos.device
    index = random_photos(photos, batch)
    template_to_image = rectified(photos, index, size)
    spread = torch.where(torch.rand(batch, 1, 1, device=device) < gentle, 0.35, 1.0) * reach
    # Half of the displacement is common to the corners, as a translation left over by the similarity is.
    common = uniform((batch, 1, 2), -1, 1, device) * 0.5
    offsets = (common + uniform((batch, 4, 2), -1, 1, device) * 0.5) * spread
    corners = torch.tensor([[-1.0, -1], [1, -1], [1, 1], [-1, 1]], device=device) * size / 2
    matrix = dlt(offsets, corners)
    to_template = torch.linalg.inv(matrix)

    template = photos.sample(index, template_to_image, size)
    search = photos.sample(index, template_to_image @ to_template, size)
    back = random_photos(photos, batch)
    mask = inside(corners.expand(batch, 4, 2), project(to_template, pixel_grid(size, device)), size)
    own = (torch.rand(batch, 1, 1, 1, device=device) < 0.3).float()  # the photograph goes on beyond the target
    mask = torch.maximum(mask, own)
    behind = photos.sample(back, placed(random_view(batch, device, 0.4, 1.6)), size)
    search = torch.lerp(behind, search, mask)

    positive = torch.rand(batch, device=device) >= negatives
    search = torch.where(positive[:, None, None, None], search, search.roll(1, 0))
    search, hidden = occlude(photos, search, occluded, offsets.mean(1), size)
    search, beyond = cut_by_border(search, 0.1 if occluded else 0.0)
    template, search = look.template(template), look.search(search)
    offsets = torch.where(positive[:, None, None], offsets, 0.0)
    clear = (1 - hidden) * (1 - beyond)
    return ResidualBatch(template * 255, search * 255, offsets, positive, clear, torch.ones_like(positive))


def unlabelled_batch(clips: Photos, index: Tensor, later: Tensor, size: int) -> ResidualBatch:
    """Crops of one random quad in two frames of a clip each, index and later (B,): how it moved is not known.

    The frames are as the camera took them: what no augmentation can invent is what they are here for.
    """
    device, batch = clips.device, len(index)
    corners = torch.tensor([[-1.0, -1], [1, -1], [1, 1], [-1, 1]], device=device) * size / 2
    tilt = dlt(uniform((batch, 4, 2), -0.1, 0.1, device) * size, corners)
    crop_to_image = rectified(clips, index, size) @ tilt
    template, search = (clips.sample(frames, crop_to_image, size) * 255 for frames in (index, later))
    unknown = torch.zeros(batch, dtype=torch.bool, device=device)
    offsets = torch.zeros((batch, 4, 2), device=device)
    return ResidualBatch(template, search, offsets, ~unknown, torch.ones_like(template[:, :1]), unknown)
