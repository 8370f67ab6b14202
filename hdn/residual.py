"""The residual component: corner offsets of what the similarity left over.

Paper: "Residual Component". Its crops show the target's own quad, rectified to a square: the regressed corners are the
target's corners, whatever its shape, and nothing in view moves on its own.
"""

import itertools

import torch
from torch import Tensor, nn

from .config import Config
from .homography import dlt, square


def _conv(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False), nn.BatchNorm2d(outputs), nn.ReLU(inplace=True)
    )


def standardise(crops: Tensor) -> Tensor:
    """RGB (B, 3, n, n), any range, to grey (B, 1, n, n) of zero mean and unit deviation: free of gain and bias."""
    grey = crops.mean(1, keepdim=True)
    centred = grey - grey.mean((2, 3), keepdim=True)
    return centred / (centred.square().mean((2, 3), keepdim=True).sqrt() + 2)


class ResidualNetwork(nn.Module):
    """Standardised template and search crops (B, 1, n, n) to corner offsets (B, 4, 2) in crop pixels.

    Offsets go from the crop's corners (top-left, top-right, bottom-right, bottom-left) to where the target's corners
    lie in the search crop.
    """

    def __init__(self, config: Config) -> None:
        super().__init__()
        # E in the paper, which keeps the full resolution; half of it serves, for refinement follows.
        self.extractor = nn.Sequential(_conv(1, 8, 2), _conv(8, 8), _conv(8, 1))
        widths = (2, *config.residual_channels)
        self.trunk = nn.Sequential(
            *(layer for a, b in itertools.pairwise(widths) for layer in (_conv(a, b, 2), _conv(b, b)))
        )
        cells = config.residual_size // 2 ** (1 + len(config.residual_channels))
        self.regressor = nn.Sequential(
            nn.Flatten(), nn.Linear(widths[-1] * cells * cells, 256), nn.ReLU(inplace=True), nn.Linear(256, 8)
        )

        self.corners = torch.from_numpy(square(config.residual_size))

    def prepare(self, crops: Tensor) -> Tensor:
        """RGB (B, 3, n, n), 0..255, to grey (B, 1, n, n), standardised."""
        return standardise(crops)

    def forward(self, template: Tensor, search: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Offsets (B, 4, 2) and the extracted maps E(template), E(search), each (B, 1, n/2, n/2)."""
        embedded_template, embedded_search = self.extractor(template), self.extractor(search)
        x = torch.cat([embedded_template, embedded_search], 1)
        return self.regressor(self.trunk(x)).reshape(-1, 4, 2), embedded_template, embedded_search

    def homography(self, offsets: Tensor) -> Tensor:
        """Offsets (B, 4, 2) to homographies (B, 3, 3), pixels of the template crop to those of the search crop."""
        return dlt(offsets, self.corners)
