"""Grain: what changes at random from one frame to the next, measured in the video and laid on the ad afresh.

Two frames in a row show the same surface, so that what differs between them, where it is flat, is twice the noise:
that of the sensor, and what a codec left of it or put in its place.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache, cached_property

import cv2
import numpy as np

from hdn.imaging.arrays import Array, Box, Floats, Image
from hdn.imaging.homography import from_corners, translation
from hdn.imaging.photometry import MAD_TO_DEVIATION


@dataclass(frozen=True)
class GrainModel:
    """How grain is measured, and drawn."""

    window_px: int = 160  # side of the part of the frame that it is measured in, at most
    min_window_px: int = 24  # with less, nothing is told
    flat_share: float = 0.25  # of the pixels, those with the least texture, are looked at
    smooth_px: int = 7  # width of the mean that is taken off: light differs from frame to frame as well
    bins: int = 8  # of grey levels, that differ in their grain
    min_pixels: int = 200  # of a bin, for it to tell
    usual_deviations: float = 2.5  # within which values count for the noise's colour and softness
    memory: float = 0.9  # share of what is known that each further frame leaves
    least_grey: float = 0.25  # standard deviation under which there is no grain to see
    most_grey: float = 16.0
    tile_px: int = 512  # side of the stock of noise, of which each frame takes another part
    widths_px: tuple[float, ...] = (0.0, 0.4, 0.55, 0.7, 0.9, 1.2, 1.6)  # of the Gaussians that noise may be as soft as


MODEL = GrainModel()


@dataclass(frozen=True)
class Grain:
    """The grain of a frame.

    Attributes:
        deviation: (bins,) grey levels, by the brightness of what it lies on, from black to white.
        colour: (3, 3) what makes of three independent noises of unit deviation those of red, green and blue, whose
            mean has unit deviation.
        softness: index of the width in `GrainModel.widths_px`.
        number: of the frame: another for each.
    """

    deviation: Floats
    colour: Floats
    softness: int
    number: int

    def on(self, picture: Image | Floats, first_row: int = 0) -> Floats:
        """Noise (h, w, 3) for a picture (h, w, 3), both of 0..1, or of 0..255 where the picture has 8 bits.

        Args: first_row: of a larger picture, of which this one is some rows.
        """
        height, width = picture.shape[:2]
        noise = np.empty((height, width, 3), np.float32)
        (top, left), tile = self._begin, _tile(self.softness)
        for rows, tile_rows in _repeats(top + first_row, height):
            for columns, tile_columns in _repeats(left, width):
                noise[rows, columns] = cv2.transform(tile[tile_rows, tile_columns], self.colour)
        in_grey = picture.dtype == np.uint8
        strength = cv2.LUT(self._brightness(picture), self._strengths * np.float32(255 if in_grey else 1))
        return np.asarray(cv2.multiply(noise, cv2.cvtColor(strength, cv2.COLOR_GRAY2RGB), dst=noise), np.float32)

    @cached_property
    def _begin(self) -> tuple[int, int]:
        """The pixel of the stock of noise, row and column, that lies on the first one."""
        top, left = np.random.default_rng(self.number).integers(0, MODEL.tile_px, 2).tolist()
        return top, left

    @cached_property
    def _strengths(self) -> Floats:
        """(256,) the deviation by brightness, 0..1."""
        levels = np.linspace(0, MODEL.bins - 1, 256)
        return np.interp(levels, np.arange(MODEL.bins), self.deviation / 255).astype(np.float32)

    @staticmethod
    def _brightness(picture: Image | Floats) -> Image:
        """The mean (h, w) of a picture's channels (h, w, 3), 0..255."""
        mean = cv2.transform(picture, np.full((1, 3), 1 / 3, np.float32))
        return np.asarray(mean if mean.dtype == np.uint8 else cv2.convertScaleAbs(mean, alpha=255), np.uint8)


def _repeats(begin: int, length: int) -> Iterator[tuple[slice, slice]]:
    """Parts of a length, and what lies there where a tile is repeated, of which it begins at some pixel."""
    at = 0
    while at < length:
        start = (begin + at) % MODEL.tile_px
        size = min(length - at, MODEL.tile_px - start)
        yield slice(at, at + size), slice(start, start + size)
        at += size


