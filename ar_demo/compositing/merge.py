"""Lay a layer on a frame: blended and hidden as it is to be; and blur one.

Tile by tile, so that what is worked out stays in the cache; in float, with one rounding at the end, but where an 8 bit
layer is laid on as it is. On HDR it is laid in light.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np

from hdn.imaging.arrays import Array, Box, Floats, Grey, Image
from hdn.imaging.blur import blurred

from ..choices import Blend
from ..hdr import Hdr, graded, ungraded
from ..scene.occlusion import Occluder
from .blend import BLENDS
from .layer import Frame, Layer, as_box, in_float, overlap, peak, within

TILE = (256, 128)  # px, width and height: fits the cache
DEPTHS = {"uint8": cv2.CV_8U, "uint16": cv2.CV_16U}  # of frames, as OpenCV names them


@dataclass(frozen=True)
class BlurModel:
    """How a layer is blurred."""

    least_variance: float = 0.05  # px^2 of the frame, below which blur is not seen
    fine_variance: float = 0.5  # px^2, up to which a pixel and its neighbours make a blur alike in all directions
    added_variance: float = 0.2  # px^2, in all directions: a thinner Gaussian would fall between the pixels
    reach: float = 3.0  # standard deviations, after which next to nothing is left of a Gaussian


BLUR = BlurModel()


def merge(
    frame: Frame,
    layer: Layer,
    blend: Blend = "normal",
    opacity: float = 1.0,
    occluder: Occluder | None = None,
    cover: Grey | None = None,
    hdr: Hdr | None = None,
) -> Box | None:
    """Lays a layer on a frame, in place.

    Args:
        frame: (H, W, 3), C-contiguous.
        layer: what is laid on it.
        blend: what the layer's colour becomes over the frame's, see `blend`.
        opacity: 0..1, multiplies the layer's alpha.
        occluder: what lies over the layer, where there is one.
        cover: (H, W) 0..1, how much of each pixel was covered by earlier layers; this one is added.
        hdr: how the frame's samples, of 16 bits, stand for light, on which the layer is SDR; None for a frame in SDR.

    Returns:
        The part of the frame that may have changed; None for none.
    """
    if not opacity > 0:
        return None
    for tile, rgba in _tiles(layer):
        part = frame[tile]
        hiding = _Hiding.of(occluder, tile)
        if cover is not None:
            _cover(cover[tile], rgba, min(opacity, 1.0), hiding)
        if hdr is not None:
            _lay_in_light(part, rgba, blend, min(opacity, 1.0), hiding, hdr)
        elif blend != "normal" or hiding is not None:
            _lay(part, rgba, blend, min(opacity, 1.0), hiding)
        elif opacity < 1 or not part.dtype == rgba.dtype == np.uint8:
            _lay_over(part, rgba, min(opacity, 1.0))
        else:
            _lay_exactly(part, rgba)
    return layer.box


def blurred_layer(layer: Layer, covariance: Array, frame_shape: tuple[int, int]) -> Layer:
    """A layer blurred by a covariance (2, 2), px^2, colour and alpha alike; it grows by the blur's reach."""
    if np.linalg.eigvalsh(covariance).max() <= BLUR.least_variance:
        return layer
    if np.ptp(np.linalg.eigvalsh(covariance)) < BLUR.least_variance:
        return _softened(layer, float(covariance[0, 0]), frame_shape)
    reach = int(np.ceil(BLUR.reach * np.sqrt(np.linalg.eigvalsh(covariance).max())))
    box, rgba = _enlarged(layer, reach, frame_shape)
    return Layer(box, blurred(in_float(rgba), covariance + BLUR.added_variance * np.eye(2)))


