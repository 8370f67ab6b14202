"""Comparing grey levels whatever the light, and with outliers: local normalisation and robust statistics."""

from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from .arrays import Grey

Float = TypeVar("Float", np.float32, np.float64)

CONTRAST_FLOOR_GREY = 2.0  # grey levels, added to the local deviation so that flat places do not turn to noise
TUKEY_CUTOFF = 4.685  # standard deviations: 95 % efficiency on normally distributed residuals (Beaton and Tukey, 1974)
MAD_TO_DEVIATION = 1.4826  # standard deviation of a normal distribution over its median absolute deviation


def normalise(image: Grey, window: int) -> tuple[Grey, Grey]:
    """Takes the local mean off and divides by the local standard deviation, over a square window of so many px.

    The result does not change with gain and bias, so hardly with uneven light.

    Returns:
        The normalised image (h, w), and the deviation (h, w) that it was divided by, grey levels.
    """
    centred = image - cv2.blur(image, (window, window))
    variance = np.maximum(cv2.blur(centred * centred, (window, window)), 0)  # running sums may round to below zero
    deviation = np.sqrt(variance) + CONTRAST_FLOOR_GREY
    return np.asarray(centred / deviation, np.float32), np.asarray(deviation, np.float32)


def quantile(values: NDArray[Float], share: float) -> float:
    """What a share of some values (n,) lies below, as NumPy has it, whose own takes many times as long for few."""
    ordered = np.sort(values)
    below, part = divmod((len(ordered) - 1) * share, 1)
    low, high = ordered[int(below)], ordered[min(int(below) + 1, len(ordered) - 1)]
    return float(low + (high - low) * part if part < 0.5 else high - (high - low) * (1 - part))


def tukey(residuals: NDArray[Float]) -> NDArray[Float]:
    """Weights 0..1 by Tukey's biweight, of residuals in units of their standard deviation."""
    return np.square(np.maximum(1 - np.square(residuals / TUKEY_CUTOFF), 0))
