"""Random motions of a target, and random views of photographs as homographies (B, 3, 3)."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from .photos import SIDE, Photos


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


@dataclass(frozen=True)
class MotionRanges:
    """The paper's ranges of a target's motion from one view to the other, to both sides of none."""

    shift: float = 32.0  # px of the crop
    scale: float = 1.38  # ratio
    rotation: float = 0.7  # rad
    residual: tuple[float, ...] = (0.1, 0.015, 0.0015, 0.0015)  # k1, k2, v1, v2 of `decomposition`
    gentle: float = 0.25  # share of these ranges that gentle motions stay within


MOTION = MotionRanges()


def random_motion(batch: int, device: torch.device, gentle: float = 0.5) -> Motion:
    """Motions over the paper's ranges; a share `gentle` is drawn from a part of them, as most frames move little."""
    reach = torch.where(torch.rand(batch, device=device) < gentle, MOTION.gentle, 1.0)
    shift = uniform((batch, 2), -MOTION.shift, MOTION.shift, device) * reach[:, None]
    log_scale = uniform(batch, -1, 1, device) * float(np.log(MOTION.scale)) * reach
    rotation = uniform(batch, -MOTION.rotation, MOTION.rotation, device) * reach
    spread = torch.tensor(MOTION.residual, device=device)
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
