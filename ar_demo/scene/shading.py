"""Light that changes within a few pixels: the edge of a shadow, of a reflection, of what stands on the surface."""

from dataclasses import dataclass

import cv2
import numpy as np

from hdn.imaging.arrays import Floats, Grey


@dataclass(frozen=True)
class ShadingModel:
    """How it is told from noise and from prints that are not quite aligned; px of the crop."""

    noise_grey: float = 4.0  # added to grey levels before their ratio is taken
    dark_grey: float = 40.0  # of the surface, below which a ratio tells little: it is what the neighbours have
    edge_grey: float = 4.0  # step of the template from which a pixel does not count ...
    edge_share: float = 0.08  # ... plus this share of its brightness
    window_px: int = 5  # of the median
    fill_px: int = 9  # within which pixels that do not count take over their neighbours' light
    min_known: float = 0.15  # share of such a window that must count, for it to tell
    log_range: tuple[float, float] = (-2.5, 1.0)  # of the light's logarithm, that is believed
    faint_log: float = 0.12  # up to which a change is taken for noise, and goes away by and by


MODEL = ShadingModel()
# Folds of cloth are fine, and shade its print's edges as well; set by trial on drawn folds.
CLOTH = ShadingModel(edge_grey=12.0, edge_share=0.3, window_px=1, fill_px=5, faint_log=0.03)


def shading(view: Grey, expected: Grey, trust: Grey, slack: float, model: ShadingModel = MODEL) -> Floats:
    """The light (h, w) on each pixel of a view that smooth light does not explain, 1 where there is nothing to tell.

    A ratio of light, not of grey levels. A median of neighbours keeps edges as sharp as they are, and drops what is
    thinner than half its window: letters that lie a little beside where they are expected.

    Args:
        view, expected: (h, w) grey levels, aligned: of the frame, and of the surface in the light as it was fitted.
        trust: (h, w) 0..1, how far each pixel can be believed to show the surface, and to tell how bright it is.
        slack: px, by which both may be misaligned.
    """
    ratio = 2 * np.log((np.maximum(view, 0) + model.noise_grey) / (np.maximum(expected, 0) + model.noise_grey))
    step = cv2.magnitude(*(cv2.Sobel(expected, cv2.CV_32F, *order, ksize=3, scale=1 / 8) for order in ((1, 0), (0, 1))))
    counts = (
        trust * (expected > model.dark_grey) * (step * max(slack, 0.5) < model.edge_grey + model.edge_share * expected)
    )
    size = (model.fill_px, model.fill_px)
    known = cv2.blur(counts, size)
    filled = cv2.blur(ratio * counts, size) / np.maximum(known, 1e-3) * (known > model.min_known)
    low, high = model.log_range
    levels = (np.where(counts > 0.5, ratio, filled).clip(low, high) - low) * (255 / (high - low))
    median = cv2.medianBlur(levels.round().astype(np.uint8), model.window_px).astype(np.float32)
    log = median * ((high - low) / 255) + low
    log *= log * log / (log * log + model.faint_log**2)
    return np.asarray(np.exp(log), np.float32)
