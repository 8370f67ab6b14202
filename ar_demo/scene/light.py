"""How a surface is lit in a frame: how much more or less than in the reference frame, and what is mirrored in it.

Values of pixels are about roots of light (a gamma of 2); light is their square, white being 1. What a surface sends is
its colour times the light on it, plus what its gloss mirrors, which has the lamp's colour, and so is taken for white.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from hdn.alignment.agreement import Cells, cell_means
from hdn.imaging.arrays import Array, Floats, Grey, Image, Mask
from hdn.imaging.homography import from_corners
from hdn.imaging.photometry import normalise, tukey
from hdn.imaging.pyramid import Pyramid
from hdn.imaging.quads import outline

GRID, COARSE = (
    16,
    4,
)  # smooth light is known on a grid of GRID x GRID over the surface, by way of one of COARSE x COARSE
FINE = 64  # cells along a side, of the grid that the edges of shadows are drawn on
MEAN = np.full((1, 3), 1 / 3, np.float32)  # matrix that averages the channels


@dataclass(frozen=True)
class LightModel:
    """The constants by which light is measured; all set by trial on drawn and real clips.

    Light is in shares of white's; a gain is a ratio of light, not of pixel values.
    """

    # Which pixels show the surface.
    window_share: float = 0.2  # width of the window that correlation is normalised over, share of the longer side
    min_contrast_grey: float = 2.0  # mean contrast from which a cell has texture to correlate
    # The fit of gain and gloss, repeated on what fits.
    allowances: tuple[float, ...] = (2.0, 1.0, 1.0)  # of each repetition, the largest error, in expected ones
    expected_error_share: float = 0.15  # of the brightness, since light differs within a cell ...
    expected_error_grey: float = 5.0  # ... plus grey levels of noise
    gain_prior: float = 0.06  # how much speaks for the gain of the larger part around, share of a cell's mean light^2
    gloss_prior: float = 0.03  # how much speaks against a gloss that differs from the part around, share of a cell
    cell_blur: float = 0.8  # cells, standard deviation by which neighbours share what they tell
    gain_range: tuple[float, float] = (0.01, 16.0)  # that is believed
    max_gloss: float = 0.8  # that is mirrored, or that was in the reference frame and is no more
    colour_prior: float = 0.02  # how much speaks for the light's colour so far, share of the mean light
    colour_range: tuple[float, float] = (0.3, 3.0)  # of a channel's gain over the mean's
    # From frame to frame.
    steady_share: float = 0.3  # share of a small change that is taken on in a frame
    clear_change: float = 0.2  # change of the log gain that adds another whole share
    gloss_weight: float = 2.0  # a change of gloss counts so much more than one of the log gain
    # Drawing.
    smooth_px: int = 8  # over which light on a grid of GRID cells does not change much
    min_gloss: float = 0.002  # less is not drawn
    clipped_grey: int = 250  # from which a pixel does not tell how bright it is


@dataclass(frozen=True)
class ExposureModel:
    """How the grey level of white is told from a frame's brightest pixels."""

    side_px: int = 160  # of the frame's longer side, at which noise is averaged out
    brightest_quantile: float = 0.995  # of the pixels, by their largest channel
    white_grey: float = 235.0  # of white in a frame that is exposed as usual
    dark_grey: float = 120.0  # of the brightest pixels in a frame that is surely dark ...
    usual_grey: float = 190.0  # ... and from which a frame may be exposed as usual


MODEL = LightModel()
EXPOSURE = ExposureModel()


