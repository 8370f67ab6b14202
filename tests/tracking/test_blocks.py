import numpy as np
import pytest

from ar_demo.tracking.blocks import solve, solve_wide


def dense(bands: list[np.ndarray]) -> np.ndarray:
    """The matrix (n m, n m) with blocks (n, m, m) on its diagonal and the further ones above and, transposed, below."""
    n, m, _ = bands[0].shape
    whole = np.zeros((n, m, n, m))
    for reach, blocks in enumerate(bands):
        for k in range(n - reach):
            whole[k, :, k + reach], whole[k + reach, :, k] = blocks[k], blocks[k].T
    return whole.reshape(n * m, n * m)


@pytest.mark.parametrize("reach", [1, 2])
@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 8, 13])
def test_agrees_with_the_dense_solution(n: int, reach: int) -> None:
    rng = np.random.default_rng(n)
    m = 3
    bands = [rng.normal(size=(n, m, m)) for _ in range(reach + 1)]
    bands[0] = bands[0] @ np.swapaxes(bands[0], 1, 2) + 12 * np.eye(m)
    matrix, right = dense(bands), rng.normal(size=(n, m, 2))
    found = solve(bands[0], bands[1][: n - 1], right) if reach == 1 else solve_wide(*bands, right)
    inverse = np.linalg.inv(matrix).reshape(n, m, n, m)
    np.testing.assert_allclose(found.mean.reshape(n * m, 2), np.linalg.solve(matrix, right.reshape(n * m, 2)))
    for k in range(n):
        np.testing.assert_allclose(found.covariance[k], inverse[k, :, k], atol=1e-12)
    for k in range(len(found.cross)):
        np.testing.assert_allclose(found.cross[k], inverse[k, :, k + 1], atol=1e-12)
    np.testing.assert_allclose(found.log_determinant, np.linalg.slogdet(matrix)[1])


def test_stacked_systems_are_solved_at_once() -> None:
    rng = np.random.default_rng(0)
    diagonal, beside, right = np.full((6, 4, 1, 1), 5.0), rng.normal(size=(5, 4, 1, 1)), rng.normal(size=(6, 4, 1, 1))
    together = solve(diagonal, beside, right).mean
    apart = [solve(diagonal[:, i], beside[:, i], right[:, i]).mean for i in range(4)]
    np.testing.assert_allclose(together, np.stack(apart, 1))
