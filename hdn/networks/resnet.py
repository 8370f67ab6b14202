"""The paper's two trunks: a dilated ResNet-50 at stride 8, and an ordinary ResNet-34.

Modules are named as in the ResNet paper's usual implementations, which the released checkpoint follows.
"""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

LEVELS = {"2": 512, "3": 1024, "4": 2048}  # stages of the ResNet-50 that are used, and their channels


class Bottleneck(nn.Module):
    """1x1 conv, 3x3 conv, 1x1 conv, with batch norm; a strided 3x3 goes without padding."""

    def __init__(self, inputs: int, width: int, stride: int, dilation: int, shortcut: nn.Module | None) -> None:
        super().__init__()
        padding = dilation if stride == 1 else 0
        self.conv1 = nn.Conv2d(inputs, width, 1, bias=False)
        self.bn1 = nn.BatchNorm2d(width)
        self.conv2 = nn.Conv2d(width, width, 3, stride, padding, dilation, bias=False)
        self.bn2 = nn.BatchNorm2d(width)
        self.conv3 = nn.Conv2d(width, 4 * width, 1, bias=False)
        self.bn3 = nn.BatchNorm2d(4 * width)
        self.downsample = shortcut

    def forward(self, x: Tensor) -> Tensor:
        y = F.relu(self.bn1(self.conv1(x)))
        y = F.relu(self.bn2(self.conv2(y)))
        y = self.bn3(self.conv3(y))
        return F.relu(y + (x if self.downsample is None else self.downsample(x)))


class BasicBlock(nn.Module):
    """Two 3x3 convs with batch norm."""

    def __init__(self, inputs: int, width: int, stride: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(inputs, width, 3, stride, 1, bias=False)
        self.bn1 = nn.BatchNorm2d(width)
        self.conv2 = nn.Conv2d(width, width, 3, 1, 1, bias=False)
        self.bn2 = nn.BatchNorm2d(width)
        self.downsample = None
        if stride > 1:
            self.downsample = nn.Sequential(nn.Conv2d(inputs, width, 1, stride, bias=False), nn.BatchNorm2d(width))

    def forward(self, x: Tensor) -> Tensor:
        y = F.relu(self.bn1(self.conv1(x)))
        y = self.bn2(self.conv2(y))
        return F.relu(y + (x if self.downsample is None else self.downsample(x)))


def _stage(inputs: int, width: int, blocks: int, stride: int, dilation: int) -> nn.Sequential:
    """A stage of bottlenecks; its first block has half the dilation, as has its shortcut."""
    first = max(dilation // 2, 1)
    if stride == 1 and dilation == 1:
        conv = nn.Conv2d(inputs, 4 * width, 1, bias=False)
    else:
        conv = nn.Conv2d(inputs, 4 * width, 3, stride, first if stride == 1 else 0, first, bias=False)
    shortcut = nn.Sequential(conv, nn.BatchNorm2d(4 * width))
    return nn.Sequential(
        Bottleneck(inputs, width, stride, first, shortcut),
        *(Bottleneck(4 * width, width, 1, dilation, None) for _ in range(blocks - 1)),
    )


class ResNet50(nn.Module):
    """RGB crops (B, 3, n, n), 0..255, to maps of stages 2, 3, 4 at stride 8: 15x15 of a 127 crop, 31x31 of 255."""

    def __init__(self) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(3, 64, 7, 2, bias=False)
        self.bn1 = nn.BatchNorm2d(64)
        self.layer1 = _stage(64, 64, 3, 1, 1)
        self.layer2 = _stage(256, 128, 4, 2, 1)
        self.layer3 = _stage(512, 256, 6, 1, 2)
        self.layer4 = _stage(1024, 512, 3, 1, 4)

    def forward(self, x: Tensor) -> tuple[Tensor, ...]:
        x = torch.cat([x[:, 2:], x[:, 1:2], x[:, :1]], 1)  # the checkpoint was trained on BGR
        x = F.relu(self.bn1(self.conv1(x)))  # (B, 64, 61, 61) of a 127 crop
        x = F.max_pool2d(x, 3, 2, 1)  # (B, 64, 31, 31)
        x = self.layer1(x)  # (B, 256, 31, 31)
        level2 = self.layer2(x)  # (B, 512, 15, 15)
        level3 = self.layer3(level2)  # (B, 1024, 15, 15)
        return level2, level3, self.layer4(level3)  # (B, 2048, 15, 15)


class ResNet34(nn.Module):
    """Maps (B, 2, n, n) to features (B, 512), averaged over the crop."""

    def __init__(self) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(2, 64, 7, 2, 3, bias=False)
        self.bn1 = nn.BatchNorm2d(64)
        self.layer1 = nn.Sequential(*(BasicBlock(64, 64, 1) for _ in range(3)))
        self.layer2 = nn.Sequential(BasicBlock(64, 128, 2), *(BasicBlock(128, 128, 1) for _ in range(3)))
        self.layer3 = nn.Sequential(BasicBlock(128, 256, 2), *(BasicBlock(256, 256, 1) for _ in range(5)))
        self.layer4 = nn.Sequential(BasicBlock(256, 512, 2), *(BasicBlock(512, 512, 1) for _ in range(2)))

    def forward(self, x: Tensor) -> Tensor:
        x = F.relu(self.bn1(self.conv1(x)))  # (B, 64, 64, 64) of a 127 crop
        x = self.layer1(F.max_pool2d(x, 3, 2, 1))  # (B, 64, 32, 32)
        x = self.layer4(self.layer3(self.layer2(x)))  # (B, 512, 4, 4)
        return x.mean((2, 3))