@dataclass(frozen=True)
class Light:
    """Light on a surface, against that in the reference frame.

    Attributes:
        gain: (n, n, 3) of the light, over the surface.
        gloss: (n, n) light that is mirrored; negative where less than in the reference frame.
    """

    gain: Floats
    gloss: Floats

    def over(self, grid_to_picture: Array, size: tuple[int, int]) -> "Light":
        """The light on each pixel of a picture (width, height) that a homography (3, 3) maps the grid to."""
        # It is smooth, and resizing is fast.
        n = len(self.gain)
        coarse = max(2, size[0] * n // (MODEL.smooth_px * GRID)), max(2, size[1] * n // (MODEL.smooth_px * GRID))
        coarse = min(coarse[0], size[0]), min(coarse[1], size[1])
        to_grid = from_corners(outline(n, n), outline(GRID, GRID))
        matrix = from_corners(outline(*size), outline(*coarse)) @ grid_to_picture @ to_grid
        gain, gloss = (
            cv2.warpPerspective(x, matrix, coarse, borderMode=cv2.BORDER_REPLICATE) for x in (self.gain, self.gloss)
        )
        return Light(gain, gloss).resized(*size)

    def resized(self, width: int, height: int) -> "Light":
        """The light on each pixel of a crop of the surface."""
        gain, gloss = (cv2.resize(x, (width, height), interpolation=cv2.INTER_LINEAR) for x in (self.gain, self.gloss))
        return Light(gain, gloss)

    def shaded(self, shading: Floats) -> "Light":
        """With shadows and other light that the grid is too coarse for: (h, w) a gain over the surface."""
        fine = self.resized(FINE, FINE)
        gain = fine.gain * cv2.resize(shading, (FINE, FINE), interpolation=cv2.INTER_AREA)[..., None]
        return Light(np.clip(gain, *MODEL.gain_range).astype(np.float32), fine.gloss)

    def without_gloss(self) -> "Light":
        """The light on what is printed, without what is mirrored."""
        return Light(self.gain, np.zeros_like(self.gloss))

    def on(self, picture: Image | Floats) -> Floats:
        """A picture, grey levels, of as many pixels as the light, in this light; it may be brighter than white."""
        if np.abs(self.gloss).max() < MODEL.min_gloss:
            return np.asarray(cv2.multiply(picture, cv2.sqrt(self.gain), dtype=cv2.CV_32F), np.float32)
        light = cv2.multiply(picture, picture, dtype=cv2.CV_32F)
        cv2.multiply(light, self.gain, dst=light)
        gloss = self.gloss * np.float32(255.0**2)
        cv2.add(light, cv2.merge([gloss, gloss, gloss]), dst=light)
        if gloss.min() < 0:
            cv2.max(light, 0.0, dst=light)
        return np.asarray(cv2.sqrt(light, dst=light), np.float32)

    def under(self, later: "Light") -> "Light":
        """The light when it has changed by a later one, on the same grid, which is told against it."""
        return Light(self.gain * later.gain, later.gloss + self.gloss * later.gain.mean(2))

    def off(self, picture: Image) -> Image:
        """The picture (h, w, 3) that looks like this in the light, of as many pixels; what is clipped stays so."""
        light = cv2.multiply(picture, picture, dtype=cv2.CV_32F)
        light -= (self.gloss * np.float32(255.0**2))[..., None]
        plain = np.sqrt(np.maximum(light, 0) / self.gain)
        clipped = picture >= MODEL.clipped_grey
        return np.where(clipped, picture, np.minimum(plain + 0.5, 255)).astype(np.uint8)

    def differs(self, other: "Light") -> float:
        """The largest difference to another light, in shares of white's grey level."""
        if self.gain.shape != other.gain.shape:
            return self.resized(FINE, FINE).differs(other.resized(FINE, FINE))
        gain = np.abs(np.sqrt(self.gain) - np.sqrt(other.gain)).max()
        return float(max(gain, np.abs(self.gloss - other.gloss).max()))


def as_it_was() -> Light:
    """The light of the reference frame."""
    return Light(np.ones((GRID, GRID, 3), np.float32), np.zeros((GRID, GRID), np.float32))


def exposure(frame: Image) -> float:
    """How bright white is in a frame (H, W, 3), as light; 1 where it is exposed as usual.

    Nothing printed is brighter than paper, and most scenes show something as bright as that: a wall, a shirt, the sky.
    So what is brightest in a dark frame is about as bright as an ad's white would be there.
    """
    small, _ = Pyramid(frame).at_most(EXPOSURE.side_px)
    brightest = np.quantile(small.max(2), EXPOSURE.brightest_quantile)
    dark, usual = EXPOSURE.dark_grey, EXPOSURE.usual_grey
    return float(np.interp(brightest, [0, dark, usual], [0, dark / EXPOSURE.white_grey, 1])) ** 2


def measure(view: Floats, template: Floats, trust: Grey, last: Light | None, shines: bool = False) -> Light:
    """The light by which a view of the surface differs from the template, each (h, w, 3) and aligned.

    Fitted again and again to what fits, with ever less allowance, so that neither an occluder nor a shadow's edge
    counts for much. The light's colour is the same all over, so that it does not take on an occluder's.

    Args:
        trust: (h, w) 0..1, how far each pixel of the view can be believed to show the surface.
        last: the light in the frame before; None where it is not known.
        shines: whether the surface shines by itself, as a screen: no shadow falls on it, so that it has one gain.
    """
    light = as_it_was() if last is None else last
    seen, own = (cv2.multiply(x, x, scale=1 / 255**2) for x in (view, template))
    change = _change(view, light.resized(*template.shape[1::-1]).on(template), trust)
    light = Light(np.clip(light.gain * change, *MODEL.gain_range), light.gloss)
    for allowance in MODEL.allowances:
        expected = light.resized(*template.shape[1::-1]).on(template)
        error = cv2.absdiff(view, expected)
        worst = cv2.max(cv2.max(error[..., 0], error[..., 1]), error[..., 2])
        usual = MODEL.expected_error_share * grey(expected) + MODEL.expected_error_grey
        weights = trust * tukey(worst / (allowance * usual))
        light = _fit(seen, own, weights, light, shines)
    return light


def follow(last: Light | None, new: Light, certainty: float) -> Light:
    """The light after a frame: clear changes are taken on at once, small ones may be noise.

    Args:
        certainty: 0..1, how surely the surface was where it was looked at.
    """
    if last is None:
        return new
    change = np.abs(np.log(new.gain / last.gain)).mean(2) + MODEL.gloss_weight * np.abs(new.gloss - last.gloss)
    share = (np.clip(MODEL.steady_share + change / MODEL.clear_change, 0, 1) * certainty).astype(np.float32)
    return Light(last.gain + share[..., None] * (new.gain - last.gain), last.gloss + share * (new.gloss - last.gloss))


def grey(image: Floats) -> Grey:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.float32)


