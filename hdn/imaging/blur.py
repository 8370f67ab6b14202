"""How much more one view of a target is blurred than another: by motion, out of focus, or for want of pixels."""

from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from .arrays import Array, Grey

Float = TypeVar("Float", np.float32, np.float64)

SCALE = 1.5  # px that both are blurred by beforehand, so that blur of a few pixels is a small change
STEPS = 3
MOST = 60.0  # px^2, the largest variance that is believed
LEAST = 0.05  # px^2, below which there is nothing to do
APART = 2  # px between the pixels that are looked at


def between(template: Grey, view: Grey, trusted: Grey, window: int) -> Array:
    """Covariance (2, 2), px^2, of the Gaussian by which a view is blurred more than the template, aligned with it.

    Negative eigenvalues are directions in which the template is the blurrier of the two. Blurring is diffusion: a
    little of it adds half the second derivatives times the covariance. So that is a linear fit, robust and gain-free,
    from which the next step starts (Gauss-Newton).

    Args:
        template, view: (h, w) grey; trusted: (h, w) 0..1, what shows the target in both.
        window: px, of the normalisation.
    """
    first, second = (cv2.GaussianBlur(image, (0, 0), SCALE) for image in (template, view))
    covariance = np.zeros((2, 2))
    counts = np.zeros(template.shape, bool)
    counts[4:-4:APART, 4:-4:APART] = True
    counts &= trusted > 0.5
    if counts.sum() < 100:
        return covariance
    for _ in range(STEPS):
        of_template, of_view = shares(covariance)
        a, b = (normalise(blurred(i, c), window)[0] for i, c in ((first, of_template), (second, of_view)))
        xx, xy, yy = (cv2.Sobel(a, -1, *order, ksize=3)[counts] / 4 for order in ((2, 0), (1, 1), (0, 2)))
        regressors = np.stack([a[counts], xx / 2, xy, yy / 2], 1).astype(np.float64)  # the first is of the gain
        error = (b - a)[counts].astype(np.float64)
        noise = 1.4826 * float(np.median(np.abs(error))) + 1e-3
        weight = tukey(error / noise)
        hessian = regressors.T @ (regressors * weight[:, None]) + 1e-3 * np.eye(4)
        _, dxx, dxy, dyy = np.linalg.solve(hessian, regressors.T @ (weight * error))
        values, axes = np.linalg.eigh(covariance + np.array([[dxx, dxy], [dxy, dyy]]))
        covariance = (axes * np.clip(values, -MOST, MOST)) @ axes.T
    return covariance


def shares(covariance: Array) -> tuple[Array, Array]:
    """By what (2, 2) the template, and by what the view is to be blurred for both to be alike."""
    values, axes = np.linalg.eigh(covariance)
    return (axes * np.maximum(values, 0)) @ axes.T, (axes * np.maximum(-values, 0)) @ axes.T


def blurred(image: Grey, covariance: Array) -> Grey:
    """An image (h, w) blurred by a Gaussian of a covariance (2, 2), px^2, without negative eigenvalues."""
    values, axes = np.linalg.eigh(covariance)
    if values.max() < LEAST:
        return image
    reach = int(np.ceil(2.5 * np.sqrt(values.max())))
    information = (axes / np.maximum(values, 1e-2)) @ axes.T
    offsets = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1.0)] * 2), -1)
    kernel = np.exp(-0.5 * np.einsum("yxi,ij,yxj->yx", offsets, information, offsets))
    return np.asarray(cv2.filter2D(image, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REFLECT_101), np.float32)


def normalise(image: Grey, window: int) -> tuple[Grey, Grey]:
    """Local mean taken off and local deviation divided out, over a square window, px; also the deviation itself."""
    centred = image - cv2.blur(image, (window, window))
    variance = np.maximum(cv2.blur(centred * centred, (window, window)), 0)  # running sums may round to below zero
    deviation = np.sqrt(variance) + 2.0
    return np.asarray(centred / deviation, np.float32), np.asarray(deviation, np.float32)


def tukey(error: NDArray[Float]) -> NDArray[Float]:
    """Tukey's biweight of residuals in units of their deviation."""
    return np.square(np.maximum(1 - np.square(error / 4.685), 0))
