"""What a report shows of the video itself: gathered in one go through it, for all surfaces."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from hdn.imaging.arrays import Array, Grey, Image
from hdn.imaging.blur import spectral_blur
from hdn.imaging.homography import from_corners
from hdn.imaging.pyramid import Pyramid
from hdn.imaging.quads import mean_size, outline, side

from ..errors import InputError
from ..media.codecs import is_linear
from ..media.reader import VideoReader
from ..media.sequences import ImageSequence
from ..media.threads import ahead
from ..progress import Listener, Stage, silent
from ..stopping import StopSignal
from ..tracks import Track
from ..words import counted
from .pictures import Picture, at_most
from .stretches import worst


@dataclass(frozen=True)
class LookModel:
    """What is gathered, and how large it is."""

    worst_frames: int = 8  # that are shown of a track
    strip_frames: int = 12  # of the steady strip
    pairs: int = 3  # of stills before and after
    measured_frames: int = 1500  # at most, of which light and blur are measured and lines are taken
    view_px: int = 160  # longer side of the rectified surface that is measured
    margin_ratio: float = 0.15  # of the surface, on each side, that the steady strip shows beside it
    thumbnail_px: int = 200  # longer side of a picture in the strip
    still_px: int = 560  # width of a still, at most
    around_ratio: float = 0.5  # of the surface's bounding box, on each side, that a still shows beside it
    dark_grey: float = 4.0  # added to grey levels before they are compared, against noise in the dark
    page_bytes: int = 2_800_000  # of all pictures in a page, before they are written as text


MODEL = LookModel()


@dataclass(frozen=True)
class Still:
    """A frame, or what is around the surface in it.

    Attributes:
        index: the frame's. left, top, scale: where the picture's first pixel lies in the frame, px, and how many px of
            the frame a pixel of it is.
    """

    index: int
    picture: Picture
    left: float = 0.0
    top: float = 0.0
    scale: float = 1.0

    def of_frame(self, points: Array) -> Array:
        """Points (n, 2) of the frame in the picture, px."""
        return (points + 0.5 - [self.left, self.top]) / self.scale - 0.5


@dataclass
class Look:
    """What was seen of one track.

    Attributes:
        light: (N,) ratio to the reference frame's, the median over the surface; NaN where it was not measured.
        blur: (N,) px of the frame, standard deviation of the blur beyond the reference frame's, along its widest axis.
        worst: the frames most worth a look, the worst first.
        strip: the rectified surface, some of its surroundings around it, evenly over the time.
        rows, columns: the middle row and the middle column of that, frame beside frame; None where there are none.
    """

    light: Array
    blur: Array
    worst: list[Still] = field(default_factory=list)
    strip: list[Still] = field(default_factory=list)
    rows: Picture | None = None
    columns: Picture | None = None


class _Surface:
    """Looks at one tracked surface in frame after frame."""

    def __init__(self, track: Track, measured: range, bytes_each: int) -> None:
        self.track, n = track, len(track)
        self.look = Look(np.full(n, np.nan), np.full(n, np.nan))
        self._measured, self._bytes = measured, bytes_each
        self._worst = worst(track, MODEL.worst_frames)
        known = [i for i in range(track.first, track.last + 1) if track.known[i]]
        picks = np.linspace(0, len(known) - 1, min(MODEL.strip_frames, len(known))).round().astype(int)
        self._strip = [known[i] for i in picks]
        width, height = mean_size(track.quad)
        shrink = min(1.0, MODEL.view_px / max(width, height))
        self._size = max(8, round(width * shrink)), max(8, round(height * shrink))
        self._outline = outline(*self._size)
        margin = np.round(MODEL.margin_ratio * np.array(self._size)).astype(int)
        self._wide = self._size[0] + 2 * int(margin[0]), self._size[1] + 2 * int(margin[1])
        self._wide_outline = self._outline + margin
        self._template: Grey | None = None
        self._lines: list[tuple[Image | None, Image | None]] = []
        self._stills: dict[int, Still] = {}

    def begin(self, reference: Image) -> None:
        """Learns what the surface looks like in the reference frame (H, W, 3)."""
        self._template = _grey(self._rectified(Pyramid(reference), self.track.quad))

    def see(self, image: Image, index: int) -> None:
        """Takes from a frame (H, W, 3) what there is to take."""
        track = self.track
        if not track.first <= index <= track.last:
            return
        if index in self._worst:
            self._stills[index] = self._still(image, index)
        if index in self._strip or index in self._measured:
            self._see_surface(Pyramid(image), index)

    def _see_surface(self, frame: Pyramid, index: int) -> None:
        if not self.track.known[index]:
            self._lines.append((None, None))
            return
        corners = self.track.corners[index]
        wide = frame.crop(from_corners(self._wide_outline, corners), *self._wide, fill=(0, 0, 0))
        if index in self._strip:
            small = at_most(wide, round(MODEL.thumbnail_px * wide.shape[1] / max(wide.shape[:2])))
            self.look.strip.append(Still(index, Picture.of(small, self._bytes)))
        if index not in self._measured:
            return
        self._lines.append((wide[wide.shape[0] // 2], wide[:, wide.shape[1] // 2]))
        view = _grey(self._rectified(frame, corners))
        if self._template is not None:
            ratio = (view + MODEL.dark_grey) / (self._template + MODEL.dark_grey)
            self.look.light[index] = float(np.median(ratio))
            scale = side(corners) / side(self._outline)  # px of the frame for a px of the view
            widest = np.linalg.eigvalsh(spectral_blur(self._template, view))[-1]
            self.look.blur[index] = scale * float(np.sqrt(max(widest, 0)))

    def finish(self) -> Look:
        """All that was seen."""
        self.look.worst = [self._stills[index] for index in self._worst if index in self._stills]
        self.look.rows, self.look.columns = (self._side_by_side(axis) for axis in (0, 1))
        return self.look

    def _side_by_side(self, axis: int) -> Picture | None:
        """The lines of the measured frames as columns of a picture; grey where there is none."""
        lines = [pair[axis] for pair in self._lines]
        seen = next((line for line in lines if line is not None), None)
        if seen is None:
            return None
        nothing = np.full_like(seen, 128)
        picture = np.stack([nothing if line is None else line for line in lines], 1)
        return Picture.of(np.ascontiguousarray(picture), 2 * self._bytes)

    def _rectified(self, frame: Pyramid, corners: Array) -> Image:
        return frame.crop(from_corners(self._outline, corners), *self._size)

    def _still(self, image: Image, index: int) -> Still:
        height, width = image.shape[:2]
        low, high = np.zeros(2), np.array([width, height], float)
        if self.track.known[index]:
            corners = self.track.corners[index]
            reach = MODEL.around_ratio * np.maximum(corners.max(0) - corners.min(0), 16)
            low = np.clip(np.floor(corners.min(0) - reach), 0, high - 16)
            high = np.clip(np.ceil(corners.max(0) + reach), low + 16, high)
        (left, top), (right, bottom) = low.astype(int), high.astype(int)
        small = at_most(np.ascontiguousarray(image[top:bottom, left:right]), MODEL.still_px)
        picture = Picture.of(small, self._bytes)
        return Still(index, picture, float(left), float(top), (right - left) / picture.width)


def look(
    reader: VideoReader, tracks: Sequence[Track], listen: Listener = silent, stop: StopSignal | None = None
) -> list[Look]:
    """Goes through a video once, and takes what a report shows of each track.

    Raises:
        Stopped: the signal was set.
    """
    first, last = min(track.first for track in tracks), max(track.last for track in tracks)
    step = -(-(last + 1 - first) // MODEL.measured_frames)
    bytes_each = MODEL.page_bytes // (len(tracks) * (MODEL.worst_frames + MODEL.strip_frames + 4) + 2 * MODEL.pairs)
    surfaces = [_Surface(track, range(first, last + 1, step), bytes_each) for track in tracks]
    for surface in surfaces:
        at = surface.track.reference_frame
        for frame in reader.frames(at, at + 1):
            surface.begin(frame.view)
    show = Stage(listen, "report", 0, last + 1 - first)
    with ahead(reader.frames(first, last + 1)) as frames:
        for frame in (stop or StopSignal()).watch(frames):
            for surface in surfaces:
                surface.see(frame.view, frame.index)
            show(tuple(track.states[frame.index] if frame.index < len(track) else None for track in tracks))
    return [surface.finish() for surface in surfaces]


def pairs(reader: VideoReader, composite: Path | str, tracks: Sequence[Track]) -> list[tuple[Still, Still]]:
    """Stills of the video and of what was made of it, in the same frames: an early one, one in the middle, a late one.

    Raises:
        InputError: what was made cannot be read, is in linear light, or is a sequence of another length.
    """
    made = ImageSequence.find(composite)
    if is_linear(Path(composite)):
        raise InputError(f"{composite} is in linear light: give one that can be looked at")
    if made is not None and len(made.files) != len(tracks[0]):
        frames = counted(len(tracks[0]), "frame")
        raise InputError(f"{composite} has {counted(len(made.files), 'picture')}, and the track {frames}")
    track = tracks[0]
    known = [i for i in range(track.first, track.last + 1) if track.known[i]]
    share = (np.arange(MODEL.pairs) + 0.5) / MODEL.pairs
    chosen = sorted({known[int(s * len(known))] for s in share}) if known else []
    bytes_each = MODEL.page_bytes // (len(tracks) * (MODEL.worst_frames + MODEL.strip_frames + 4) + 2 * MODEL.pairs)
    found = []
    with VideoReader(made or composite) as after:
        for index in chosen:
            stills = [
                Still(index, Picture.of(at_most(frame.view, MODEL.still_px), bytes_each))
                for shown in (reader, after)
                for frame in shown.frames(index, index + 1)
            ]
            if len(stills) == 2:
                found.append((stills[0], stills[1]))
    return found


def _grey(image: Image) -> Grey:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.float32)
