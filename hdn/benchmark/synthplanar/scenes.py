"""SynthPlanar's scenes: what each attribute asks for, and the chance by which the rest is drawn."""

from dataclasses import dataclass

import cv2
import numpy as np

from ...imaging.arrays import Array, Image
from .drawings import draw_occluder, draw_shadows, palette
from .light import Light
from .motion import Ranges, Trajectory
from .pictures import Pictures
from .render import BACKGROUND, LEVELS, Layer, Passage, Scene

Rng = np.random.Generator
DEFAULT_RANGES = Ranges()


@dataclass(frozen=True)
class Challenge:
    """What makes an attribute.

    between: frames from one passer-by to the next, 0 for none. flat: little texture. lamp: probability that one is
    mirrored in the target. crf: of H.264, the least, and one above the most. Others as in Scene and Light, the least
    and the most of them.
    """

    ranges: Ranges = DEFAULT_RANGES
    shutter: tuple[float, float] = (0.25, 0.5)
    exposure: tuple[float, float] = (0.8, 1.15)
    swing: float = 0.2
    rates: tuple[float, float] = (0.02, 0.12)
    grain: tuple[float, float] = (1.0, 2.5)
    between: int = 0
    flat: bool = False
    lamp: float = 0.6
    crf: tuple[int, int] = (19, 29)


# Named as in POT, and two of our own.
CHALLENGES = {
    "scale": Challenge(Ranges(size=(85, 500), tilt=15, roll=15)),
    "rotation": Challenge(Ranges(size=(150, 440), roll=170)),
    "perspective": Challenge(Ranges(size=(170, 500), tilt=62)),
    "motion blur": Challenge(Ranges(speed=1.8), shutter=(0.8, 1.0)),
    "occlusion": Challenge(between=60),
    "out of view": Challenge(Ranges(leaves=True)),
    "unconstrained": Challenge(
        Ranges(size=(110, 480), tilt=55, roll=130, leaves=True), shutter=(0.3, 0.9), swing=0.35, between=160
    ),
    "low texture": Challenge(flat=True),
    "low light": Challenge(shutter=(0.6, 0.9), exposure=(0.07, 0.16), grain=(4.0, 7.0)),
}
# Nothing is hard here but to be exact: a well-seen target, and one that stands still under flickering light; compressed
# as a camera does.
CONTROLS = {
    "clean": Challenge(
        Ranges(size=(150, 480), speed=0.6), shutter=(0.02, 0.1), grain=(1.0, 1.5), lamp=0.0, crf=(14, 18)
    ),
    "static": Challenge(Ranges(size=(150, 480), speed=0.0), rates=(0.5, 2.5), grain=(2.0, 4.0), lamp=0.0, crf=(14, 18)),
}


@dataclass(frozen=True)
class Cast:
    """A scene, and its ad as an image (h, w, 3); names say where the pictures come from."""

    scene: Scene
    ad: Image
    poster_name: str
    ad_name: str


def make_scene(challenge: Challenge, width: int, height: int, frames: int, pictures: Pictures, rng: Rng) -> Cast:
    """A scene for frames of width x height, px, drawn by chance."""
    longest = width * 4 // 5 // 16 * 16  # texels of the target: more than it ever takes pixels
    aspect = float(np.exp(rng.uniform(-0.5, 0.5)))
    texels = (longest, _sixteenths(longest / aspect)) if aspect > 1 else (_sixteenths(longest * aspect), longest)
    trajectory = Trajectory(challenge.ranges, texels[0] / texels[1], frames, rng)
    poster, poster_name = pictures.poster(texels, rng)
    ad, ad_name = pictures.poster(texels, rng)
    if challenge.flat:
        poster = _flattened(poster, rng)

    margin = int(rng.integers(0, 4)) * longest // 64 // 2**LEVELS * 2**LEVELS  # a board's edge around the picture
    board = palette(1, rng)[0] * 0.5 + (110 if rng.random() < 0.5 else 20)
    sheets = [_sheet(picture, margin, board, longest) for picture in (poster, ad)]
    padding = (sheets[0].shape[1] - texels[0]) // 2
    target = cv2.copyMakeBorder(np.full(texels[::-1], 255, np.uint8), *[padding] * 4, cv2.BORDER_CONSTANT, value=0)
    texel = 1 / np.sqrt(texels[0] * texels[1])  # the target has unit area
    centre = -texel * (np.array(sheets[0].shape[1::-1]) - 1) / 2
    texel_to_plane = np.array([[texel, 0, centre[0]], [0, texel, centre[1]], [0, 0, 1]])

    background = (int(BACKGROUND * width), int(BACKGROUND * height))
    scene = Scene(
        width,
        height,
        trajectory,
        pictures.scene(background, rng),
        Layer.of(sheets[0], texel_to_plane),
        Layer.of(sheets[1], texel_to_plane),
        Layer.of(np.asarray(target, np.uint8), texel_to_plane),
        _passages(challenge.between, frames, rng),
        _light(challenge, width, rng),
        shutter=rng.uniform(*challenge.shutter),
        grain=rng.uniform(*challenge.grain),
    )
    return Cast(scene, ad, poster_name, ad_name)


