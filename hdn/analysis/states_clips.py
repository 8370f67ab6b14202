"""Clips in which a target is hidden, leaves or is cut away, and what of it is truly seen in each frame.

Any clip with known corners will do: a SynthPlanar scene drawn here, or a real one. What happens to it is put on
afterwards, so that the truth is exact: a picture slides over the target, the camera pans away to what the picture
shows, or there is a cut to it.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import cycle, islice
from pathlib import Path

import cv2
import numpy as np

from ..alignment.agreement import CELLS
from ..benchmark.datasets import read_clips
from ..benchmark.sequences import Sequence
from ..benchmark.synthplanar.drawings import draw_poster, draw_scene, palette
from ..benchmark.synthplanar.motion import Ranges, to_setting
from ..benchmark.synthplanar.pictures import Pictures
from ..benchmark.synthplanar.render import Renderer
from ..benchmark.synthplanar.scenes import Challenge, make_scene
from ..errors import InputError
from ..imaging.arrays import Array, Image
from ..imaging.homography import from_corners, transform
from ..imaging.quads import square

WIDTH, HEIGHT = 640, 360
CHALLENGE = Challenge(Ranges(size=(180, 420)))  # of SynthPlanar's usual light, speed and tilt
TEXTURED, LOW_TEXTURE = "textured", "low texture"


@dataclass(frozen=True)
class Staging:
    """How the target goes and comes back, again and again."""

    seen_frames: int = 10  # in view
    way_frames: int = 15  # until it has gone, and until it is back
    away_frames: tuple[int, ...] = (30, 6)  # in turn: longer than a tracker holds its pose, then shorter
    partly_share: float = 0.6  # of the target that is covered where it is not covered as a whole
    cover_ratio: float = 1.2  # sides of what covers the target to those of its bounding box
    pan_px: int = 3  # a frame, while the clip is cut away


STAGING = Staging()
DIRECTIONS = np.array([[-1, 0], [0, -1], [1, 0], [0, 1]])  # in turn


@dataclass(frozen=True)
class Clip:
    """A target in full view.

    Attributes:
        group: the clips that it is counted with.
        images: RGB frames (H, W, 3).
        truth: (N, 4, 2) px, the target's corners in each.
        elsewhere: (H, W, 3) a picture without the target.
    """

    group: str
    name: str
    images: list[Image]
    truth: Array
    elsewhere: Image


@dataclass(frozen=True)
class View:
    """A frame (H, W, 3), the target's corners (4, 2) in it, px, and what share of each of its cells (8, 8) is seen and
    lies in the frame, 0..1; the cells are those of the target's own plane, row by row in its reading order."""

    image: Image
    corners: Array
    seen: Array
    in_frame: Array


class _Logos(Pictures):
    """Posters of low texture: a few plain strokes on a flat ground. Scenes as usual."""

    def __init__(self) -> None:
        super().__init__(None)

    def poster(self, size: tuple[int, int], rng: np.random.Generator) -> tuple[Image, str]:
        return draw_logo(size, rng), "logo"


def draw_logo(size: tuple[int, int], rng: np.random.Generator) -> Image:
    """A ring, a bar and a polygon of one colour on a flat ground of another (height, width, 3)."""
    width, height = size
    ground, ink = (np.clip(c, 0, 255) for c in palette(2, rng))
    ink = ink if abs(ink.mean() - ground.mean()) > 50 else (ground + 128) % 256
    image = np.full((height, width, 3), ground, np.uint8)
    reach, colour = min(size), [float(c) for c in ink]
    middle = rng.uniform(0.35, 0.65, 2) * size
    radius = reach * rng.uniform(0.16, 0.28)
    cv2.circle(image, middle.astype(int).tolist(), int(radius), colour, int(reach * 0.06), cv2.LINE_AA)
    angles = rng.uniform(0, 2 * np.pi) + np.cumsum(rng.uniform(0.8, 2.2, 3))
    polygon = middle + radius * 0.6 * np.stack([np.cos(angles), np.sin(angles)], 1)
    cv2.fillPoly(image, [polygon.astype(np.int32)], colour, cv2.LINE_AA)
    y = height * (0.12 if middle[1] > height / 2 else 0.88)
    left, right = np.sort(rng.uniform(0.1, 0.9, 2)) * width
    right = max(right, left + 0.2 * width)
    cv2.line(image, [int(left), int(y)], [int(right), int(y)], colour, int(reach * 0.07), cv2.LINE_AA)
    return image


