"""How soft a video is: what lens, focus, sensor and codec leave of an edge, told by each frame's sharpest ones.

An edge that is blurred again becomes the less soft, the softer it was: the ratio of both gradients on it tells by how
much (Zhuo and Sim, "Defocus map estimation from a single image", 2011). Most edges are of soft things; the sharpest few
are those of the lens. Motion leaves edges along itself as they are, so that they do not count for it.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from hdn.imaging.arrays import Array, Box, Image


@dataclass(frozen=True)
class SoftnessModel:
    """How softness is measured; px are those of the frame."""

    window_px: int = 320  # side of the part of the frame that is looked at, at most
    margin: float = 0.15  # around the surface, as a share of its size: its own border is an edge as well
    again_px: float = 1.0  # standard deviation of the second blur
    min_step_grey: float = 8.0  # gradient per px, from which an edge counts ...
    strong_share: float = 0.3  # ... and of the strongest ones' there
    min_edges: int = 20  # pixels of edges, with fewer nothing is told
    sharpest: float = 0.15  # share of all edges, by their strength, that are at least as sharp
    drawn_px2: float = 0.2  # variance of an edge that is drawn, which covers pixels in part
    most_px2: float = 9.0  # variance that is believed
    memory: float = 0.8  # share of what is known that each further frame leaves


MODEL = SoftnessModel()


class SoftnessMeter:
    """Measures a video's softness at a surface, frame by frame."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """The next frame is of another shot."""
        self._total = self._weight = 0.0

    @property
    def variance(self) -> float:
        """px^2 of the Gaussian by which a picture that is drawn is sharper than the video; 0 where nothing is known."""
        return self._total / self._weight if self._weight else 0.0

    def see(self, frame: Image, pose: Array) -> float:
        """The variance, see above, with what a frame (H, W, 3) shows in which the surface has the corners (4, 2)."""
        box = _window(frame, pose)
        seen = None if box is None else sharpest_edges(frame[box])
        if seen is not None:
            more = min(max(seen - MODEL.drawn_px2, 0.0), MODEL.most_px2)
            self._total = MODEL.memory * self._total + more
            self._weight = MODEL.memory * self._weight + 1
        return self.variance


def sharpest_edges(image: Image) -> float | None:
    """Variance, px^2, of the Gaussian that an image's (h, w, 3) sharpest edges are blurred by; None without edges."""
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32)
    again = MODEL.again_px**2
    once, twice = (_steepness(x) for x in (grey, cv2.GaussianBlur(grey, (0, 0), MODEL.again_px)))
    least = max(MODEL.min_step_grey, MODEL.strong_share * float(np.quantile(once, 0.995)))
    edges = (once >= cv2.dilate(once, np.ones((3, 3), np.uint8))) & (once > least)
    if edges.sum() < MODEL.min_edges:
        return None
    strength = once[edges]
    ratio2 = np.square(strength / np.maximum(twice[edges], 1e-3))  # 1 + again / variance
    variance = again / np.maximum(ratio2 - 1, 1e-3)
    order = np.argsort(variance)
    mass = np.cumsum(strength[order])
    return float(variance[order][np.searchsorted(mass, MODEL.sharpest * mass[-1])])


def _steepness(grey: Array) -> Array:
    """The gradient's magnitude (h, w), grey levels a px."""
    return np.asarray(cv2.magnitude(*(cv2.Sobel(grey, -1, *o, ksize=3, scale=1 / 8) for o in ((1, 0), (0, 1)))))


def _window(frame: Image, pose: Array) -> Box | None:
    """The part of the frame around the surface, or its middle; None where it is too small."""
    bounds = np.array(frame.shape[1::-1])
    middle = pose.mean(0)
    outer = middle + (pose - middle) * (1 + 2 * MODEL.margin)
    low = np.clip(np.maximum(outer.min(0), middle - MODEL.window_px / 2), 0, bounds).astype(int)
    high = np.clip(np.minimum(outer.max(0), middle + MODEL.window_px / 2), 0, bounds).astype(int)
    if (high - low).min() < 12:
        return None
    return slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))
