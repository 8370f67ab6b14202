"""Trackers over sequences, from frames to a folder of tracks, tables, plots and sheets."""

import logging
import sys
from collections.abc import Mapping
from collections.abc import Sequence as Many
from pathlib import Path
from types import MappingProxyType

from tqdm import tqdm

from ..errors import InputError, RunError
from .identity import made_by
from .metrics import measure
from .plots import write_plots
from .report import Result, by_tracker, write_sheet, write_tables
from .running import ClipTracker, Job, run_all
from .sequences import Sequence
from .trackers import make_tracker

log = logging.getLogger(__name__)


class Evaluation:
    """Every tracker once over every sequence; tracks that are there already are kept.

    Args:
        trackers: names, each with its weights (see `weights_of`).
        out: the folder to write.
        clip_trackers: what `trackers` names beside those of this package.

    Raises:
        InputError: an unknown tracker, or two sequences of the same name.
    """

    def __init__(
        self,
        sequences: Many[Sequence],
        trackers: Mapping[str, Path | None],
        out: Path,
        clip_trackers: Mapping[str, ClipTracker] = MappingProxyType({}),
    ) -> None:
        self.out = out
        self.jobs: list[Job] = []
        for name, path in trackers.items():
            of_clips = clip_trackers.get(name)
            if of_clips is None:
                make_tracker(name, path)  # says now what is missing
            code = made_by(path) if of_clips is None else of_clips.made_by(path)
            self.jobs += [
                Job(s, name, out / "tracks" / s.dataset / name / f"{s.name}.json", path, code, of_clips)
                for s in sequences
            ]
        self.failures: list[str] = []
        if len({job.path for job in self.jobs}) < len(self.jobs):
            raise InputError("two data sets have the same name and sequences: give each its own run and --out")

    def run(self, workers: int = 1, fresh: bool = False) -> None:
        """Runs what has not run, or everything; see `check` for what failed."""
        todo = [job for job in self.jobs if fresh or job.load() is None]
        total, done = len(self.jobs), len(self.jobs) - len(todo)
        with tqdm(total=total, initial=done, unit=" runs", disable=not sys.stderr.isatty()) as bar:

            def advance(title: str) -> None:
                bar.set_postfix_str(title, refresh=False)
                bar.update()

            self.failures = run_all(todo, workers, advance)

    def results(self) -> list[Result]:
        """What ran, measured; a sequence that nothing can be said of is left out, and the log says so."""
        results = []
        for job in self.jobs:
            track = job.load()
            if track is None:
                continue  # it failed
            truth = job.sequence.truth[: len(track.corners)]
            try:
                measures = measure(truth, track.corners, track.states, track.seconds)
            except InputError as error:
                log.warning("%s is left out: %s", job.title, error)
                continue
            results.append(Result(job.tracker, job.sequence, track, measures))
        return results

    def write(self) -> str:
        """Writes tables, plots and sheets; returns the tables as Markdown, nothing where there are no results."""
        results = self.results()
        if not results:
            return ""
        markdown = write_tables(results, self.out)
        for dataset in dict.fromkeys(r.sequence.dataset for r in results):
            of_dataset = [r for r in results if r.sequence.dataset == dataset]
            (self.out / dataset).mkdir(parents=True, exist_ok=True)
            write_plots(of_dataset, self.out / dataset)
            for tracker, group in by_tracker(of_dataset).items():
                write_sheet(group, self.out / dataset / f"failures-{tracker}.jpg")
        return markdown

    def check(self) -> None:
        """Raises RunError where a run failed."""
        if self.failures:
            raise RunError(f"{len(self.failures)} of {len(self.jobs)} runs failed; the first: {self.failures[0]}")
