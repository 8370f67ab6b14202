"""`hdn-eval`: runs trackers over data sets and writes one folder of tracks, tables, plots and failure sheets."""

import argparse
import logging
import sys
from collections.abc import Iterable, Mapping
from collections.abc import Sequence as Many
from fnmatch import fnmatchcase
from pathlib import Path
from types import MappingProxyType

from ..commandline import Parser, run
from ..errors import InputError
from .datasets import READERS, open_dataset
from .degradation import DEGRADATIONS
from .evaluation import Evaluation
from .running import ClipTracker
from .sequences import Sequence
from .trackers import TRACKERS, weights_of


def main(arguments: Many[str] | None = None) -> None:
    """Entry point of hdn-eval."""
    sys.exit(run(command, arguments, "finished tracks are kept, the same command goes on from there"))


def command(
    arguments: Many[str] | None,
    program: str = "hdn-eval",
    trackers: Many[str] = ("hdn",),
    clip_trackers: Mapping[str, ClipTracker] = MappingProxyType({}),
) -> int:
    """What hdn-eval does, and returns its exit status.

    Args:
        program: by which name it was called.
        trackers: by default.
        clip_trackers: what can be compared beside TRACKERS; they take the weights that hdn takes.

    Raises:
        InputError, RunError: wrong input; a run failed.
    """
    options = _parser(program, trackers, clip_trackers).parse_args(arguments)
    logging.basicConfig(format="%(levelname)s: %(message)s", level=logging.WARNING)
    if options.workers < 1 or (options.limit is not None and options.limit < 2):
        raise InputError("--workers takes 1 or more, --limit 2 or more")
    names = {name: "hdn" if name in clip_trackers else name for name in options.trackers}
    weights = {name: weights_of(alike, options.weights) for name, alike in names.items()}
    unused = [str(path) for path in options.weights if path not in weights.values()]
    if unused:
        raise InputError(f"none of the trackers takes {unused[0]}: name one that does with --trackers")
    evaluation = Evaluation(_sequences(options), weights, options.out, clip_trackers)
    evaluation.run(options.workers, options.fresh)
    markdown = evaluation.write()
    if markdown and not options.quiet:
        print(markdown)
        print(f"Written to {options.out}")
    evaluation.check()
    return 0


def _parser(program: str, trackers: Many[str], clip_trackers: Iterable[str]) -> Parser:
    parser = Parser(
        prog=program,
        description="Run planar trackers over data sets and compare them. Each runs once over each clip, from its "
        "first frame. Finished tracks are kept: the same command after an interruption goes on from there, and runs "
        "again only what its code or weights have changed for.",
        epilog="Exit status: 0 done, 1 failed while working, 2 wrong input.",
    )
    parser.add_argument(
        "datasets",
        nargs="+",
        metavar="DATASET",
        help=f"a folder whose layout is recognised, or READER:FOLDER; readers: {', '.join(READERS)}",
    )
    parser.add_argument(
        "--trackers",
        nargs="+",
        default=trackers,
        metavar="NAME",
        help=f"default {' '.join(trackers)}; of {', '.join((*clip_trackers, *TRACKERS))}",
    )
    parser.add_argument(
        "--weights",
        nargs="+",
        type=Path,
        default=[],
        metavar="FILE",
        help="for the trackers that are ours, each of the configuration that it names: a compact file instead of the "
        "shipped one, a paper one for hdn-paper and hdn-authors, which need it",
    )
    degradations = "; ".join(f"{name}: {text.replace('%', '%%')}" for name, text in DEGRADATIONS.items())
    parser.add_argument("--degrade", choices=list(DEGRADATIONS), help=f"make every clip harder. {degradations}")
    parser.add_argument("--out", type=Path, default=Path("runs/eval"), metavar="DIR", help="default runs/eval")
    parser.add_argument("--only", metavar="PATTERN", help="only sequences with such names, as in 'V0[1-3]_*'")
    parser.add_argument("--limit", type=int, metavar="N", help="only each clip's first N frames")
    parser.add_argument(
        "--workers", type=int, default=1, metavar="N", help="processes at once (default 1: times are comparable)"
    )
    parser.add_argument("--fresh", action="store_true", help="run again what there are tracks of already")
    parser.add_argument("--quiet", action="store_true", help="print no table")
    return parser


def _sequences(options: argparse.Namespace) -> list[Sequence]:
    sequences = [s for spec in options.datasets for s in open_dataset(spec)]
    sequences = [s for s in sequences if options.only is None or fnmatchcase(s.name, options.only)]
    if not sequences:
        raise InputError(f"no sequence is called like '{options.only}': see the names without --only")
    sequences = [s.limited(options.limit) for s in sequences]
    return [s.degraded(options.degrade) for s in sequences] if options.degrade else sequences


if __name__ == "__main__":
    main()
