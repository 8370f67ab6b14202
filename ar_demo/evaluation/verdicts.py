"""`python -m ar_demo.evaluation.verdicts FOLDER`: how far the verdict on a track can be believed.

Clips with known corners, clean, degraded and staged (the target is covered, leaves, is cut away), are tracked as a
user's videos are, and judged. How often does `pass` hide an error of more than 10 px, and how often is a good track
sent to be checked? Every other clip is there to choose thresholds by, and the others to measure them. Tracks are kept:
what is there already, by the same code and weights, is not made again.
"""

import logging
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from dataclasses import replace as changed
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from hdn.analysis.states_clips import Clip, drawn_clips, measured_clips, staged
from hdn.benchmark.datasets import read_clips
from hdn.benchmark.degradation import DEGRADATIONS, SETTINGS
from hdn.benchmark.metrics import alignment_errors
from hdn.commandline import DONE, Parser, natural, run
from hdn.imaging.arrays import Array, Image

from ..errors import InputError
from ..pipeline import track
from ..surface import Surface
from ..tracks import Track
from ..verdict import LIMITS, Limits, judge
from .tracking import made_by, write_lossless

log = logging.getLogger(__name__)

WRONG_PX, GOOD_PX = 10.0, 5.0  # root mean square over the corners, beyond and within which a pose is wrong, and good
WELL_SEEN = 0.7  # share of the target that makes it wrong to call it lost
EVENTS = ("in view", "partly covered", "covered", "leaves", "cut away")
SEEDS = (101, 102)  # of drawn clips, to choose by and to measure
DRAWN_EACH = 3  # of posters, and of logos, of each seed


@dataclass(frozen=True)
class Case:
    """A clip, and what was done to it.

    Attributes:
        kind: what was done, or "clean". chosen_by: whether thresholds may be chosen by it.
        quad: (4, 2) px, in the first frame. truth: (N, 4, 2) px, NaN where it is not known.
        seen: (N,) share of the target that is to be seen.
    """

    name: str
    kind: str
    chosen_by: bool
    frames: Iterable[Image]
    quad: Array
    truth: Array
    seen: Array


