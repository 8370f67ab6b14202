"""Robust statistics."""

import numpy as np
import pytest

from hdn.imaging.photometry import quantile


@pytest.mark.parametrize("count", [1, 2, 7, 64])
@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 0.9, 1.0])
def test_a_quantile_is_numpys_to_the_bit(count: int, share: float) -> None:
    values = np.random.default_rng(count).standard_normal(count).astype(np.float32)
    assert quantile(values, share) == float(np.quantile(values, share))
