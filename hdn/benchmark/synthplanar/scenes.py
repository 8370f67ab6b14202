"""SynthPlanar's scenes: what each attribute asks for, and the chance by which the rest is drawn."""

from dataclasses import dataclass

import cv2
import numpy as np

from ...imaging.arrays import Array, Image
from .drawings import (
    PERSON,
    draw_edge,
    draw_hand,
    draw_long_hair,
    draw_occluder,
    draw_shadows,
    draw_wall,
    palette,
)
from .light import Focus, Light
from .motion import Ranges, Trajectory
from .pictures import Pictures
from .render import BACKGROUND, LEVELS, Layer, Passage, Scene

Rng = np.random.Generator
DEFAULT_RANGES = Ranges()


@dataclass(frozen=True)
class Challenge:
    """What makes an attribute.

    between: frames from one passer-by to the next, 0 for none. flat: little texture. lamp: probability that one is
    mirrored in the target. crf: of H.264, the least, and one above the most. wall: how far a wall that lies in the
    target's plane reaches around it, ratio to its longest side, 0 for none. hands: frames from one hand that reaches
    over the target to the next, 0 for none. hidden: somebody stands before the whole target for a third of the clip.
    edge: a shadow's edge lies on the target in the first frame, and a lamp, if there is one, is mirrored in its middle.
    still: the light stays as it is on the target. defocus: radius of the lens's blur, least and most, px of 1280. skin:
    the poster has the colours of skin, and who passes has loose hair. screen: the target shines by itself. Others as in
    Scene and Light, the least and the most of them.
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
    wall: float = 0.0
    hands: int = 0
    hidden: bool = False
    ambient: tuple[float, float] = (0.4, 0.75)
    edge: bool = False
    still: bool = False
    defocus: tuple[float, float] | None = None
    skin: bool = False
    screen: bool = False


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
# Where the target is covered or gone for long; what surrounds it lies on its plane in some, and behind it in others.
INTERRUPTED = {
    "wall": Challenge(Ranges(size=(190, 400), speed=0.7), wall=1.5, hands=70),
    "board": Challenge(Ranges(size=(150, 380)), wall=0.4, between=60),
    "hands": Challenge(Ranges(size=(150, 440), speed=0.7), hands=70),
    "absence": Challenge(Ranges(size=(150, 400), absent=True)),
    "hidden": Challenge(Ranges(size=(140, 260), speed=0.5), hidden=True),
}
# Where a composite has to pass for real: light that lies on the target in the first frame already, and how it is
# pictured. They move gently, for it is not tracking that is asked here.
GENTLE = Ranges(size=(190, 420), speed=0.7)
APPEARANCE = {
    "shadow": Challenge(GENTLE, edge=True, ambient=(0.25, 0.5), lamp=0.0),
    "still shadow": Challenge(GENTLE, edge=True, still=True, ambient=(0.25, 0.5), lamp=0.0, wall=0.4),
    "glare": Challenge(Ranges(size=(190, 420), speed=0.7, tilt=40), edge=True, ambient=(0.9, 1.0), lamp=1.0),
    "still glare": Challenge(GENTLE, edge=True, still=True, ambient=(0.9, 1.0), lamp=1.0),
    "defocus": Challenge(GENTLE, ambient=(0.9, 1.0), lamp=0.0, defocus=(0.0, 9.0)),
    "soft": Challenge(GENTLE, ambient=(0.9, 1.0), lamp=0.0, defocus=(3.0, 3.5)),
    "grain": Challenge(GENTLE, ambient=(0.9, 1.0), lamp=0.0, grain=(4.0, 8.0), crf=(14, 19)),
    "fingers": Challenge(GENTLE, ambient=(0.9, 1.0), lamp=0.0, hands=45, between=90, skin=True),
    "screen": Challenge(GENTLE, lamp=1.0, screen=True),
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
    if challenge.skin:
        poster = _as_skin(poster, rng)

    margin = int(rng.integers(0, 4)) * longest // 64 // 2**LEVELS * 2**LEVELS  # a board's edge around the picture
    board = palette(1, rng)[0] * 0.5 + (110 if rng.random() < 0.5 else 20)
    sheets = [_sheet(picture, margin, board, longest) for picture in (poster, ad)]
    if challenge.wall:
        sheets = _on_wall(sheets, _sixteenths(challenge.wall * longest), rng)
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
        _passages(challenge, frames, rng) + _hands(challenge.hands, frames, rng) + _screen(challenge, frames, rng),
        _light(challenge, width, rng),
        shutter=rng.uniform(*challenge.shutter),
        grain=rng.uniform(*challenge.grain),
        focus=None
        if challenge.defocus is None
        else Focus(*challenge.defocus, *rng.uniform((0.04, 0), (0.1, 2 * np.pi))),
    )
    return Cast(scene, ad, poster_name, ad_name)


def _sixteenths(length: float) -> int:
    return max(16, round(length / 16) * 16)


def _flattened(picture: Image, rng: Rng) -> Image:
    """The picture with little left of it: soft, pale."""
    soft = cv2.GaussianBlur(picture, (0, 0), picture.shape[1] / rng.uniform(20, 45)).astype(np.float32)
    mean = soft.mean((0, 1))
    return np.clip(mean + rng.uniform(0.35, 0.6) * (soft - mean), 0, 255).astype(np.uint8)


def _as_skin(picture: Image, rng: Rng) -> Image:
    """The picture in tones of one skin, as a portrait has them."""
    skin = np.array([222, 175, 146], np.float32) * rng.uniform(0.5, 1.05)
    light = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY).astype(np.float32)[..., None] / 150
    return np.clip(skin * (0.35 + 0.65 * light) + 0.15 * (picture - picture.mean((0, 1))), 0, 255).astype(np.uint8)


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


def _on_wall(sheets: list[Image], reach: int, rng: Rng) -> list[Image]:
    """The sheets on one wall that goes `reach` texels farther than they to all sides, RGBA."""
    height, width = (side + 2 * reach for side in sheets[0].shape[:2])
    wall = draw_wall((width, height), rng)
    inner = slice(reach, -reach), slice(reach, -reach)
    on_wall = []
    for sheet in sheets:
        whole = wall.copy()
        through = 255 - sheet[..., 3]
        behind = cv2.multiply(np.ascontiguousarray(wall[inner]), cv2.merge([through] * 3), scale=1 / 255)
        whole[inner] = cv2.add(behind, np.ascontiguousarray(sheet[..., :3]))
        on_wall.append(np.concatenate([whole, np.full((height, width, 1), 255, np.uint8)], 2))
    return on_wall


def _passages(challenge: Challenge, frames: int, rng: Rng) -> tuple[Passage, ...]:
    """Passers-by at uneven intervals, none of them before the target in the first frame, from which trackers start."""
    passages: list[Passage] = []
    between = challenge.between
    middle = rng.uniform(0.4, 0.7) * between
    while between and middle < frames:
        texture = draw_long_hair(rng) if challenge.skin else draw_occluder(rng)
        length, size = rng.uniform(18, 40), rng.uniform(2.0, 3.2)
        direction = (0.0 if rng.random() < 0.5 else np.pi) + rng.uniform(-0.3, 0.3)
        passages.append(Passage(texture, max(middle, 1.4 * length), length, direction, size, rng.uniform(-0.35, 0.35)))
        middle += between * rng.uniform(0.7, 1.3)
    return tuple(passages)


def _hands(between: int, frames: int, rng: Rng) -> tuple[Passage, ...]:
    """Hands that reach over up to two thirds of the target from any side, stay, and go back; none is there at first."""
    passages: list[Passage] = []
    if not between:
        return ()
    middle = rng.uniform(0.4, 0.6) * between
    while middle < frames:
        length, stay, direction = rng.uniform(6, 12), rng.uniform(15, 30), rng.uniform(0, 2 * np.pi)
        passages.append(
            Passage(
                draw_hand(rng),
                max(middle, 1.4 * length + stay / 2),
                length,
                direction,
                rng.uniform(2.0, 2.6),
                direction + np.pi / 2,  # its fingers, which the drawing has upward, go first
                stay,
                returns=True,
                sway=rng.uniform(0.03, 0.1),
            )
        )
        middle += between * rng.uniform(0.8, 1.2)
    return tuple(passages)


def _screen(challenge: Challenge, frames: int, rng: Rng) -> tuple[Passage, ...]:
    """Somebody who stands before the whole target in the clip's middle third."""
    if not challenge.hidden:
        return ()
    direction = (0.0 if rng.random() < 0.5 else np.pi) + rng.uniform(-0.2, 0.2)
    return (Passage(draw_occluder(rng, PERSON), frames / 2, frames / 9, direction, 6.0, 0.0, stay=frames / 3),)


