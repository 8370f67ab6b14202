"""A tracker of one's own in place of HDN's: SIFT keypoints and MAGSAC++ in forty lines.

`python examples/own_tracker.py VIDEO TRACK.json X,Y X,Y X,Y X,Y` writes a track file that `ar-replace --track` renders.
"""

import sys
from dataclasses import dataclass

import cv2
import numpy as np

from ar_demo import Surface, parse_quad, track
from hdn import Observation
from hdn.imaging.arrays import Array
from hdn.imaging.homography import transform
from hdn.imaging.observation import find_keypoints
from hdn.imaging.regions import EVERYWHERE, Region
from hdn.state import State

TOLERANCE_PX, MIN_MATCHES = 3.0, 12


@dataclass(frozen=True)
class Answer:
    """What ar_demo wants to know of a frame, see `ar_demo.tracking.protocol.Estimate`."""

    corners: Array
    state: State
    confidence: float
    deviation: float


class SiftTracker:
    """Fits `ar_demo.PlanarTracker`."""

    def init(self, frame: Observation, quad: Array, region: Region = EVERYWHERE) -> None:
        self.quad = self.corners = quad
        points, descriptors = find_keypoints(frame.grey, 1500, within=quad)
        x, y = points.round().astype(int).T
        allowed = region.mask(*frame.grey.size)[y, x] > 0
        self.points, self.descriptors = points[allowed], descriptors[allowed]

    def place(self, homography: Array) -> None:
        self.corners = transform(homography, self.quad)

    def lose(self) -> None:
        """Each frame is searched as a whole anyway."""

    def track(self, frame: Observation) -> Answer:
        points, descriptors = frame.keypoints
        pairs = cv2.BFMatcher().knnMatch(self.descriptors, descriptors, k=2)
        good = [pair[0] for pair in pairs if len(pair) == 2 and pair[0].distance < 0.8 * pair[1].distance]
        if len(good) >= MIN_MATCHES:
            source, target = self.points[[m.queryIdx for m in good]], points[[m.trainIdx for m in good]]
            homography, inliers = cv2.findHomography(source, target, cv2.USAC_MAGSAC, TOLERANCE_PX)
            if homography is not None and inliers.sum() >= MIN_MATCHES:
                self.corners = transform(homography, self.quad)
                return Answer(self.corners, "tracked", float(inliers.mean()), 1.0)
        return Answer(self.corners, "lost", 0.0, np.inf)


def main(video: str, output: str, *corners: str) -> None:
    found = track(video, Surface(quad=parse_quad(list(corners))), make_tracker=SiftTracker)
    found.save(output)
    print(f"{output}: {found.counts}")


if __name__ == "__main__":
    main(*sys.argv[1:])
