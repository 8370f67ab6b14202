"""Training samples, synthesised in batches on the training device.

A sample shows a planar target twice: as the template and, moved by a known homography, as the search crop, with light,
blur, noise, occluders and frame borders of its own. Everything is a tensor; nothing loops over samples.
"""

import functools
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields
from pathlib import Path

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from .errors import InputError
from .homography import dlt
from .jpeg import compress
from .sampling import Image

SIDE = 304  # images are kept as squares of this side; their aspect does not matter to a texture


def read_photo(path: Path) -> Tensor:
    """An image file as uint8 RGB (3, SIDE, SIDE).

    Raises:
        InputError: it cannot be read.
    """
    image = cv2.imread(str(path), cv2.IMREAD_COLOR_RGB)
    if image is None:
        raise InputError(f"{path} is not an image that can be read: remove it from the training folders")
    return squared(np.asarray(image, np.uint8))


def squared(image: Image) -> Tensor:
    """An RGB image (H, W, 3) as uint8 (3, SIDE, SIDE)."""
    shrinks = min(image.shape[:2]) > SIDE
    image = cv2.resize(image, (SIDE, SIDE), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_CUBIC)
    return torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1)))


class Photos:
    """Images held in memory as one uint8 tensor (N, 3, SIDE, SIDE)."""

    def __init__(self, pixels: Tensor, device: torch.device | str = "cpu") -> None:
        self.pixels = pixels.to(device)
        self.device = self.pixels.device

    @classmethod
    def read(cls, paths: Sequence[Path], device: torch.device | str = "cpu") -> "Photos":
        """Photos from image files; raises InputError for one that cannot be read."""
        pixels = torch.empty((len(paths), 3, SIDE, SIDE), dtype=torch.uint8)
        with ThreadPoolExecutor() as readers:
            for i, image in enumerate(readers.map(read_photo, paths)):
                pixels[i] = image
        return cls(pixels, device)

    def __len__(self) -> int:
        return len(self.pixels)

    def sample(self, index: Tensor, crop_to_image: Tensor, size: int) -> Tensor:
        """Crops (B, 3, size, size), 0..1, of images index (B,) through homographies (B, 3, 3).

        Crop and image coordinates are relative to their centres; an image goes on beyond its border as its own mirror
        image.
        """
        unit = torch.diag(torch.tensor([2 / SIDE, 2 / SIDE, 1], device=self.device))
        grid = project(unit @ crop_to_image, pixel_grid(size, self.device)).reshape(-1, size, size, 2)
        images = self.pixels[index].float().div_(255)
        return F.grid_sample(images, grid, padding_mode="reflection", align_corners=False)


@functools.lru_cache
def pixel_grid(size: int, device: torch.device) -> Tensor:
    """Pixel coordinates (size*size, 2) relative to the crop's centre, x first."""
    r = torch.arange(size, device=device, dtype=torch.float32) - (size - 1) / 2
    y, x = torch.meshgrid(r, r, indexing="ij")
    return torch.stack([x, y], -1).reshape(-1, 2)


def project(matrix: Tensor, points: Tensor) -> Tensor:
    """Points (N, 2) through homographies (B, 3, 3): (B, N, 2)."""
    p = F.pad(points, (0, 1), value=1.0) @ matrix.transpose(1, 2)
    return p[..., :2] / p[..., 2:].clamp_min(1e-3)


def uniform(shape: int | tuple[int, ...], low: float, high: float, device: torch.device) -> Tensor:
    return torch.empty(shape, device=device).uniform_(low, high)


def decomposition(scale: Tensor, rotation: Tensor, shift: Tensor, residual: Tensor) -> Tensor:
    """H = H_S H_Lambda (paper, eq. 2): scale (B,), rotation (B,), shift (B, 2), residual (B, 4) = k1, k2, v1, v2."""
    b = len(scale)
    k1, k2, v1, v2 = residual.unbind(1)
    zero, one = torch.zeros_like(scale), torch.ones_like(scale)
    c, s = scale * rotation.cos(), scale * rotation.sin()
    group = torch.stack([c, -s, shift[:, 0], s, c, shift[:, 1], zero, zero, one], 1).reshape(b, 3, 3)
    rest = torch.stack([k1, k2, zero, zero, 1 / k1, zero, v1, v2, one], 1).reshape(b, 3, 3)
    return group @ rest