def _softened(layer: Layer, variance: float, frame_shape: tuple[int, int]) -> Layer:
    """A layer blurred alike in all directions, px^2; up to `fine_variance` within a pixel and its neighbours."""
    if variance <= BLUR.fine_variance:
        kernel = np.array([variance / 2, 1 - variance, variance / 2], np.float32)
    else:
        reach = int(np.ceil(BLUR.reach * np.sqrt(variance)))
        kernel = np.exp(np.square(np.arange(-reach, reach + 1.0)) / (-2 * (variance + BLUR.added_variance)))
        kernel = (kernel / kernel.sum()).astype(np.float32)
    box, rgba = _enlarged(layer, len(kernel) // 2, frame_shape)
    soft = cv2.sepFilter2D(rgba, -1, kernel, kernel, borderType=cv2.BORDER_REPLICATE)
    return Layer(box, cast("Image | Floats", soft))


def _enlarged(layer: Layer, reach: int, frame_shape: tuple[int, int]) -> tuple[Box, Image | Floats]:
    """A layer's box and premultiplied RGBA with so many px more to each side, within the frame."""
    rows, columns = layer.box
    top, left = max(rows.start - reach, 0), max(columns.start - reach, 0)
    bottom, right = min(rows.stop + reach, frame_shape[0]), min(columns.stop + reach, frame_shape[1])
    sides = rows.start - top, bottom - rows.stop, columns.start - left, right - columns.stop
    rgba = cv2.copyMakeBorder(layer.rgba, *sides, cv2.BORDER_CONSTANT, value=(0, 0, 0, 0))
    return as_box(left, top, right, bottom), cast("Image | Floats", rgba)


def _tiles(layer: Layer) -> Iterator[tuple[Box, Image | Floats]]:
    """Parts of the frame, and the layer's pixels there."""
    rows, columns = layer.box
    for top in range(rows.start, rows.stop, TILE[1]):
        for left in range(columns.start, columns.stop, TILE[0]):
            tile = as_box(left, top, min(left + TILE[0], columns.stop), min(top + TILE[1], rows.stop))
            yield tile, layer.rgba[within(tile, layer.box)]


def _lay_exactly(part: Frame, rgba: Image | Floats) -> None:
    """Lays 8 bit premultiplied RGBA (h, w, 4) on an 8 bit part of a frame (h, w, 3): colour + (1 - alpha) part."""
    pixels = rgba.view(np.uint32)  # one number a pixel, whose highest byte is alpha in little-endian order
    if pixels.min() >= 0xFF000000:
        cv2.cvtColor(rgba, cv2.COLOR_RGBA2RGB, dst=part)
    elif pixels.max() > 0:
        kept = cv2.cvtColor(cv2.bitwise_not(cv2.extractChannel(rgba, 3)), cv2.COLOR_GRAY2RGB)
        cv2.multiply(part, kept, dst=kept, scale=1 / 255)
        cv2.add(kept, cv2.cvtColor(rgba, cv2.COLOR_RGBA2RGB), dst=part)


def _lay_over(part: Frame, rgba: Image | Floats, opacity: float) -> None:
    """The same with an opacity, and at any depth, in float."""
    white, unit = peak(part.dtype), peak(rgba.dtype)
    alpha = cv2.extractChannel(rgba, 3)
    lowest, highest, _, _ = cv2.minMaxLoc(alpha)
    if highest <= 0:
        return
    colour = cv2.cvtColor(rgba, cv2.COLOR_RGBA2RGB)
    if lowest >= unit:
        behind, share = part, 1 - opacity
    else:
        kept = cv2.cvtColor(np.subtract(1, alpha * (opacity / unit), dtype=np.float32), cv2.COLOR_GRAY2RGB)
        behind, share = cv2.multiply(part, kept, dtype=cv2.CV_32F), 1.0
    cv2.addWeighted(colour, opacity * white / unit, behind, share, 0, dst=part, dtype=DEPTHS[part.dtype.name])


@dataclass(frozen=True)
class _Hiding:
    """What an occluder does to a tile, (h, w, 3) each, colours 0..1; see `Occluder`."""

    share: Floats
    colour: Floats
    behind: Floats

    @staticmethod
    def of(occluder: Occluder | None, tile: Box) -> "_Hiding | None":
        """None where there is none, or the tile is beside its box."""
        if occluder is None or (shared := overlap(tile, occluder.box)) is None:
            return None
        hiding = _Hiding(*(np.zeros((*_shape(tile), 3), np.float32) for _ in range(3)))
        source, target = within(shared, occluder.box), within(shared, tile)
        hiding.share[target] = occluder.share[source]
        hiding.colour[target] = occluder.colour[source] * np.float32(1 / 255)
        hiding.behind[target] = occluder.behind[source] * np.float32(1 / 255)
        return hiding


def _lay(part: Frame, rgba: Image | Floats, blend: Blend, opacity: float, hiding: _Hiding | None) -> None:
    """Lays premultiplied RGBA (h, w, 4) on a part of a frame (h, w, 3) in whatever way, rounded once."""
    rgba = in_float(rgba)
    colour = np.asarray(cv2.cvtColor(rgba, cv2.COLOR_RGBA2RGB), np.float32)
    alpha = np.asarray(cv2.cvtColor(cv2.extractChannel(rgba, 3), cv2.COLOR_GRAY2RGB), np.float32)
    ground = in_float(part)
    if blend != "normal":
        # With an opaque backdrop, W3C's formula comes to alpha B(cb, cs) + (1 - alpha) cb.
        own = np.clip(np.divide(colour, alpha, out=np.zeros_like(colour), where=alpha > 0), 0, 1)
        behind = ground if hiding is None else np.where(hiding.share > 0, hiding.behind, ground)
        colour = alpha * BLENDS[blend](behind, own)
    if hiding is not None:
        # The occluder lies atop the layer (Porter and Duff's operator): beside it, there is the frame already.
        own = hiding.colour if part.dtype == np.uint8 else hiding.colour + hiding.share * _finer(part)
        colour = colour * (1 - hiding.share) + alpha * own
    result = ground * (1 - opacity * alpha) + opacity * colour
    cv2.addWeighted(result, peak(part.dtype), result, 0, 0, dst=part, dtype=DEPTHS[part.dtype.name])


def _cover(cover: Grey, rgba: Image | Floats, opacity: float, hiding: _Hiding | None) -> None:
    """Adds what a layer (h, w, 4) takes of each pixel to what others take (h, w)."""
    alpha = in_float(rgba[..., 3]) * np.float32(opacity)
    if hiding is not None:
        alpha = alpha * (1 - hiding.share[..., 0])
    cover += alpha * (1 - cover)


def _finer(part: Frame) -> Floats:
    """What a part of a frame of 16 bits has that 8 bits do not tell, 0..1."""
    return in_float(part) - in_float((part >> 8).astype(np.uint8))


def _lay_in_light(
    part: Frame, rgba: Image | Floats, blend: Blend, opacity: float, hiding: _Hiding | None, hdr: Hdr
) -> None:
    """Lays premultiplied SDR on a part of an HDR frame (h, w, 3), both as light.

    Blend modes take what is brighter than graphics white for white, and keep by how much it is.
    """
    rgba = in_float(rgba)
    alpha = np.asarray(cv2.cvtColor(cv2.extractChannel(rgba, 3), cv2.COLOR_GRAY2RGB), np.float32)
    touched = alpha > 0
    if not touched.any():
        return
    colour = np.asarray(cv2.cvtColor(rgba, cv2.COLOR_RGBA2RGB), np.float32)
    own = hdr.of_graphics(np.clip(np.divide(colour, alpha, out=np.zeros_like(colour), where=touched), 0, 1))
    deep = np.asarray(part, np.uint16)
    ground = hdr.light(deep)
    if blend != "normal":
        behind = ground
        if hiding is not None:
            behind = np.where(hiding.share > 0, hdr.of_graphics(np.clip(hiding.behind, 0, 1)), ground)
        seen = graded(np.asarray(behind, np.float32))
        above = np.maximum(seen, np.float32(1))
        white = np.float32(1)
        mixed = np.clip(BLENDS[blend](np.minimum(seen, white), np.minimum(graded(own), white)), 0, 1) * above
        own = ungraded(np.asarray(mixed, np.float32))
    if hiding is not None:
        # The occluder is known as a part of what SDR shows of each pixel; so much of the pixel's own light is its.
        view = in_float(hdr.to_sdr(deep))
        portion = np.clip(np.divide(hiding.colour, view, out=np.zeros_like(view), where=view > 0), 0, 1)
        own = ungraded(graded(own) * (1 - hiding.share) + graded(ground) * portion)
    result = hdr.signal(ground * (1 - opacity * alpha) + opacity * alpha * own)
    # A sample that comes back off by one did not change: it is that of the frame's own light.
    np.copyto(part, result, where=touched & (cv2.absdiff(deep, result) > 1))


def _shape(box: Box) -> tuple[int, int]:
    rows, columns = box
    return rows.stop - rows.start, columns.stop - columns.start
