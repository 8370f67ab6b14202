"""A textured poster on a textured wall, seen by a moving camera: frames with exact corners, made at test time."""

from dataclasses import dataclass

import cv2
import numpy as np

from hdn.imaging.arrays import Array, Image
from hdn.imaging.homography import from_corners, similarity, transform, translation
from hdn.imaging.quads import square


def texture(seed: int, width: int, height: int) -> Image:
    """A print-like picture: soft clouds of colour with shapes and letters on them."""
    rng = np.random.default_rng(seed)
    clouds = rng.integers(40, 216, (6, 6, 3), np.uint8)
    picture = cv2.resize(clouds, (width, height), interpolation=cv2.INTER_CUBIC)
    for _ in range(40):
        centre = tuple(int(v) for v in rng.uniform(0, [width, height]))
        colour = tuple(float(v) for v in rng.uniform(0, 255, 3))
        if rng.uniform() < 0.5:
            cv2.circle(picture, centre, int(rng.uniform(4, width / 8)), colour, -1, cv2.LINE_AA)
        else:
            cv2.putText(
                picture, chr(int(rng.integers(65, 91))), centre, cv2.FONT_HERSHEY_SIMPLEX, 1.5, colour, 3, cv2.LINE_AA
            )
    return np.asarray(picture, np.uint8)


@dataclass
class Scene:
    """Draws the poster at given corners; wall and poster have their own textures."""

    width: int = 320
    height: int = 240
    seed: int = 0

    def __post_init__(self) -> None:
        self.poster = texture(self.seed, 240, 180)
        self.wall = cv2.GaussianBlur(texture(self.seed + 100, self.width, self.height), (0, 0), 2)
        self.quad = np.array([[100.0, 70], [220, 74], [216, 166], [102, 160]])

    def draw(self, corners: Array | None, noise: float = 2.0) -> Image:
        """A frame with the poster at corners (4, 2), or with the bare wall."""
        frame = self.wall.astype(np.float32)
        if corners is not None:
            outline = square(1) * [240, 180] + [119.5, 89.5]
            big = from_corners(outline, (corners + 0.5) * 2 - 0.5)  # drawn at twice the size against aliasing
            size = (self.width * 2, self.height * 2)
            drawn = cv2.warpPerspective(self.poster, big, size, flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REPLICATE)
            mask = cv2.warpPerspective(np.full(self.poster.shape[:2], 255, np.uint8), big, size)
            drawn, mask = (
                cv2.resize(x, (self.width, self.height), interpolation=cv2.INTER_AREA) for x in (drawn, mask)
            )
            alpha = mask[..., None].astype(np.float32) / 255
            frame = frame * (1 - alpha) + drawn.astype(np.float32) * alpha
        rng = np.random.default_rng(int(frame[::9, ::9].sum()) % 2**32)
        return np.clip(frame + rng.normal(0, noise, frame.shape), 0, 255).astype(np.uint8)


def moved(
    quad: Array, shift: tuple[float, float] = (0, 0), scale: float = 1, rotation: float = 0, tilt: float = 0
) -> Array:
    """The quad (4, 2) after a similarity about its centre and some perspective."""
    x, y = quad.mean(0)
    perspective = np.array([[1.0, 0, 0], [0, 1, 0], [tilt, tilt / 2, 1]])
    matrix = translation(x, y) @ similarity(scale, rotation, *shift) @ perspective @ translation(-x, -y)
    return transform(matrix, quad)


def path(quad: Array, frames: int) -> list[Array]:
    """Corners over a smooth hand-held-like motion that starts at the quad."""
    t = np.arange(frames) / 30
    return [
        moved(
            quad,
            (30 * np.sin(2.1 * s), 14 * np.sin(3.3 * s)),
            1 + 0.25 * np.sin(1.3 * s),
            0.3 * np.sin(1.7 * s),
            0.0012 * np.sin(1.1 * s),
        )
        for s in t
    ]


def error(corners: Array, truth: Array) -> float:
    """Root mean square distance over the four corners, px."""
    return float(np.sqrt(np.square(corners - truth).sum(-1).mean()))
