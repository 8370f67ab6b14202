"""The heads of the paper's own networks, on a dilated ResNet-50 and a ResNet-34.

They answer to the same calls as the compact ones in `similarity` and `residual`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from ..imaging.quads import square
from .config import Config
from .correlation import adapt, centre, correlate, pad_polar
from .geometry import dlt, project
from .resnet import LEVELS, ResNet34


class _Head(nn.Module):
    """One map of one level: what goes before the correlation, and what comes after it."""

    def __init__(self, channels: int, outputs: int) -> None:
        super().__init__()
        self.template = adapt(channels)
        self.search = adapt(channels)
        self.head = nn.Sequential(
            nn.Conv2d(channels, channels, 1, bias=False),
            nn.BatchNorm2d(channels),
            nn.ReLU(),
            nn.Conv2d(channels, outputs, 1),
        )


def _fuse(weights: Tensor, heads: Any, levels: Sequence[Tensor]) -> Tensor:
    """The weighted sum of what the heads make of correlated levels, each (B, C, n, n)."""
    maps = [w * head.head(x) for w, head, x in zip(weights.unbind(), heads.values(), levels, strict=True)]
    return sum(maps[1:], maps[0])


class LevelBranch(nn.Module):
    """A correlation branch over three levels, each with a head for scores and one for offsets; weights fuse them.

    What the six heads correlate is kept side by side in the channels, level by level, scores first: 6 C of them.
    """

    def __init__(self, config: Config, polar: bool) -> None:
        super().__init__()
        c = config.channels
        self.cells = None if polar else config.template_cells
        self.reach = config.polar_reach if polar else 0
        self.necks = nn.ModuleDict(
            {level: nn.Sequential(nn.Conv2d(n, c, 1, bias=False), nn.BatchNorm2d(c)) for level, n in LEVELS.items()}
        )
        self.cls = nn.ModuleDict({level: _Head(c, 2) for level in LEVELS})
        # The log-polar head has four offsets, of which the first and the third are log-scale and rotation.
        self.loc = nn.ModuleDict({level: _Head(c, 4 if polar else 2) for level in LEVELS})
        self.cls_weight = nn.Parameter(torch.ones(len(LEVELS)))
        self.loc_weight = nn.Parameter(torch.ones(len(LEVELS)))
        self.loc_scale = nn.Parameter(torch.ones(len(LEVELS)))

    def neck(self, maps: tuple[Tensor, ...]) -> list[Tensor]:
        """Maps of the levels, each brought to (B, C, n, n)."""
        return [neck(x) for neck, x in zip(self.necks.values(), maps, strict=True)]

    def encode_template(self, maps: tuple[Tensor, ...]) -> Tensor:
        """Backbone maps to correlation kernels: (B, 6 C, 5, 5) of translation, (B, 6 C, 13, 13) of log-polar."""
        necks = self.neck(maps)
        if self.cells:
            necks = [centre(x, self.cells) for x in necks]  # (B, C, 7, 7)
        return torch.cat([head.template(x) for x, head in self._heads(necks)], 1)

    def encode_search(self, maps: tuple[Tensor, ...]) -> Tensor:
        """Backbone maps to what the kernels slide over: (B, 6 C, 29, 29), or (B, 6 C, 25, 25) of log-polar."""
        x = torch.cat([head.search(x) for x, head in self._heads(self.neck(maps))], 1)
        return pad_polar(x, self.reach) if self.reach else x

    def forward(self, template: Tensor, search: Tensor) -> tuple[Tensor, Tensor]:
        """Encoded template and search to score logits (B, 2, n, n) and offsets (B, 2 or 4, n, n) in cells."""
        levels = correlate(template, search).chunk(2 * len(LEVELS), 1)  # six of (B, C, n, n)
        cls, loc = self.cls_weight.softmax(0), self.loc_weight.softmax(0) * self.loc_scale
        return _fuse(cls, self.cls, levels[0::2]), _fuse(loc, self.loc, levels[1::2])

    def _heads(self, necks: list[Tensor]) -> Iterator[tuple[Tensor, Any]]:
        """Each level's map twice, with its head for scores and with that for offsets."""
        for x, cls, loc in zip(necks, self.cls.values(), self.loc.values(), strict=True):
            yield x, cls
            yield x, loc


