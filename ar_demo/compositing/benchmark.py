"""Time the compositors side by side: `python -m ar_demo.compositing.benchmark`.

Prints milliseconds a frame for drawing a layer and merging it, with an ad that stays the same (an image), one that
changes with every frame (a video), and one in float32 (lit, or of more than 8 bits); and in brackets how many times
OpenCV's that is.
"""

import time

import numpy as np

from hdn.imaging.arrays import Array, Image, Picture

from ..choices import Backend
from ..errors import RunError
from .compositor import Compositor, open_compositor
from .merge import merge
from .opencv import CvCompositor

SIZES = {"720p": (1280, 720), "1080p": (1920, 1080)}
COVERS = {"25%": 0.25, "100%": 1.0}  # share of the frame
BACKENDS: tuple[Backend, ...] = ("egl", "osmesa")
ROUNDS, DRAWS = 6, 4  # the best of the rounds counts: the least disturbed


def slanted_quad(width: int, height: int, cover: float) -> Array:
    """A quad seen slightly from the side, around the frame's centre, whose area is about `cover` of the frame."""
    shape = np.array([[-0.52, -0.46], [0.48, -0.54], [0.48, 0.54], [-0.52, 0.46]]) * np.sqrt(cover)
    return np.asarray((shape + 0.5) * (width, height), np.float64)


def ads() -> dict[str, list[Picture]]:
    """1080p ads by name, of one frame or two."""
    rng = np.random.default_rng(0)
    first, second = (rng.integers(0, 256, (1080, 1920, 3), np.uint8) for _ in range(2))
    return {"still ad": [first], "moving ad": [first, second], "float ad": [first / np.float32(255)]}


def milliseconds(compositor: Compositor, frame: Image, pictures: list[Picture], quad: Array) -> float:
    """Mean time of a layer and its merge, over some draws. What a moving ad's frame leaves behind is not kept."""
    size = frame.shape[1], frame.shape[0]
    start = time.perf_counter()
    for i in range(DRAWS):
        # A frame of a video is another array each time; a view of it is one too, and costs nothing.
        picture = pictures[0] if len(pictures) == 1 else pictures[i % len(pictures)][:]
        layer = compositor.draw(picture, quad, size)
        assert layer is not None
        merge(frame, layer)
    return (time.perf_counter() - start) / DRAWS * 1000


def compare(compositor: Compositor, baseline: Compositor) -> None:
    """Prints the times of two compositors; their rounds alternate, so that what else runs disturbs both alike."""
    for ad, pictures in ads().items():
        for size, (width, height) in SIZES.items():
            frame = np.random.default_rng(1).integers(0, 256, (height, width, 3), np.uint8)
            for cover, share in COVERS.items():
                quad = slanted_quad(width, height, share)
                rounds = [
                    [milliseconds(each, frame, pictures, quad) for each in (baseline, compositor)]
                    for _ in range(ROUNDS)
                ]
                usual, took = np.min(rounds, axis=0)
                print(
                    f"  {ad:9}  {size:5}  quad {cover:4} of the frame  {took:5.1f} ms, "
                    f"OpenCV {usual:5.1f} ms  ({took / usual:.2f}x)"
                )


def main() -> None:
    """Entry point."""
    for backend in BACKENDS:
        try:
            compositor = open_compositor(backend)
        except RunError as error:
            print(f"{backend}: {error}")
            continue
        print(compositor.description)
        with compositor, CvCompositor() as baseline:
            compare(compositor, baseline)


if __name__ == "__main__":
    main()
