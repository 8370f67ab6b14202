"""The old surface's colour beside its edge, taken out of a frame.

Lens, codec and pixels mix a surface's edge with what lies behind it. Where a layer covers a pixel in part, so did the
surface: what else the pixel holds is the background, but only once the surface's share is taken out of it.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from hdn.imaging.arrays import Array, Mask
from hdn.imaging.homography import from_corners, transform

from ..scene.occlusion import Occluder
from .layer import Frame, Layer, in_float, peak

REMAP_SIDE = 1024  # pixels in a row of those that are looked up: OpenCV takes rows below 32768


@dataclass(frozen=True)
class SpillModel:
    """How it is told what a pixel beside an edge holds."""

    aside_px: float = (
        1.5  # of the frame, into and out of the surface, where its colour and the background's are looked up,
    )
    aside_deviations: float = 2.0  # and so many standard deviations of the edge's blur farther
    covered: tuple[float, float] = (0.021, 0.979)  # share of a pixel, from which and up to which it is mixed
    hidden_share: float = 0.02  # of a pixel, that an occluder takes, from which it counts
    beyond: float = 0.04  # of white, by which a background may differ from what is seen there and farther out


MODEL = SpillModel()


def without_spill(frame: Frame, layer: Layer, pose: Array, variance: float, occluder: Occluder | None = None) -> None:
    """Takes the surface's share out of pixels of a frame (H, W, 3) that a layer is to cover in part, in place.

    Args:
        layer: what is to be laid on it, as soft as the frame.
        pose: (4, 2) the surface's corners, px.
        variance: of the blur of its edge, px^2.
        occluder: what hides the surface, where nothing is done.
    """
    alpha = cv2.extractChannel(layer.rgba, 3)
    least, most = (share * peak(alpha.dtype) for share in MODEL.covered)
    touched = cv2.inRange(alpha, least, most)
    if occluder is not None:
        touched[_near(occluder, layer, frame.shape[:2])] = 0
    places = cv2.findNonZero(touched)
    if places is None:
        return
    columns, rows = np.asarray(places).reshape(-1, 2).T
    aside = MODEL.aside_px + MODEL.aside_deviations * float(np.sqrt(max(variance, 0.0)))
    at = np.stack([columns + layer.box[1].start, rows + layer.box[0].start], 1)
    inner, outer = (_looked_up(frame, at, pose, by) for by in (-aside, aside))
    part, white = frame[layer.box], peak(frame.dtype)
    seen, surface, far = (x.astype(np.float32) / white for x in (part[rows, columns], inner, outer))
    share = in_float(alpha[rows, columns])[:, None]
    behind = (seen - share * surface) / (1 - share)
    # An edge that is not quite where it is taken to be must not leave a line of the opposite colour.
    low, high = np.minimum(seen, far) - MODEL.beyond, np.maximum(seen, far) + MODEL.beyond
    part[rows, columns] = (np.clip(behind, np.maximum(low, 0), np.minimum(high, 1)) * white + 0.5).astype(part.dtype)


def _near(occluder: Occluder, layer: Layer, shape: tuple[int, ...]) -> Mask:
    """The pixels of a layer's box that an occluder takes, and some beside them."""
    hidden = np.zeros(shape, np.uint8)
    hidden[occluder.box] = occluder.share[..., 0] > MODEL.hidden_share
    return np.asarray(cv2.dilate(hidden[layer.box], np.ones((7, 7), np.uint8)) > 0)


def _looked_up(frame: Frame, at: Array, pose: Array, by: float) -> Frame:
    """The frame (n, 3) as it is so many px farther out than pixels (n, 2) at an edge."""
    away = pose - pose.mean(0)
    sides = np.linalg.norm(np.roll(pose, -1, 0) - pose, axis=1)
    grown = pose.mean(0) + away * (1 + 2 * by / max(float(sides.min()), 1.0))
    places = transform(from_corners(pose, grown), at).astype(np.float32)
    count = len(places)
    rows = -(-count // REMAP_SIDE)
    map_xy = np.resize(places, (rows * REMAP_SIDE, 2)).reshape(rows, REMAP_SIDE, 2)
    found = cv2.remap(frame, map_xy, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found.reshape(-1, 3)[:count])
