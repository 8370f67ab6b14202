"""Gaussian blur of any shape, and how much blurrier one view of a surface is than another.

Blur by motion, by focus and by want of pixels is told alike: by the covariance (2, 2), px^2, of a Gaussian.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from .arrays import Array, Floats, Grey
from .photometry import MAD_TO_DEVIATION, normalise, tukey


@dataclass(frozen=True)
class BlurModel:
    """Constants of the estimate of relative blur, and of blurring."""

    presmoothing_px: float = 1.5  # deviation of the Gaussian over both views: blur of a few px is a small change then
    steps: int = 3  # of Gauss and Newton
    max_variance_px2: float = 250.0  # the largest that is believed: a streak of 55 px
    min_variance_px2: float = 0.05  # below it there is nothing to blur
    pixel_spacing_px: int = 2  # between the pixels that are compared, along x and y
    margin_px: int = 4  # at the edge of the views, where filters do not see enough
    min_trust: float = 0.5  # of the pixels that are compared
    min_pixels: int = 100  # with fewer to compare, no difference is told
    noise_floor: float = 1e-3  # normalised grey levels, added to the residuals' deviation
    ridge: float = 1e-3  # on the normal equations' diagonal, against views without texture
    kernel_deviations: float = 2.5  # from a kernel's centre to its edge
    kernel_min_variance_px2: float = 1e-2  # across a line of motion, so that its kernel is not degenerate


@dataclass(frozen=True)
class SpectraModel:
    """Constants of the comparison of spectra; powers are ratios to that of the noise."""

    noise_rad: float = 2.2  # frequency, rad/px, above which there is nothing but noise
    max_rad: float = 0.9  # up to which spectra are compared
    min_periods: float = 2.5  # of a wave in the longer side, for it to be compared: light is slower
    min_signal: float = 10.0  # of the template, at a frequency that is compared
    min_soft_signal: float = 4.0  # of the view, at one that a Gaussian is fitted to
    min_frequencies: int = 30  # that a Gaussian is fitted to; with fewer, no blur is told
    robust_steps: int = 5  # of reweighting
    ridge: float = 1e-3  # on the normal equations' diagonal, and on the deviation of the residuals
    min_streak_px2: float = 3.0  # variance from which a blur is taken for a streak
    streak_trials: int = 12  # lengths that are tried
    min_passed: float = 0.3  # share of a frequency's power that a streak leaves, for the gain to be told there


MODEL = BlurModel()
SPECTRA = SpectraModel()


def relative_blur(template: Grey, view: Grey, trusted: Grey, window: int, start: Array | None = None) -> Array:
    """Covariance (2, 2), px^2, of the Gaussian by which a view is blurrier than the template that it is aligned with.

    Negative eigenvalues belong to directions in which the template is the blurrier of the two. Blurring is diffusion:
    a little of it adds half the second derivatives times the covariance. So each step is a linear fit, robust and
    free of gain, from which the next step starts (Gauss-Newton).

    Args:
        template, view: (h, w) grey.
        trusted: (h, w) 0..1, the pixels that show the target in both.
        window: px, of the local normalisation.
        start: (2, 2) the covariance that is expected; None is none.

    Returns:
        What was expected where too few pixels are trusted.
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
    """Covariance (2, 2), px^2, by which a view is blurrier than a template (h, w), however they are aligned.

    Blur lowers the power of a spectrum, and motion leaves it alone. A Gaussian of covariance C multiplies the power at
    the frequency w, rad/px, by exp(-w C w): the logarithm of the powers' ratio is a linear fit. A long streak has a
    spectrum with zeros, though (a sinc), and its length is found by trying.

    Returns:
        Zeros where too few frequencies stand out from the noise.
    """
    height, width = template.shape
    window = np.outer(np.hanning(height), np.hanning(width)).astype(np.float32)
    sharp, soft = _power(template, window), _power(view, window)
    wx = 2 * np.pi * np.fft.rfftfreq(width)[None] + np.zeros((height, 1))
    wy = 2 * np.pi * np.fft.fftshift(np.fft.fftfreq(height))[:, None] + np.zeros_like(wx)
    frequency = np.hypot(wx, wy)
    sharp_noise, soft_noise = (float(np.median(power[frequency > SPECTRA.noise_rad])) for power in (sharp, soft))
    lowest = SPECTRA.min_periods * 2 * np.pi / max(width, height)
    shown = (frequency > lowest) & (frequency < SPECTRA.max_rad) & (sharp > SPECTRA.min_signal * sharp_noise)
    fitted = shown & (soft > SPECTRA.min_soft_signal * soft_noise)
    if fitted.sum() < SPECTRA.min_frequencies:
        return np.zeros((2, 2))
    ratio = np.log(soft[fitted] - soft_noise) - np.log(sharp[fitted] - sharp_noise)
    x, y = wx[fitted], wy[fitted]
    _, xx, xy, yy = _robust_fit(np.stack([np.ones_like(x), -x * x, -2 * x * y, -y * y], 1), ratio)
    values, axes = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
    values = np.clip(values, 0, MODEL.max_variance_px2)
    if values[1] > SPECTRA.min_streak_px2:
        along = wx[shown] * axes[0, 1] + wy[shown] * axes[1, 1]
        values[1] = _streak_variance(along, sharp[shown] - sharp_noise, soft[shown], soft_noise, values[1])
    return np.asarray((axes * values) @ axes.T)


def _power(image: Grey, window: Grey) -> Floats:
    """Power spectrum of a windowed image (h, w), smoothed: (h, w // 2 + 1), the rows' frequencies in rising order."""
    mean = float((image * window).sum() / window.sum())
    power = np.square(np.abs(np.fft.fftshift(np.fft.rfft2((image - mean) * window), 0)))
    return np.asarray(cv2.blur(power.astype(np.float32), (3, 3)))


def _robust_fit(rows: Array, values: Array) -> Array:
    """Parameters (p,) for which rows (N, p) times them come nearest to values (N,)."""
    weight = np.ones(len(values))
    for _ in range(SPECTRA.robust_steps):
        weighted = rows * weight[:, None]
        fit = np.linalg.solve(weighted.T @ rows + SPECTRA.ridge * np.eye(rows.shape[1]), weighted.T @ values)
        error = values - rows @ fit
        weight = tukey(error / (MAD_TO_DEVIATION * float(np.median(np.abs(error))) + SPECTRA.ridge))
    return np.asarray(fit)


def _streak_variance(along: Array, sharp: Array, soft: Array, noise: float, least: float) -> float:
    """Variance, px^2, of the streak that makes one spectrum of another.

    Args:
        along: (N,) frequencies along the streak, rad/px.
        sharp, soft: (N,) power without and with the streak; noise: of the latter.
        least: px^2, the shortest that is tried.
    """
    trials = np.geomspace(least, MODEL.max_variance_px2, SPECTRA.streak_trials)
    lengths = np.sqrt(12 * trials)
    powers = sharp * np.square(np.sinc(np.outer(lengths, along) / (2 * np.pi)))
    passed = powers > SPECTRA.min_passed * sharp
    error = np.full(len(trials), np.inf)
    for i, (power, known) in enumerate(zip(powers, passed, strict=True)):
        if known.any():
            gain = np.exp(np.median(np.log(soft[known]) - np.log(power[known] + noise)))
            error[i] = np.abs(np.log(soft) - np.log(gain * power + noise)).mean()
    return float(trials[error.argmin()])


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
