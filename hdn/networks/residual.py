"""The residual component: corner offsets of what the similarity left over.

Paper: "Residual Component". Its crops show the target's own quad, rectified to a square: the regressed corners are the
target's corners, whatever its shape, and nothing in view moves on its own.

Where the paper's network regresses the offsets from both crops at once, the compact one matches: descriptors of a grid
of points are looked up in the search crop, and the homography that the matches agree on, each as far as the network
trusts it, gives the corners. Trust that is nowhere leaves the corners where they are: the paper's negative sample.
"""

import functools
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from .config import Config

DESCRIPTOR_STRIDE = 4  # px
POINT_STEP = 8  # px between the points that are looked up
CHANNELS = 32  # of the descriptors


@dataclass(frozen=True)
class Matching:
    """Constants of how the compact network matches, which the shipped weights were trained with."""

    reach: float = 28.0  # px that a point is looked for to each side
    ridge: float = 0.25  # on each of the homography's eight parameters, against a few hundred points of weight 1


MATCHING = Matching()


def _conv(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False), nn.BatchNorm2d(outputs), nn.ReLU(inplace=True)
    )


def standardise(crops: Tensor) -> Tensor:
    """RGB (B, 3, n, n), any range, to grey (B, 1, n, n) of zero mean and unit deviation: free of gain and bias."""
    grey = crops.mean(1, keepdim=True)
    centred = grey - grey.mean((2, 3), keepdim=True)
    variance = centred.square().mean((2, 3), keepdim=True)
    return centred / (variance.clamp_min(1e-6).sqrt() + 2)  # of a crop without contrast the root has no gradient


class Extractor(nn.Module):
    """E in the paper: grey (B, 1, n, n) to unit descriptors (B, C, n / 4, n / 4), cell (i, j) on pixel (4i, 4j)."""

    def __init__(self) -> None:
        super().__init__()
        self.fine = nn.Sequential(_conv(1, 16, 2), _conv(16, CHANNELS, 2), _conv(CHANNELS, CHANNELS))
        self.coarse = nn.Sequential(_conv(CHANNELS, 48, 2), _conv(48, 48), nn.Conv2d(48, CHANNELS, 1))
        self.merge = nn.Sequential(_conv(CHANNELS, CHANNELS), nn.Conv2d(CHANNELS, CHANNELS, 1))

    def forward(self, grey: Tensor) -> Tensor:
        fine = self.fine(grey)
        coarse = F.interpolate(self.coarse(fine), scale_factor=2.0, mode="bilinear", align_corners=False)
        return F.normalize(self.merge(fine + coarse), dim=1)


@dataclass
class Matches:
    """What the points of the template, a grid of m x m, found in the search crop.

    Attributes:
        probability: (B, m * m, n * n) over the cells of the search crop's descriptors.
        displacement: (B, m * m, 2) px.
        weight: (B, m * m) 0..1, in the fit of the homography.
        visible: (B, m * m) logit that the point is seen at all.
    """

    probability: Tensor
    displacement: Tensor
    weight: Tensor
    visible: Tensor


