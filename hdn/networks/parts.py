"""The parts of HDN that are run by themselves, as PyTorch modules of their own."""

from typing import Any

from torch import Tensor, nn


class Encode(nn.Module):
    """A branch's correlation kernel from the maps of a template crop."""

    def __init__(self, branch: nn.Module) -> None:
        super().__init__()
        self.branch: Any = branch

    def forward(self, *maps: Tensor) -> tuple[Tensor]:
        return (self.branch.encode_template(maps),)


class Correlate(nn.Module):
    """A branch's logits and offsets from its kernel and the maps of a search crop."""

    def __init__(self, branch: nn.Module) -> None:
        super().__init__()
        self.branch: Any = branch

    def forward(self, kernel: Tensor, *maps: Tensor) -> tuple[Tensor, Tensor]:
        return self.branch(kernel, self.branch.encode_search(maps))


class OfImage(nn.Module):
    """A network whose last input is an image as it is kept, uint8 (1, n, n, 3), in place of floats (1, 3, n, n)."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = network

    def forward(self, *inputs: Tensor) -> tuple[Tensor, ...]:
        *others, image = inputs
        return self.network(*others, image.permute(0, 3, 1, 2).float())


class Joined(nn.Module):
    """A head on the backbone's maps of the last input."""

    def __init__(self, backbone: nn.Module, head: nn.Module) -> None:
        super().__init__()
        self.backbone, self.head = backbone, head

    def forward(self, *inputs: Tensor) -> tuple[Tensor, ...]:
        *kernels, crop = inputs
        return self.head(*kernels, *self.backbone(crop))


class Describe(nn.Module):
    """What the residual network keeps of a template crop."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network: Any = network

    def forward(self, crop: Tensor) -> tuple[Tensor]:
        return (self.network.describe(crop),)


class Compare(nn.Module):
    """The residual network's part that runs once a frame."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network: Any = network

    def forward(self, template: Tensor, crop: Tensor) -> tuple[Tensor, ...]:
        return self.network.compare(template, crop)
