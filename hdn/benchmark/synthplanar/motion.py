"""How SynthPlanar's target moves: poses of a plane before a camera, at a speed drawn as it is in hand-held video.

All lengths are pixels of a 1280x720 frame, whatever is rendered, so that one seed means one path. A pose is six
numbers: the plane's centre in the frame (x, y; px), the log of its size (px that one unit of the plane takes when seen
frontally), yaw, pitch and roll (rad). A target has unit area in its plane, centred at the origin, x right and y down.
"""

from dataclasses import dataclass

import numpy as np

from ...imaging.arrays import Array

WIDTH, HEIGHT = 1280, 720
FOCAL = 1100.0
CENTRE = np.array([(WIDTH - 1) / 2, (HEIGHT - 1) / 2])


@dataclass(frozen=True)
class SpeedModel:
    """Speeds of the target, log-normal: 90 % of them stay below 24 px a frame and 99 % below 65 px."""

    median_px: float = 8.0  # a frame
    log_deviation: float = 0.82  # standard deviation of the logarithm
    max_deviations: float = 2.6  # of the logarithm from its mean
    steady_frames: float = 6.0  # standard deviation of the time over which the speed stays about the same
    slow_start_frames: int = 10  # until it is reached


SPEED = SpeedModel()

_SAMPLES = 48  # of the path between two of its keys
_FINE = 16  # samples of the speed in a frame
# The share of the target's motion that the camera makes: the background moves by it. Little of the tilt, or a part of
# the background's plane would come to lie behind the camera.
_FOLLOW = np.array([0.55, 0.55, 0.35, 0.22, 0.22, 0.75])


@dataclass(frozen=True)
class Ranges:
    """Where a path may go.

    size: smallest and largest, px. tilt, roll: largest, degrees. speed: ratio to the usual; at 0 nothing moves, not
    even a hand. leaves: leaves the frame, again and again. absent: is out of it for a third of the clip.
    """

    size: tuple[float, float] = (110.0, 480.0)
    tilt: float = 25.0
    roll: float = 20.0
    speed: float = 1.0
    leaves: bool = False
    absent: bool = False


class Trajectory:
    """A target's path, continuous in time, which counts in frames: the middle of frame i's exposure is at time i."""

    def __init__(self, ranges: Ranges, aspect: float, frames: int, rng: np.random.Generator) -> None:
        self.outline = outline(aspect)
        self._times = np.arange(-_FINE, (frames + 1) * _FINE) / _FINE
        speed = _speeds(self._times, frames, rng) * ranges.speed
        self._travelled = np.concatenate([[0.0], np.cumsum(speed[:-1]) / _FINE])  # px
        keys = _keys(ranges, self.outline, 8 + int(self._travelled[-1] / 60), rng)
        self._path = _curve(keys)
        corners = project(self._path, self.outline)
        steps = np.linalg.norm(np.diff(corners, axis=0), axis=2).mean(1)
        self._length = np.concatenate([[0.0], np.cumsum(steps)])
        self._shake = float(ranges.speed > 0) * np.array([0.6, 0.6, 0.0006, 0.001, 0.001, 0.0008])
        self._tremor = rng.uniform(0, 2 * np.pi, (3, 6)), rng.uniform(0.06, 0.3, (3, 1))  # phases, cycles a frame
        self._frames, self._away = frames, 0.0
        if ranges.absent:
            self._away = self._way_out(1 if rng.random() < 0.5 else -1)

    def poses(self, times: Array) -> Array:
        """Poses (N, 6) at times (N,)."""
        travelled = np.interp(times, self._times, self._travelled)
        pose = np.stack([np.interp(travelled, self._length, column) for column in self._path.T], 1)
        phases, rates = self._tremor
        waves = np.sin(2 * np.pi * rates * times[:, None, None] + phases).sum(1)  # (N, 6)
        pose = pose + waves * self._shake
        if self._away:
            pose[:, 1] += self._away * self._absence(times)
        return np.asarray(pose)

    def _absence(self, times: Array) -> Array:
        """How far the target is on its way out at times (N,): 1 in the clip's middle third, and within a sixth 0."""
        share = np.clip(2 - 6 * np.abs(times / self._frames - 0.5), 0, 1)
        return np.asarray(share**2 * (3 - 2 * share))

    def _way_out(self, down: int) -> float:
        """By how much its centre must be moved, downward (1) or upward (-1), for it to be out of view, px."""
        times = np.linspace(1 / 3, 2 / 3, 100) * self._frames
        self._away = 0.0
        while (down * (self.corners(times)[..., 1] - CENTRE[1]) < HEIGHT / 2 + 12).any():
            self._away += down * 24.0
        return self._away

    def corners(self, times: Array) -> Array:
        """The target's corners (N, 4, 2) at times (N,), px."""
        return project(self.poses(times), self.outline)


def outline(aspect: float) -> Array:
    """Corners (4, 2) of a target of unit area in its plane; aspect is width over height."""
    w, h = np.sqrt(aspect) / 2, 1 / np.sqrt(aspect) / 2
    return np.array([[-w, -h], [w, -h], [w, h], [-w, h]])


