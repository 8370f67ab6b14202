import numpy as np
import torch

from hdn.imaging.homography import from_corners
from hdn.imaging.quads import square
from hdn.networks.geometry import dlt


def test_dlt_agrees_with_from_corners_and_has_gradients() -> None:
    corners = square(128)
    offsets = np.array([[3.0, -2], [1, 4], [-5, 2], [0, 1]])
    ours = dlt(torch.from_numpy(offsets[None]), torch.from_numpy(corners))[0].numpy()
    np.testing.assert_allclose(ours, from_corners(corners, corners + offsets), atol=1e-9)
    variable = torch.from_numpy(offsets[None] / 10).requires_grad_()
    assert torch.autograd.gradcheck(lambda o: dlt(o, torch.from_numpy(corners / 64)), variable)