def window_px(side: int) -> int:
    """Width of the window that a crop with this longer side is normalised over, px, odd."""
    return 2 * round(side * MODEL.window_share / 2) + 1


def shows(view: Grey, template: Grey) -> tuple[Grey, Mask]:
    """How well each cell (8, 8) of a view agrees with the template, as correlation, and which have texture to tell."""
    window = window_px(max(view.shape))
    textured = cell_means(cv2.absdiff(template, cv2.blur(template, (window, window)))) > MODEL.min_contrast_grey
    return Cells(normalise(template, window)[0]).correlation(normalise(view, window)[0]), textured


def _change(view: Floats, expected: Floats, trust: Grey) -> float:
    """By how much light has changed everywhere at once: the median over the cells, as they are trusted."""
    a, b = (_cells(grey(image) * trust, GRID) for image in (view, expected))
    ratio = (a / np.maximum(b, 1e-3)).ravel()
    order = np.argsort(ratio)
    mass = np.cumsum(b.ravel()[order])
    return float(ratio[order][np.searchsorted(mass, mass[-1] / 2)]) ** 2 if mass[-1] > 1 else 1.0


def _fit(seen: Floats, own: Floats, weights: Grey, before: Light, shines: bool) -> Light:
    """Least squares of seen = gain own + gloss, light (h, w, 3), from coarse to fine.

    Where a cell tells little, what the larger part around it tells counts, and a gain rather than a gloss.
    """
    colour = before.gain.mean((0, 1))
    colour /= colour.mean()
    shown = own * colour
    w = _cells(weights, GRID)
    x, y, xx, xy = (
        _cells(weights * cv2.transform(term, MEAN), GRID) for term in (shown, seen, shown * shown, shown * seen)
    )
    square = float(np.square(own).mean()) + 1e-6
    gain, gloss = np.full((1, 1), before.gain.mean(), np.float32), np.zeros((1, 1), np.float32)
    for n in (1, COARSE, GRID):
        w_, x_, y_, xx_, xy_ = (
            cv2.GaussianBlur(_cells(term, n), (3, 3), MODEL.cell_blur) for term in (w, x, y, xx, xy)
        )
        above = cv2.resize(gain, (n, n)), cv2.resize(gloss, (n, n))
        p, q = xx_ + MODEL.gain_prior * square, w_ + MODEL.gloss_prior
        r, s = xy_ + MODEL.gain_prior * square * above[0], y_ + MODEL.gloss_prior * above[1]
        determinant = p * q - x_ * x_
        if shines and n > 1:
            gain, gloss = above[0], (s - x_ * above[0]) / q
        else:
            gain, gloss = (r * q - s * x_) / determinant, (p * s - x_ * r) / determinant
        gain, gloss = np.clip(gain, *MODEL.gain_range), np.clip(gloss, -MODEL.max_gloss, MODEL.max_gloss)
    # The light's colour: of what is seen without the gloss, against what would be in white light.
    three = cv2.merge([weights] * 3)
    size = seen.shape[1::-1]
    plain = cv2.multiply(seen - cv2.resize(gloss, size)[..., None], three).mean((0, 1))
    white = cv2.multiply(own * cv2.resize(gain, size)[..., None], three).mean((0, 1))
    prior = MODEL.colour_prior * float(own.mean()) + 1e-4
    colour = np.clip((plain + prior * colour) / (white + prior), *MODEL.colour_range)
    return Light(np.clip(gain[..., None] * colour, *MODEL.gain_range).astype(np.float32), gloss.astype(np.float32))


def _cells(image: Floats, n: int) -> Floats:
    """Means (n, n, ...) of an image's cells."""
    return np.asarray(cv2.resize(image, (n, n), interpolation=cv2.INTER_AREA), np.float32)
