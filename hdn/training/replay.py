"""Samples that are used more than once, where making one costs more than learning from it."""

from collections.abc import Callable
from typing import Generic, TypeVar

import torch

Sample = TypeVar("Sample")

BATCHES_KEPT = 200  # in memory: 2.3 GB of the translation branch's


class Replay(Generic[Sample]):
    """Batches, each one used so many times on average: new ones in turn with random ones of the last."""

    def __init__(self, make: Callable[[], Sample], uses: int) -> None:
        self.make, self.uses = make, uses
        self.kept: list[Sample] = []
        self.count = 0

    def next(self) -> Sample:
        """The next batch, by PyTorch's chance."""
        self.count += 1
        if self.uses == 1:
            return self.make()
        if (self.count - 1) % self.uses:
            return self.kept[int(torch.randint(len(self.kept), ()))]
        new = self.make()
        if len(self.kept) < BATCHES_KEPT:
            self.kept.append(new)
        else:
            self.kept[int(torch.randint(BATCHES_KEPT, ()))] = new
        return new
