"""The tracker without the rest, on frames of one's own: `python examples/tracker_alone.py VIDEO X,Y X,Y X,Y X,Y`."""

import sys
from itertools import islice

import imageio.v3 as iio

from ar_demo import parse_quad
from hdn import Tracker

FRAMES = 20


def main(video: str, *corners: str) -> None:
    frames = iio.imiter(video, plugin="pyav")  # RGB, uint8 (H, W, 3)
    tracker = Tracker()
    tracker.init(next(frames), parse_quad(list(corners)))
    for number, frame in enumerate(islice(frames, FRAMES), 1):
        estimate = tracker.track(frame)
        print(number, estimate.state, estimate.corners.round(1).tolist())


if __name__ == "__main__":
    main(*sys.argv[1:])
