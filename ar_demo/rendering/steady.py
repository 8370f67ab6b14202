"""The steady view: each frame warped so that the surface stands still, as it is in the reference frame."""

from dataclasses import dataclass

import numpy as np

from hdn.imaging.arrays import Image
from hdn.imaging.homography import similarity
from hdn.imaging.pyramid import Pyramid

from ..tracks import Track


@dataclass(frozen=True)
class SteadyModel:
    """How the view is cut out."""

    margin_ratio: float = 0.5  # on each side, to the size of the quad's bounding box
    max_width_px: int = 1280  # of the view; a larger one is made smaller


MODEL = SteadyModel()


class SteadyView:
    """The surface of a track with its surroundings, where they are in the reference frame.

    Attributes:
        width, height: px of the view, even.
    """

    def __init__(self, track: Track, model: SteadyModel = MODEL) -> None:
        self._track = track
        low, high = track.quad.min(0), track.quad.max(0)
        margin = model.margin_ratio * (high - low)
        width, height = high - low + 2 * margin
        scale = max(1.0, width / model.max_width_px)  # px of the frame for a px of the view
        self.width, self.height = (2 * round(size / scale / 2) for size in (width, height))
        left, top = low - margin
        self._to_reference = similarity(scale, 0.0, left, top)

    def of(self, frame: Image, index: int) -> Image:
        """The view (height, width, 3) of an RGB frame (H, W, 3) of this index: black outside it and without a pose."""
        pose = self._track.homography(index)
        if pose is None:
            return np.zeros((self.height, self.width, 3), np.uint8)
        return Pyramid(frame).crop(pose @ self._to_reference, self.width, self.height, fill=(0, 0, 0))