def drawn_clips(each: int, frames: int, seed: int) -> Iterator[Clip]:
    """SynthPlanar scenes without passers-by, so many of posters and so many of logos."""
    for number in range(each):
        for group, pictures in ((TEXTURED, Pictures(None)), (LOW_TEXTURE, _Logos())):
            rng = np.random.default_rng([seed, number])
            scene = make_scene(CHALLENGE, WIDTH, HEIGHT, frames, pictures, rng).scene
            renderer = Renderer(scene, frames, rng)
            images = [renderer.render(index).poster for index in range(frames)]
            truth = transform(to_setting(WIDTH), scene.trajectory.corners(np.arange(float(frames))))
            yield Clip(group, f"{group} {number + 1}", images, truth, _elsewhere(rng))


def _elsewhere(rng: np.random.Generator) -> Image:
    """Another street with another poster."""
    picture = np.asarray(draw_scene((WIDTH, HEIGHT), rng), np.uint8)
    poster = draw_poster((WIDTH // 3, HEIGHT // 2), rng)
    picture[HEIGHT // 4 : HEIGHT // 4 + HEIGHT // 2, WIDTH // 3 : WIDTH // 3 + WIDTH // 3] = poster
    return picture


def measured_clips(folder: Path, frames: int) -> Iterator[Clip]:
    """Clips with measured corners, of the layout of `read_clips`; shorter ones are played forward and backward.

    Elsewhere is what the next clip shows first.

    Raises:
        InputError: there are none, or they cannot be read.
    """
    sequences = read_clips(folder)
    if not sequences:
        raise InputError(f"{folder} holds no clips with corners (NAME.mp4 beside NAME.json): give one that does")
    others = [*sequences[1:], sequences[0]]
    return (_measured(folder.resolve().name, s, o, frames) for s, o in zip(sequences, others, strict=True))


def _measured(group: str, sequence: Sequence, other: Sequence, frames: int) -> Clip:
    images, truth = _known(sequence, frames)
    order = list(islice(cycle([*range(len(images)), *range(len(images) - 2, 0, -1)]), frames))
    size = images[0].shape[1::-1]
    if other is sequence:
        elsewhere = draw_scene((size[0], size[1]), np.random.default_rng(0))
    else:
        elsewhere = np.asarray(cv2.resize(next(other.frames()), size, interpolation=cv2.INTER_AREA), np.uint8)
    return Clip(group, sequence.name, [images[i] for i in order], truth[order], elsewhere)


def _known(sequence: Sequence, frames: int) -> tuple[list[Image], Array]:
    """The first frames whose corners are known, and these."""
    known = np.asarray(np.isfinite(sequence.truth).all((1, 2)))
    pairs = zip(sequence.frames(), sequence.truth, known, strict=False)
    images, truth = zip(*islice(((i, t) for i, t, k in pairs if k), frames), strict=True)
    return list(images), np.stack(truth)


def absence(frames: int) -> tuple[Array, Array]:
    """How far the target has gone (N,), 0 in view to 1 away, and which time it is (N,), from 0."""
    way = np.arange(1, STAGING.way_frames + 1) / (STAGING.way_frames + 1)
    gone, times = np.empty(0), np.empty(0, int)
    while len(gone) < frames:
        time = int(times[-1]) + 1 if len(times) else 0
        away = np.ones(STAGING.away_frames[time % len(STAGING.away_frames)])
        turn = np.concatenate([np.zeros(STAGING.seen_frames), way, away, way[::-1]])
        gone, times = np.concatenate([gone, turn]), np.concatenate([times, np.full(len(turn), time)])
    return gone[:frames], times[:frames]


def staged(clip: Clip, event: str) -> Iterator[View]:
    """The clip's frames with one of EVENTS put on, and their truth."""
    gone, times = absence(len(clip.images))
    for index, (image, corners) in enumerate(zip(clip.images, clip.truth, strict=True)):
        direction = DIRECTIONS[times[index] % len(DIRECTIONS)]
        yield EVENTS[event](clip, image, corners, float(gone[index]), direction, index)


def _in_view(clip: Clip, image: Image, corners: Array, gone: float, direction: Array, index: int) -> View:
    return _view(image, corners, np.ones(image.shape[:2], np.float32))


def _covered(clip: Clip, image: Image, corners: Array, gone: float, direction: Array, index: int) -> View:
    """The picture elsewhere, a little larger than the target, slides over it."""
    low, high = corners.min(0), corners.max(0)
    size = np.ceil((high - low) * STAGING.cover_ratio).astype(int)
    cover = np.asarray(cv2.resize(clip.elsewhere, size.tolist(), interpolation=cv2.INTER_AREA), np.uint8)
    # From just beside the target's box to where it has that in its middle.
    centre = (low + high) / 2 + direction * (1 - gone) * ((size + high - low) / 2 + 2)
    image, open_ = image.copy(), np.ones(image.shape[:2], np.float32)
    _lay(image, cover, np.round(centre - size / 2).astype(int))
    _lay(open_, np.zeros(size[::-1], np.float32), np.round(centre - size / 2).astype(int))
    return _view(image, corners, open_)


def _partly_covered(clip: Clip, image: Image, corners: Array, gone: float, direction: Array, index: int) -> View:
    # The cover's way is cover_ratio + 1 half boxes long, of which the last cover_ratio - 1 no longer hide more.
    return _covered(clip, image, corners, gone * STAGING.partly_share * 2 / (STAGING.cover_ratio + 1), direction, index)


def _left(clip: Clip, image: Image, corners: Array, gone: float, direction: Array, index: int) -> View:
    """The camera pans until the target is out of the frame; beyond the clip's edge there is the picture elsewhere."""
    height, width = image.shape[:2]
    low, high = corners.min(0), corners.max(0)
    way = np.where(direction < 0, high + 1, np.array([width, height]) - low)
    shift = np.round(direction * way * gone).astype(int)
    move = np.array([[1.0, 0, shift[0]], [0, 1, shift[1]]])
    around = cv2.warpAffine(clip.elsewhere, move, (width, height), flags=cv2.INTER_NEAREST, borderMode=cv2.BORDER_WRAP)
    panned = np.asarray(around, np.uint8)
    _lay(panned, image, shift)
    return _view(panned, corners + shift, np.ones((height, width), np.float32))


def _cut_away(clip: Clip, image: Image, corners: Array, gone: float, direction: Array, index: int) -> View:
    """While the target is away, the picture elsewhere, panned."""
    if gone < 1:
        return _in_view(clip, image, corners, gone, direction, index)
    nothing = np.zeros((CELLS, CELLS))
    return View(np.roll(clip.elsewhere, STAGING.pan_px * index, 1), corners, nothing, nothing)


Event = Callable[[Clip, Image, Array, float, Array, int], View]
EVENTS: dict[str, Event] = {
    "in view": _in_view,
    "partly covered": _partly_covered,
    "covered": _covered,
    "leaves": _left,
    "cut away": _cut_away,
}


def _lay(image: np.ndarray, other: np.ndarray, at: Array) -> None:
    """Puts an image on another, in place, its top left corner at x, y; what falls beside it is left out."""
    (height, width), (h, w) = image.shape[:2], other.shape[:2]
    x, y = (int(v) for v in at)
    rows, columns = slice(max(y, 0), max(min(y + h, height), 0)), slice(max(x, 0), max(min(x + w, width), 0))
    image[rows, columns] = other[rows.start - y : rows.stop - y, columns.start - x : columns.stop - x]


def _view(image: Image, corners: Array, open_: np.ndarray) -> View:
    """With the cells' shares of what is open (H, W), 0 or 1, and of what lies in the frame."""
    side = 8 * CELLS  # px of the rectified target
    to_frame = from_corners(square(side), corners)
    flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    maps = (cv2.warpPerspective(mask, to_frame, (side, side), flags=flags) for mask in (open_, np.ones_like(open_)))
    seen, in_frame = (np.asarray(cv2.resize(m, (CELLS, CELLS), interpolation=cv2.INTER_AREA), float) for m in maps)
    return View(image, corners, seen, in_frame)