def _drift(challenge: Challenge, rng: Rng) -> Array:
    """How the shadows move, units a frame; one that lies on the target at first goes over it."""
    drift = rng.normal(0, 0.0012, 2)
    if challenge.still:
        return 0 * drift
    return drift / np.linalg.norm(drift) * rng.uniform(0.003, 0.006) if challenge.edge else drift


def _light(challenge: Challenge, width: int, rng: Rng) -> Light:
    warmth = rng.uniform(-0.07, 0.07)
    shadows = draw_edge if challenge.edge else draw_shadows
    lamp = 0.15 if challenge.edge else 0.45
    return Light(
        shadows=shadows(width * 4 // 5, rng),
        drift=_drift(challenge, rng),
        ambient=rng.uniform(*challenge.ambient),
        colour=np.array([1 + warmth, 1.0, 1 - warmth]),
        exposure=rng.uniform(*challenge.exposure),
        swing=challenge.swing,
        rates=rng.uniform(*challenge.rates, 2),
        glare=rng.uniform(0.25, 0.8) if rng.random() < challenge.lamp else 0.0,
        lamp=rng.uniform(-lamp, lamp, 2),
        spread=rng.uniform(0.08, 0.2),
        still=challenge.still,
        reach=4.0 if challenge.still else 1.4,  # a target of unit area, or a background one unit wide
        glow=float(rng.uniform(0.8, 1.1)) if challenge.screen else None,
    )
