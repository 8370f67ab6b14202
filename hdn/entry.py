"""Entry points of the command lines that take PyTorch: it is loaded inside `run`, which says where it is missing."""

import sys

from .commandline import load, run

LEFT_BEHIND = "nothing was begun"


def train_main() -> None:
    """Entry point of hdn-train."""
    _main("hdn.training.cli:main")


def import_main() -> None:
    """Entry point of hdn-import."""
    _main("hdn.networks.importing:main")


def bench_main() -> None:
    """Entry point of hdn-bench."""
    _main("hdn.benchmark.speed:main")


def _main(name: str) -> None:
    sys.exit(run(lambda arguments: load(name, LEFT_BEHIND)(arguments), None, LEFT_BEHIND))
