"""What a track shows of a surface's motion, where some of its directions are known far worse than others."""

import numpy as np

from ar_demo.tracking.motion import MODES, estimate_motion, in_corners, mode_variance


def test_a_direction_that_is_hardly_known_does_not_pass_for_the_noise_of_all() -> None:
    """Shake that is seen clearly in some modes stays motion, though one direction is known to some pixels only."""
    rng, n = np.random.default_rng(0), 120
    deviation = np.full((4, 2), 0.05)
    deviation[0, 0] = 4.0
    modes = np.zeros((n, 4, 2))
    modes[:, 1:3] = rng.normal(0, 0.3, (n, 2, 2))
    measured = modes + rng.normal(0, 0.2 * deviation, (n, 4, 2))
    axes = np.kron(MODES, np.eye(2))
    covariance = axes.T @ np.diag(np.square(deviation).ravel()) @ axes
    corners = (measured.reshape(n, 8) @ axes)[None]
    found = estimate_motion(corners, np.broadcast_to(covariance, (1, n, 8, 8)))
    bend = np.diff(modes[:, 1:3], 2, axis=0).var()
    assert 0.5 * bend < found.variance[1:3].min() <= found.variance[1:3].max() < 2 * bend
    assert found.variance[[0, 3]].max() < 0.1 * bend


def test_variances_of_modes_are_those_of_their_corners() -> None:
    np.testing.assert_allclose(mode_variance(in_corners(np.arange(1.0, 5)))[:, 1], np.arange(1.0, 5))