@dataclass(frozen=True)
class ResidualModel:
    """Constants of the paper's residual network. The first two are its training's, of red, green and blue."""

    channel_mean: tuple[float, ...] = (102.60, 113.97, 118.93)  # grey levels
    channel_deviation: tuple[float, ...] = (72.45, 68.81, 69.85)  # grey levels
    seen_distance: float = 0.97  # of the features' distance before the warp: nearer than that after it, it is seen


MODEL = ResidualModel()


class PaperResidual(nn.Module):
    """Grey template and search crops (B, 1, n, n) to corner offsets (B, 4, 2) in crop pixels.

    They are offsets of the corners (0, 0), (0, 127), (127, 127), (127, 0) from the search crop to the template's.
    """

    def __init__(self, config: Config) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for inputs, outputs in ((1, 4), (4, 8), (8, 1)):
            layers += [nn.Conv2d(inputs, outputs, 3, 1, 1, bias=False), nn.BatchNorm2d(outputs), nn.ReLU()]
        self.extractor = nn.Sequential(*layers)  # E in the paper
        self.backbone = ResNet34()
        self.fc = nn.Linear(512, 8)
        self.size = config.residual_size

    def prepare(self, crops: Tensor) -> Tensor:
        """RGB (B, 3, n, n), 0..255, to grey (B, 1, n, n): the mean of the normalised channels."""
        mean, deviation = (crops.new_tensor(v)[:, None, None] for v in (MODEL.channel_mean, MODEL.channel_deviation))
        return ((crops - mean) / deviation).mean(1, keepdim=True)

    def forward(self, template: Tensor, search: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Offsets (B, 4, 2) and the extracted maps E(template), E(search), each (B, 1, n, n)."""
        embedded_template, embedded_search = self.extractor(template), self.extractor(search)
        features = self.backbone(torch.cat([embedded_template, embedded_search], 1))  # (B, 512)
        return self.fc(features).reshape(-1, 4, 2), embedded_template, embedded_search

    def describe(self, crops: Tensor) -> Tensor:
        """What is kept of the template: the prepared crops."""
        return self.prepare(crops)

    def compare(self, template: Tensor, crops: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """A prepared template and RGB search crops to what `conclude` takes."""
        return self(template, self.prepare(crops))

    def conclude(self, offsets: Tensor, template: Tensor, search: Tensor) -> tuple[Tensor, Tensor]:
        """Offsets (B, 4, 2) px from the crop's corners to the target's, and whether (B, 1, 1) the target is seen.

        It is taken to be where the features' distance falls by the warp, as it does not for negative samples.
        """
        n = self.size
        matrix = self.homography(offsets)
        corners = torch.from_numpy(square(n)).to(offsets).expand(len(offsets), 4, 2)
        y, x = torch.meshgrid(torch.arange(n), torch.arange(n), indexing="ij")
        pixels = torch.stack([x, y], -1).reshape(1, -1, 2).to(offsets)
        places = project(torch.linalg.inv(matrix), pixels).reshape(-1, n, n, 2)
        warped = F.grid_sample(template, places * (2 / (n - 1)) - 1, padding_mode="border", align_corners=True)
        before, after = ((search - t).abs().mean((1, 2, 3)) for t in (template, warped))
        return project(matrix, corners) - corners, (after < MODEL.seen_distance * before).float()[:, None, None]

    def homography(self, offsets: Tensor) -> Tensor:
        """Offsets (B, 4, 2) to homographies (B, 3, 3), pixels of the template crop to those of the search crop."""
        n = float(self.size)
        return torch.linalg.inv(dlt(offsets, offsets.new_tensor([[0.0, 0.0], [0.0, n], [n, n], [n, 0.0]])))
