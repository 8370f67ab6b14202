"""Make the demo clip, its ground truth and the ad: `python assets/make_demo.py [--out assets]`.

Everything is drawn and synthesised by our own code with fixed seeds. The clip is rendered in linear light: each frame
averages renders spread over a 180-degree shutter, every one offset by part of a pixel, so motion blur and smooth edges
come from the same sum. The truth is the print's outline projected at mid-exposure.
"""

import argparse
import json
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from demo_ad import AD_FPS, AD_FRAMES, ad_frames
from demo_paint import (
    FRAME,
    POSTER,
    POSTER_PROUD,
    WALL_LEFT,
    WALL_SCALE,
    WALL_TOP,
    Bytes,
    Floats,
    Layer,
    floats,
    noise,
    ramp,
    upright,
)
from demo_props import bicycle, framed_poster, passer_by, poster_print
from demo_sound import SAMPLE_RATE, jingle, street_pad
from demo_video import write_video
from demo_wall import Facade, pavement
from numpy.typing import NDArray

Doubles = NDArray[np.float64]

WIDTH, HEIGHT, FPS, FRAMES = 1280, 720, 30, 300
FOCAL = 1000.0  # pixels
SUBFRAMES = 12
SHUTTER = 0.5  # 180 degrees
# Each sub-frame's offset in pixels, (SUBFRAMES, 2): evenly strewn over a pixel, of zero mean so that the truth holds.
JITTER = np.arange(SUBFRAMES)[:, None] * [0.754878, 0.569840] % 1
JITTER -= JITTER.mean(0)
JOLT_TIME = 7.2  # a stumble of the hand, for a few strongly blurred frames
# The passer-by: when, from which x, metres per second, metres off the wall.
WALK_START, WALK_FROM, WALK_SPEED, WALK_Z = 4.55, -3.4, 1.35, 1.75

# The hand-held camera's way round the poster: time in seconds, angle off the wall's normal, distance to the poster,
# the point looked at (x, y) relative to the poster's centre, roll. Angles in degrees, lengths in metres.
CAMERA_KEYS = np.array(
    [
        [0.0, -7, 4.25, 0.10, -0.22, 0.0],
        [1.2, -3, 4.20, 0.12, -0.20, 0.5],
        [3.6, 39, 3.60, 0.30, -0.14, 2.2],
        [4.4, 41, 3.50, 0.28, -0.10, 1.5],
        [6.2, 12, 3.70, -0.10, -0.12, -1.0],
        [8.2, -16, 2.60, -0.08, -0.02, -2.6],
        [9.1, -14, 2.54, 0.06, 0.02, -1.2],
        [10.2, -2, 2.85, 0.02, -0.02, 0.0],
    ]
)


def spline(time: float) -> Doubles:
    """The camera keys at a time, by a cubic Hermite curve: smooth, through every key."""
    times = CAMERA_KEYS[:, 0]
    i = int(np.clip(np.searchsorted(times, time, "right") - 1, 0, len(times) - 2))
    slopes = np.gradient(CAMERA_KEYS[:, 1:], times, axis=0)
    slopes[0] = 0
    span = times[i + 1] - times[i]
    t = (time - times[i]) / span
    value = (
        (2 * t**3 - 3 * t**2 + 1) * CAMERA_KEYS[i, 1:]
        + (3 * t**2 - 2 * t**3) * CAMERA_KEYS[i + 1, 1:]
        + span * ((t**3 - 2 * t**2 + t) * slopes[i] + (t**3 - t**2) * slopes[i + 1])
    )
    return np.asarray(value)


def shake(time: float, seed: int) -> float:
    """A hand's tremor of about unit size: a few sines that never line up."""
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, 5)
    rates, sizes = np.array([0.31, 0.83, 1.7, 3.1, 5.9]), np.array([0.8, 0.6, 0.35, 0.13, 0.05])
    return float(sizes @ np.sin(2 * np.pi * rates * time + phases))


