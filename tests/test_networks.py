"""Shapes, equivariance and engines of the networks."""

import numpy as np
import pytest
import torch

from hdn.config import COMPACT
from hdn.engine import Engine
from hdn.polar import polar_crop, polar_points
from hdn.residual import standardise
from hdn.weights import Hdn

from .scenes import texture


def crops(size: int, seed: int = 0) -> np.ndarray:
    return texture(seed, size, size)


def test_correlation_maps_have_the_paper_s_size(network: Hdn) -> None:
    n = network.similarity
    z = n.encode_template(n.backbone(torch.zeros(1, 3, 127, 127)))
    logits, offsets = n.translation(z, n.encode_search(n.backbone(torch.zeros(1, 3, 255, 255))))
    assert logits.shape == offsets.shape == (1, 2, 25, 25)


def test_on_the_polar_grid_scale_and_rotation_are_shifts() -> None:
    points = torch.from_numpy(polar_points(COMPACT))
    rows, columns = 9, 14
    scale, angle = np.exp(columns * COMPACT.log_scale_per_pixel), rows * COMPACT.radians_per_pixel
    c, s = scale * np.cos(angle), scale * np.sin(angle)
    moved = points @ torch.tensor([[c, s], [-s, c]], dtype=torch.float32)
    inner = moved[:-rows, :-columns]
    torch.testing.assert_close(inner, points[rows:, columns:], atol=1e-3, rtol=1e-4)


def test_polar_crop_looks_about_its_centre() -> None:
    y, x = torch.meshgrid(torch.arange(255.0), torch.arange(255.0), indexing="ij")
    image = torch.stack([x, y, x])[None]
    points = torch.from_numpy(polar_points(COMPACT))
    crop = polar_crop(image, torch.tensor([[10.0, -5.0]]), points)
    torch.testing.assert_close(crop[0, 0], points[..., 0] + 127 + 10, atol=1e-2, rtol=0)
    torch.testing.assert_close(crop[0, 1], points[..., 1] + 127 - 5, atol=1e-2, rtol=0)


def test_standardised_crops_know_no_gain_and_bias() -> None:
    crop = torch.rand(1, 3, 32, 32) * 100
    torch.testing.assert_close(standardise(crop * 2 + 10), standardise(crop), atol=0.3, rtol=0)


@pytest.fixture(scope="module")
def torch_engine(network: Hdn) -> Engine:
    return Engine(network, "cpu", library="torch")


def test_openvino_and_pytorch_agree(engine: Engine, torch_engine: Engine) -> None:
    template, search, polar = crops(127), crops(255, 1), crops(128, 2)
    ours, theirs = engine.encode_template(template, polar), torch_engine.encode_template(template, polar)
    for a, b in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-3 * np.abs(b).max())
    for a, b in (
        (engine.translation(ours[0], search), torch_engine.translation(theirs[0], search)),
        (engine.polar(ours[1], polar), torch_engine.polar(theirs[1], polar)),
    ):
        assert (a.x, a.y, a.score) == pytest.approx((b.x, b.y, b.score), abs=0.02)
    a, b = engine.residual(polar, crops(128, 3)), torch_engine.residual(polar, crops(128, 3))
    np.testing.assert_allclose(a.offsets, b.offsets, atol=0.02)
    assert a.distance_after == pytest.approx(b.distance_after, rel=0.02)
