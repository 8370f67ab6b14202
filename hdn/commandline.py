"""What all command lines share: one line per error, and the same exit statuses."""

import argparse
import logging
import re
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

from .errors import TORCH_MISSING, InputError, RunError
from .signals import Ended, ending, heard, leaving
from .signals import status as ended_status
from .standard_streams import lost, make_harmless

SHELLS = ("bash", "zsh", "tcsh")
FILES = ("input", "ad", "output", "layer", "matte")  # arguments that are files, and sometimes something else

DONE, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130

NEGATIVE = re.compile(r"-\.?\d[\d.,:;e+-]*(s|ms|%)?")  # a number, numbers, or a time, below zero

log = logging.getLogger(__name__)


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, as every other error of ours is said."""

    def __init__(self, prog: str, description: str, epilog: str | None = None) -> None:
        super().__init__(prog, description=description, epilog=epilog)
        self.add_argument(
            "--version", action=_Version, nargs=0, default=argparse.SUPPRESS, help="show the version and exit"
        )
        self.add_argument(
            "--print-completion",
            action=_Completion,
            choices=SHELLS,
            default=argparse.SUPPRESS,
            help="print what completes this command's options in a shell, and exit",
        )

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As argparse does, but corners such as -50,70 are values, not options.

        A blank before a number changes nothing of it, and argparse takes no option to begin with one.
        """
        words = [*(sys.argv[1:] if args is None else args)]
        return super().parse_known_args([f" {w}" if NEGATIVE.fullmatch(w) else w for w in words], namespace)

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message} (see {self.prog} --help)")


class _Version(argparse.Action):
    """Looked up only when asked for: reading what is installed takes time."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        from importlib.metadata import version

        print(f"{parser.prog} {version('ar-replace')}")
        parser.exit()


class _Completion(argparse.Action):
    """Made only when asked for, by shtab. A name of a file is completed wherever a path is taken."""

    def __call__(self, parser: argparse.ArgumentParser, _: Any, shell: Any, *__: Any) -> None:
        import shtab

        for action in parser._actions:
            if action.type is Path or action.dest in FILES:
                action.complete = shtab.FILE  # type: ignore[attr-defined]
        print(shtab.complete(parser, shell))
        parser.exit()


def natural(text: str) -> int:
    """The type of an option that takes a whole number from 1 on."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number from 1 on")
    return int(text)


Command = Callable[[Sequence[str] | None], int]


def run(command: Command, arguments: Sequence[str] | None, interrupted: str) -> int:
    """The command's exit status; whatever it raises is said in one line on stderr.

    Args:
        command: takes the arguments, and gives the exit status; see `load`.
        interrupted: what Ctrl-C, SIGTERM and SIGHUP leave behind.
    """
    make_harmless()
    with ending():
        status = _status(command, arguments, interrupted)
    if (error := lost()) is not None:
        print(f"error: standard output cannot be written to: {(error.strerror or str(error)).lower()}", file=sys.stderr)
        return status or FAILED
    return status


def _status(command: Command, arguments: Sequence[str] | None, interrupted: str) -> int:
    try:
        return command(arguments)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return BAD_INPUT
    except ModuleNotFoundError as error:
        if error.name != "torch":
            raise
        print(f"error: this takes {TORCH_MISSING}", file=sys.stderr)
        return BAD_INPUT
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        print(f"error: {reason if error.filename is None else f'{error.filename}: {reason}'}", file=sys.stderr)
        return FAILED
    except (RunError, MemoryError) as error:
        print(f"error: {str(error) or type(error).__name__}", file=sys.stderr)
        return error.exit_status if isinstance(error, RunError) else FAILED
    except KeyboardInterrupt as error:
        print(f"interrupted: {interrupted}", file=sys.stderr)
        return ended_status(error.number) if isinstance(error, Ended) else INTERRUPTED
    except Exception as error:  # ours to mend, but no reason to show a trace to somebody who cannot
        if isinstance(error, ModuleNotFoundError) and error.name == "torch":
            print(f"error: this takes {TORCH_MISSING}", file=sys.stderr)
            return BAD_INPUT
        log.debug("unexpected", exc_info=True)
        reason = f"{type(error).__name__}: {error}".split("\n")[0]
        print(f"error: {reason}; this should not happen: please report it with the command line", file=sys.stderr)
        return FAILED


def load(command: str, interrupted: str) -> Any:
    """Imports 'module:function'. Libraries that are being loaded swallow Ctrl-C, or fail by it: so it just ends all."""
    with heard(leaving(f"interrupted: {interrupted}")):
        module, _, function = command.partition(":")
        return getattr(import_module(module), function)
