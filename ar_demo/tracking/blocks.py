"""Linear systems whose matrix is symmetric, positive definite and block-tridiagonal, and the inverse's own blocks.

By cyclic reduction (Golub and Hockney, 1965): every other unknown is eliminated at once, which leaves a system of the
same kind and half the length. So all the work is done on stacks of small matrices, in log2(n) rounds.
"""

from typing import NamedTuple

import numpy as np

from hdn.imaging.arrays import Array


class Inverse(NamedTuple):
    """What a system's matrix A and right side tell.

    Attributes:
        mean: (n, ..., m, c) the solutions, of c right sides.
        covariance: (n, ..., m, m) the blocks of inv(A) on its diagonal.
        cross: (n - 1, ..., m, m) those above it: of block k's rows and block k + 1's columns.
        log_determinant: (...) of A.
    """

    mean: Array
    covariance: Array
    cross: Array
    log_determinant: Array


def solve(diagonal: Array, beside: Array, right: Array) -> Inverse:
    """Solves A x = right.

    Args:
        diagonal: (n, ..., m, m) blocks of A on its diagonal.
        beside: (n - 1, ..., m, m) the blocks above it: of block k's rows and block k + 1's columns.
        right: (n, ..., m, c).
    """
    n, m = len(diagonal), diagonal.shape[-1]
    own = np.asarray(np.linalg.inv(diagonal[1::2]), np.float64)
    log_determinant = np.asarray(np.linalg.slogdet(diagonal[1::2])[1].sum(0), np.float64)
    if n == 1:
        covariance = np.asarray(np.linalg.inv(diagonal), np.float64)
        log_determinant = np.asarray(np.linalg.slogdet(diagonal)[1][0], np.float64)
        return Inverse(covariance @ right, covariance, beside, log_determinant)

    # The odd blocks as functions of their neighbours: x = share + gain @ (x before, x after).
    before = np.swapaxes(beside[0::2], -1, -2)
    after = np.zeros_like(before)
    after[: len(beside[1::2])] = beside[1::2]
    gain = -own @ np.concatenate([before, after], -1)
    share = own @ right[1::2]

    # What they tell of their neighbours.
    schur = np.concatenate([before, after], -1).swapaxes(-1, -2) @ gain
    told = np.concatenate([before, after], -1).swapaxes(-1, -2) @ share
    even, even_right = diagonal[0::2].copy(), right[0::2].copy()
    count = len(own)
    even[:count] += schur[..., :m, :m]
    even_right[:count] -= told[..., :m, :]
    followed = len(even) - 1  # of the odd blocks, those with a block after them
    even[1:] += schur[:followed, ..., m:, m:]
    even_right[1:] -= told[:followed, ..., m:, :]
    rest = solve(even, schur[:followed, ..., :m, m:], even_right)

    joint = np.zeros((count, *diagonal.shape[1:-2], 2 * m, 2 * m))
    joint[..., :m, :m] = rest.covariance[:count]
    joint[:followed, ..., m:, m:] = rest.covariance[1:]
    joint[:followed, ..., :m, m:] = rest.cross
    joint[:followed, ..., m:, :m] = np.swapaxes(rest.cross, -1, -2)
    neighbours = np.zeros((count, *right.shape[1:-2], 2 * m, right.shape[-1]))
    neighbours[..., :m, :] = rest.mean[:count]
    neighbours[:followed, ..., m:, :] = rest.mean[1:]

    with_neighbours = gain @ joint
    mean, covariance, cross = np.empty_like(right), np.empty_like(diagonal), np.empty_like(beside)
    mean[0::2], covariance[0::2] = rest.mean, rest.covariance
    mean[1::2] = share + gain @ neighbours
    covariance[1::2] = own + with_neighbours @ np.swapaxes(gain, -1, -2)
    cross[0::2] = np.swapaxes(with_neighbours[..., :m], -1, -2)
    cross[1::2] = with_neighbours[:followed, ..., m:]
    return Inverse(mean, covariance, cross, log_determinant + rest.log_determinant)


def solve_wide(own: Array, after: Array, second: Array, right: Array) -> Inverse:
    """Solves a system whose blocks reach two further, as those of a second difference do.

    Args:
        own: (n, ..., m, m) blocks on the diagonal. after, second: (n, ..., m, m) of block k's rows and the columns of
            block k + 1 and k + 2; the last one and the last two are not used.
        right: (n, ..., m, c).

    Returns:
        Without the cross blocks.
    """
    n, m, pairs = len(own), own.shape[-1], (len(own) + 1) // 2

    def padded(blocks: Array, count: int) -> Array:
        return np.concatenate([blocks[:count], np.zeros((2 * pairs - count, *blocks.shape[1:]))])

    own, after, second, right = padded(own, n), padded(after, n - 1), padded(second, max(n - 2, 0)), padded(right, n)
    own[n:] = np.eye(m)  # an unknown of its own, where n is odd
    diagonal = np.zeros((pairs, *own.shape[1:-2], 2 * m, 2 * m))
    diagonal[..., :m, :m], diagonal[..., m:, m:], diagonal[..., :m, m:] = own[0::2], own[1::2], after[0::2]
    diagonal[..., m:, :m] = np.swapaxes(after[0::2], -1, -2)
    beside = np.zeros((pairs - 1, *own.shape[1:-2], 2 * m, 2 * m))
    beside[..., m:, :m] = after[1:-1:2]
    beside[..., :m, :m], beside[..., m:, m:] = second[0:-2:2], second[1:-2:2]
    found = solve(diagonal, beside, np.concatenate([right[0::2], right[1::2]], -2))

    def single(first: Array, then: Array) -> Array:
        return np.stack([first, then], 1).reshape(2 * pairs, *first.shape[1:])[:n]

    mean = single(found.mean[..., :m, :], found.mean[..., m:, :])
    covariance = single(found.covariance[..., :m, :m], found.covariance[..., m:, m:])
    return Inverse(mean, covariance, found.cross[:0], found.log_determinant)
