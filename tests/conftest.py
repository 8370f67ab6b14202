import logging
from collections.abc import Iterator

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


@pytest.fixture(autouse=True)
def _loggers_as_they_were() -> Iterator[None]:
    """Commands set up their own logging, which is none of the next test's business."""
    loggers = [logging.getLogger(name) for name in ("ar_demo", "hdn")]
    before = [(logger.level, logger.handlers[:]) for logger in loggers]
    yield
    for logger, (level, handlers) in zip(loggers, before, strict=True):
        logger.setLevel(level)
        logger.handlers[:] = handlers
