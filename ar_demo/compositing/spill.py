"""The old surface's colour beside its edge, taken out of a frame.

Lens, codec and pixels mix a surface's edge with what lies behind it. Where a layer covers a pixel in part, so did the
surface: what else the pixel holds is the background, but only once the surface's share is taken out of it.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from hdn.imaging.arrays import Array, Mask
from hdn.imaging.homography import from_corners, translation

from ..scene.occlusion import Occluder
from .layer import Frame, Layer, in_float, peak


@dataclass(frozen=True)
class SpillModel:
    """How it is told what a pixel beside an edge holds."""

    aside_px: float = (
        1.5  # of the frame, into and out of the surface, where its colour and the background's are looked up,
    )
    aside_deviations: float = 2.0  # and so many standard deviations of the edge's blur farther
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
    alpha = in_float(layer.rgba[..., 3])
    touched = (alpha > 0.02) & (alpha < 0.98) & ~_near(occluder, layer, frame.shape[:2])
    if not touched.any():
        return
    aside = MODEL.aside_px + MODEL.aside_deviations * float(np.sqrt(max(variance, 0.0)))
    inner, outer = (_looked_up(frame, layer, pose, by) for by in (-aside, aside))
    part, white = frame[layer.box], peak(frame.dtype)
    seen, surface, far = (x[touched].astype(np.float32) / white for x in (part, inner, outer))
    share = alpha[touched][:, None]
    behind = (seen - share * surface) / (1 - share)
    # An edge that is not quite where it is taken to be must not leave a line of the opposite colour.
    low, high = np.minimum(seen, far) - MODEL.beyond, np.maximum(seen, far) + MODEL.beyond
    part[touched] = (np.clip(behind, np.maximum(low, 0), np.minimum(high, 1)) * white + 0.5).astype(part.dtype)


def _near(occluder: Occluder | None, layer: Layer, shape: tuple[int, ...]) -> Mask:
    """The pixels of a layer's box that an occluder takes, and some beside them."""
    hidden = np.zeros(shape, np.uint8)
    if occluder is not None:
        hidden[occluder.box] = occluder.share[..., 0] > MODEL.hidden_share
    return np.asarray(cv2.dilate(hidden[layer.box], np.ones((7, 7), np.uint8)) > 0)


def _looked_up(frame: Frame, layer: Layer, pose: Array, by: float) -> Frame:
    """The frame in the layer's box, each pixel at an edge from so many px farther out."""
    away = pose - pose.mean(0)
    sides = np.linalg.norm(np.roll(pose, -1, 0) - pose, axis=1)
    grown = pose.mean(0) + away * (1 + 2 * by / max(float(sides.min()), 1.0))
    rows, columns = layer.box
    to_frame = from_corners(pose, grown) @ translation(columns.start, rows.start)
    size = columns.stop - columns.start, rows.stop - rows.start
    how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpPerspective(frame, to_frame, size, flags=how, borderMode=cv2.BORDER_REPLICATE))
