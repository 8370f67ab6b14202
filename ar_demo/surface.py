"""A surface of a video: where it is, and what is laid on it and how."""

import logging
import re
from dataclasses import dataclass, field, fields
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from hdn import Observation
from hdn.alignment.snapping import snap
from hdn.imaging.arrays import Array
from hdn.imaging.regions import Region

from .choices import CHOICES, Blend, Effect, FirstLight, Fit, Grain, Lost, Playback, Softness, SurfaceKind
from .errors import InputError
from .tracks import Track

log = logging.getLogger(__name__)

# What an effect that is made from the surface itself has no use for.
ADS_ALONE = ("ad", "fit", "playback", "flat", "shutter", "grain", "softness", "first_light", "surface_kind", "matte")
IN_SCENE_ALONE = ("shutter", "grain", "softness", "first_light", "surface_kind", "matte")


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


FIRST = Moment(frame=0)


@dataclass(frozen=True)
class Span:
    """A part of a video, both of its ends included; None for the video's own."""

    begin: Moment | None = None
    end: Moment | None = None

    @classmethod
    def parse(cls, text: "str | Span") -> "Span":
        """Reads '10s..20s', '250..500', '10s..' or '..20s'.

        Raises:
            InputError: not two moments, see `Moment.parse`, or one.
        """
        if isinstance(text, Span):
            return text
        begin, dots, end = text.partition("..")
        if not dots or not (begin or end):
            raise InputError(f"'{text}' is no span of time: give one as in 10s..20s, 250..500, 10s.. or ..20s")
        return cls(Moment.parse(begin) if begin else None, Moment.parse(end) if end else None)

    def __str__(self) -> str:
        return f"{self.begin or 'the beginning'} to {self.end or 'the end'}"


def parse_quad(points: Any) -> Array:
    """Four corners to a quad (4, 2), px.

    Args:
        points: 'x,y x,y x,y x,y' in one text or four, whatever is between the numbers; or four pairs of numbers.

    Raises:
        InputError: not four points of two numbers.
    """
    quad = _points(points)
    if quad is None or len(quad) != 4:
        raise InputError(
            "the quad needs four corners x,y in pixels: top-left, top-right, bottom-right, bottom-left of the ad, "
            "as in --quad 100,80 300,80 300,240 100,240"
        )
    return quad


def parse_polygon(points: Any) -> Array:
    """Three corners or more to a polygon (n, 2), px of the reference frame.

    Args:
        points: 'x,y x,y x,y ...' in one text or several, whatever is between the numbers; or pairs of numbers.

    Raises:
        InputError: not points of two numbers, or fewer than three.
    """
    polygon = _points(points)
    if polygon is None or len(polygon) < 3:
        raise InputError(
            "a polygon needs three corners x,y or more in pixels of the reference frame, "
            "as in --region 60,40 420,44 410,330 64,320"
        )
    return polygon


def _points(points: Any) -> Array | None:
    """Points (n, 2) of numbers in a text or in several, or of pairs of numbers; None where they are no such thing."""
    try:
        if isinstance(points, str) or all(isinstance(point, str) for point in points):
            text = points if isinstance(points, str) else " ".join(points)
            points = np.array(re.split(r"[\s,;()\[\]]+", text.strip(" ,;()[]\t\n")), np.float64).reshape(-1, 2)
        found = np.array(points, np.float64)
    except (TypeError, ValueError):
        return None
    return found if found.ndim == 2 and found.shape[1] == 2 and np.isfinite(found).all() else None


