"""Which frames of a damaged file can be trusted: what a decoder conceals looks like any other picture."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction

import av


@dataclass(frozen=True)
class DamageModel:
    """When frames that are missing from a file without a word are taken for damage.

    Attributes:
        gap_frames: missing from between two that else come evenly.
        even_frames: that came evenly before it.
        even_seconds: by which times of such frames may be off.
        told_stretches: of damaged frames that are named.
    """

    gap_frames: int = 3
    even_frames: int = 8
    even_seconds: Fraction = Fraction(2, 1000)
    told_stretches: int = 8


MODEL = DamageModel()


class DamageWatch:
    """Looks at frames as they are decoded: after damage all are doubtful, up to the next whole key frame.

    A frame is damaged where its decoder says so, or a packet before it did not decode or was marked as damaged. The
    arithmetic coding of HEVC, VP9 and AV1 hardly tells, since whatever stands there decodes to something. The demuxers
    of Matroska and MPEG-TS pass over what they cannot read: a gap between frames that else come evenly tells.

    Attributes:
        missing: frames that are not there, as far as a gap between frames that else come evenly tells.
    """

    def __init__(self, muxer: str, rate: Fraction) -> None:
        """Args:
        muxer: FFmpeg's name of the file's format.
        rate: frames per second.
        """
        self.missing = 0
        self._gaps_tell, self._step = any(name in muxer for name in ("matroska", "mpegts")), 1 / rate
        self._counts = muxer != "avi"  # whose demuxer guesses times after damage
        self._last: Fraction | None = None
        self._even: int | None = 0  # frames that came evenly, None since one did not
        self._breaks: list[float] = []  # timestamps from which frames are doubtful
        self._is_known = False  # that the file is damaged: from then on each gap tells

    def broken(self, since: int | None) -> None:
        """Takes note of a packet, of this timestamp or a later one, that did not decode or was marked as damaged."""
        self._is_known = True
        self._breaks.append(-math.inf if since is None else since)

    def damaged(self, number: int, frame: av.VideoFrame, time: Fraction) -> range:
        """Which frames the next one, at a time in seconds, proves to show damage, or to be likely to."""
        pts = math.inf if frame.pts is None else frame.pts
        gap = self._gap(time)
        tells = gap > 0 and (self._is_known or (self._gaps_tell and gap >= MODEL.gap_frames))
        self._is_known = self._is_known or tells or frame.is_corrupt
        self.missing += gap * (self._is_known and self._counts)
        if frame.key_frame:
            self._breaks = [since for since in self._breaks if since >= pts]
        if frame.is_corrupt or (tells and not frame.key_frame):
            self._breaks.append(pts)
        doubtful = any(since <= pts for since in self._breaks)
        return range(number - tells, number + doubtful)  # the one before a gap is likely to be cut off

    def _gap(self, time: Fraction) -> int:
        """Frames missing before this one, where those so far came evenly."""
        last, self._last = self._last, time
        if last is None or self._even is None:
            return 0
        frames = round((time - last) / self._step)
        if frames < 1 or abs(time - last - frames * self._step) > MODEL.even_seconds:
            self._even = None
            return 0
        self._even += 1
        return frames - 1 if self._even > MODEL.even_frames else 0


def told(name: str, frames: Iterable[int], missing: int) -> str:
    """A warning: a file's name, numbers of its damaged frames, and how many are missing beside them."""
    numbers = sorted(frames)
    parts = []
    if numbers:
        noun = "frame" if len(numbers) == 1 else "frames"
        parts.append(f"{noun} {in_stretches(numbers)} may show it")
    if missing:
        parts.append(f"{missing} {'frame is' if missing == 1 else 'frames are'} missing")
    return f"{name} is damaged: {', '.join(parts)}; what can be decoded is used"


def in_stretches(numbers: Iterable[int]) -> str:
    """Ascending numbers in words, as '3, 30 to 44 and 60'."""
    found: list[list[int]] = []
    for number in numbers:
        if found and number == found[-1][1] + 1:
            found[-1][1] = number
        else:
            found.append([number, number])
    words = [str(first) if first == last else f"{first} to {last}" for first, last in found]
    if len(words) > MODEL.told_stretches:
        words[MODEL.told_stretches - 1 :] = ["others"]
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
