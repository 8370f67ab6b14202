"""How near a composite comes to the picture as it would have been: PSNR and SSIM where the ad is, and on its edge."""

from dataclasses import dataclass

import cv2
import numpy as np

from hdn.imaging.arrays import Array, Image, Mask
from hdn.imaging.homography import from_corners, translation
from hdn.imaging.quads import area


@dataclass(frozen=True)
class QualityMeasures:
    """Where composites are compared, and the constants of PSNR and of SSIM (Wang et al., 2004)."""

    edge_band_px: float = 6.0  # the edge's width, half of it on each side
    window_reach_px: int = 5  # half of SSIM's window of 11
    window_deviation_px: float = 1.5  # standard deviation of that window's Gaussian weights
    c1_grey2: float = (0.01 * 255) ** 2  # steadies the comparison of means
    c2_grey2: float = (0.03 * 255) ** 2  # steadies that of variances
    c_gradient_grey2: float = 170.0  # steadies the comparison of gradients
    min_error_grey2: float = 1 / 12  # mean squared error of rounding to whole grey levels: less is told from none


MEASURES = QualityMeasures()
NAMES = ("PSNR inside", "SSIM inside", "PSNR edge", "SSIM edge")


def quality(picture: Image, truth: Image, quad: Array) -> Array | None:
    """The figures of NAMES for one frame, (4,); None where none of the quad (4, 2), px, is in the frame."""
    box = _box(quad, truth.shape)
    if box is None:
        return None
    picture, truth = picture[box], truth[box]
    quad = quad - [box[1].start, box[0].start]
    inside, edge = regions(quad, truth.shape)
    similar = ssim(_grey(picture), _grey(truth))
    figures = [f for mask in (inside, edge) for f in (psnr(picture, truth, mask), _mean(similar, mask))]
    return np.array(figures)


def regions(quad: Array, shape: tuple[int, ...]) -> tuple[Mask, Mask]:
    """The pixels of a frame (height, width) with their centres inside a convex quad, and those on its edge."""
    rows, columns = np.mgrid[: shape[0], : shape[1]].astype(np.float64)
    inside = np.ones(rows.shape, bool)
    nearest = np.full(rows.shape, np.inf)  # px to the edge
    turn = np.sign(area(quad))
    for (x, y), (u, v) in zip(quad, np.roll(quad, -1, 0) - quad, strict=True):
        length = np.hypot(u, v)
        across = (u * (rows - y) - v * (columns - x)) / length
        along = (u * (columns - x) + v * (rows - y)) / length
        inside &= turn * across >= 0
        nearest = np.minimum(nearest, np.hypot(across, along - np.clip(along, 0, length)))
    return inside, nearest <= MEASURES.edge_band_px / 2


def psnr(picture: Image, truth: Image, mask: Mask) -> float:
    """Peak signal to noise ratio over the pixels of a mask, all three channels, dB; NaN for none."""
    if not mask.any():
        return np.nan
    error = np.square(picture[mask].astype(np.float64) - truth[mask]).mean()
    return float(10 * np.log10(255**2 / max(float(error), MEASURES.min_error_grey2)))


def ssim(a: Image, b: Image) -> Array:
    """Structural similarity of two grey pictures (H, W), pixel by pixel (Wang et al., 2004, eq. 13)."""
    x, y = a.astype(np.float64), b.astype(np.float64)
    mean_x, mean_y = _window(x), _window(y)
    variance_x, variance_y = _window(x * x) - mean_x**2, _window(y * y) - mean_y**2
    covariance = _window(x * y) - mean_x * mean_y
    brightness = (2 * mean_x * mean_y + MEASURES.c1_grey2) / (mean_x**2 + mean_y**2 + MEASURES.c1_grey2)
    return brightness * (2 * covariance + MEASURES.c2_grey2) / (variance_x + variance_y + MEASURES.c2_grey2)


def gradient_deviation(picture: Image, truth: Image, quad: Array) -> float:
    """Gradient magnitude similarity deviation inside a quad (4, 2) of a frame: 0 is alike (Xue et al., 2014)."""
    box = _box(quad, truth.shape)
    if box is None:
        return np.nan
    inside, _ = regions(quad - [box[1].start, box[0].start], picture[box].shape)
    if not inside.any():
        return np.nan
    a, b = (_gradient(_grey(image[box])) for image in (picture, truth))
    similar = (2 * a * b + MEASURES.c_gradient_grey2) / (a * a + b * b + MEASURES.c_gradient_grey2)
    return float(similar[inside].std())


def plain_warp(frame: Image, ad: Image, quad: Array) -> None:
    """The baseline: an ad (h, w, 3) warped onto a quad with bilinear sampling and hard edges, in place."""
    box = _box(quad, frame.shape)
    if box is None:
        return
    part = frame[box]
    h, w = ad.shape[:2]
    # The quad's corners are those of the ad's outermost pixels, half a pixel beyond their centres.
    outline = np.array([[-0.5, -0.5], [w - 0.5, -0.5], [w - 0.5, h - 0.5], [-0.5, h - 0.5]])
    to_box = translation(-box[1].start, -box[0].start) @ from_corners(outline, quad)
    size = part.shape[1], part.shape[0]
    drawn = cv2.warpPerspective(ad, to_box, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    inside, _ = regions(quad - [box[1].start, box[0].start], part.shape)
    part[inside] = drawn[inside]


def _window(plane: Array) -> Array:
    size = 2 * MEASURES.window_reach_px + 1
    return np.asarray(cv2.GaussianBlur(plane, (size, size), MEASURES.window_deviation_px), np.float64)


def _gradient(grey: Image) -> Array:
    """Magnitude of the gradient (H, W) by Prewitt's filter, as the paper has it."""
    kernel = np.array([[1, 0, -1]] * 3) / 3
    x, y = (cv2.filter2D(grey.astype(np.float64), -1, k) for k in (kernel, kernel.T))
    return np.hypot(x, y)


def _mean(values: Array, mask: Mask) -> float:
    return float(values[mask].mean()) if mask.any() else np.nan


def _grey(picture: Image) -> Image:
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(picture), cv2.COLOR_RGB2GRAY), np.uint8)


def _box(quad: Array, shape: tuple[int, ...]) -> tuple[slice, slice] | None:
    """Rows and columns of a frame that hold the quad, its edge, and what SSIM's window reaches; None for none."""
    margin = MEASURES.edge_band_px / 2 + MEASURES.window_reach_px + 1
    bounds = np.array(shape[1::-1])
    low = np.clip(np.floor(quad.min(0) - margin), 0, bounds).astype(int)
    high = np.clip(np.ceil(quad.max(0) + margin) + 1, 0, bounds).astype(int)
    if (high <= low).any():
        return None
    return slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))
