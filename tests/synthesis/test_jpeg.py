"""The augmentation does to a picture what a JPEG encoder does."""

import cv2
import numpy as np
import pytest
import torch

from hdn.synthesis.jpeg import compress
from hdn.synthesis.looks import code

from ..scenes import texture


@pytest.mark.parametrize("quality", [20, 50, 80])
def test_a_grey_picture_is_as_a_jpeg_file_has_it(quality: int) -> None:
    grey = cv2.cvtColor(texture(0, 64, 48), cv2.COLOR_RGB2GRAY)
    file = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    expected = cv2.imdecode(file, cv2.IMREAD_GRAYSCALE)
    crop = torch.from_numpy(grey).float().div(255).expand(1, 3, -1, -1)
    ours = compress(crop, torch.tensor([float(quality)]))[0, 0].mul(255).numpy()
    assert np.abs(ours - expected).mean() < 0.5
    assert np.abs(grey.astype(float) - expected).mean() > 0.8  # there was something to lose


def test_sizes_that_are_no_multiple_of_eight_and_any_phase() -> None:
    crops = torch.rand(2, 3, 27, 27)
    for phase in ((0, 0), (5, 0), (0, 3), (7, 7)):
        out = compress(crops, torch.tensor([20.0, 80.0]), phase)
        assert out.shape == crops.shape
        error = (out - crops).abs().mean((1, 2, 3))
        assert 0 < error[1] < error[0]


def test_a_share_is_compressed() -> None:
    torch.manual_seed(0)
    crops = torch.rand(40, 3, 16, 16)
    changed = (code(crops, 0.5) != crops).any(3).any(2).any(1)
    assert 8 < int(changed.sum()) < 32
    assert code(crops, 0.0) is crops
