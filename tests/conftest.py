import pytest

from hdn import weights
from hdn.engine import Engine


@pytest.fixture(scope="session")
def network() -> weights.Hdn:
    """The shipped networks."""
    return weights.load(weights.shipped())


@pytest.fixture(scope="session")
def engine(network: weights.Hdn) -> Engine:
    """The shipped networks as the tracker runs them on a CPU; loaded once for all tests."""
    return Engine(network, "cpu")
