"""Gaussian blur of any shape, and how much blurrier one view of a surface is than another.

Blur by motion, by focus and by want of pixels is told alike: by the covariance (2, 2), px^2, of a Gaussian.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from .arrays import Array, Grey
from .photometry import MAD_TO_DEVIATION, normalise, tukey


@dataclass(frozen=True)
class BlurModel:
    """Constants of the estimate of relative blur, and of blurring."""

    presmoothing_px: float = 1.5  # deviation of the Gaussian over both views: blur of a few px is a small change then
    steps: int = 3  # of Gauss and Newton
    max_variance_px2: float = 250.0  # the largest that is believed
    min_variance_px2: float = 0.05  # below it there is nothing to blur
    pixel_spacing_px: int = 2  # between the pixels that are compared, along x and y
    margin_px: int = 4  # at the edge of the views, where filters do not see enough
    min_trust: float = 0.5  # of the pixels that are compared
    min_pixels: int = 100  # with fewer to compare, no difference is told
    noise_floor: float = 1e-3  # normalised grey levels, added to the residuals' deviation
    ridge: float = 1e-3  # on the normal equations' diagonal, against views without texture
    kernel_deviations: float = 2.5  # from a kernel's centre to its edge
    kernel_min_variance_px2: float = 1e-2  # across a line of motion, so that its kernel is not degenerate


MODEL = BlurModel()


def relative_blur(template: Grey, view: Grey, trusted: Grey, window: int, start: Array | None = None) -> Array:
    """Covariance (2, 2), px^2, of the Gaussian by which a view is blurrier than the template that it is aligned with.

    Negative eigenvalues belong to directions in which the template is the blurrier of the two. Blurring is diffusion:
    a little of it adds half the second derivatives times the covariance. So each step is a linear fit, robust and
    free of gain, from which the next step starts (Gauss-Newton).

    Args:
        template, view: (h, w) grey.
        trusted: (h, w) 0..1, the pixels that show the target in both.
        window: px, of the local normalisation.

    Returns:
        Zeros where too few pixels are trusted.
    """
    first, second = (cv2.GaussianBlur(image, (0, 0), MODEL.presmoothing_px) for image in (template, view))
    covariance = np.zeros((2, 2)) if start is None else start
    compared = np.zeros(template.shape, bool)
    inner = slice(MODEL.margin_px, -MODEL.margin_px, MODEL.pixel_spacing_px)
    compared[inner, inner] = True
    compared &= trusted > MODEL.min_trust
    if compared.sum() < MODEL.min_pixels:
        return covariance
    for _ in range(MODEL.steps):
        of_template, of_view = equalising_blurs(covariance)
        a, b = (normalise(blurred(i, c), window)[0] for i, c in ((first, of_template), (second, of_view)))
        # Sobel's second derivatives come out four times too large.
        xx, xy, yy = (cv2.Sobel(a, -1, *order, ksize=3)[compared] / 4 for order in ((2, 0), (1, 1), (0, 2)))
        # The first regressor is for the gain.
        regressors = np.stack([a[compared], xx / 2, xy, yy / 2], 1).astype(np.float64)
        error = (b - a)[compared].astype(np.float64)
        noise = MAD_TO_DEVIATION * float(np.median(np.abs(error))) + MODEL.noise_floor
        weight = tukey(error / noise)
        hessian = regressors.T @ (regressors * weight[:, None]) + MODEL.ridge * np.eye(4)
        _, dxx, dxy, dyy = np.linalg.solve(hessian, regressors.T @ (weight * error))
        values, axes = np.linalg.eigh(covariance + np.array([[dxx, dxy], [dxy, dyy]]))
        covariance = (axes * np.clip(values, -MODEL.max_variance_px2, MODEL.max_variance_px2)) @ axes.T
    return covariance


def spectral_blur(template: Grey, view: Grey) -> Array:
    """Covariance (2, 2), px^2, by which a view is blurrier than a template, whatever their alignment by some px.

    A Gaussian multiplies the spectrum's power at w rad/px by exp(-w C w): the logarithm of the ratio of both powers,
    smoothed, is linear in the covariance C. Frequencies that are drowned in noise in either do not count.
    """
    h, w = template.shape
    window = np.outer(np.hanning(h), np.hanning(w)).astype(np.float32)
    powers = []
    for image in (template, view):
        spectrum = np.fft.rfft2((image - float((image * window).sum() / window.sum())) * window)
        powers.append(cv2.blur(np.square(np.abs(np.fft.fftshift(spectrum, 0))).astype(np.float32), (3, 3)))
    wy = np.fft.fftshift(np.fft.fftfreq(h))[:, None] * 2 * np.pi + np.zeros((h, w // 2 + 1))
    wx = np.fft.rfftfreq(w)[None] * 2 * np.pi + np.zeros((h, w // 2 + 1))
    radius = np.hypot(wx, wy)
    noise = [float(np.median(p[(radius > 2.2)])) for p in powers]
    low = (radius < 0.9) & (radius > 2.5 * 2 * np.pi / max(w, h))
    good = low & (powers[0] > 10 * noise[0]) & (powers[1] > 4 * noise[1])
    if good.sum() < 30:
        return np.zeros((2, 2))
    ratio = np.log(powers[1][good] - noise[1]) - np.log(powers[0][good] - noise[0])
    x, y = wx[good], wy[good]
    rows = np.stack([np.ones_like(x), -x * x, -2 * x * y, -y * y], 1)
    weight = np.ones(len(x))
    for _ in range(5):
        weighted = rows * weight[:, None]
        solution = np.linalg.solve(weighted.T @ rows + 1e-6 * np.eye(4), weighted.T @ ratio)
        error = ratio - rows @ solution
        weight = tukey(error / (MAD_TO_DEVIATION * float(np.median(np.abs(error))) + 1e-3))
    _, xx, xy, yy = solution
    values, axes = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
    values = np.clip(values, 0, MODEL.max_variance_px2)
    if values[1] > 3.0:
        # A long streak has zeros in its spectrum, which no Gaussian has: its length is found by the streak itself.
        shown = low & (powers[0] > 10 * noise[0])
        along = np.abs(wx[shown] * axes[0, 1] + wy[shown] * axes[1, 1]) / 2
        p0, p1 = powers[0][shown] - noise[0], np.log(powers[1][shown])
        best = np.inf
        for deviation in np.geomspace(np.sqrt(values[1]), np.sqrt(MODEL.max_variance_px2), 12):
            gain = np.square(np.sinc(along * deviation * np.sqrt(12) / np.pi))
            predicted = p0 * gain
            scale = (
                float(np.exp(np.median((p1 - np.log(predicted + noise[1]))[gain > 0.3]))) if (gain > 0.3).any() else 1.0
            )
            error = float(np.abs(p1 - np.log(scale * predicted + noise[1])).mean())
            if error < best:
                best, values[1] = error, deviation**2
    return np.asarray((axes * values) @ axes.T)


def equalising_blurs(relative: Array) -> tuple[Array, Array]:
    """The blurs that make template and view equally sharp, by how much blurrier the view is: covariances, px^2.

    Returns:
        The positive part (2, 2) of the relative covariance, to blur the template by; the negative one, for the view.
    """
    values, axes = np.linalg.eigh(relative)
    return (axes * np.maximum(values, 0)) @ axes.T, (axes * np.maximum(-values, 0)) @ axes.T


def blurred(image: Grey, covariance: Array) -> Grey:
    """An image (h, w), or (h, w, c), blurred by a Gaussian of a covariance (2, 2), px^2, without negative eigenvalues.

    Its borders are mirrored.
    """
    values, axes = np.linalg.eigh(covariance)
    if values.max() < MODEL.min_variance_px2:
        return image
    reach = int(np.ceil(MODEL.kernel_deviations * np.sqrt(values.max())))
    information = (axes / np.maximum(values, MODEL.kernel_min_variance_px2)) @ axes.T
    offsets = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1.0)] * 2), -1)
    kernel = np.exp(-0.5 * np.einsum("yxi,ij,yxj->yx", offsets, information, offsets))
    return np.asarray(cv2.filter2D(image, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REFLECT_101), np.float32)