def camera(time: float, jitter: Doubles) -> Doubles:
    """The (3, 4) projection from world metres to pixels at a time, shifted by `jitter` (2,) pixels."""
    angle, distance, look_x, look_y, roll = spline(time)
    angle = np.deg2rad(angle)
    middle = np.array([(POSTER[0] + POSTER[2]) / 2, (POSTER[1] + POSTER[3]) / 2, POSTER_PROUD])
    sway = 0.02 * np.array([shake(time, 1), shake(time, 2), shake(time, 3)])
    place = middle + distance * np.array([-np.sin(angle), 0, np.cos(angle)]) + sway
    jolt = np.exp(-(((time - JOLT_TIME) / 0.12) ** 2))
    aim_x = look_x + 0.016 * shake(time, 4) + 0.13 * jolt
    aim_y = look_y + 0.016 * shake(time, 5) - 0.06 * jolt
    target = middle + np.array([aim_x, aim_y, 0])
    forward = (target - place) / np.linalg.norm(target - place)
    right = np.cross(forward, [0, 1, 0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    tilt = np.deg2rad(roll + 0.5 * shake(time, 6))
    right, down = np.cos(tilt) * right + np.sin(tilt) * down, np.cos(tilt) * down - np.sin(tilt) * right
    rotation = np.stack([right, down, forward])
    centre = np.array([(WIDTH - 1) / 2, (HEIGHT - 1) / 2]) + jitter
    intrinsic = np.array([[FOCAL, 0, centre[0]], [0, FOCAL, centre[1]], [0, 0, 1]])
    return intrinsic @ np.column_stack([rotation, -rotation @ place])


def project(projection: Doubles, points: Doubles) -> Doubles:
    """World points (N, 3) to pixels (N, 2)."""
    homogeneous = points @ projection[:, :3].T + projection[:, 3]
    return np.asarray(homogeneous[:, :2] / homogeneous[:, 2:])


def rectangle(rect: tuple[float, float, float, float], z: float) -> Doubles:
    """The corners (4, 3) of an upright (left, bottom, right, top): top-left, top-right, bottom-right, bottom-left."""
    left, bottom, right, top = rect
    return np.array([[left, top, z], [right, top, z], [right, bottom, z], [left, bottom, z]])


def texture_to_frame(projection: Doubles, layer: Layer) -> Doubles:
    """The (3, 3) homography from a layer's texture pixels to frame pixels."""
    first = layer.origin + 0.5 * (layer.right + layer.down)
    basis = np.column_stack([layer.right, layer.down, first]).astype(np.float64)
    matrix = projection[:, :3] @ basis
    matrix[:, 2] += projection[:, 3]
    return matrix


def paste(frame: Bytes, layer: Layer, projection: Doubles) -> tuple[tuple[slice, slice], Bytes] | None:
    """Draw a layer with alpha over the frame, within its box. Returns the box and the (h, w) alpha, None if outside."""
    matrix = texture_to_frame(projection, layer)
    height, width = layer.texture.shape[:2]
    corners = np.array([[0, 0, 1], [width, 0, 1], [width, height, 1], [0, height, 1]]) @ matrix.T
    low, high = np.zeros(2), np.array([WIDTH, HEIGHT])
    if (corners[:, 2] > 0.1).all():  # else part of it is behind the camera, and the box is the whole frame
        pixels = corners[:, :2] / corners[:, 2:]
        low, high = np.maximum(np.floor(pixels.min(0)) - 1, low), np.minimum(np.ceil(pixels.max(0)) + 2, high)
    if (high <= low).any():
        return None
    (x0, y0), (x1, y1) = low.astype(int).tolist(), high.astype(int).tolist()
    shift = np.array([[1, 0, -x0], [0, 1, -y0], [0, 0, 1.0]])
    drawn = cv2.warpPerspective(layer.texture, shift @ matrix, (x1 - x0, y1 - y0), flags=cv2.INTER_LINEAR)
    box = (slice(y0, y1), slice(x0, x1))
    alpha = drawn[..., 3]
    behind = cv2.multiply(frame[box], cv2.merge([255 - alpha] * 3), scale=1 / 255)
    frame[box] = cv2.add(behind, np.ascontiguousarray(drawn[..., :3]))
    return box, alpha


class Street:
    """The scene with its textures, rendered frame by frame."""

    def __init__(self) -> None:
        rng = np.random.default_rng(27)
        sheet = poster_print(rng)
        wall = Facade(rng).texture(sheet)
        self.wall = upright(wall, WALL_LEFT, WALL_TOP, 0.0, WALL_SCALE)
        self.pavement = pavement(rng)
        self.bicycle_shadow, self.bicycle = bicycle()
        self.poster = framed_poster(sheet)
        self.walker = passer_by()
        leaves = ramp(-0.1, 0.9, noise((512, 512), 90, rng, 4))
        self.leaves = cv2.GaussianBlur(leaves, (0, 0), 4)
        self.grain = rng.standard_normal((HEIGHT + 64, WIDTH + 64)).astype(np.float32)
        y, x = np.mgrid[-1 : 1 : HEIGHT * 1j, -1 : 1 : WIDTH * 1j]
        self.vignette = (1 - 0.17 * (x**2 + 0.8 * y**2)).astype(np.float32)[..., None]

    def walker_layer(self, time: float) -> Layer:
        """The passer-by at a time, walking along the wall to the right with a light bob."""
        texture, scale = self.walker
        stride = time - WALK_START
        left = WALK_FROM + WALK_SPEED * stride
        return upright(texture, left, 2.4 + 0.022 * abs(np.sin(2 * np.pi * 0.95 * stride)), WALK_Z, scale)

    def exposure(self, time: float, jitter: Doubles) -> tuple[Bytes, float]:
        """One instant: the frame in gamma-2 bytes, and how much of the print the passer-by covers, 0..1."""
        projection = camera(time, jitter)
        frame = cv2.warpPerspective(
            self.wall.texture, texture_to_frame(projection, self.wall), (WIDTH, HEIGHT), flags=cv2.INTER_LINEAR
        )
        paste(frame, self.pavement, projection)
        paste(frame, self.bicycle_shadow, projection)
        paste(frame, self.bicycle, projection)
        ends = np.vstack([project(projection, rectangle(FRAME, z)) for z in (0.0, POSTER_PROUD)])
        hull = cv2.convexHull(np.round(ends * 256).astype(np.int32))
        cv2.fillConvexPoly(frame, hull, (34, 35, 38), cv2.LINE_AA, 8)
        paste(frame, self.poster, projection)
        hit = paste(frame, self.walker_layer(time), projection)
        if hit is None:
            return frame, 0.0
        box, alpha = hit
        outline = project(projection, rectangle(POSTER, POSTER_PROUD)) - [box[1].start, box[0].start]
        print_mask = np.zeros(alpha.shape, np.uint8)
        cv2.fillConvexPoly(print_mask, np.round(outline * 256).astype(np.int32), 1, cv2.LINE_8, 8)
        area = cv2.contourArea(outline.astype(np.float32))
        return frame, float(alpha[print_mask > 0].sum() / 255 / area)

    def light(self, time: float) -> Floats:
        """What the light does to linear values, (H, W, 3): a cloud's edge, leaves' shade, the walker's, slow drift."""
        projection = camera(time, np.zeros(2))
        to_wall = np.linalg.inv(projection[:, [0, 1, 3]])
        y, x = np.mgrid[0:HEIGHT:4, 0:WIDTH:4] + 1.5
        wall = np.stack([x, y, np.ones_like(x)], -1) @ to_wall.T
        wall_x = (wall[..., 0] / wall[..., 2]).astype(np.float32)
        wall_y = (wall[..., 1] / wall[..., 2]).astype(np.float32)
        edge = float(np.interp(time, [0, 2.0, 4.6, 6.9, 9.0, 10], [6.0, 3.2, -4.5, -4.5, 3.4, 6.0]))
        cloud = ramp(-0.45, 0.45, wall_x + 0.35 * wall_y - edge)
        sway = float(6 * np.sin(2 * np.pi * 0.23 * time) + 3 * np.sin(2 * np.pi * 0.61 * time))
        leaf_x, leaf_y = (wall_x * 80 + 300 + sway), (wall_y * 80 + 20 + 0.4 * sway)
        leaves = cv2.remap(self.leaves, leaf_x, leaf_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
        sun = (1 - cloud) * (1 - 0.5 * leaves)
        walker_x = WALK_FROM + 1.35 + WALK_SPEED * (time - WALK_START)  # ahead of the body: the sun stands on the left
        sun *= 1 - 0.4 * np.exp(-(((wall_x - walker_x) / 0.5) ** 2)) * ramp(2.4, 1.6, wall_y)
        drift = 1 + 0.05 * np.sin(2 * np.pi * time / 7.3)
        tint = floats([1, 1, 1]) + floats([0.03, 0, -0.03]) * np.sin(2 * np.pi * time / 9.1)
        light = floats([0.80, 0.86, 0.94]) + floats([1.17, 0.99, 0.73]) * sun[..., None]
        return cv2.resize((light * drift * tint).astype(np.float32), (WIDTH, HEIGHT))

    def frame(self, index: int) -> tuple[Bytes, Doubles, float]:
        """The finished frame, the print's corners (4, 2) at mid-exposure, and its visible part 0..1."""
        time = index / FPS
        light = np.zeros((HEIGHT, WIDTH, 3), np.float32)
        covered = 0.0
        for i in range(SUBFRAMES):
            moment = time + ((i + 0.5) / SUBFRAMES - 0.5) * SHUTTER / FPS
            instant, part = self.exposure(moment, JITTER[i])
            cv2.accumulateSquare(instant, light)
            covered += part / SUBFRAMES
        light *= self.light(time) * (self.vignette**2 / (SUBFRAMES * 255.0**2))
        tone = np.sqrt(light)
        tone = tone * (1 + 0.12 * tone) / (1 + 0.22 * tone**2)  # a soft shoulder, so that sunlit parts do not clip
        dx, dy = np.random.default_rng(index).integers(0, 64, 2)
        grain = self.grain[dy : dy + HEIGHT, dx : dx + WIDTH, None] * (1.1 / 255)
        picture = np.clip((tone + grain) * 255 + 0.5, 0, 255).astype(np.uint8)
        corners = project(camera(time, np.zeros(2)), rectangle(POSTER, POSTER_PROUD))
        return picture, corners, 1.0 - min(covered, 1.0)


def make_clip(folder: Path) -> None:
    street = Street()
    corners: list[Doubles] = []
    visible: list[float] = []

    def frames() -> Iterator[Bytes]:
        for index in range(FRAMES):
            picture, quad, seen = street.frame(index)
            corners.append(quad)
            visible.append(seen)
            yield picture

    write_video(folder / "demo.mp4", frames(), FPS, 21, street_pad(FRAMES / FPS), SAMPLE_RATE)
    truth = {
        "width": WIDTH,
        "height": HEIGHT,
        "fps": f"{FPS}/1",
        "quad": corners[0].round(3).tolist(),
        "corners": [quad.round(3).tolist() for quad in corners],
        "visible": [round(seen, 4) for seen in visible],
    }
    (folder / "demo.json").write_text(json.dumps(truth) + "\n")


def main() -> None:
    parser = argparse.ArgumentParser(description="Make the demo clip, its ground truth and the ad.")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent, help="folder to write to (default: assets)")
    folder: Path = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    write_video(folder / "ad.mp4", ad_frames(), AD_FPS, 22, jingle(AD_FRAMES / AD_FPS), SAMPLE_RATE)
    make_clip(folder)


if __name__ == "__main__":
    main()
