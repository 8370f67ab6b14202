"""Running trackers over sequences, once each from the first frame, and keeping what they say on disk."""

import json
import logging
import multiprocessing
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import cv2
import numpy as np

from ..errors import InputError, RunError
from ..imaging.arrays import Array, Image
from .sequences import Sequence
from .trackers import LOST, Answer, make_tracker

log = logging.getLogger(__name__)

FAILURES = (cv2.error, ValueError, RuntimeError, np.linalg.LinAlgError)  # of a tracker

Done = Callable[[str], None]


@dataclass(frozen=True)
class Track:
    """What a tracker said.

    Attributes:
        corners: (N, 4, 2) px, NaN where it gave none; the first row is the quad that it was given.
        states: N times 'tracked', 'held' or 'lost'.
        seconds: (N - 1,) for each frame but the first.
    """

    corners: Array
    states: tuple[str, ...]
    seconds: Array


@dataclass(frozen=True)
class ClipTracker:
    """What tracks a whole clip at once, knowing the frames to come, unlike the trackers of `trackers`.

    Attributes:
        track: from a sequence and the weights to take, its track; raises InputError or RunError. Other processes must
            find the function: it is one of a module.
        made_by: the code and weights that make the tracks, as `identity.made_by` says it of other trackers.
    """

    track: Callable[[Sequence, Path | None], Track]
    made_by: Callable[[Path | None], str]


@dataclass(frozen=True)
class Job:
    """One tracker on one sequence, and the file for its track.

    weights: of ours; None for a peer. made_by: the code and weights that make the track, see `identity.made_by`.
    clip_tracker: what tracks the whole clip at once; None where the tracker is one of `trackers`.
    """

    sequence: Sequence
    tracker: str
    path: Path
    weights: Path | None = None
    made_by: str = ""
    clip_tracker: ClipTracker | None = None

    @property
    def title(self) -> str:
        return f"{self.tracker} on {self.sequence.dataset}/{self.sequence.name}"

    def load(self) -> Track | None:
        """The track, if it is there and was made of just these frames by just this code and these weights."""
        try:
            data = json.loads(self.path.read_text(encoding="utf-8"))
        except (FileNotFoundError, json.JSONDecodeError):
            return None
        if data["of"] != self.identity:
            return None
        corners = [np.full((4, 2), np.nan) if c is None else np.array(c, np.float64) for c in data["corners"]]
        return Track(np.stack(corners), tuple(data["states"]), np.array(data["seconds"]))

    def save(self, track: Track) -> None:
        """Writes the track; it appears under its name only when it is complete."""
        corners = [None if np.isnan(c).any() else np.round(c, 4).tolist() for c in track.corners]
        data = {
            "of": self.identity,
            "corners": corners,
            "states": list(track.states),
            "seconds": np.round(track.seconds, 6).tolist(),
        }
        self.path.parent.mkdir(parents=True, exist_ok=True)
        partial = self.path.with_suffix(f".{os.getpid()}.part")
        partial.write_text(json.dumps(data), encoding="utf-8")
        partial.replace(self.path)

    @property
    def identity(self) -> dict[str, object]:
        """What the track is made of and by, as JSON."""
        s = self.sequence
        return {
            "made by": self.made_by,
            "bytes": s.source.stat().st_size if isinstance(s.source, Path) else len(s.source),
            "dataset": s.dataset,
            "sequence": s.name,
            "tracker": self.tracker,
            "frames": len(s.truth),
            "quad": s.quad.tolist(),
        }


def run(job: Job) -> Track:
    """Runs the tracker over the sequence's frames.

    A tracker that refuses the target is lost in every frame; a clip that ends early gives a shorter track. The log
    says so.

    Raises:
        InputError: the frames cannot be read, or there are fewer than two.
        RunError: the tracker failed.
    """
    if job.clip_tracker is not None:
        try:
            return job.clip_tracker.track(job.sequence, job.weights)
        except (InputError, RunError):
            raise
        except FAILURES as error:
            raise RunError(f"{job.title} failed: {_reason(error)}") from error
    sequence, tracker = job.sequence, make_tracker(job.tracker, job.weights)
    frames = sequence.frames()
    first = next(frames, None)
    if first is None:
        raise InputError(f"{sequence.dataset}/{sequence.name} has no frames: copy it again from its data set")
    answer: Callable[[Image], Answer] = tracker.track
    try:
        tracker.init(first, sequence.quad)
    except InputError as error:
        log.warning("%s counts as lost throughout: %s", job.title, error)
        answer = _no_answer
    corners, states, seconds = [sequence.quad], ["tracked"], []
    for frame in frames:
        start = perf_counter()
        try:
            found = answer(frame)
        except FAILURES as error:
            raise RunError(f"{job.title} failed in frame {len(corners)}: {_reason(error)}") from error
        seconds.append(perf_counter() - start)
        corners.append(np.full((4, 2), np.nan) if found.corners is None else found.corners)
        states.append(found.state)
    if len(corners) < 2:
        raise InputError(f"{sequence.dataset}/{sequence.name} has a single frame: there is nothing to track")
    if len(corners) < len(sequence.truth):
        log.warning("%s ends after %d frames, its truth after %d", job.title, len(corners), len(sequence.truth))
    return Track(np.stack(corners), tuple(states), np.array(seconds))


def run_all(jobs: Iterable[Job], workers: int, done: Done) -> list[str]:
    """Runs jobs and saves their tracks, in this process or in several; tells `done` each finished one's title.

    Returns:
        What went wrong, a sentence for each job that failed; the others are finished all the same.
    """
    failures = []
    for job, failure in _in_turn(jobs) if workers == 1 else _at_once(list(jobs), workers):
        if failure:
            failures.append(failure)
        done(job.title)
    return failures


def _in_turn(jobs: Iterable[Job]) -> Iterator[tuple[Job, str | None]]:
    for job in jobs:
        yield job, _run_and_save(job)


def _at_once(jobs: list[Job], workers: int) -> Iterator[tuple[Job, str | None]]:
    threads = max(1, (os.cpu_count() or 1) // workers)
    # A forked process would inherit locks of OpenCV's and PyTorch's threads.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context, _limit_threads, (threads,)) as pool:
        try:
            futures = {pool.submit(_run_and_save, job): job for job in jobs}
            for future in as_completed(futures):
                yield futures[future], future.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def _run_and_save(job: Job) -> str | None:
    try:
        job.save(run(job))
    except (InputError, RunError) as error:
        return str(error)
    return None


def _reason(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[-1]


def _limit_threads(threads: int) -> None:
    cv2.setNumThreads(threads)
    os.environ["OMP_NUM_THREADS"] = str(threads)  # PyTorch's, which is not imported yet


def _no_answer(_: Image) -> Answer:
    return LOST