def _sixteenths(length: float) -> int:
    return max(16, round(length / 16) * 16)


def _flattened(picture: Image, rng: Rng) -> Image:
    """The picture with little left of it: soft, pale."""
    soft = cv2.GaussianBlur(picture, (0, 0), picture.shape[1] / rng.uniform(20, 45)).astype(np.float32)
    mean = soft.mean((0, 1))
    return np.clip(mean + rng.uniform(0.35, 0.6) * (soft - mean), 0, 255).astype(np.uint8)


def _sheet(picture: Image, margin: int, board: Array, longest: int) -> Image:
    """The picture on its board with a soft shadow around, premultiplied RGBA."""
    reach = longest // 32 // 2**LEVELS * 2**LEVELS + 2**LEVELS  # of the shadow, texels
    framed = cv2.copyMakeBorder(picture, *[margin] * 4, cv2.BORDER_CONSTANT, value=board.tolist())
    padded = cv2.copyMakeBorder(framed, *[reach] * 4, cv2.BORDER_CONSTANT, value=0)
    solid = np.zeros(padded.shape[:2], np.uint8)
    solid[reach:-reach, reach:-reach] = 255
    inner = cv2.erode(solid, np.ones((3, 3), np.uint8), iterations=reach // 4)
    shadow = np.asarray(cv2.GaussianBlur(inner, (0, 0), reach / 3), np.float32) * 0.8
    alpha = np.where(solid > 0, 255, shadow.astype(np.uint8)).astype(np.uint8)
    return np.concatenate([padded, alpha[..., None]], 2)


def _passages(between: int, frames: int, rng: Rng) -> tuple[Passage, ...]:
    """Passers-by at uneven intervals, none of them before the target in the first frame, from which trackers start."""
    passages: list[Passage] = []
    middle = rng.uniform(0.4, 0.7) * between
    while between and middle < frames:
        texture, length, size = draw_occluder(rng), rng.uniform(18, 40), rng.uniform(2.0, 3.2)
        direction = (0.0 if rng.random() < 0.5 else np.pi) + rng.uniform(-0.3, 0.3)
        passages.append(Passage(texture, max(middle, 1.4 * length), length, direction, size, rng.uniform(-0.35, 0.35)))
        middle += between * rng.uniform(0.7, 1.3)
    return tuple(passages)


def _light(challenge: Challenge, width: int, rng: Rng) -> Light:
    warmth = rng.uniform(-0.07, 0.07)
    return Light(
        shadows=draw_shadows(width * 4 // 5, rng),
        drift=rng.normal(0, 0.0012, 2),
        ambient=rng.uniform(0.4, 0.75),
        colour=np.array([1 + warmth, 1.0, 1 - warmth]),
        exposure=rng.uniform(*challenge.exposure),
        swing=challenge.swing,
        rates=rng.uniform(*challenge.rates, 2),
        glare=rng.uniform(0.25, 0.8) if rng.random() < challenge.lamp else 0.0,
        lamp=rng.uniform(-0.45, 0.45, 2),
        spread=rng.uniform(0.08, 0.2),
    )
