"""Time the compositors side by side: `python -m ar_demo.compositing.benchmark`.

Prints milliseconds a frame, for an ad that stays the same (an image) and one that changes with every frame (a video),
and in brackets how much longer than OpenCV that is.
"""

import time

import numpy as np

from ..errors import RunError
from .compositor import Compositor, open_compositor
from .raster import Floats

SIZES = {"720p": (1280, 720), "1080p": (1920, 1080)}
COVERS = {"25%": 0.25, "100%": 1.0}  # share of the frame
ROUNDS, DRAWS = 3, 6  # best of the rounds: the least disturbed by whatever else runs


def slanted_quad(width: int, height: int, cover: float) -> Floats:
    """A quad seen slightly from the side, around the frame's centre, whose area is about `cover` of the frame."""
    shape = np.array([[-0.52, -0.46], [0.48, -0.54], [0.48, 0.54], [-0.52, 0.46]]) * np.sqrt(cover)
    return np.asarray((shape + 0.5) * (width, height), np.float64)


def milliseconds(compositor: Compositor, size: tuple[int, int], cover: float, moving_ad: bool) -> float:
    """Best mean time of one composite over the rounds, with a 1080p ad."""
    rng = np.random.default_rng(0)
    frame = rng.integers(0, 256, (size[1], size[0], 3), np.uint8)
    ads = [rng.integers(0, 256, (1080, 1920, 3), np.uint8) for _ in range(2 if moving_ad else 1)]
    quad = slanted_quad(*size, cover)
    compositor.composite(frame, ads[0], quad)
    means = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        for i in range(DRAWS):
            compositor.composite(frame, ads[(i + 1) % len(ads)], quad)
        means.append((time.perf_counter() - start) / DRAWS * 1000)
    return min(means)


def main() -> None:
    cases = [(ad, size, cover) for ad in ("still ad", "moving ad") for size in SIZES for cover in COVERS]
    baseline: dict[tuple[str, str, str], float] = {}
    for backend in ("opencv", "egl", "osmesa"):
        try:
            compositor = open_compositor(backend)
        except RunError as error:
            print(f"{backend}: {error}")
            continue
        print(compositor.description)
        with compositor:
            for ad, size, cover in cases:
                took = milliseconds(compositor, SIZES[size], COVERS[cover], ad == "moving ad")
                ratio = took / baseline.setdefault((ad, size, cover), took)
                print(f"  {ad:9}  {size:5}  quad {cover:4} of the frame  {took:7.1f} ms  ({ratio:.2f}x)")


if __name__ == "__main__":
    main()
