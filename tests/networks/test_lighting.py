"""The light network as it ships, and what it is given."""

import numpy as np
import pytest
import torch

from hdn.networks import light_network, loading
from hdn.networks.config import LIGHT_SIZE
from hdn.networks.lighting import INNER, INPUTS, LEVELS, QUANTILES, Lighting, summary
from hdn.networks.weights import LIGHT_FILE_NAME, shipped

SIZE = LIGHT_SIZE


def views(count: int, seed: int = 0) -> np.ndarray:
    """Views (1, count, 3, n, n), values 0..1, of one print."""
    print_ = np.random.default_rng(seed).uniform(0.2, 0.7, (3, SIZE, SIZE)).astype(np.float32)
    return np.repeat(print_[None, None], count, 1)


def test_the_summary_is_the_same_whatever_the_order_of_the_views() -> None:
    rng = np.random.default_rng(1)
    seen = views(9) * rng.uniform(0.5, 1.2, (1, 9, 1, 1, 1)).astype(np.float32)
    known = (rng.random((1, 9, 1, SIZE, SIZE)) < 0.8).astype(np.float32)
    order = [0, *(1 + rng.permutation(8))]
    one, other = summary(seen, known), summary(seen[:, order], known[:, order])
    assert one.shape == (1, INPUTS, SIZE, SIZE)
    np.testing.assert_allclose(one, other, atol=1e-6)


def test_views_are_as_bright_as_the_first_one_before_they_are_compared() -> None:
    gains = np.array([1, 0.5, 0.5, 0.8, 0.9], np.float32)
    seen = views(5) * gains[None, :, None, None, None]
    found = summary(seen, np.ones((1, 5, 1, SIZE, SIZE), np.float32))
    first = found[:, :3]
    for k in range(len(QUANTILES)):
        np.testing.assert_allclose(found[:, 3 + 4 * k : 6 + 4 * k], first, atol=0.06)
    darkest = found[0, -len(LEVELS), 0, 0]
    assert darkest == pytest.approx(np.log(0.5), abs=0.05)


def test_what_is_not_known_does_not_count() -> None:
    seen, known = views(6), np.ones((1, 6, 1, SIZE, SIZE), np.float32)
    hidden = seen.copy()
    hidden[:, 2:, :, 4:20, 4:20] = 0.0
    known[:, 2:, :, 4:20, 4:20] = 0
    found, whole = summary(hidden, known), summary(seen, np.ones_like(known))
    np.testing.assert_allclose(found[:, : 3 + 4 * len(QUANTILES)], whole[:, : 3 + 4 * len(QUANTILES)], atol=1e-5)


def test_openvino_computes_what_pytorch_does() -> None:
    rng = np.random.default_rng(2)
    seen = np.clip(views(8) * rng.uniform(0.5, 1.4, (1, 8, 1, SIZE, 1)), 0, 1).astype(np.float32)
    inputs = summary(seen, np.ones((1, 8, 1, SIZE, SIZE), np.float32))
    network = light_network.load(shipped(LIGHT_FILE_NAME))
    with torch.inference_mode():
        expected = [x.numpy() for x in network(torch.from_numpy(inputs))]
    for ours, theirs in zip(loading.load_lighting().function(inputs), expected, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=2e-3)


def test_a_lighting_tells_the_surface_alone() -> None:
    lighting = loading.load_lighting()
    seen = [(255 * view.transpose(1, 2, 0)).astype(np.uint8) for view in views(5)[0]]
    known = [np.full((SIZE, SIZE), 255, np.uint8)] * 5
    found = lighting(seen, known)
    side = INNER.stop - INNER.start
    assert found.gain.shape == found.glare.shape == (side, side)
    assert (found.gain > 0).all()
    assert (found.glare >= 0).all()
    assert isinstance(lighting, Lighting)
