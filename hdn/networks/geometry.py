"""Homographies and log-polar crops of batches, differentiable."""

import torch
import torch.nn.functional as F
from torch import Tensor


def dlt(offsets: Tensor, corners: Tensor) -> Tensor:
    """Direct linear transform, differentiable: corners (4, 2) and their offsets (B, 4, 2) to homographies (B, 3, 3)."""
    b = offsets.shape[0]
    source = corners.to(offsets).expand(b, 4, 2)
    target = source + offsets
    x, y = source.unbind(2)  # (B, 4) each
    u, v = target.unbind(2)
    zero, one = torch.zeros_like(x), torch.ones_like(x)
    system = torch.cat(
        [
            torch.stack([x, y, one, zero, zero, zero, -u * x, -u * y], 2),
            torch.stack([zero, zero, zero, x, y, one, -v * x, -v * y], 2),
        ],
        1,
    )  # (B, 8, 8)
    solution = torch.linalg.solve(system, torch.cat([u, v], 1))  # (B, 8)
    return torch.cat([solution, torch.ones_like(solution[:, :1])], 1).reshape(b, 3, 3)


def project(matrix: Tensor, points: Tensor) -> Tensor:
    """Points (M, 2) or (B, M, 2) through homographies (B, 3, 3), differentiable: (B, M, 2)."""
    p = F.pad(points, (0, 1), value=1.0) @ matrix.transpose(1, 2)
    return p[..., :2] / p[..., 2:]


def polar_crop(crops: Tensor, centre: Tensor, points: Tensor) -> Tensor:
    """Log-polar crops (B, 3, n, n) of square crops (B, 3, m, m) about centre (B, 2), px from the crops' centres."""
    m = crops.shape[-1]
    grid = (points[None] + centre[:, None, None]) * (2 / m)
    return F.grid_sample(crops, grid, padding_mode="border", align_corners=False)
