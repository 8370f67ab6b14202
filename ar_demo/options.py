"""What a user can choose, with its defaults; checked where it is made."""

import re
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from .errors import InputError

Fit = Literal["stretch", "contain", "cover"]
Playback = Literal["loop", "hold", "once"]
AudioMode = Literal["source", "ad", "mix", "none"]
Lost = Literal["hold", "fade", "hide"]
Effect = Literal["replace", "mosaic", "blur", "outline"]
Backend = Literal["auto", "egl", "osmesa", "opencv"]
Device = Literal["auto", "cpu", "cuda"]

Quad = NDArray[np.float64]


@dataclass(frozen=True)
class Moment:
    """A frame of a video, by number or by time in seconds."""

    frame: int | None = None
    time: Fraction | None = None

    @classmethod
    def parse(cls, text: "str | int | Moment") -> "Moment":
        """Reads '120' as a frame number; '4.5s', '0:04.5' or '1:02:03' as a time.

        Raises:
            InputError: neither.
        """
        if isinstance(text, Moment):
            return text
        text = str(text)
        if re.fullmatch(r"\d+", text):
            return cls(frame=int(text))
        if match := re.fullmatch(r"(?:(?:(\d+):)?(\d+):)?(\d+(?:\.\d+)?)s?", text):
            hours, minutes, seconds = (Fraction(g or 0) for g in match.groups())
            return cls(time=hours * 3600 + minutes * 60 + seconds)
        raise InputError(f"'{text}' is neither a frame number (120) nor a time (4.5s, 0:04.5): give one of these")

    def reached(self, index: int, time: Fraction) -> bool:
        """Whether a frame of this index and time, seconds from the first frame, is at or after the moment."""
        return index >= self.frame if self.frame is not None else self.time is None or time >= self.time

    def __str__(self) -> str:
        return f"frame {self.frame}" if self.frame is not None else f"{float(self.time or 0):g} s"


def parse_quad(points: list[str] | str | Quad | list[list[float]]) -> Quad:
    """Four corners 'x,y', as strings or numbers, to a quad (4, 2).

    Raises:
        InputError: not four points of two numbers.
    """
    if isinstance(points, str):
        points = points.split()
    try:
        rows = [p.replace(",", " ").split() if isinstance(p, str) else p for p in points]
        quad = np.array(rows, np.float64)
    except (TypeError, ValueError):
        quad = np.empty(0)
    if quad.shape != (4, 2) or not np.isfinite(quad).all():
        raise InputError(
            "the quad needs four corners x,y in pixels: top-left, top-right, bottom-right, bottom-left of the ad, "
            "as in --quad 100,80 300,80 300,240 100,240"
        )
    return quad


@dataclass(frozen=True)
class Keyframe:
    """Corners given by hand: the track passes through them.

    Attributes:
        at: the frame, another one than the reference frame.
        corners: (4, 2) px, in the order of the quad; they may lie outside the frame.
    """

    at: Moment
    corners: Quad

    @classmethod
    def parse(cls, text: str) -> "Keyframe":
        """Reads 'FRAME:x,y,x,y,x,y,x,y', where FRAME is a number or a time as of `Moment.parse`.

        Raises:
            InputError: not of this form, or corners that are no quad.
        """
        moment, _, corners = text.rpartition(":")
        numbers = corners.split(",")
        if not moment or len(numbers) != 8:
            raise InputError(f"keyframe '{text}' is not FRAME:x,y,x,y,x,y,x,y: give a frame and its four corners")
        return cls(Moment.parse(moment), parse_quad([",".join(numbers[i : i + 2]) for i in range(0, 8, 2)]))


@dataclass(frozen=True)
class Placing:
    """One surface: where it is, and how the ad lies on it.

    Attributes:
        quad: (4, 2) the surface's corners in the reference frame, px; top-left, top-right, bottom-right, bottom-left of
            the ad as it shall appear. Needed to track, not to render a track.
        start: the reference frame; tracking runs forward and backward from it.
        keyframes: corners in other frames, where tracking went wrong.
        fit: how the ad's shape is brought to the surface's.
        playback: what a moving ad does when it is over: start again, hold its last frame, or go.
        opacity: 0..1.
        feather: px of the frame over which the ad's edge fades.
        lost: what the ad does while the surface is lost.
        effect: what is drawn; all but 'replace' need no ad.
        flat: whether an ad is laid on as it is, over all, and not lit, blurred and hidden as the surface is.
    """

    quad: Quad | None = None
    start: Moment = field(default_factory=lambda: Moment(frame=0))
    keyframes: tuple[Keyframe, ...] = ()
    fit: Fit = "stretch"
    playback: Playback = "loop"
    opacity: float = 1.0
    feather: float = 0.0
    lost: Lost = "fade"
    effect: Effect = "replace"
    flat: bool = False

    @property
    def in_scene(self) -> bool:
        """Whether the ad takes on the scene's light, blur and occluders."""
        return self.effect == "replace" and not self.flat

    def __post_init__(self) -> None:
        """Raises InputError for a value that is not allowed."""
        for name, choices in CHOICES.items():
            if hasattr(self, name) and getattr(self, name) not in choices:
                raise InputError(f"{name} '{getattr(self, name)}' is unknown: choose {', '.join(choices)}")
        if not 0 <= self.opacity <= 1:
            raise InputError(f"opacity {self.opacity} is out of range: give 0 to 1")
        check_not_negative("feather", self.feather)
        if not isinstance(self.flat, bool):
            raise InputError(f"flat '{self.flat}' is neither true nor false: give one of these")


@dataclass(frozen=True)
class Options(Placing):
    """How to track and render. Every field has the command-line option of the same name.

    Attributes, beside those of a `Placing`:
        end: the last frame; later ones are left out of track and output.
        audio: whose sound the output has.
        smooth: 0 off; 1 by the noise that the track shows; more is stronger.
        backend: what composites.
        device: what runs the networks.
        weights: another weights file.
        crf: quality of the encoder, lower is better; None takes the codec's usual.
        codec: encoder by FFmpeg's name; None takes the container's usual.
        overwrite: whether an existing output may be replaced.
    """

    end: Moment = field(default_factory=Moment)
    audio: AudioMode = "source"
    smooth: float = 1.0
    backend: Backend = "auto"
    device: Device = "auto"
    weights: Path | None = None
    crf: float | None = None
    codec: str | None = None
    overwrite: bool = False

    def __post_init__(self) -> None:
        """Raises InputError for a value that is not allowed."""
        super().__post_init__()
        check_not_negative("smooth", self.smooth)
        if self.crf is not None and not 0 <= self.crf <= 63:
            raise InputError(f"crf {self.crf} is out of range: give 0 (best) to 51, or to 63 for VP9 and AV1")


def check_not_negative(name: str, value: float) -> None:
    """Raises InputError for a negative, infinite or undefined value."""
    if not 0 <= value < np.inf:
        raise InputError(f"{name} {value} is out of range: give 0 or more")


CHOICES: dict[str, tuple[str, ...]] = {
    "fit": get_args(Fit),
    "playback": get_args(Playback),
    "audio": get_args(AudioMode),
    "lost": get_args(Lost),
    "effect": get_args(Effect),
    "backend": get_args(Backend),
    "device": get_args(Device),
}
