"""The track: where the surface is in every frame, as data that is saved, loaded and edited."""

import json
from collections import Counter
from copy import deepcopy
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdn.imaging.arrays import Array
from hdn.imaging.homography import from_corners
from hdn.imaging.regions import EVERYWHERE, Region
from hdn.state import STATES, State

from .errors import InputError
from .markup import items, state_bar, table
from .media.claims import Claim, write_whole
from .words import counted

VERSION = 1
PASSED_PX = 1e-3  # within which a track passes through a point


@dataclass(frozen=True)
class Source:
    """The video that a track belongs to.

    Attributes:
        width, height: px, upright. fps: average frames per second.
        frames: as many as the track has.
        fingerprint: see `media.fingerprint`; None in files of older versions, and where there is no file.
        pixel_aspect: width of a pixel over its height.
        first_number: of the first picture of an image sequence; None for a video.
    """

    path: str
    width: int
    height: int
    fps: Fraction
    frames: int
    fingerprint: str | None = None
    pixel_aspect: Fraction = Fraction(1)
    first_number: int | None = None


@dataclass
class Track:
    """Per frame, from the first of the video on, the surface's corners, a state and a confidence.

    Attributes:
        source: the video it was measured on.
        reference_frame: index of the frame that `quad` was given in.
        quad: (4, 2) corners in that frame, px: top-left, top-right, bottom-right, bottom-left of the ad.
        times: (N,) seconds.
        corners: (N, 4, 2) px; NaN where there is no pose.
        states: N of 'tracked', 'held', 'lost'.
        confidence: (N,) 0..1.
        deviation: (N,) px, standard deviation of the corners; infinite where they are not measured.
        warnings: what is wrong with the video, and which frames had better be checked, one sentence each.
        keyframes: corners (4, 2) given by hand, by the frame's index; used: those that the track was made with.
        cuts: indices of frames that begin another shot than the one before them.
        region: where in the reference frame tracking may look.
        span: first and last frame that are of interest; None for all. Outside it nothing is tracked and drawn.
    """

    source: Source
    reference_frame: int
    quad: Array
    times: list[Fraction]
    corners: Array
    states: list[State]
    confidence: Array
    deviation: Array
    warnings: list[str] = field(default_factory=list)
    keyframes: dict[int, Array] = field(default_factory=dict)
    used: dict[int, Array] = field(default_factory=dict)
    cuts: list[int] = field(default_factory=list)
    region: Region = EVERYWHERE
    span: tuple[int, int] | None = None

    def __len__(self) -> int:
        return len(self.states)

    @property
    def counts(self) -> dict[str, int]:
        """How many frames of the span are in each state."""
        return self.counts_in(None)

    def counts_in(self, part: range | None) -> dict[str, int]:
        """How many frames of the span, and of a part of the video, are in each state. part: indices; None for all."""
        inside = range(len(self))[self.inside]
        counts = Counter(self.states[i] for i in inside if part is None or i in part)
        return {state: counts[state] for state in STATES}

    @property
    def inside(self) -> slice:
        """The frames of the span."""
        return slice(None) if self.span is None else slice(self.span[0], self.span[1] + 1)

    @property
    def first(self) -> int:
        """The first frame of the span."""
        return 0 if self.span is None else self.span[0]

    @property
    def last(self) -> int:
        """The last frame of the span."""
        return len(self) - 1 if self.span is None else self.span[1]

    @property
    def seconds(self) -> tuple[Fraction, Fraction | None]:
        """When the span begins and ends, seconds from the first frame; None where it goes on to the video's end."""
        if self.span is None:
            return Fraction(0), None
        first, last = self.span
        end = self.times[last + 1] if last + 1 < len(self) else self.times[last] + 1 / self.source.fps
        return self.times[first] - self.times[0], end - self.times[0]

    @property
    def known(self) -> NDArray[np.bool_]:
        """(N,) whether a frame has a pose."""
        return np.asarray(np.isfinite(self.corners).all((1, 2)))

    @property
    def given(self) -> dict[int, Array]:
        """Corners (4, 2) that are not measured but given: those of the reference frame and of the keyframes."""
        return {self.reference_frame: self.quad, **self.keyframes}

    def within(self, first: int, last: int) -> "Track":
        """The same where the frames from first to last are of interest, and all others are lost."""
        track, n = deepcopy(self), len(self)
        track.span = first, min(last, n - 1)
        for index in {*range(n)} - {*range(n)[track.inside]}:
            track.corners[index], track.states[index] = np.nan, "lost"
            track.confidence[index], track.deviation[index] = 0.0, np.inf
        return track

    def homography(self, index: int) -> Array | None:
        """Reference-frame pixels to those of frame `index`, (3, 3); None where there is no pose."""
        return from_corners(self.quad, self.corners[index]) if self.known[index] else None

    @property
    def is_steady(self) -> bool:
        """Whether all frames last equally long, to half a frame."""
        steps = [float((time - self.times[0]) * self.source.fps) for time in self.times]
        return all(abs(step - index) < 0.5 for index, step in enumerate(steps))

    def motion(self, index: int) -> Array:
        """Motion (4, 2) of the corners in a frame, px to the next one, by the neighbours of its shot that are known."""
        before = index - 1 if index > 0 and index not in self.cuts and self.known[index - 1] else index
        after = index + 1 if index + 1 < len(self) and index + 1 not in self.cuts and self.known[index + 1] else index
        if before == after:
            return np.zeros((4, 2))
        return np.asarray((self.corners[after] - self.corners[before]) / (after - before))

    def save(self, path: Path | str | Claim) -> None:
        """Writes the track file (JSON, version 1), whole or not at all.

        Raises:
            InputError: there can be no file of this name.
            RunError: the file cannot be written.
        """
        write_whole(path, self.as_json().encode())

    def as_saved(self) -> "Track":
        """The track that its file would give, so that what is made of either is the same."""
        return _parse(json.loads(self.as_json()))

    def as_json(self) -> str:
        """What a track file has in it."""
        frames = []
        for i, state in enumerate(self.states):
            homography = self.homography(i)
            frames.append(
                {
                    "index": i,
                    "time": float(self.times[i]),
                    "corners": None if homography is None else np.round(self.corners[i], 4).tolist(),
                    "homography": None if homography is None else homography.tolist(),
                    "state": state,
                    "confidence": round(float(self.confidence[i]), 4),
                    "deviation": round(float(self.deviation[i]), 4) if np.isfinite(self.deviation[i]) else None,
                }
            )
        s = self.source
        content = {
            "version": VERSION,
            "source": {
                "path": s.path,
                "width": s.width,
                "height": s.height,
                "fps": str(s.fps),
                "frames": s.frames,
                "fingerprint": s.fingerprint,
                "pixel_aspect": str(s.pixel_aspect),
                "first_number": s.first_number,
            },
            "reference_frame": self.reference_frame,
            "quad": self.quad.tolist(),
            "keyframes": [self._keyframe(i) for i in sorted(self.keyframes)],
            "cuts": self.cuts,
            "region": None if self.region.include is None else self.region.include.tolist(),
            "span": self.span,
            "exclude": [polygon.tolist() for polygon in self.region.exclude],
            "warnings": self.warnings,
            "frames": frames,
        }
        return json.dumps(content)

    def _repr_html_(self) -> str:
        told = ", ".join(f"{count} {state}" for state, count in self.counts.items())
        size = f"{self.source.width}x{self.source.height}, {float(self.source.fps):.6g} frames/s"
        rows = [("Track", self.source.path), ("Video", size), ("States", told)]
        return f"{table(rows)}{state_bar(self.states[self.inside])}{items(self.warnings)}"

    def _keyframe(self, index: int) -> dict[str, Any]:
        used = {"used": self.used[index].tolist()} if index in self.used else {}
        return {"frame": index, "corners": self.keyframes[index].tolist(), **used}

    @classmethod
    def load(cls, path: Path | str) -> "Track":
        """Reads a track file.

        Raises:
            InputError: no such file, not a track file, another version, or values that are not a track's.
        """
        try:
            content = json.loads(Path(path).read_text())
        except OSError as error:
            raise InputError(f"cannot read track file {path}: {error.strerror}") from error
        except ValueError as error:
            raise InputError(f"{path} is not a track file (not JSON): make one with ar-track") from error
        if not isinstance(content, dict) or "version" not in content:
            raise InputError(f"{path} is not a track file (no version): make one with ar-track")
        if content["version"] != VERSION:
            raise InputError(
                f"{path} is a track file of version {content['version']}, this program reads version {VERSION}: "
                "track the video again"
            )
        try:
            return _parse(content)
        except (KeyError, TypeError, ValueError, ZeroDivisionError) as error:
            reason = f"{type(error).__name__}: {error}".replace("\n", " ")
            raise InputError(f"{path} is damaged ({reason}): track the video again") from error


