"""Images in memory, and views of them."""

import functools
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from ..errors import InputError
from ..imaging.arrays import Image
from ..networks.geometry import project

SIDE = 304  # images are kept as squares of this side; their aspect does not matter to a texture


def read_photo(path: Path) -> Tensor:
    """An image file as uint8 RGB (3, SIDE, SIDE).

    Raises:
        InputError: it cannot be read.
    """
    image = cv2.imread(str(path), cv2.IMREAD_COLOR_RGB)
    if image is None:
        raise InputError(f"{path} is not an image that can be read: remove it from the training folders")
    return squared(np.asarray(image, np.uint8))


def squared(image: Image) -> Tensor:
    """An RGB image (H, W, 3) as uint8 (3, SIDE, SIDE)."""
    shrinks = min(image.shape[:2]) > SIDE
    image = cv2.resize(image, (SIDE, SIDE), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_CUBIC)
    return torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1)))


class Photos:
    """Images held in memory as one uint8 tensor (N, 3, SIDE, SIDE)."""

    def __init__(self, pixels: Tensor, device: torch.device | str = "cpu") -> None:
        self.pixels = pixels.to(device)
        self.device = self.pixels.device

    @classmethod
    def read(cls, paths: Sequence[Path], device: torch.device | str = "cpu") -> "Photos":
        """Photos from image files; raises InputError for one that cannot be read."""
        pixels = torch.empty((len(paths), 3, SIDE, SIDE), dtype=torch.uint8)
        with ThreadPoolExecutor() as readers:
            for i, image in enumerate(readers.map(read_photo, paths)):
                pixels[i] = image
        return cls(pixels, device)

    def __len__(self) -> int:
        return len(self.pixels)

    def sample(self, index: Tensor, crop_to_image: Tensor, size: int) -> Tensor:
        """Crops (B, 3, size, size), 0..1, of images index (B,) through homographies (B, 3, 3).

        Crop and image coordinates are relative to their centres; an image goes on beyond its border as its own mirror
        image.
        """
        unit = torch.diag(torch.tensor([2 / SIDE, 2 / SIDE, 1], device=self.device))
        grid = project(unit @ crop_to_image, pixel_grid(size, self.device)).reshape(-1, size, size, 2)
        images = self.pixels[index].float().div_(255)
        return F.grid_sample(images, grid, padding_mode="reflection", align_corners=False)


def random_photos(photos: Photos, batch: int) -> Tensor:
    return torch.randint(len(photos), (batch,), device=photos.device)


@functools.lru_cache
def pixel_grid(size: int, device: torch.device) -> Tensor:
    """Pixel coordinates (size*size, 2) relative to the crop's centre, x first."""
    r = torch.arange(size, device=device, dtype=torch.float32) - (size - 1) / 2
    y, x = torch.meshgrid(r, r, indexing="ij")
    return torch.stack([x, y], -1).reshape(-1, 2)