@dataclass(frozen=True)
class Outcome:
    """A track beside the truth.

    Attributes:
        wrong: whether a pose in it is wrong. good: whether all are good, and it is lost nowhere where it is well seen.
    """

    name: str
    kind: str
    chosen_by: bool
    track: Track
    wrong: bool
    good: bool

    @classmethod
    def of(cls, case: Case, found: Track) -> "Outcome":
        """Compares the frames whose corners are known, but the first."""
        n = len(found)
        truth, seen = case.truth[:n], case.seen[:n]
        known = np.asarray(np.isfinite(truth).all((1, 2)))
        known[0] = False
        measured = known & found.known & (seen > 0)
        errors = alignment_errors(truth[measured], found.corners[measured])
        lost = known & (np.array(found.states) == "lost") & (seen >= WELL_SEEN)
        wrong = bool((errors > WRONG_PX).any())
        return cls(
            case.name, case.kind, case.chosen_by, found, wrong, bool((errors <= GOOD_PX).all() and not lost.any())
        )


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point."""
    sys.exit(run(_command, arguments, "finished tracks are kept, the same command goes on from there"))


def _command(arguments: Sequence[str] | None) -> int:
    parser = Parser("python -m ar_demo.evaluation.verdicts", "Measure how far the verdict on a track can be believed.")
    parser.add_argument("clips", type=Path, help="a folder of clips with their corners")
    parser.add_argument("--out", type=Path, default=Path("runs/verdicts"), metavar="DIR", help="where tracks are kept")
    parser.add_argument("--frames", type=natural, default=60, metavar="N", help="of each clip, at most (default: 60)")
    options = parser.parse_args(arguments)
    logging.basicConfig(format="%(levelname)s: %(message)s", level=logging.WARNING)
    outcomes = [Outcome.of(case, found) for case, found in tracked(cases(options.clips, options.frames), options.out)]
    print("\n".join([*table(outcomes, LIMITS), "", *by_threshold(outcomes)]))
    return DONE


def cases(folder: Path, frames: int) -> Iterator[Case]:
    """The clips of a folder, and drawn ones, with all that is done to them."""
    clips = read_clips(folder)
    for number, clip in enumerate(clips):
        for kind in ("clean", *DEGRADATIONS):
            length = frames * SETTINGS.skip_frames if kind == "skip" else frames
            made = clip.limited(length) if kind == "clean" else clip.limited(length).degraded(kind)
            yield Case(clip.name, kind, number % 2 == 0, made.frames(), made.quad, made.truth, np.ones(len(made.truth)))
    dense = [bool(np.isfinite(clip.truth[1:frames]).all()) for clip in clips]
    for number, staged_clip in enumerate(measured_clips(folder, frames)):
        if dense[number]:  # else the frames with known corners lie apart
            yield from _staged(staged_clip, number % 2 == 0, EVENTS[1:])
    for seed in SEEDS:
        for drawn in drawn_clips(DRAWN_EACH, frames, seed):
            yield from _staged(changed(drawn, name=f"drawn {drawn.name}, seed {seed}"), seed == SEEDS[0], EVENTS)


def _staged(clip: Clip, chosen_by: bool, events: Iterable[str]) -> Iterator[Case]:
    for event in events:
        views = list(staged(clip, event))
        seen = np.array([view.seen.mean() for view in views])
        truth = np.stack([view.corners for view in views])
        yield Case(clip.name, event, chosen_by, [view.image for view in views], truth[0], truth, seen)


def tracked(cases: Iterable[Case], out: Path) -> Iterator[tuple[Case, Track]]:
    """Each case with its track; without those whose quad is refused."""
    folder = out / made_by(None)
    folder.mkdir(parents=True, exist_ok=True)
    for case in cases:
        title = f"{case.name} {case.kind} {len(case.truth)}".replace(" ", "-")
        file = folder / f"{title}.json"
        if not file.exists():
            with TemporaryDirectory() as temporary:
                video = Path(temporary) / "clip.mkv"
                write_lossless(iter(case.frames), video, title)
                try:
                    track(video, Surface(quad=case.quad)).save(file)
                except InputError as error:
                    log.warning("%s is left out: %s", title, error)
                    continue
        yield case, Track.load(file)


def table(outcomes: Sequence[Outcome], limits: Limits) -> list[str]:
    """Lines of Markdown: by what was done, and for both halves."""
    rows = [
        "| clips | tracks | `pass` | wrong that `pass` | good that do not | of these nowhere lost |",
        "|---|---|---|---|---|---|",
    ]
    kinds = dict.fromkeys(outcome.kind for outcome in outcomes)
    rows += [_row(kind, [o for o in outcomes if o.kind == kind], limits) for kind in kinds]
    for half, name in ((True, "**all, thresholds chosen by them**"), (False, "**all others**")):
        rows.append(_row(name, [o for o in outcomes if o.chosen_by == half], limits))
    return rows


def by_threshold(outcomes: Sequence[Outcome]) -> list[str]:
    """Lines of Markdown: what other thresholds would do on either half."""
    rows = [
        "| `--max-deviation` | `--max-held` | wrong that `pass`, chosen by | others | good, nowhere lost, that do not "
        "`pass`, chosen by | others |",
        "|---|---|---|---|---|---|",
    ]
    halves = [[o for o in outcomes if o.chosen_by == half] for half in (True, False)]
    for deviation in (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0):
        for held in (0.05, 0.25, 0.5, 1.0):
            counts = [_counts(half, Limits(max_held=held, max_deviation=deviation)) for half in halves]
            hidden = [f"{c.wrong_passes} of {c.wrong}" for c in counts]
            checked = [f"{c.seen_checked} of {c.seen}" for c in counts]
            rows.append(f"| {deviation:g} px | {held:.0%} | {' | '.join([*hidden, *checked])} |")
    return rows


@dataclass(frozen=True)
class _Counts:
    """How many tracks pass, are wrong, or good, or good and nowhere lost ("seen"), and how the verdict takes them."""

    passes: int
    wrong: int
    wrong_passes: int
    good: int
    good_checked: int
    seen: int
    seen_checked: int


def _counts(outcomes: Sequence[Outcome], limits: Limits) -> _Counts:
    passes = {id(o): judge(o.track, limits).status == "pass" for o in outcomes}
    wrong, good = [o for o in outcomes if o.wrong], [o for o in outcomes if o.good]
    seen = [o for o in good if not o.track.counts["lost"]]
    return _Counts(
        sum(passes.values()),
        len(wrong),
        sum(passes[id(o)] for o in wrong),
        len(good),
        sum(not passes[id(o)] for o in good),
        len(seen),
        sum(not passes[id(o)] for o in seen),
    )


def _row(name: str, outcomes: Sequence[Outcome], limits: Limits) -> str:
    c = _counts(outcomes, limits)
    shares = (c.wrong_passes, c.wrong), (c.good_checked, c.good), (c.seen_checked, c.seen)
    figures = " | ".join(f"{some} of {all_}" for some, all_ in shares)
    return f"| {name} | {len(outcomes)} | {c.passes} | {figures} |"


if __name__ == "__main__":
    main()
