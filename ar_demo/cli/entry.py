"""Entry points of the command lines. What they need beyond parsing is loaded once there is something to do."""

import sys
from argparse import Namespace
from collections.abc import Callable, Mapping, Sequence

from hdn.commandline import Parser, load, run

from .parsers import (
    batch_parser,
    export_parser,
    find_parser,
    join_parser,
    replace_parser,
    report_parser,
    studio_parser,
    track_parser,
)

LEFT_BEHIND = "nothing unfinished is left"
PICK = "ar_demo.studio.command:pick_command"


def replace_main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of ar-replace."""
    _main(replace_parser(), "ar_demo.cli.commands:replace_command", arguments, {"pick": PICK})


def track_main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of ar-track."""
    _main(track_parser(), "ar_demo.cli.commands:track_command", arguments)


def export_main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of ar-export."""
    _main(export_parser(), "ar_demo.cli.exports:export_command", arguments)


def find_main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of ar-find."""
    _main(find_parser(), "ar_demo.cli.finds:find_command", arguments)


def join_main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of ar-join."""
    _main(join_parser(), "ar_demo.cli.joining:join_command", arguments)


def report_main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of ar-report."""
    _main(report_parser(), "ar_demo.cli.reports:report_command", arguments)


def batch_main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of ar-batch."""
    _main(batch_parser(), "ar_demo.batch.commands:batch_command", arguments)


def studio_main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of ar-studio."""
    _main(studio_parser(), "ar_demo.studio.command:studio_command", arguments)


def _main(
    parser: Parser, command: str, arguments: Sequence[str] | None, others: Mapping[str, str] | None = None
) -> None:
    """Args: others: commands in place of it where an option is given, by the option's name."""

    def parse_and_do(arguments: Sequence[str] | None) -> int:
        chosen = parser.parse_args(arguments)
        named = next((other for name, other in (others or {}).items() if name in chosen), command)
        do: Callable[[Namespace], int] = load(named, LEFT_BEHIND)
        return do(chosen)

    sys.exit(run(parse_and_do, arguments, LEFT_BEHIND))
