"""How a surface is lit in a frame: a smooth gain over what the reference frame shows of it."""

import cv2
import numpy as np
from numpy.typing import NDArray

from hdn.agreement import CELLS, Cells, Grey, cell_means
from hdn.blur import normalise, tukey
from hdn.sampling import Image, Pyramid

Floats = NDArray[np.float32]

GRID, COARSE = 16, 4  # the light's brightness is known on a grid of GRID x GRID over the surface, its colour on COARSE
STEPS = 3  # of reweighting
AGREES = 0.6  # correlation of a cell from which it is sure to show the surface
TEXTURE = 2.0  # grey levels of mean contrast, from which a cell has texture to correlate
UNSURE = 0.3  # trust in cells without texture
SPREAD, NOISE = 0.15, 5.0  # what light differs by within a cell: as a share of the brightness, and in grey levels
LEAST, MOST = 0.05, 4.0  # gains that are believed
STEADY, CHANGE = 0.3, 0.12  # share of a small change that is taken on in a frame; log of a ratio that is sure to be one
WHITE = 235.0  # grey levels of white in a frame that is exposed as usual
BRIGHTEST = 0.995  # quantile of a frame's pixels that tells its white
SMALL = 160  # px of a frame's longer side, at which its noise is averaged out


def exposure(frame: Image) -> float:
    """How bright white is in a frame (H, W, 3), 1 where it is exposed as usual.

    Nothing printed is brighter than paper, and most scenes show something as bright as that: a wall, a shirt, the sky.
    So what is brightest in the frame is about as bright as an ad's white would be there.
    """
    small, _ = Pyramid(frame).at_most(SMALL)
    return min(1.0, float(np.quantile(small.max(2), BRIGHTEST)) / WHITE)


def measure(view: Floats, template: Floats, usable: Grey, last: Floats | None) -> Floats:
    """The gain (GRID, GRID, 3) from the template to a view of the surface, each (h, w, 3) and aligned.

    Parts that show the template's texture are trusted whatever their brightness; flat ones as far as their gain is that
    of what is trusted. So an occluder counts for little. Light has less of colour than of brightness: its colour is
    taken to be the same over large parts, so that it does not take on an occluder's.

    Args:
        usable: (h, w) 0..1, what of the view can be compared.
        last: (GRID, GRID, 3) the gain in the frame before; None where it is not known.
    """
    trust = cv2.resize(_shows(view, template), view.shape[1::-1], interpolation=cv2.INTER_LINEAR) * usable
    gain = np.ones((GRID, GRID, 3), np.float32) if last is None else last
    gain = np.clip(gain * _change(view, template, trust, gain), LEAST, MOST)
    for _ in range(STEPS):
        lit = template * over(gain, view.shape)
        tolerance = SPREAD * grey(lit) + NOISE
        error = cv2.absdiff(view, lit)
        worst = cv2.max(cv2.max(error[..., 0], error[..., 1]), error[..., 2])
        gain = _fit(view, template, trust * tukey(worst / tolerance), gain)
    return gain


def follow(last: Floats | None, new: Floats) -> Floats:
    """The light (GRID, GRID, 3) after a frame: clear changes are taken on at once, small ones may be noise."""
    if last is None:
        return new
    change = np.abs(np.log(new / last)).mean(2, keepdims=True) / CHANGE
    return np.asarray(last + np.clip(STEADY + change, 0, 1) * (new - last), np.float32)


def over(gain: Floats, shape: tuple[int, ...]) -> Floats:
    """A gain (n, n, 3) at every pixel of a crop (h, w)."""
    return np.asarray(cv2.resize(gain, (shape[1], shape[0]), interpolation=cv2.INTER_LINEAR), np.float32)


def grey(image: Floats) -> Grey:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.float32)


def _shows(view: Floats, template: Floats) -> Grey:
    """How far each cell (CELLS, CELLS) of a view can be trusted to show the template, 0..1."""
    window = 2 * round(max(view.shape) / 10) + 1
    a, b = grey(template), grey(view)
    textured = cell_means(cv2.absdiff(a, cv2.blur(a, (window, window)))) > TEXTURE
    correlation = Cells(normalise(a, window)[0]).correlation(normalise(b, window)[0])
    return np.where(textured, np.clip(2 * correlation / AGREES - 1, 0, 1), UNSURE).astype(np.float32)


def _change(view: Floats, template: Floats, trust: Grey, gain: Floats) -> float:
    """By what the light has changed everywhere at once: the median over the cells, as they are trusted."""
    seen = _cells(grey(view) * trust)
    expected = _cells(grey(template * over(gain, view.shape)) * trust)
    ratio = (seen / np.maximum(expected, 1e-3)).ravel()
    order = np.argsort(ratio)
    mass = np.cumsum(expected.ravel()[order])
    return float(ratio[order][np.searchsorted(mass, mass[-1] / 2)]) if mass[-1] > 1 else 1.0


def _fit(view: Floats, template: Floats, weights: Grey, before: Floats) -> Floats:
    """Ratios of weighted means; where a cell tells little, of the larger parts around it, from coarse to fine.

    Means do not mind a shift by a part of a pixel, as products would.
    """
    seen, shown = (_cells(cv2.multiply(image, cv2.merge([weights] * 3))) for image in (view, template))
    usual = 0.1 * float(template.mean()) + 1.0
    whole = 0.01 * usual
    gain = (seen.mean((0, 1)) + whole * before.mean((0, 1))) / (shown.mean((0, 1)) + whole)
    coarse = _ratio(seen, shown, np.broadcast_to(gain, (COARSE, COARSE, 3)), usual)
    gain = over(coarse, seen.shape)
    brightness = _ratio(grey(seen), grey(shown * gain), np.ones((GRID, GRID), np.float32), usual)
    return np.clip(gain * brightness[..., None], LEAST, MOST).astype(np.float32)


def _ratio(seen: Floats, shown: Floats, above: Floats, usual: float) -> Floats:
    """Of means over the cells of a grid (n, n), which count as much as there is; `above` counts as much as `usual`."""
    size = above.shape[1::-1]
    a, b = (cv2.GaussianBlur(cv2.resize(x, size, interpolation=cv2.INTER_AREA), (3, 3), 0.8) for x in (seen, shown))
    return np.asarray((a + usual * above) / (b + usual), np.float32)


def _cells(image: Floats) -> Floats:
    return np.asarray(cv2.resize(image, (GRID, GRID), interpolation=cv2.INTER_AREA), np.float32)
