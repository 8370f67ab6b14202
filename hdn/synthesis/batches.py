"""Batches of samples, put together from views, covers and looks."""

from dataclasses import dataclass, fields

import torch
from torch import Tensor

from ..networks.geometry import dlt, project
from .covers import NOTHING, Hiding, cut_by_border, hide, inside, occlude
from .drawings import screens
from .looks import DEFAULT_LOOK, Look
from .photos import Photos, pixel_grid, random_photos
from .shapes import Outlines
from .views import Motion, placed, random_motion, random_view, rectified, textured, uniform


class Surface:
    """What the pairs show: photographs index (B,), and screens instead of them in a share `plain`.

    Attributes:
        is_screen: (B,) bool.
    """

    def __init__(self, photos: Photos, index: Tensor, plain: float) -> None:
        self._photos, self._index = photos, index
        self.is_screen = torch.zeros_like(index, dtype=torch.bool)
        if plain:
            self.is_screen = torch.rand(len(index), device=photos.device) < plain
        self._rows = self.is_screen.nonzero()[:, 0]
        self._screens = screens(Outlines(photos, len(index)), len(self._rows)) if len(self._rows) else None

    def sample(self, crop_to_image: Tensor, size: int) -> Tensor:
        """Crops (B, 3, size, size), 0..1, as of `Photos.sample`."""
        crops = self._photos.sample(self._index, crop_to_image, size)
        if self._screens is not None:
            numbers = torch.arange(len(self._rows), device=crops.device)
            crops[self._rows] = self._screens.sample(numbers, crop_to_image[self._rows], size)
        return crops


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
    hiding: Hiding = NOTHING, gentle: float = 0.5, look: Look = DEFAULT_LOOK, plain: float = 0.0,
) -> SimilarityBatch:  # fmt: skip
    """Template and search crops for both branches of the similarity component; a share `plain` is of screens."""
    device = photos.device
    index = random_photos(photos, batch)
    template_to_image = textured(photos, index, template_size, 0.4, 1.5)
    surface = Surface(photos, index, plain)
    motion = random_motion(batch, device, gentle)

    # The target's box in the template: its window, box plus context, is the whole crop.
    aspect = (uniform(batch, -0.9, 0.9, device)).exp()
    w, h = aspect.sqrt(), 1 / aspect.sqrt()
    margin = context * (w + h)
    window = ((w + margin) * (h + margin)).sqrt()
    half = torch.stack([w, h], 1) * (template_size / 2 / window)[:, None]
    corner = torch.tensor([[-1.0, -1], [1, -1], [1, 1], [-1, 1]], device=device)
    quad = half[:, None] * corner * uniform((batch, 4, 2), 0.75, 1, device)

    template = surface.sample(template_to_image, template_size)
    search = surface.sample(template_to_image @ torch.linalg.inv(motion.matrix), search_size)

    # Half the targets lie on a background that does not move with them, and all screens.
    rows = ((torch.rand(batch, device=device) < 0.5) | surface.is_screen).nonzero()[:, 0]
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
    kinds, extent = hiding.kinds(batch, device), template_size / 2
    search, _ = occlude(photos, search, kinds == 0, motion.shift, extent)
    search, _ = hide(photos, search, kinds, motion.shift, extent, motion.rotation)
    search, _ = cut_by_border(search, hiding.border)
    never_seen = hiding.some_templates(batch, device)
    template, _ = occlude(photos, template, never_seen, torch.zeros_like(motion.shift), extent)
    template, search = look.template(template), look.search(search)
    return SimilarityBatch(template * 255, search * 255, half, motion, positive, torch.randn_like(motion.shift))


@dataclass
class ResidualBatch:
    template: Tensor  # (B, 3, n, n), 0..255
    search: Tensor  # (B, 3, n, n), 0..255
    offsets: Tensor  # (B, 4, 2) px: where the target's corners lie in the search crop, less the crop's corners
    positive: Tensor  # (B,) bool
    clear: Tensor  # (B, 1, n, n) 0..1: where nothing hides what the search crop would show
    known: Tensor  # (B, 1, n, n) 0..1: where nothing hides what the template would show
    labelled: Tensor  # (B,) bool: the offsets are known

    def __add__(self, other: "ResidualBatch") -> "ResidualBatch":
        """Both batches' samples in one."""
        pairs = ((getattr(self, f.name), getattr(other, f.name)) for f in fields(self))
        return ResidualBatch(*(torch.cat(pair) for pair in pairs))


def residual_batch(
    photos: Photos, batch: int, size: int, reach: float, negatives: float = 0.2, hiding: Hiding = NOTHING,
    gentle: float = 0.5, look: Look = DEFAULT_LOOK, plain: float = 0.0,
) -> ResidualBatch:  # fmt: skip
    """Rectified template and search crops for the residual component, corners off by up to `reach` px.

    A share `plain` of them is of screens.
    """
    device = photos.device
    index = random_photos(photos, batch)
    template_to_image = rectified(photos, index, size)
    surface = Surface(photos, index, plain)
    spread = torch.where(torch.rand(batch, 1, 1, device=device) < gentle, 0.35, 1.0) * reach
    # Half of the displacement is common to the corners, as a translation left over by the similarity is.
    common = uniform((batch, 1, 2), -1, 1, device) * 0.5
    offsets = (common + uniform((batch, 4, 2), -1, 1, device) * 0.5) * spread
    corners = torch.tensor([[-1.0, -1], [1, -1], [1, 1], [-1, 1]], device=device) * size / 2
    matrix = dlt(offsets, corners)
    to_template = torch.linalg.inv(matrix)

    template = surface.sample(template_to_image, size)
    search = surface.sample(template_to_image @ to_template, size)
    back = random_photos(photos, batch)
    mask = inside(corners.expand(batch, 4, 2), project(to_template, pixel_grid(size, device)), size)
    own = (torch.rand(batch, device=device) < 0.3) & ~surface.is_screen  # the photograph goes on beyond the target
    mask = torch.maximum(mask, own[:, None, None, None].float())
    behind = photos.sample(back, placed(random_view(batch, device, 0.4, 1.6)), size)
    search = torch.lerp(behind, search, mask)

    positive = torch.rand(batch, device=device) >= negatives
    search = torch.where(positive[:, None, None, None], search, search.roll(1, 0))
    kinds, about = hiding.kinds(batch, device), offsets.mean(1)
    search, by_quad = occlude(photos, search, kinds == 0, about, size)
    search, by_others = hide(photos, search, kinds, about, size, torch.zeros(batch, device=device))
    search, beyond = cut_by_border(search, hiding.border)
    never_seen = hiding.some_templates(batch, device)
    template, unknown = occlude(photos, template, never_seen, torch.zeros_like(about), size)
    template, search = look.template(template), look.search(search)
    offsets = torch.where(positive[:, None, None], offsets, 0.0)
    clear = (1 - by_quad) * (1 - by_others) * (1 - beyond)
    known = 1 - unknown
    return ResidualBatch(template * 255, search * 255, offsets, positive, clear, known, torch.ones_like(positive))


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
    clear = torch.ones_like(template[:, :1])
    return ResidualBatch(template, search, offsets, ~unknown, clear, clear, unknown)
