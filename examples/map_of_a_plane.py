"""A target's plane map as it grows, as three pictures beside each other: at the start, halfway, and at the end.

`python examples/map_of_a_plane.py VIDEO PICTURE X,Y X,Y X,Y X,Y`
"""

import sys

import cv2
import imageio.v3 as iio
import numpy as np

from ar_demo import parse_quad
from hdn import Tracker


def main(video: str, picture: str, *corners: str) -> None:
    frames = iio.imiter(video, plugin="pyav")  # RGB, uint8 (H, W, 3)
    tracker = Tracker()
    tracker.init(next(frames), parse_quad(list(corners)))
    maps = [tracker.map_picture()]
    for frame in frames:
        tracker.track(frame)
        maps.append(tracker.map_picture())
    gap = np.full((len(maps[0]), 6, 3), 255, np.uint8)
    stages = np.hstack([maps[0], gap, maps[len(maps) // 2], gap, maps[-1]])
    iio.imwrite(picture, cv2.resize(stages, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC))


if __name__ == "__main__":
    main(*sys.argv[1:])