@dataclass
class Motion:
    """Parameters of a batch of homographies about the crops' centres."""

    shift: Tensor  # (B, 2) px
    log_scale: Tensor  # (B,)
    rotation: Tensor  # (B,) rad
    matrix: Tensor  # (B, 3, 3) template to search, both relative to the crop's centre


def random_motion(batch: int, device: torch.device, gentle: float = 0.5) -> Motion:
    """Motions over the paper's ranges; a share `gentle` is drawn from a quarter of them, as most frames move little."""
    reach = torch.where(torch.rand(batch, device=device) < gentle, 0.25, 1.0)
    shift = uniform((batch, 2), -32, 32, device) * reach[:, None]
    log_scale = uniform(batch, -1, 1, device) * float(np.log(1.38)) * reach
    rotation = uniform(batch, -0.7, 0.7, device) * reach
    spread = torch.tensor([0.1, 0.015, 0.0015, 0.0015], device=device)
    residual = uniform((batch, 4), -1, 1, device) * spread * reach[:, None]
    residual[:, 0] += 1
    return Motion(shift, log_scale, rotation, decomposition(log_scale.exp(), rotation, shift, residual))


def random_view(batch: int, device: torch.device, low: float, high: float) -> Tensor:
    """Random similarities (B, 3, 3) about the origin with a scale between low and high, mirrored half the time."""
    scale = (uniform(batch, 0, 1, device) * float(np.log(high / low))).exp() * low
    angle = uniform(batch, -0.5, 0.5, device)
    mirror = torch.where(torch.rand(batch, device=device) < 0.5, 1.0, -1.0)
    zero, one = torch.zeros_like(scale), torch.ones_like(scale)
    c, s = scale * angle.cos(), scale * angle.sin()
    return torch.stack([c * mirror, -s, zero, s * mirror, c, zero, zero, zero, one], 1).reshape(batch, 3, 3)


def placed(view: Tensor) -> Tensor:
    """Views (B, 3, 3) about the origin made to look at a random point in the images' inner half."""
    move = torch.eye(3, device=view.device).repeat(len(view), 1, 1)
    move[:, :2, 2] = uniform((len(view), 2), -SIDE / 4, SIDE / 4, view.device)
    return move @ view


def textured(photos: Photos, index: Tensor, size: int, low: float, high: float) -> Tensor:
    """Views (B, 3, 3) of photographs for crops of a size: of two drawn, the one that shows more texture.

    A target is chosen by somebody who wants it found: a patch of sky is a rare one.
    """
    n = 24
    coarse = torch.diag(torch.tensor([size / n, size / n, 1.0], device=photos.device))
    views, texture = [], []
    for _ in range(2):
        views.append(placed(random_view(len(index), photos.device, low, high)))
        grey = photos.sample(index, views[-1] @ coarse, n).mean(1)
        texture.append(grey.diff(dim=1).abs().mean((1, 2)) + grey.diff(dim=2).abs().mean((1, 2)))
    return torch.where((texture[0] > texture[1])[:, None, None], views[0], views[1])


def rectified(photos: Photos, index: Tensor, size: int) -> Tensor:
    """Views (B, 3, 3) of photographs for square crops of targets that are not square."""
    stretch = (uniform(len(index), -0.5, 0.5, photos.device)).exp()
    stretch = torch.diag_embed(torch.stack([stretch, 1 / stretch, torch.ones_like(stretch)], 1))
    return textured(photos, index, size, 0.5, 1.8) @ stretch


