"""Rendering SynthPlanar's frames: layers in three dimensions, summed over the shutter.

A frame is the mean of sub-frames spread over its exposure, each offset by a part of a pixel, so that motion blur and
smooth edges come out of one sum. Layers hold roots of light, so that the sum of their squares is one of light. Every
frame is rendered with the poster and with the ad; outside the target's box the two are one.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from ...imaging.arrays import Array, Floats, Image
from ...imaging.homography import transform, translation
from ...imaging.quads import area
from .light import Focus, Light, Sensor
from .motion import Trajectory, background_poses, plane_to_frame, to_setting

SUBFRAMES_RANGE = 4, 16  # sub-frames of a frame, fewest and most
SUBFRAME_STEP_PX = 2.0  # that a corner moves between two sub-frames, as long as there are enough of them
SWAY_FRAMES = 25  # in which what passes moves to and fro once
LEVELS = 4  # of the textures' pyramids
BACKGROUND = 1.6  # the background's width, ratio to the frame's; beyond, it is mirrored

Box = tuple[slice, slice]


@dataclass(frozen=True)
class Layer:
    """A texture at LEVELS sizes, each half the one before; texel_to_plane (3, 3) is the first one's."""

    levels: tuple[Image, ...]
    texel_to_plane: Array

    @staticmethod
    def of(texture: Image, texel_to_plane: Array) -> "Layer":
        """From the largest texture, whose sides 2 ** (LEVELS - 1) divides."""
        levels = [texture]
        for _ in range(LEVELS - 1):
            height, width = levels[-1].shape[:2]
            levels.append(np.asarray(cv2.resize(levels[-1], (width // 2, height // 2), interpolation=cv2.INTER_AREA)))
        return Layer(tuple(levels), texel_to_plane)

    def at(self, size: float) -> tuple[Image, Array]:
        """The texture that suits a plane whose unit takes `size` px in the frame, and its texel_to_plane."""
        texels = 1 / self.texel_to_plane[0, 0]
        level = int(np.clip(np.floor(np.log2(texels / size) + 0.35), 0, LEVELS - 1))
        s = 2.0**level
        return self.levels[level], self.texel_to_plane @ [[s, 0, (s - 1) / 2], [0, s, (s - 1) / 2], [0, 0, 1]]


@dataclass(frozen=True)
class Passage:
    """Something that passes before the target.

    texture: premultiplied RGBA. middle: when it is before the target. length: frames in which it crosses it. direction:
    of its way in the frame, rad. size: of its upper half, ratio to the target's. turn: rad. stay: frames that it stands
    before the target. returns: goes back the way that it came. sway: how far it moves to and fro, ratio to the target's
    size.
    """

    texture: Image
    middle: float
    length: float
    direction: float
    size: float
    turn: float
    stay: float = 0.0
    returns: bool = False
    sway: float = 0.0

    def texel_to_frame(self, time: float, target: Array) -> Array:
        """Its homography (3, 3) to 1280x720 pixels; target: about x, y and log size of it."""
        height, width = self.texture.shape[:2]
        size = np.exp(target[2])
        since = time - self.middle
        moving = max(abs(since) - self.stay / 2, 0.0) * (-1.0 if self.returns else float(np.sign(since)))
        way = moving / self.length * size * 1.6 + self.sway * size * np.sin(2 * np.pi * since / SWAY_FRAMES)
        x, y = target[:2] + way * np.array([np.cos(self.direction), np.sin(self.direction)])
        s = self.size * size / (height / 2)
        c, d = s * np.cos(self.turn), s * np.sin(self.turn)
        return np.array([[c, -d, x], [d, c, y], [0, 0, 1.0]]) @ translation(-width / 2, -height / 4)


@dataclass(frozen=True)
class Scene:
    """All that a sequence shows.

    background: (H, W, 3), BACKGROUND frames wide. poster, ad: sheets, premultiplied RGBA, of one outline. target: one
    channel of the sheets' size, 255 where the target is. shutter: exposure, frames. grain: of the sensor, pixel values.
    focus: of the lens; None for one that is as sharp as the pixels.
    """

    width: int
    height: int
    trajectory: Trajectory
    background: Image
    poster: Layer
    ad: Layer
    target: Layer
    passages: tuple[Passage, ...]
    light: Light
    shutter: float
    grain: float
    focus: Focus | None = None


@dataclass(frozen=True)
class Rendered:
    """One frame with the poster and with the ad, (H, W, 3); visible: share of the target in the frame and unhidden."""

    poster: Image
    ad: Image
    visible: float


class Renderer:
    """Renders a scene's frames; the same ones for the same state of `rng` when asked for in the same order."""

    def __init__(self, scene: Scene, frames: int, rng: np.random.Generator) -> None:
        self._scene = scene
        self._setting = to_setting(scene.width)
        self._sensor = Sensor(scene.width, scene.height, scene.grain, rng)
        h, w = scene.background.shape[:2]
        s = BACKGROUND / w
        self._background_to_plane = np.array([[s, 0, -s * (w - 1) / 2], [0, s, -s * (h - 1) / 2], [0, 0, 1]])
        # Passers-by come to where the target is about, and do not follow its every jerk.
        self._times = np.arange(-1.0, frames + 1)
        poses = scene.trajectory.poses(self._times)[:, :3]
        self._about = np.asarray(cv2.blur(poses, (1, 25), borderType=cv2.BORDER_REPLICATE))

    def render(self, index: int) -> Rendered:
        scene = self._scene
        times = index + self._sub_frames(index)
        poses = scene.trajectory.poses(times)
        size = float(np.exp(poses[:, 2].mean())) * self._setting[0, 0]
        (poster, to_plane), (ad, _), (target, _) = scene.poster.at(size), scene.ad.at(size), scene.target.at(size)
        to_frame = [translation(*shift) @ self._setting for shift in _strewn(len(times))]
        sheets = [a @ b @ to_plane for a, b in zip(to_frame, plane_to_frame(poses), strict=True)]
        backs = [a @ b for a, b in zip(to_frame, plane_to_frame(background_poses(poses)), strict=True)]
        spread = scene.focus.reach(self._setting[0, 0]) if scene.focus else 0
        box = _box(sheets, poster.shape, (scene.height, scene.width), spread)
        to_box = translation(-box[1].start, -box[0].start)

        total = np.zeros((scene.height, scene.width, 3), np.float32)
        total_ad = np.zeros_like(total[box])
        seen = np.zeros(total_ad.shape[:2], np.float32)  # of the target
        for k, time in enumerate(times):
            frame = _warp(scene.background, backs[k] @ self._background_to_plane, total.shape, cv2.BORDER_REFLECT)
            if seen.size:
                with_ad = frame[box].copy()
                _paste(frame, poster, sheets[k])
                _paste(with_ad, ad, to_box @ sheets[k])
                mask = _warp(target, to_box @ sheets[k], seen.shape)
            for passage in scene.passages:
                matrix = to_frame[k] @ passage.texel_to_frame(time, self._about_at(time))
                if _paste(frame, passage.texture, matrix) and seen.size:
                    _paste(with_ad, passage.texture, to_box @ matrix)
                    hidden = _warp(np.ascontiguousarray(passage.texture[..., 3]), to_box @ matrix, seen.shape)
                    mask = cv2.multiply(mask, 255 - hidden, scale=1 / 255)
            cv2.accumulateSquare(frame, total)
            if seen.size:
                cv2.accumulateSquare(with_ad, total_ad)
                cv2.accumulate(mask, seen)
        seen /= 255 * len(times)

        self._light(index, total, total_ad, seen, box, len(times))
        if scene.focus is not None:
            whole = total.copy()
            whole[box] = total_ad
            total, whole = (scene.focus.blur(light, index, self._setting[0, 0]) for light in (total, whole))
            total_ad = np.ascontiguousarray(whole[box])
        outline = transform(self._setting, scene.trajectory.corners(np.array([float(index)]))[0])
        visible = min(1.0, float(seen.sum()) / abs(area(outline)))
        self._sensor.expose()
        picture = self._sensor.develop(total, 0, 0)
        advertising = picture.copy()
        if seen.size:
            advertising[box] = self._sensor.develop(total_ad, box[0].start, box[1].start)
        return Rendered(picture, advertising, visible)

    def _light(self, index: int, total: Floats, total_ad: Floats, seen: Floats, box: Box, count: int) -> None:
        """Lights the sums of `count` sub-frames, the frame's and the box's, in place."""
        light, time = self._scene.light, np.array([float(index)])
        pose = self._scene.trajectory.poses(time)
        plane = self._setting @ plane_to_frame(pose if light.still else background_poses(pose))[0]
        gain = light.gain(index, plane, (self._scene.height, self._scene.width))
        if light.glow is not None and seen.size:
            gain[box] += seen[..., None] * (light.glow - gain[box])
        gain /= count
        cv2.multiply(total, gain, total)
        if not seen.size:
            return
        cv2.multiply(total_ad, np.ascontiguousarray(gain[box]), total_ad)
        if light.glare:
            to_box = translation(-box[1].start, -box[0].start) @ self._setting @ plane_to_frame(pose)[0]
            glare = cv2.merge([light.glare_on(pose[0], to_box, seen.shape) * seen] * 3)
            total[box] += glare
            total_ad += glare

    def _sub_frames(self, index: int) -> Array:
        """When the sub-frames of a frame are, relative to the middle of its exposure."""
        half = self._scene.shutter / 2
        ends = self._scene.trajectory.corners(np.array([index - half, index, index + half]))
        way = np.linalg.norm(np.diff(ends, axis=0), axis=2).sum(0).max() * self._setting[0, 0]
        count = int(np.clip(np.ceil(way / SUBFRAME_STEP_PX), *SUBFRAMES_RANGE))
        return np.asarray(((np.arange(count) + 0.5) / count - 0.5) * self._scene.shutter)

    def _about_at(self, time: float) -> Array:
        return np.array([np.interp(time, self._times, column) for column in self._about.T])


def visible_corners(scene: Scene, frames: int) -> list[Array | None]:
    """The target's corners (4, 2) at the middle of each frame's exposure, px; None where no part is in the frame."""
    corners = transform(to_setting(scene.width), scene.trajectory.corners(np.arange(float(frames))))
    right, bottom = scene.width - 0.5, scene.height - 0.5
    frame = np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]], np.float32)
    return [c if cv2.intersectConvexConvex(c.astype(np.float32), frame)[0] > 0 else None for c in corners]


def _strewn(count: int) -> Array:
    """Offsets (count, 2) evenly strewn over a pixel, of zero mean so that the truth holds."""
    offsets = (np.arange(count)[:, None] + 0.5) * [0.754878, 0.569840] % 1
    return np.asarray(offsets - offsets.mean(0))


def _warp(image: Image, matrix: Array, shape: tuple[int, ...], border: int = cv2.BORDER_CONSTANT) -> Image:
    return np.asarray(cv2.warpPerspective(image, matrix, (shape[1], shape[0]), borderMode=border), np.uint8)


def _box(matrices: list[Array], texture: tuple[int, ...], frame: tuple[int, int], spread: int = 0) -> Box:
    """Rows and columns of a frame (height, width) that a texture touches through any of the homographies.

    spread: px that it reaches farther.
    """
    height, width = texture[:2]
    outline = np.array([[-1.0, -1], [width, -1], [width, height], [-1, height]])
    points = np.concatenate([transform(matrix, outline) for matrix in matrices])
    bounds = np.array(frame[::-1])
    low = np.clip(np.floor(points.min(0)) - spread, 0, bounds).astype(int)
    high = np.clip(np.ceil(points.max(0)) + 1 + spread, low, bounds).astype(int)
    return slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))


def _paste(image: Image, texture: Image, matrix: Array) -> bool:
    """Lays premultiplied RGBA over an image, in place; False where it falls beside it."""
    box = _box([matrix], texture.shape, image.shape[:2])
    part = image[box]
    if not part.size:
        return False
    drawn = _warp(texture, translation(-box[1].start, -box[0].start) @ matrix, part.shape)
    through = 255 - drawn[..., 3]
    behind = cv2.multiply(part, cv2.merge([through] * 3), scale=1 / 255)
    image[box] = cv2.add(behind, cv2.cvtColor(drawn, cv2.COLOR_RGBA2RGB))
    return True
