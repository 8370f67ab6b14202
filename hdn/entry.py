"""Entry points of the command lines that take PyTorch. `run` loads it, and says so where it is not installed."""

import sys

from .commandline import run


def train_main() -> None:
    """Entry point of hdn-train."""
    sys.exit(run("hdn.training.cli:main", None, "nothing was begun"))


def import_main() -> None:
    """Entry point of hdn-import."""
    sys.exit(run("hdn.networks.importing:main", None, "nothing was written"))


def bench_main() -> None:
    """Entry point of hdn-bench."""
    sys.exit(run("hdn.benchmark.speed:main", None, "nothing was measured"))