def inside(quad: Tensor, points: Tensor, size: int) -> Tensor:
    """Masks (B, 1, size, size), soft over a pixel, of the points (B, size*size, 2) in convex clockwise quads."""
    edge = quad.roll(-1, 1) - quad
    normal = torch.stack([-edge[..., 1], edge[..., 0]], -1) / edge.norm(dim=-1, keepdim=True)
    level = (normal * quad).sum(-1)
    distance = torch.baddbmm(-level[:, None], points, normal.transpose(1, 2))  # (B, N, 4)
    return distance.amin(2).add_(0.5).clamp_(0, 1).reshape(-1, 1, size, size)


def random_photos(photos: Photos, batch: int) -> Tensor:
    return torch.randint(len(photos), (batch,), device=photos.device)


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
    b = len(rows)
    half = uniform((b, 2), float(np.log(0.06)), float(np.log(0.6)), device).exp() * extent
    angle = uniform(b, 0, 2 * np.pi, device)
    axes = torch.stack([angle.cos(), angle.sin()], 1)
    across = torch.stack([-axes[:, 1], axes[:, 0]], 1)
    sign = torch.tensor([[-1.0, -1], [1, -1], [1, 1], [-1, 1]], device=device)
    quad = sign[None, :, :1] * (axes * half[:, :1])[:, None] + sign[None, :, 1:] * (across * half[:, 1:])[:, None]
    # Its near edge may cross the target's middle, but leaves a fifth of it to see.
    near = uniform((b, 1), -0.3, 0.5, device) * extent + half[:, :1]
    centre = about[rows] + axes * near + across * uniform((b, 1), -0.4, 0.4, device) * extent
    quad = quad + centre[:, None]
    grid = pixel_grid(size, device).expand(b, -1, -1)
    other = photos.sample(random_photos(photos, b), placed(random_view(b, device, 0.4, 1.6)), size)
    plain = uniform((b, 3, 1, 1), 0, 1, device)
    other = torch.where(torch.rand(b, 1, 1, 1, device=device) < 0.3, plain, other)
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
    reach = uniform((b, 1), 0.1, 0.45, device) * size
    grid = pixel_grid(size, device)
    axis = torch.stack([grid[:, 0], -grid[:, 0], grid[:, 1], -grid[:, 1]])[side[:, 0]]  # (B, n*n)
    beyond = ((axis > reach) & (torch.rand(b, 1, device=device) < share)).reshape(b, 1, size, size)
    return torch.where(beyond, crops.mean((2, 3), keepdim=True), crops), beyond.float()