class ResidualNetwork(nn.Module):
    """Template and search crops, RGB (B, 3, n, n), to corner offsets (B, 4, 2) in crop pixels.

    Offsets go from the crop's corners (top-left, top-right, bottom-right, bottom-left) to where the target's corners
    lie in the search crop.
    """

    def __init__(self, config: Config) -> None:
        super().__init__()
        self.size = config.residual_size
        self.extractor = Extractor()
        self.sharpness = nn.Parameter(torch.tensor(2.5))  # log of what multiplies the descriptors' cosines
        # From what the look-up of each point gave, and its neighbours', to corrections, weight and visibility.
        self.judge = nn.Sequential(_conv(6, 32), _conv(32, 32), _conv(32, 32), nn.Conv2d(32, 4, 1))

    def describe(self, crops: Tensor) -> Tensor:
        """RGB crops (B, 3, n, n) to descriptors (B, C, n / 4, n / 4)."""
        return self.extractor(standardise(crops))

    def compare(self, template: Tensor, crops: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Descriptors of the template and RGB search crops to what `conclude` takes."""
        matches = self.match(template, self.describe(crops))
        return *self.equations(matches.displacement, matches.weight), matches.visible

    def conclude(self, normal: Tensor, right: Tensor, visible: Tensor) -> tuple[Tensor, Tensor]:
        """Offsets (B, 4, 2) px of the corners, and the probability (B, m, m) that each part of the target is seen."""
        m = self.size // POINT_STEP
        return self.solve(normal, right), visible.sigmoid().reshape(-1, m, m)

    def match(self, template: Tensor, search: Tensor) -> Matches:
        """Descriptors of both crops, each (B, C, n / 4, n / 4), to matches."""
        m = self.size // POINT_STEP
        source, cells, near = geometry(self.size, template.device)
        # The mask is added by the same operation that correlates: these maps are the largest there are.
        step = POINT_STEP // DESCRIPTOR_STRIDE
        points = template[:, :, ::step, ::step].flatten(2).transpose(1, 2)
        score = torch.baddbmm(near, points * self.sharpness.exp(), search.flatten(2))
        probability = score.softmax(2)
        moments = probability @ torch.cat([cells, cells.square().sum(1, keepdim=True) / 64], 1)
        mean = moments[..., :2]
        displacement = mean - source
        spread = moments[..., 2] * 64 - mean.square().sum(2)
        best = probability.detach().amax(2)
        evidence = torch.stack(
            [
                *(displacement / 16).unbind(2),
                best,
                best.clamp_min(1e-6).log() / 4,
                spread.clamp_min(0).add(1).log() / 4,
                score.detach().amax(2) / 8,
            ],
            1,
        )
        judged = self.judge(evidence.unflatten(2, (m, m))).flatten(2)
        displacement = displacement + judged[:, :2].transpose(1, 2)
        return Matches(probability, displacement, judged[:, 2].sigmoid() * judged[:, 3].sigmoid(), judged[:, 3])

    def fit(self, displacement: Tensor, weight: Tensor) -> Tensor:
        """Offsets (B, 4, 2) of the corners by the homography that fits weighted displacements (B, m * m, 2) best.

        Ridge regression of its parameters' difference to the identity's: no weight, no motion.
        """
        return self.solve(*self.equations(displacement, weight))

    def equations(self, displacement: Tensor, weight: Tensor) -> tuple[Tensor, Tensor]:
        """The normal equations of that regression: (B, 8, 8) and (B, 8)."""
        half = self.size / 2
        source, _, _ = geometry(self.size, displacement.device)
        x, y = (source / half).to(displacement).unbind(1)
        u, v = ((source + displacement) / half).unbind(2)
        one, zero = torch.ones_like(u), torch.zeros_like(u)
        x, y = x.expand_as(u), y.expand_as(v)
        rows = torch.cat(
            [
                torch.stack([x, y, one, zero, zero, zero, -u * x, -u * y], 2),
                torch.stack([zero, zero, zero, x, y, one, -v * x, -v * y], 2),
            ],
            1,
        )  # (B, 2 m * m, 8)
        right = torch.cat((displacement / half).unbind(2), 1)
        weighted = rows * torch.cat([weight, weight], 1)[..., None]
        normal = weighted.transpose(1, 2) @ rows + MATCHING.ridge * torch.eye(8).to(rows)
        return normal, (weighted.transpose(1, 2) @ right[..., None])[..., 0]

    def solve(self, normal: Tensor, right: Tensor) -> Tensor:
        """Offsets (B, 4, 2) px of the corners by the normal equations."""
        solution = torch.linalg.solve(normal, right)
        identity = torch.tensor([1.0, 0, 0, 0, 1, 0, 0, 0]).to(solution)
        matrix = F.pad(solution + identity, (0, 1), value=1.0).reshape(-1, 3, 3)
        corners = F.pad(torch.tensor([[-1.0, -1], [1, -1], [1, 1], [-1, 1]]), (0, 1), value=1.0).to(matrix)
        moved = corners @ matrix.transpose(1, 2)
        return (moved[..., :2] / moved[..., 2:].clamp_min(0.1) - corners[:, :2]) * (self.size / 2)


@functools.lru_cache
@torch.inference_mode(False)  # what is kept may be used in training next
def geometry(size: int, device: torch.device) -> tuple[Tensor, Tensor, Tensor]:
    """Points looked up (m * m, 2) and cells looked in (n * n, 2), px from the crop's centre; -1e4 where too far off."""
    r = torch.arange(0, size, DESCRIPTOR_STRIDE, dtype=torch.float32, device=device) - (size - 1) / 2
    y, x = torch.meshgrid(r, r, indexing="ij")
    cells = torch.stack([x, y], -1)
    step = POINT_STEP // DESCRIPTOR_STRIDE
    source = cells[::step, ::step].reshape(-1, 2)
    cells = cells.reshape(-1, 2)
    near = (cells[None] - source[:, None]).abs().amax(-1) <= MATCHING.reach
    near = torch.where(near, 0.0, -1e4)
    return source, cells, near