@dataclass
class GrainMeter:
    """Measures the grain of a video, frame by frame."""

    _before: tuple[Image, Array, Array] | None = None  # a part of a frame, where it begins, and the surface's corners
    _variance: Floats = field(default_factory=lambda: np.zeros(MODEL.bins, np.float32))  # of a difference, grey^2
    _weight: Floats = field(default_factory=lambda: np.zeros(MODEL.bins, np.float32))
    _covariance: Array = field(default_factory=lambda: np.zeros((3, 3)))
    _softness: float = 0.0  # share of the variance that the mean of three by three pixels keeps
    _total: float = 0.0
    _number: int = 0

    def forget(self) -> None:
        """The next frame is of another shot."""
        self._before = None

    def see(self, frame: Image, pose: Array) -> Grain | None:
        """The grain in a frame (H, W, 3) in which the surface has the corners (4, 2); None where it is not known."""
        before = self._before
        self._look(frame, pose)
        if self._before is not None and before is not None:
            self._learn(self._before, before)
        return self.grain

    def passed(self, frame: Image, pose: Array) -> Grain | None:
        """The grain in a frame, see `see`, as it is known already: so much costs less."""
        self._look(frame, pose)
        return self.grain

    def _look(self, frame: Image, pose: Array) -> None:
        self._number += 1
        box = _window(frame, pose)
        self._before = None if box is None else (frame[box].copy(), np.array([box[1].start, box[0].start], float), pose)

    def missed(self) -> Grain | None:
        """The grain in a frame that does not tell it, as before: another pattern all the same."""
        self.forget()
        self._number += 1
        return self.grain

    @property
    def grain(self) -> Grain | None:
        """As it is known by now."""
        variance, weight = (np.convolve(x, (0.25, 0.5, 0.25), "same") for x in (self._variance, self._weight))
        known = weight > 0
        if not known.any():
            return None
        deviation = np.sqrt(variance[known] / weight[known] / 2)
        deviation = np.interp(np.arange(MODEL.bins), np.flatnonzero(known), deviation)
        if deviation.max() < MODEL.least_grey:
            return None
        covariance = self._covariance / self._total
        covariance = covariance / max(float(covariance.mean()), 1e-9) + 1e-6 * np.eye(3)
        softness = int(np.abs(_kept() - self._softness / self._total).argmin())
        deviation = np.minimum(deviation, MODEL.most_grey).astype(np.float32)
        return Grain(deviation, np.linalg.cholesky(covariance).astype(np.float32), softness, self._number)

    def _learn(self, now: tuple[Image, Array, Array], before: tuple[Image, Array, Array]) -> None:
        image, origin, pose = now
        other, other_origin, other_pose = before
        motion = translation(*-other_origin) @ from_corners(pose, other_pose) @ translation(*origin)
        size = image.shape[1::-1]
        # The nearest pixel, since a mixture of pixels has less noise; where it is flat they are alike.
        flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
        same = cv2.warpPerspective(other, motion, size, flags=flags)
        shown = cv2.warpPerspective(np.full(other.shape[:2], 255, np.uint8), motion, size, flags=flags)
        grey = cv2.GaussianBlur(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), (0, 0), 1.5).astype(np.float32)
        texture = cv2.magnitude(cv2.Sobel(grey, -1, 1, 0), cv2.Sobel(grey, -1, 0, 1))
        edge = MODEL.smooth_px
        inner = np.zeros(grey.shape, bool)
        inner[edge:-edge, edge:-edge] = True
        inner &= cv2.erode(shown, np.ones((edge, edge), np.uint8)) > 0
        inner &= (grey > 4) & (grey < 250)  # what is cut off has no noise
        if inner.sum() < MODEL.min_pixels:
            return
        inner &= texture <= np.quantile(texture[inner], MODEL.flat_share)
        difference = image.astype(np.float32) - same
        difference -= cv2.blur(difference, (MODEL.smooth_px, MODEL.smooth_px))
        difference *= 1 / np.sqrt(1 - 1 / MODEL.smooth_px**2)
        mean = difference.mean(2)
        values, levels = mean[inner], np.clip(grey[inner] * (MODEL.bins / 256), 0, MODEL.bins - 1).astype(int)
        # What moves, or is not quite flat, is no noise: such values are far out.
        usual = np.abs(values) <= MODEL.usual_deviations * MAD_TO_DEVIATION * np.median(np.abs(values))
        for level in np.unique(levels):
            chosen = values[levels == level]
            if len(chosen) >= MODEL.min_pixels:
                variance = (MAD_TO_DEVIATION * np.median(np.abs(chosen))) ** 2
                self._variance[level] = MODEL.memory * self._variance[level] + variance
                self._weight[level] = MODEL.memory * self._weight[level] + 1
        if usual.sum() < MODEL.min_pixels or not np.median(np.abs(values)) > 0:
            return
        soft = cv2.blur(mean, (3, 3))[inner]
        kept = (np.median(np.abs(soft)) / np.median(np.abs(values))) ** 2
        self._covariance = MODEL.memory * self._covariance + np.cov(difference[inner][usual].T)
        self._softness = MODEL.memory * self._softness + float(kept)
        self._total = MODEL.memory * self._total + 1


def _window(frame: Image, pose: Array) -> Box | None:
    """A part of the surface in its middle; None where it is too small."""
    bounds = np.array(frame.shape[1::-1])
    middle = pose.mean(0)
    inner = middle + (pose - middle) * 0.7
    low = np.clip(np.maximum(inner.min(0), middle - MODEL.window_px / 2), 0, bounds).astype(int)
    high = np.clip(np.minimum(inner.max(0), middle + MODEL.window_px / 2), 0, bounds).astype(int)
    if (high - low).min() < MODEL.min_window_px:
        return None
    return slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))


@cache
def _tile(softness: int) -> Floats:
    """Noise (n, n, 3) of unit deviation and this softness, without a seam."""
    n, width = MODEL.tile_px, MODEL.widths_px[softness]
    noise = np.random.default_rng(softness).standard_normal((n, n, 3)).astype(np.float32)
    if width:
        around = np.pad(noise, ((16, 16), (16, 16), (0, 0)), mode="wrap")
        noise = cv2.GaussianBlur(around, (0, 0), width)[16:-16, 16:-16]
    return np.asarray(noise / noise.std(), np.float32)


@cache
def _kept() -> Floats:
    """For each width, the share of its variance that noise keeps in the mean of three by three pixels."""
    tiles = (_tile(softness)[..., 0] for softness in range(len(MODEL.widths_px)))
    highs = (tile - cv2.blur(tile, (MODEL.smooth_px, MODEL.smooth_px)) for tile in tiles)
    return np.array([cv2.blur(high, (3, 3)).var() / high.var() for high in highs], np.float32)
