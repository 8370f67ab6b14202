"""The verdict on tracks: whether they can be believed unseen, by a few thresholds, and the reasons."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import numpy as np

from .errors import InputError
from .tracks import Track
from .words import counted

Status = Literal["pass", "check", "fail"]
STATUSES: tuple[Status, ...] = get_args(Status)
EXIT_STATUS: dict[Status, int] = {"pass": 0, "check": 4, "fail": 5}  # with `--strict`

WIDE_PX = 1280  # longer side of a frame from which on the deviation that is allowed grows with it


def parse_share(text: str | float) -> float:
    """Reads '5%' or 0.05 as a share, 0..1.

    Raises:
        InputError: neither.
    """
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*(%?)\s*", str(text))
    share = float(match[1]) / (100 if match[2] else 1) if match else np.nan
    if not 0 <= share <= 1:
        raise InputError(f"'{text}' is no share: give one as 5% or 0.05")
    return share


@dataclass(frozen=True)
class Limits:
    """What a track may be and still pass; `docs/report.md` says how they were chosen.

    Attributes:
        max_held: share of its frames that may be held, 0..1; with more it is to be checked.
        max_lost: share that may be lost; with more it is to be checked.
        fail_lost: share of lost frames beyond which it fails.
        max_deviation: px, standard deviation of the corners that no frame may exceed, or it is to be checked; in
            frames wider or higher than 1280 px in proportion more.

    Raises:
        InputError: a value that is not allowed.
    """

    max_held: float = 0.5
    max_lost: float = 0.0
    fail_lost: float = 0.5
    max_deviation: float = 1.5

    def __post_init__(self) -> None:
        for name in ("max_held", "max_lost", "fail_lost"):
            if not 0 <= getattr(self, name) <= 1:
                raise InputError(f"{name} {getattr(self, name):g} is out of range: give 0% to 100%")
        if not 0 <= self.max_deviation < np.inf:
            raise InputError(f"max_deviation {self.max_deviation:g} is out of range: give 0 px or more")

    def deviation_in(self, track: Track) -> float:
        """The largest that is allowed in the track's frames, px."""
        return self.max_deviation * max(1.0, max(track.source.width, track.source.height) / WIDE_PX)


LIMITS = Limits()


@dataclass(frozen=True)
class Verdict:
    """Whether tracks can be believed unseen.

    Attributes:
        status: 'pass'; 'check': somebody should look at it; 'fail': it is of no use as it is.
        reasons: why it does not pass, one sentence each.
        held, lost: shares of the frames, 0..1, of the worst track. deviation: px, the largest of any frame.
        limits: by which it was judged.
    """

    status: Status
    reasons: list[str] = field(default_factory=list)
    held: float = 0.0
    lost: float = 0.0
    deviation: float = 0.0
    limits: Limits = LIMITS

    @property
    def exit_status(self) -> int:
        """Of a command with `--strict`."""
        return EXIT_STATUS[self.status]

    def __str__(self) -> str:
        return ": ".join([self.status, *filter(None, ["; ".join(self.reasons)])])

    def summary(self) -> dict[str, Any]:
        """As JSON can hold it."""
        return {
            "status": self.status,
            "reasons": self.reasons,
            "held": round(self.held, 4),
            "lost": round(self.lost, 4),
            "deviation": round(self.deviation, 3),
        }


def judge(tracks: Track | Sequence[Track], limits: Limits = LIMITS) -> Verdict:
    """The verdict on the track of a surface, or on those of several, of which the worst counts.

    Raises:
        InputError: there is none.
    """
    tracks = [tracks] if isinstance(tracks, Track) else list(tracks)
    if not tracks:
        raise InputError("there is no track to judge: give one")
    single = [_of_one(track, limits) for track in tracks]
    reasons = [
        reason if len(tracks) == 1 else f"surface {number}: {reason}"
        for number, verdict in enumerate(single, 1)
        for reason in verdict.reasons
    ]
    status = max((verdict.status for verdict in single), key=STATUSES.index)
    held, lost, deviation = (max(getattr(v, name) for v in single) for name in ("held", "lost", "deviation"))
    return Verdict(status, reasons, held, lost, deviation, limits)


def _of_one(track: Track, limits: Limits) -> Verdict:
    counts = track.counts
    frames = sum(counts.values())
    held, lost = counts["held"] / frames, counts["lost"] / frames
    known = track.deviation[track.inside][np.isfinite(track.deviation[track.inside])]
    deviation, allowed = float(known.max(initial=0)), limits.deviation_in(track)
    reasons = []
    for state, share, most in (("lost", lost, limits.max_lost), ("held", held, limits.max_held)):
        if share > most:
            of_all = f"{counts[state]} of {counted(frames, 'frame')} ({share:.1%})"
            reasons.append(f"{state} in {of_all}, where {most:.1%} may be")
    if deviation > allowed:
        count = int((known > allowed).sum())
        where = f"by more than {allowed:.1f} px in {counted(count, 'frame')}"
        reasons.append(f"corners are uncertain by {deviation:.1f} px at worst, {where}")
    status: Status = "check" if reasons else "pass"
    if lost > max(limits.fail_lost, limits.max_lost):
        status = "fail"
    return Verdict(status, reasons, held, lost, deviation, limits)