def plane_to_frame(poses: Array) -> Array:
    """Homographies (N, 3, 3) from plane to frame, of poses (N, 6)."""
    x, y, log_size, yaw, pitch, roll = poses.T
    distance = FOCAL / np.exp(log_size)
    a, b, c = np.cos(yaw), np.cos(pitch), np.cos(roll)
    d, e, f = np.sin(yaw), np.sin(pitch), np.sin(roll)
    # The first two columns of Rz(roll) Rx(pitch) Ry(yaw).
    right = np.stack([c * a - f * e * d, f * a + c * e * d, -b * d], 1)
    down = np.stack([-f * b, c * b, e], 1)
    place = np.stack([(x - CENTRE[0]) * distance / FOCAL, (y - CENTRE[1]) * distance / FOCAL, distance], 1)
    camera = np.array([[FOCAL, 0, CENTRE[0]], [0, FOCAL, CENTRE[1]], [0, 0, 1]])
    return camera @ np.stack([right, down, place], 2)


def project(poses: Array, points: Array) -> Array:
    """Points (M, 2) of a plane in the frame: (N, M, 2) for poses (N, 6)."""
    matrices = plane_to_frame(poses)
    p = points @ matrices[:, :, :2].transpose(0, 2, 1) + matrices[:, None, :, 2]
    return p[..., :2] / p[..., 2:]


def background_poses(poses: Array) -> Array:
    """Poses (N, 6) of the background's plane, whose unit is the frame's width."""
    rest = np.array([*CENTRE, np.log(280.0), 0, 0, 0])
    moved = (poses - rest) * _FOLLOW + [*CENTRE, np.log(WIDTH), 0, 0, 0]
    return np.asarray(moved)


def to_setting(width: int) -> Array:
    """The (3, 3) that takes 1280x720 pixels to those of a frame `width` wide, pixel centres at whole numbers."""
    s = width / WIDTH
    return np.array([[s, 0, (s - 1) / 2], [0, s, (s - 1) / 2], [0, 0, 1]])


def _speeds(times: Array, frames: int, rng: np.random.Generator) -> Array:
    """Speeds at the times (N,), px a frame: log-normal, steady over some frames, slow at first."""
    reach = int(4 * SPEED.steady_frames)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / SPEED.steady_frames) ** 2)
    wave = np.convolve(rng.standard_normal(frames + 2 * reach), kernel, "valid")
    wave = (wave - wave.mean()) / max(wave.std(), 1e-9)
    wave = np.minimum(wave, SPEED.max_deviations)
    # Few frames cannot hold the whole range of speeds: they get its middle.
    spread = SPEED.log_deviation * min(1.0, frames / 40)
    speed = SPEED.median_px * np.exp(spread * np.interp(times, np.arange(frames), wave))
    return np.asarray(speed * np.clip((times + 1) / SPEED.slow_start_frames, 0.05, 1))


def _keys(ranges: Ranges, outline: Array, count: int, rng: np.random.Generator) -> Array:
    """Poses (count, 6) that the path goes through; near and far, left and right turned ones take turns."""
    tilt, roll = np.deg2rad([ranges.tilt, ranges.roll])
    keys = np.empty((count, 6))
    low, high = np.log(ranges.size)
    phase = int(rng.integers(2))
    for i in range(count):
        first, side = i == 0, (i + phase) % 2
        share = rng.uniform(0.4, 0.6) if first else side * 0.7 + rng.uniform(0, 0.3)
        direction, gentle = rng.uniform(0, 2 * np.pi), 0.2 if first else 1.0
        lean = tilt * gentle * rng.uniform(0.3, 1)
        turn = roll * gentle * rng.uniform(0.3, 1) * (1 if side else -1)
        keys[i] = [*CENTRE, low + share * (high - low), lean * np.cos(direction), lean * np.sin(direction), turn]
        reach = project(keys[i : i + 1], outline)[0] - CENTRE
        room_low, room_high = -reach.min(0) + 12, np.array([WIDTH, HEIGHT]) - 12 - reach.max(0)
        within = np.sort(np.stack([room_low, room_high]), 0)  # where the target is larger than the frame, it covers it
        keys[i, :2] = CENTRE + rng.uniform(-60, 60, 2) if first else rng.uniform(within[0], within[1])
        if first:
            keys[i, :2] = np.clip(keys[i, :2], within[0], within[1])
        elif ranges.leaves and i % 2:
            angle = rng.uniform(0, 2 * np.pi)
            away = np.array([np.cos(angle), np.sin(angle)])
            border = (CENTRE + 0.5) / np.maximum(np.abs(away), 1e-9)
            keys[i, :2] = CENTRE + away * (border.min() + rng.uniform(0.5, 1.5) * (reach.max() - reach.min()) / 2)
    return keys


def _curve(keys: Array) -> Array:
    """A smooth curve through the keys (K, 6), sampled: ((K - 1) * _SAMPLES + 1, 6)."""
    # Tangents of a monotone cubic: nothing beyond the keys, so that what is in the frame at the keys stays in it.
    steps = np.diff(keys, axis=0)
    product = steps[:-1] * steps[1:]
    total = steps[:-1] + steps[1:]
    safe = np.where(product > 0, total, 1.0)
    slopes = np.zeros_like(keys)
    slopes[1:-1] = np.where(product > 0, 2 * product / safe, 0.0)
    t = (np.arange(_SAMPLES) / _SAMPLES)[None, :, None]
    start, end = keys[:-1, None], keys[1:, None]
    curve = (
        (2 * t**3 - 3 * t**2 + 1) * start
        + (3 * t**2 - 2 * t**3) * end
        + (t**3 - 2 * t**2 + t) * slopes[:-1, None]
        + (t**3 - t**2) * slopes[1:, None]
    )
    return np.concatenate([curve.reshape(-1, keys.shape[1]), keys[-1:]])
