"""A poster on a long wall of its own plane, seen by a moving camera; drawn at test time."""

from dataclasses import dataclass

import cv2
import numpy as np

from hdn.imaging.arrays import Array, Image
from hdn.imaging.homography import similarity, transform, translation
from hdn.imaging.observation import Observation
from hdn.imaging.quads import outline
from hdn.plane.plane_map import PlaneMap

from ..scenes import error, texture

WIDTH, HEIGHT = 640, 360
POSTER = outline(160, 120) + np.array([420.0, 300])  # px of the wall
STANDARD_SIDE = 160


@dataclass
class Wall:
    """The wall with its poster; a view of it is told by its pose: pixels of the wall to those of the frame."""

    seed: int = 0

    def __post_init__(self) -> None:
        tiles = [[texture(self.seed + 10 * row + column, 240, 240) for column in range(6)] for row in range(3)]
        self.picture = cv2.GaussianBlur(np.vstack([np.hstack(row) for row in tiles]), (0, 0), 1.5)
        poster = texture(self.seed + 100, 160, 120)
        self.picture[300:420, 420:580] = poster

    def view(self, pose: Array, noise: float = 2.0, gain: float = 1.0) -> Image:
        """A frame by a pose (3, 3), with noise, grey levels, and light."""
        size = (WIDTH, HEIGHT)
        frame = cv2.warpPerspective(self.picture, pose, size, borderMode=cv2.BORDER_REFLECT).astype(np.float32)
        rng = np.random.default_rng(int(frame[::9, ::9].sum()) % 2**32)
        return np.clip(gain * frame + rng.normal(0, noise, frame.shape), 0, 255).astype(np.uint8)


def camera(x: float, y: float, rotation: float = 0.0, tilt: float = 0.0) -> Array:
    """Pose (3, 3) of a camera whose frame's middle is at x, y of the wall, px."""
    middle = translation((WIDTH - 1) / 2, (HEIGHT - 1) / 2)
    perspective = np.array([[1.0, 0, 0], [0, 1, 0], [tilt, 0, 1]])
    return middle @ perspective @ similarity(1, rotation, 0, 0) @ translation(-x, -y)


def shaken(frames: int) -> list[Array]:
    """Poses (3, 3) of a hand-held camera before the poster."""
    return [camera(500 + 25 * np.sin(0.5 * i), 360 + 18 * np.sin(0.8 * i), 0.02 * np.sin(i)) for i in range(frames)]


def panned(frames: int) -> list[Array]:
    """Poses (3, 3) of a camera that pans to the right, until the poster is half out of the frame."""
    return [camera(262 + 558 * i / (frames - 1), 360, 0.01 * np.sin(i)) for i in range(frames)]


def mapped(wall: Wall, pose: Array) -> PlaneMap:
    """The map of the poster's plane from a view by a pose (3, 3)."""
    return PlaneMap(Observation(wall.view(pose)), transform(pose, POSTER), STANDARD_SIDE)


def learnt(plane: PlaneMap, wall: Wall, poses: list[Array]) -> None:
    """Lets a map learn from views by poses (3, 3), the first of which it was made from."""
    for pose in poses[1:]:
        plane.look(Observation(wall.view(pose)), motion(poses[0], pose), learn=True)


def motion(reference: Array, pose: Array) -> Array:
    """Pixels of the view by one pose (3, 3) to those of the view by another."""
    return pose @ np.linalg.inv(reference)


def pose_error(homography: Array, reference: Array, pose: Array) -> float:
    """How far a homography (3, 3) has the poster's corners from where they are, px."""
    return error(transform(homography, transform(reference, POSTER)), transform(pose, POSTER))


def cover(frame: Image, pose: Array, beyond: float = 8) -> Image:
    """The frame with a plain sheet over the poster, and over so many px of the wall around it."""
    hidden = frame.copy()
    sheet = outline(1, 1) * [160 + 2 * beyond, 120 + 2 * beyond] + POSTER.mean(0)
    cv2.fillConvexPoly(hidden, np.round(transform(pose, sheet)).astype(np.int32), (120, 125, 118))
    return hidden


def rms(values: list[float]) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def truth(plane: PlaneMap, wall: Wall, reference: Array) -> Image:
    """What a map's picture (h, w, 3) would be if it were wholly known."""
    to_wall = np.linalg.inv(reference) @ plane.level.to_template
    scale = float(np.linalg.norm(to_wall[:2, 0]))
    soft = cv2.GaussianBlur(wall.picture, (0, 0), 0.4 * scale)
    size = plane.level.width, plane.level.height
    return np.asarray(cv2.warpPerspective(soft, to_wall, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP), np.uint8)