@dataclass(frozen=True)
class Keyframe:
    """Corners given by hand, about as well as a hand can: what was measured more surely counts more.

    Attributes:
        at: the frame, another one than the reference frame.
        corners: (4, 2) px, in the order of the quad; they may lie outside the frame.
    """

    at: Moment
    corners: Array

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
class Surface:
    """A surface: where it is, and what is laid on it and how.

    Attributes:
        ad: video, image or animated image; None with an effect that is made from the surface itself.
        quad: (4, 2) the surface's corners in the reference frame, px; top-left, top-right, bottom-right, bottom-left of
            the ad as it shall appear. Not needed where there is a track, or a picture to find it by.
        find: picture of the surface, or folder of such, by which it is found in the video; each copy that is seen at
            once is a surface of its own.
        snap: whether the quad, given by hand, moves to the clear edges beside it; keyframes stay as they are given.
        start: the reference frame; tracking runs forward and backward from it.
        region: polygon (n, 2) of the reference frame, px, of what is tracked: around the quad where more of its plane
            is seen, or smaller. None leaves that to the tracker.
        exclude: polygons (n, 2) of the reference frame, px, that tracking ignores: what moves or shines.
        keyframes: corners in other frames, where tracking went wrong.
        track: made earlier; it is tracked anew only around keyframes that it was not made with.
        fit: how the ad's shape is brought to the surface's.
        playback: what a moving ad does when it is over: start again, hold its last frame, or go.
        blend: how the ad's colours mix with those of the surface (W3C Compositing and Blending Level 1); in all modes
            but 'normal' the light is the surface's own.
        opacity: 0..1.
        feather: px of the frame over which the ad's edge fades.
        inset: px of the reference frame that the ad stays within the quad, to each side.
        radius: px of that frame, of the ad's rounded corners.
        lost: what the ad does while the surface is lost.
        effect: what is drawn; all but 'replace' are made from the surface itself.
        flat: whether an ad is laid on as it is, over all, and not lit, blurred and hidden as the surface is.
        shutter: degrees, 0 to 360, of each frame that the camera's shutter is open, by which an ad in motion is blurred
            along its way; None tells it by the surface's own streaks.
        grain: whether an ad gets the grain of the video.
        softness: whether it gets the softness of the video's lens, focus and codec; 'off' leaves it as sharp as it is
            where the surface is as sharp as in the reference frame.
        first_light: whether shadows and glare that lie on the surface in the reference frame fall on it as well; 'even'
            takes that frame to be lit evenly.
        surface_kind: 'print', which light falls on; 'screen', which shines by itself and mirrors what is before it;
            'cloth', whose folds are shaded, and move.
        matte: made elsewhere: video, image sequence or picture in the frame's shape, white where the ad may be seen
            and black where something is in front of it, as it is saved; None tells by the video what is in front.

    Raises:
        InputError: a value that is not allowed, or one that cannot apply beside another.
    """

    ad: Path | str | None = None
    quad: Array | None = None
    find: Path | str | None = None
    snap: bool = False
    start: Moment = FIRST
    region: Array | None = None
    exclude: tuple[Array, ...] = ()
    keyframes: tuple[Keyframe, ...] = ()
    track: Track | None = field(default=None, repr=False)
    fit: Fit = "stretch"
    playback: Playback = "loop"
    blend: Blend = "normal"
    opacity: float = 1.0
    feather: float = 0.0
    inset: float = 0.0
    radius: float = 0.0
    lost: Lost = "fade"
    effect: Effect = "replace"
    flat: bool = False
    shutter: float | None = None
    grain: Grain = "auto"
    softness: Softness = "auto"
    first_light: FirstLight = "auto"
    surface_kind: SurfaceKind = "print"
    matte: Path | str | None = None

    @property
    def in_scene(self) -> bool:
        """Whether the ad takes on the scene's light, blur and occluders."""
        return self.effect == "replace" and not self.flat

    def quad_in(self, frame: Observation) -> Array:
        """The quad (4, 2), px, in the reference frame: as given, or snapped to edges, of which the log tells.

        Raises:
            InputError: it has to be snapped, and is impossible.
        """
        assert self.quad is not None
        quad = np.asarray(self.quad, np.float64)
        if not self.snap:
            return quad
        snapped, moved = snap(frame, quad)
        if moved.any():
            log.info("--snap moved the corners by %s px", ", ".join(f"{px:.1f}" for px in moved))
        else:
            log.info("--snap left the corners where they are: there are no clear edges beside the quad")
        return snapped

    @property
    def tracking_region(self) -> Region:
        """Where tracking may look."""
        return Region(self.region, self.exclude)

    @property
    def name(self) -> str | None:
        """The ad's file, as text; None without an ad."""
        return None if self.ad is None else str(self.ad)

    def __post_init__(self) -> None:
        check_choices(self)
        if not 0 <= self.opacity <= 1:
            raise InputError(f"opacity {self.opacity} is out of range: give 0 to 1")
        for name in ("feather", "inset", "radius"):
            check_not_negative(name, getattr(self, name))
        for name in ("flat", "snap"):
            if not isinstance(getattr(self, name), bool):
                raise InputError(f"{name} '{getattr(self, name)}' is neither true nor false: give one of these")
        if self.shutter is not None and not 0 <= self.shutter <= 360:
            raise InputError(f"shutter {self.shutter} is out of range: give 0 to 360 degrees")
        Region(self.region, self.exclude)
        for name in IN_SCENE_ALONE if self.flat else ():
            if getattr(self, name) != _DEFAULTS[name]:
                raise InputError(f"{name} does nothing with a flat ad, which is laid on as it is: leave it out")
        if self.effect != "replace":
            for name in ADS_ALONE:
                if getattr(self, name) != _DEFAULTS[name]:
                    raise InputError(f"{name} does nothing with effect {self.effect}, which needs no ad: leave it out")
        if self.find is not None:
            for name in ("quad", "start", "region", "exclude", "keyframes", "track"):
                if getattr(self, name) is not _DEFAULTS[name]:
                    raise InputError(f"{name} does nothing beside find, which says where the surface is: leave one out")
        if self.effect == "outline" and (self.inset or self.radius):
            raise InputError("inset and radius do nothing with effect outline, which is the quad's own: leave them out")
        if self.track is not None:
            if not isinstance(self.track, Track):
                raise InputError(f"track {self.track!r} is not a Track: load it with Track.load")
            for name in ("quad", "snap", "start", "region", "exclude"):
                if getattr(self, name) is not _DEFAULTS[name]:
                    raise InputError(f"{name} does nothing beside a track, which has its own: leave one of them out")


_DEFAULTS = {f.name: f.default for f in fields(Surface)}


def check_choices(options: Any) -> None:
    """Raises InputError for a field of a dataclass that is none of the choices of its name."""
    for f in fields(options):
        value = getattr(options, f.name)
        if f.name in CHOICES and value is not None and value not in CHOICES[f.name]:
            raise InputError(f"{f.name} '{value}' is unknown: choose {', '.join(CHOICES[f.name])}")


def check_not_negative(name: str, value: float) -> None:
    """Raises InputError for a negative, infinite or undefined value."""
    if not 0 <= value < np.inf:
        raise InputError(f"{name} {value} is out of range: give 0 or more")