def blur(crops: Tensor, share: float, reach: int) -> Tensor:
    """Motion blur in a share of crops (B, 3, n, n): a box along a random line of up to `reach` (odd) px."""
    device = crops.device
    rows = (torch.rand(len(crops), device=device) < share).nonzero()[:, 0]
    if not len(rows):
        return crops
    b, (_, c, h, w) = len(rows), crops.shape
    length = uniform((b, 1), 1.5, reach, device)
    angle = uniform((b, 1), 0, np.pi, device)
    grid = pixel_grid(reach, device)
    along = grid[:, 0] * angle.cos() + grid[:, 1] * angle.sin()  # (B, reach*reach)
    across = grid[:, 1] * angle.cos() - grid[:, 0] * angle.sin()
    kernel = (length / 2 - along.abs() + 0.5).clamp(0, 1) * (1 - across.abs()).clamp(0, 1)
    kernel = (kernel / kernel.sum(1, keepdim=True)).reshape(b, 1, reach, reach).repeat_interleave(c, 0)
    padded = F.pad(crops[rows], [reach // 2] * 4, mode="replicate").reshape(1, b * c, h + reach - 1, w + reach - 1)
    crops = crops.clone()
    crops[rows] = F.conv2d(padded, kernel, groups=b * c).reshape(b, c, h, w)
    return crops


def coarsen(crops: Tensor, share: float) -> Tensor:
    """A share of crops (B, 3, n, n) seen at a lower resolution, as small targets are."""
    device = crops.device
    rows = (torch.rand(len(crops), device=device) < share).nonzero()[:, 0]
    if not len(rows):
        return crops
    size = int(crops.shape[-1] / float(uniform(1, 1.3, 4, device)))
    small = F.interpolate(crops[rows], (size, size), mode="bilinear", antialias=True, align_corners=False)
    crops = crops.clone()
    crops[rows] = F.interpolate(small, crops.shape[-2:], mode="bilinear", align_corners=False)
    return crops


def relight(crops: Tensor, strength: float = 1.0, darkened: float = 0.1) -> Tensor:
    """Gain, bias, gamma, colour cast, a ramp of light, sensor noise, and darkness of some: crops (B, 3, n, n), 0..1."""
    device, (b, _, size, _) = crops.device, crops.shape
    curve = uniform((b, 1, 1, 1), -0.5, 0.5, device) * strength  # as a gamma bends the tones, but cheap
    gain = (uniform((b, 1, 1, 1), -0.4, 0.4, device) * strength).exp()
    cast = (uniform((b, 3, 1, 1), -0.12, 0.12, device) * strength).exp()
    is_dark = torch.rand(b, 1, 1, 1, device=device) < darkened * strength
    dark = torch.where(is_dark, uniform((b, 1, 1, 1), 0.15, 0.5, device), 1.0)
    bias = uniform((b, 1, 1, 1), -0.1, 0.1, device) * strength * dark
    angle = uniform((b, 1), 0, 2 * np.pi, device)
    steepness = uniform((b, 1), 0, 0.8, device) * strength / size
    grid = pixel_grid(size, device)
    ramp = 1 + grid[:, 0] * (angle.cos() * steepness) + grid[:, 1] * (angle.sin() * steepness)
    sigma = uniform((b, 1, 1, 1), 0, 1, device) ** 3 * 0.05 * strength
    x = torch.addcmul(crops, crops, (1 - crops).mul_(curve)).mul_(ramp.reshape(b, 1, size, size))
    x = x.mul_(gain * cast * dark).add_(bias)
    return x.add_(torch.randn_like(x).mul_(sigma)).clamp_(0, 1)


def code(crops: Tensor, share: float) -> Tensor:
    """A share of crops (B, 3, n, n) in 0..1 as lossy compression of qualities 20 to 80 leaves them."""
    device = crops.device
    rows = (torch.rand(len(crops), device=device) < share).nonzero()[:, 0]
    if not len(rows):
        return crops
    left, top = (int(v) for v in torch.randint(8, (2,)))
    crops = crops.clone()
    crops[rows] = compress(crops[rows], uniform(len(rows), 20, 80, device), (left, top))
    return crops


@dataclass(frozen=True)
class Look:
    """What happens to the search crops' look besides light and noise, each in a share of them; templates get less."""

    blurred: float = 0.25
    coarse: float = 0.2
    darkened: float = 0.1
    compressed: float = 0.0

    def search(self, crops: Tensor) -> Tensor:
        """Search crops (B, 3, n, n), 0..1, as a camera shows them."""
        crops = relight(coarsen(blur(crops, self.blurred, 15), self.coarse), 1.0, self.darkened)
        return code(crops, self.compressed)

    def template(self, crops: Tensor) -> Tensor:
        """Template crops (B, 3, n, n), 0..1: chosen by somebody, and so better to see."""
        crops = relight(coarsen(blur(crops, self.blurred / 5, 7), self.coarse / 2), 0.6, self.darkened)
        return code(crops, self.compressed)


USUAL = Look()


@dataclass
class SimilarityBatch:
    template: Tensor  # (B, 3, 127, 127), 0..255
    search: Tensor  # (B, 3, 255, 255), 0..255
    target: Tensor  # (B, 2) half width and half height of the target's box in the template, px
    motion: Motion
    positive: Tensor  # (B,) bool: the search shows the template's target


def similarity_batch(
    photos: Photos, batch: int, template_size: int, search_size: int, context: float, negatives: float = 0.2,
    occluded: float = 0.3,
    gentle: float = 0.5, look: Look = USUAL,
) -> SimilarityBatch:  # fmt: skip
    """Template and search crops for the similarity component."""
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
    return SimilarityBatch(template * 255, search * 255, half, motion, positive)


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
    gentle: float = 0.5, look: Look = USUAL,
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
