"""`hdn-eval`: runs trackers over data sets and writes one folder of tracks, tables, plots and failure sheets."""

import argparse
import logging
import sys
from collections.abc import Sequence as Many
from fnmatch import fnmatchcase
from pathlib import Path

from tqdm import tqdm

from ..commandline import Parser, run
from ..errors import InputError, RunError
from .datasets import READERS, open_dataset
from .degradation import DEGRADATIONS
from .metrics import measure
from .plots import write_plots
from .report import Result, by_tracker, write_sheet, write_tables
from .running import Job, run_all
from .sequences import Sequence
from .trackers import TRACKERS, make_tracker

log = logging.getLogger(__name__)


def main(arguments: Many[str] | None = None) -> None:
    """Entry point of hdn-eval."""
    sys.exit(run(_command, arguments, "finished tracks are kept, the same command goes on from there"))


def _command(arguments: Many[str] | None) -> int:
    options = _parser().parse_args(arguments)
    logging.basicConfig(format="%(levelname)s: %(message)s", level=logging.WARNING)
    evaluate(options)
    return 0


def _parser() -> Parser:
    parser = Parser(
        prog="hdn-eval",
        description="Run planar trackers over data sets and compare them. Each runs once over each clip, from its "
        "first frame. Finished tracks are kept: the same command after an interruption goes on from there.",
        epilog="Exit status: 0 done, 1 failed while working, 2 wrong input.",
    )
    parser.add_argument(
        "datasets",
        nargs="+",
        metavar="DATASET",
        help=f"a folder whose layout is recognised, or READER:FOLDER; readers: {', '.join(READERS)}",
    )
    parser.add_argument(
        "--trackers", nargs="+", default=["hdn"], metavar="NAME", help=f"default hdn; of {', '.join(TRACKERS)}"
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


def evaluate(options: argparse.Namespace) -> None:
    """What the command does, with the options of its parser.

    Raises:
        InputError: wrong options, data sets or trackers.
        RunError: a tracker failed on some sequences; what the others did is written all the same.
    """
    if options.workers < 1 or (options.limit is not None and options.limit < 2):
        raise InputError("--workers takes 1 or more, --limit 2 or more")
    for name in options.trackers:
        make_tracker(name)  # says now what is missing
    sequences = [s for spec in options.datasets for s in open_dataset(spec)]
    sequences = [s for s in sequences if options.only is None or fnmatchcase(s.name, options.only)]
    if not sequences:
        raise InputError(f"no sequence is called like '{options.only}': see the names without --only")
    sequences = [s.limited(options.limit) for s in sequences]
    if options.degrade:
        sequences = [s.degraded(options.degrade) for s in sequences]

    jobs = [_job(s, tracker, options.out) for tracker in dict.fromkeys(options.trackers) for s in sequences]
    if len({job.path for job in jobs}) < len(jobs):
        raise InputError("two data sets have the same name and sequences: give them one by one, with their own --out")
    todo = [job for job in jobs if options.fresh or job.load() is None]
    with tqdm(total=len(jobs), initial=len(jobs) - len(todo), unit=" runs", disable=not sys.stderr.isatty()) as bar:

        def done(title: str) -> None:
            bar.set_postfix_str(title, refresh=False)
            bar.update()

        failures = run_all(todo, options.workers, done)
    _report(jobs, options.out, options.quiet)
    if failures:
        raise RunError(f"{len(failures)} of {len(jobs)} runs failed; the first: {failures[0]}")


def _job(sequence: Sequence, tracker: str, out: Path) -> Job:
    return Job(sequence, tracker, out / "tracks" / sequence.dataset / tracker / f"{sequence.name}.json")


def _report(jobs: list[Job], out: Path, quiet: bool) -> None:
    results = []
    for job in jobs:
        track = job.load()
        if track is None:
            continue  # it failed
        truth = job.sequence.truth[: len(track.corners)]
        try:
            measures = measure(truth, track.corners, track.lost, track.seconds)
        except InputError as error:
            log.warning("%s is left out: %s", job.title, error)
            continue
        results.append(Result(job.tracker, job.sequence, track, measures))
    if not results:
        return
    markdown = write_tables(results, out)
    for dataset in dict.fromkeys(r.sequence.dataset for r in results):
        of_dataset = [r for r in results if r.sequence.dataset == dataset]
        (out / dataset).mkdir(parents=True, exist_ok=True)
        write_plots(of_dataset, out / dataset)
        for tracker, group in by_tracker(of_dataset).items():
            write_sheet(group, out / dataset / f"failures-{tracker}.jpg")
    if not quiet:
        print(markdown)
        print(f"Written to {out}")


if __name__ == "__main__":
    main()
