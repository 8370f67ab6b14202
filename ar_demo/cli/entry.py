"""Entry points of the command lines. What they need is loaded inside `run`, which knows what to do with Ctrl-C."""

import sys
from collections.abc import Sequence

from hdn.commandline import run

LEFT_BEHIND = "nothing was written"


def replace_main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of ar-replace."""
    sys.exit(run("ar_demo.cli.commands:replace_command", arguments, LEFT_BEHIND))


def track_main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of ar-track."""
    sys.exit(run("ar_demo.cli.commands:track_command", arguments, LEFT_BEHIND))
