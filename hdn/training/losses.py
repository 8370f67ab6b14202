"""Labels and losses of the components, as in the paper; equations by their order there."""

import math

import torch
import torch.nn.functional as F
from torch import Tensor


def grid_points(cells: int, stride: int, device: torch.device) -> Tensor:
    """What the cells of a correlation map stand for: shifts (n, n, 2) in px of the crop, x first."""
    r = (torch.arange(cells, device=device, dtype=torch.float32) - cells // 2) * stride
    y, x = torch.meshgrid(r, r, indexing="ij")
    return torch.stack([x, y], -1)


def hamming_labels(points: Tensor, shift: Tensor, scale: Tensor, rotation: Tensor, half: Tensor) -> Tensor:
    """Probability (B, n, n) of the target's centre: a Hamming window over its box, rotated and scaled with it.

    Args:
        points: (n, n, 2) px of the search crop, from its centre.
        shift: (B, 2) px; scale: (B,) ratio; rotation: (B,) rad: the target's motion.
        half: (B, 2) half width and half height of its box in the template, px.
    """
    offset = points[None] - shift[:, None, None]
    c, s = rotation.cos()[:, None, None], rotation.sin()[:, None, None]
    x, y = offset[..., 0], offset[..., 1]
    own = torch.stack([c * x + s * y, c * y - s * x], -1) / (scale[:, None] * half)[:, None, None]
    window = 0.54 + 0.46 * (math.pi * own).cos()
    return torch.where((own.abs() < 1).all(-1), window.prod(-1), 0.0)


def classification_loss(probability: Tensor, label: Tensor, threshold: float = 0.7, top: int = 100) -> Tensor:
    """L_cls of the translation map: hardest negatives by log-loss, positives by distance to their label.

    Both maps are (B, n, n). Positives are where the label exceeds the threshold; of the others, the `top` most probable
    of each sample count, so that hard negatives are not drowned by easy ones.
    """
    positive = label > threshold
    negative = probability.masked_fill(positive, 0.0).flatten(1)
    hardest = negative.topk(min(top, negative.shape[1]), dim=1).values
    loss = -torch.log1p(-hardest.clamp_max(1 - 1e-6)).mean()
    if positive.any():
        loss = loss + (probability - label)[positive].abs().mean()
    return loss


def peak_loss(score: Tensor, target: Tensor, positive: Tensor) -> Tensor:
    """Cross-entropy of where the peak of maps (B, n, n) of logits is, their truth (B, 2) in cells shared among four."""
    b, n, _ = score.shape
    probability = score.reshape(b, 1, n * n).softmax(2)
    return matching_loss(probability, target[:, None], positive[:, None], n)


def polar_labels(points: Tensor, truth: Tensor, stride: int) -> Tensor:
    """Labels (B, n, n) of the log-polar map: 1 at the truth (B, 2) px, 0 off it, -1 between, where nothing counts."""
    distance = (points[None] - truth[:, None, None]).norm(dim=-1) / stride
    return torch.where(distance < 0.75, 1, torch.where(distance < 1.5, -1, 0))


def polar_classification_loss(logits: Tensor, labels: Tensor) -> Tensor:
    """L_cls2: cross-entropy of logits (B, 2, n, n), positives and negatives weighing the same."""
    losses = F.cross_entropy(logits, labels, ignore_index=-1, reduction="none")
    parts = [losses[labels == value] for value in (0, 1)]
    return torch.stack([part.mean() for part in parts if len(part)]).mean()


def offset_loss(
    offsets: Tensor, points: Tensor, truth: Tensor, where: Tensor, stride: int, beta: float = 0.2
) -> Tensor:
    """L_reg: smooth l1 of offsets (B, 2, n, n), in cells, to (grid point - truth) where the mask (B, n, n) is set.

    Args: beta: cells of error beyond which it is linear.
    """
    if not where.any():
        return offsets.sum() * 0
    label = (points[None] - truth[:, None, None]) / stride  # (B, n, n, 2)
    return F.smooth_l1_loss(offsets.permute(0, 2, 3, 1)[where], label[where], beta=beta)


def corner_loss(offsets: Tensor, truth: Tensor) -> Tensor:
    """Supervised loss: l1 norm of the corner offsets' error, (B, 4, 2) px each."""
    return (offsets - truth).abs().sum(2).mean() if len(offsets) else offsets.sum() * 0


def negative_loss(offsets: Tensor) -> Tensor:
    """L_Lambda-: smooth l1 that pulls the offsets (B, 4, 2) of pairs of different objects to zero."""
    return F.smooth_l1_loss(offsets, torch.zeros_like(offsets)) if len(offsets) else offsets.sum() * 0


def warp(crops: Tensor, matrix: Tensor) -> Tensor:
    """W(T, H), a spatial transformer: crops (B, C, n, n) seen through homographies (B, 3, 3), differentiable in both.

    The homographies map pixels of the result to those of the crops, both relative to the crop's centre; beyond the
    crop goes on what is at its edge.
    """
    b, _, n, _ = crops.shape
    r = torch.arange(n, dtype=crops.dtype, device=crops.device) - (n - 1) / 2
    y, x = torch.meshgrid(r, r, indexing="ij")
    points = torch.stack([x, y, torch.ones_like(x)], -1).reshape(1, -1, 3) @ matrix.transpose(1, 2)
    grid = (points[..., :2] / points[..., 2:].clamp_min(1e-3) * (2 / n)).reshape(b, n, n, 2)
    return F.grid_sample(crops, grid, padding_mode="border", align_corners=False)


def triplet_loss(search: Tensor, warped: Tensor, template: Tensor, margin: float = 1.0) -> Tensor:
    """L_Lambda+*: E(search) shall be nearer to E(warped template) than to E(template), maps (B, 1, m, m), per pixel."""
    nearer, farther = (search - warped).norm(dim=1), (search - template).norm(dim=1)
    return F.relu(nearer - farther + margin).mean() if len(search) else search.sum() * 0


def matching_loss(probability: Tensor, target: Tensor, seen: Tensor, cells: int) -> Tensor:
    """Cross-entropy of where points are found, their truth shared among the four cells around it.

    Args:
        probability: (B, M, cells * cells).
        target: (B, M, 2) true places in cells, x first.
        seen: (B, M) bool, what counts.
    """
    low = target.floor()
    right, down = (target - low).unbind(2)
    share = torch.stack([(1 - right) * (1 - down), right * (1 - down), (1 - right) * down, right * down], 2)
    around = low[:, :, None] + torch.tensor([[0.0, 0], [1, 0], [0, 1], [1, 1]]).to(low)  # (B, M, 4, 2)
    x, y = around.clamp(0, cells - 1).long().unbind(3)
    entropy = -(share * probability.gather(2, y * cells + x).clamp_min(1e-9).log()).sum(2)
    return (entropy * seen).sum() / seen.sum().clamp_min(1)