def _parse(content: dict[str, Any]) -> Track:
    source, frames = content["source"], content["frames"]
    if not frames:
        raise ValueError("no frames")
    if [f["index"] for f in frames] != list(range(len(frames))):
        raise ValueError("frames are not numbered from 0 on")
    if unknown := {f["state"] for f in frames} - set(STATES):
        raise ValueError(f"unknown state {unknown.pop()!r}")
    nothing = np.full((4, 2), np.nan)
    corners = np.array([nothing if f["corners"] is None else f["corners"] for f in frames], np.float64)
    quad = np.array(content["quad"], np.float64)
    keyframes = {int(k["frame"]): np.array(k["corners"], np.float64) for k in content.get("keyframes", [])}
    used = {int(k["frame"]): np.array(k["used"], np.float64) for k in content.get("keyframes", []) if "used" in k}
    quads = [quad, *keyframes.values(), *used.values()]
    if {q.shape for q in quads} != {(4, 2)} or corners.shape != (len(frames), 4, 2):
        raise ValueError("a quad without exactly four corners")
    if beyond := [k for k in keyframes if not 0 <= k < len(frames)]:
        raise ValueError(f"keyframe at frame {beyond[0]}, of {counted(len(frames), 'frame')}")
    return Track(
        Source(
            source["path"],
            int(source["width"]),
            int(source["height"]),
            Fraction(source["fps"]),
            source["frames"],
            source.get("fingerprint"),
            Fraction(source.get("pixel_aspect", 1)),
            None if source.get("first_number") is None else int(source["first_number"]),
        ),
        int(content["reference_frame"]),
        quad,
        [Fraction(f["time"]).limit_denominator(10**6) for f in frames],
        corners,
        [f["state"] for f in frames],
        np.array([f["confidence"] for f in frames], np.float64),
        np.array([_deviation(f) for f in frames], np.float64),
        [str(w) for w in content.get("warnings", [])],
        keyframes,
        # Tracks of older versions pass through the keyframes that they were made with.
        {i: c for i, c in keyframes.items() if np.abs(corners[i] - c).max() < PASSED_PX} | used,
        cuts=[int(c) for c in content.get("cuts", [])],
        region=_region(content),
        span=_span(content, len(frames)),
    )


def _span(content: dict[str, Any], frames: int) -> tuple[int, int] | None:
    if content.get("span") is None:
        return None
    first, last = map(int, content["span"])
    if not 0 <= first <= last < frames:
        raise ValueError(f"span from {first} to {last}, where there are {frames} frames")
    return first, last


def _region(content: dict[str, Any]) -> Region:
    include, exclude = content.get("region"), content.get("exclude", [])
    return Region(
        None if include is None else np.array(include, np.float64), tuple(np.array(p, np.float64) for p in exclude)
    )


def _deviation(frame: dict[str, Any]) -> float:
    """Of a frame's corners, px; where the file does not tell, a fix by half the target counts half as much."""
    if "deviation" in frame:
        return np.inf if frame["deviation"] is None else float(frame["deviation"])
    return 1 / max(frame["confidence"], 0.1) if frame["state"] == "tracked" else np.inf
