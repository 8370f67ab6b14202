"""Clips that are drawn for measuring speed: posters that move before a street, of any size, share and length.

`python -m ar_demo.evaluation.drawn_clips OUT WIDTH HEIGHT SHARE FRAMES SURFACES` writes one.
"""

import sys
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np

from hdn.benchmark.synthplanar.drawings import draw_poster, draw_scene
from hdn.imaging.arrays import Array, Image
from hdn.imaging.homography import from_corners, similarity, transform, translation
from hdn.imaging.quads import outline

from ..media.writer import VideoWriter

FPS = 30


@dataclass(frozen=True)
class DrawingModel:
    """How posters lie and move; shares are of the frame's width."""

    gap: float = 0.06  # of a poster's place that stays free on each side
    swing_frames: int = 120  # of a motion that begins again
    shift: float = 0.03
    scale: float = 0.05
    turn_rad: float = 0.05
    noise_grey: float = 2.0  # standard deviation
    stock: int = 7  # noises that are laid on in turn
    largest_poster_px: int = 720


MODEL = DrawingModel()


@dataclass(frozen=True)
class Kind:
    """What is drawn.

    Attributes:
        width, height: px. share: of the frame that the surfaces take together, 0..1.
        frames: how many. surfaces: how many, side by side in a grid.
    """

    width: int
    height: int
    share: float
    frames: int
    surfaces: int = 1

    @property
    def quads(self) -> list[Array]:
        """The surfaces' corners (4, 2) in the first frame, px."""
        columns = int(np.ceil(np.sqrt(self.surfaces)))
        rows = -(-self.surfaces // columns)
        place = np.array([self.width, self.height]) * np.sqrt(self.share) / [columns, rows]
        own = place * (1 - (2 * MODEL.gap if self.surfaces > 1 else 0))
        middle = (np.array([self.width, self.height]) - 1) / 2
        first = middle - place * [(columns - 1) / 2, (rows - 1) / 2]
        corners = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) * (own - 1)
        return [first + place * [k % columns, k // columns] + corners for k in range(self.surfaces)]


def draw_clip(path: Path, kind: Kind) -> None:
    """Writes a clip, H.264 as the product writes it.

    Raises:
        InputError, RunError: see `VideoWriter`.
    """
    rng = np.random.default_rng(7)
    size, quads = (kind.width, kind.height), kind.quads
    first = draw_scene(size, rng)
    for quad in quads:
        sides = np.ptp(quad, 0)
        width, height = np.maximum(sides * min(1, MODEL.largest_poster_px / sides.max()), 16).astype(int).tolist()
        poster = draw_poster((width, height), rng)
        cv2.warpPerspective(
            poster, from_corners(outline(width, height), quad), size, first, cv2.INTER_LINEAR, cv2.BORDER_TRANSPARENT
        )
    noises = [rng.normal(0, MODEL.noise_grey, first.shape).astype(np.int8) for _ in range(MODEL.stock)]
    with VideoWriter(path, *size, Fraction(FPS)) as writer:
        for i in range(kind.frames):
            frame = cv2.warpPerspective(first, motion(i, size), size, borderMode=cv2.BORDER_REFLECT)
            noisy: Image = cv2.add(frame, noises[i % MODEL.stock], dtype=cv2.CV_8U)
            writer.write(noisy, Fraction(i, FPS))


def motion(index: int, size: tuple[int, int]) -> Array:
    """How the scene has moved from the first frame to another: (3, 3) px."""
    phase = 2 * np.pi * index / MODEL.swing_frames
    swing, middle = np.sin(phase), (np.array(size) - 1) / 2
    shift = MODEL.shift * size[0]
    moved = similarity(1 + MODEL.scale * swing, MODEL.turn_rad * swing, shift * swing, shift / 2 * (1 - np.cos(phase)))
    return translation(*middle) @ moved @ translation(*-middle)


def corners_in(index: int, kind: Kind) -> list[Array]:
    """The surfaces' corners (4, 2) in a frame, px."""
    return [transform(motion(index, (kind.width, kind.height)), quad) for quad in kind.quads]


if __name__ == "__main__":
    out, width, height, share, frames, surfaces = sys.argv[1:]
    draw_clip(Path(out), Kind(int(width), int(height), float(share), int(frames), int(surfaces)))
