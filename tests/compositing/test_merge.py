"""Merge: one rounding, at any depth; blur, opacity and occluders as in one picture; nothing else touched."""

from typing import Any

import numpy as np
import pytest

from ar_demo.choices import Blend
from ar_demo.compositing.layer import Layer
from ar_demo.compositing.merge import BLUR, blurred_layer, merge
from ar_demo.hdr import Hdr
from ar_demo.scene.occlusion import Occluder
from hdn.imaging.arrays import Floats, Image

HEIGHT, WIDTH = 150, 300  # more than a tile each way
BOX = slice(5, 145), slice(10, 290)


def noise(*shape: int, seed: int = 0) -> Floats:
    return np.random.default_rng(seed).random(shape).astype(np.float32)


def frame_of(dtype: type) -> Image:
    return np.rint(noise(HEIGHT, WIDTH, 3) * np.iinfo(dtype).max).astype(dtype)


def layer_of(dtype: type) -> Layer:
    """A random one with all kinds of tiles: clear, solid, and in between."""
    alpha = noise(140, 280, 1, seed=1)
    alpha[:, :100] = 1
    alpha[:, 256:] = 0
    rgba = np.concatenate([noise(140, 280, 3, seed=2) * alpha, alpha], axis=2)
    return Layer(BOX, np.rint(rgba * 255).astype(np.uint8) if dtype is np.uint8 else rgba)


def in_float(pixels: np.ndarray) -> np.ndarray:
    return pixels.astype(np.float64) / (np.iinfo(pixels.dtype).max if pixels.dtype.kind == "u" else 1)


def over(frame: np.ndarray, layer: Layer, opacity: float = 1.0) -> np.ndarray:
    """Porter and Duff's over, in 64 bit, with one rounding."""
    result, rgba = in_float(frame), in_float(layer.rgba) * opacity
    result[layer.box] = rgba[..., :3] + (1 - rgba[..., 3:]) * result[layer.box]
    return result * np.iinfo(frame.dtype).max


@pytest.mark.parametrize("opacity", [1.0, 0.3])
@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_a_layer_is_laid_over_with_one_rounding(dtype: type, depth: type, opacity: float) -> None:
    frame, layer = frame_of(depth), layer_of(dtype)
    exact = over(frame, layer, opacity)
    merge(frame, layer, opacity=opacity)
    # Float32 holds 16 bit values to a few hundredths.
    assert np.abs(frame - exact).max() <= (0.501 if depth is np.uint8 else 0.52)
    outside = np.ones(frame.shape[:2], bool)
    outside[BOX] = False
    assert (frame[outside] == frame_of(depth)[outside]).all()


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_a_clear_layer_and_no_opacity_leave_the_frame(dtype: type) -> None:
    frame = frame_of(np.uint8)
    merge(frame, Layer(BOX, np.zeros((140, 280, 4), dtype)))
    merge(frame, Layer(BOX, np.zeros((140, 280, 4), dtype)), "multiply")
    merge(frame, layer_of(dtype), opacity=0.0)
    assert (frame == frame_of(np.uint8)).all()


def test_a_layer_brighter_than_white_is_white() -> None:
    for depth in (np.uint8, np.uint16):
        frame = frame_of(depth)
        merge(frame, Layer(BOX, np.full((140, 280, 4), (1.4, 2.0, 1.0, 1.0), np.float32)))
        assert (frame[BOX] == np.iinfo(depth).max).all()


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_blur_spreads_colour_and_alpha_alike(dtype: type) -> None:
    """White over white stays white, however blurred: no dark or light fringe; and as much of it as before."""
    layer = Layer((slice(60, 80), slice(100, 140)), np.full((20, 40, 4), 255 if dtype is np.uint8 else 1, dtype))
    blurred = blurred_layer(layer, np.diag([16.0, 0.0]), (HEIGHT, WIDTH))
    assert blurred.rgba[..., 0] == pytest.approx(blurred.rgba[..., 3], abs=1e-5)
    assert blurred.rgba[..., 3].sum() == pytest.approx(800, rel=1e-3)
    white = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)
    merge(white, blurred_layer(layer, np.diag([16.0, 0.0]), white.shape[:2]))
    assert (white == 255).all()
    black = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    merge(black, blurred_layer(layer, np.diag([16.0, 0.0]), black.shape[:2]))
    row = black[70, :, 0].astype(float) / 255
    profile = -np.diff(row[120:])  # of the edge: a Gaussian of the blur's variance
    x = np.arange(len(profile)) - (profile * np.arange(len(profile))).sum()
    assert (profile * x * x).sum() == pytest.approx(16 + BLUR.added_variance, rel=0.06)


def test_blur_at_the_frames_edge_does_not_let_the_frame_in() -> None:
    frame = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    layer = Layer((slice(0, 150), slice(0, 300)), np.full((150, 300, 4), 255, np.uint8))
    merge(frame, blurred_layer(layer, np.eye(2) * 25, frame.shape[:2]))
    assert (frame == 255).all()


def test_too_little_blur_is_none() -> None:
    one, other = frame_of(np.uint8), frame_of(np.uint8)
    merge(one, layer_of(np.uint8))
    merge(other, blurred_layer(layer_of(np.uint8), np.eye(2) * BLUR.least_variance * 0.9, other.shape[:2]))
    assert (one == other).all()


def occluder(box: tuple[slice, slice] = (slice(40, 140), slice(0, 200))) -> Occluder:
    """Grey, on a surface of 120; its share rises from left to right."""
    shape = box[0].stop - box[0].start, box[1].stop - box[1].start
    share = np.broadcast_to(np.linspace(0, 1, shape[1], dtype=np.float32)[None, :, None], (*shape, 3)).copy()
    return Occluder(box, share, share * 60, np.full((*shape, 3), 120, np.float32))


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_an_occluder_lies_over_an_opaque_layer(dtype: type, depth: type) -> None:
    white = np.iinfo(depth).max
    frame, hides = frame_of(depth), occluder()
    merge(frame, Layer(BOX, np.full((140, 280, 4), 255 if dtype is np.uint8 else 1, dtype)), occluder=hides)
    inner = slice(40, 140), slice(10, 200)
    share = hides.share[:, 10:]
    before = frame_of(depth)[inner].astype(int)
    finer = 0 if depth is np.uint8 else before - (before >> 8) * 257  # what the occluder's 8 bits lack
    assert np.abs(frame[inner] - white * (1 - share + share * 60 / 255) - share * finer).max() <= 0.55
    assert (frame[5:40, 10:290] == white).all()
    assert (frame[5:145, 200:290] == white).all()
    assert (frame[:, :10] == frame_of(depth)[:, :10]).all()


def test_an_occluder_leaves_the_frame_beside_the_layer() -> None:
    frame = frame_of(np.uint8)
    rgba = np.zeros((140, 280, 4), np.float32)
    rgba[:, :100] = 1
    merge(frame, Layer(BOX, rgba), occluder=occluder())
    assert (frame[5:145, 110:290] == frame_of(np.uint8)[5:145, 110:290]).all()
    assert (frame[5:40, 10:110] == 255).all()


def test_an_occluder_elsewhere_makes_no_difference() -> None:
    one, other = frame_of(np.uint8), frame_of(np.uint8)
    merge(one, layer_of(np.uint8))
    merge(other, layer_of(np.uint8), occluder=occluder((slice(146, 150), slice(0, 300))))
    assert (one == other).all()


def test_blending_is_with_the_surface_behind_the_occluder() -> None:
    """Multiplied with black behind a half-seen occluder, nothing but the occluder's own light is left."""
    frame = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
    hides = occluder()
    layer = Layer(BOX, np.full((140, 280, 4), (0.5, 0.5, 0.5, 1.0), np.float32))
    merge(frame, layer, "multiply", occluder=hides)
    x = 100  # whose share is about a half
    share = hides.share[0, x, 0]
    assert frame[60, x] == pytest.approx(120 * 0.5 * (1 - share) + 60 * share, abs=0.51)
    assert frame[20, x] == pytest.approx(45, abs=0.51)


HDR = Hdr("pq")


def hdr_frame() -> Any:
    """Light of up to five times graphics white."""
    return HDR.signal(5 * noise(HEIGHT, WIDTH, 3) ** 2)


@pytest.mark.parametrize("opacity", [1.0, 0.3])
def test_a_layer_on_hdr_is_mixed_in_light(opacity: float) -> None:
    frame, layer = hdr_frame(), layer_of(np.float32)
    before = HDR.light(frame)
    merge(frame, layer, opacity=opacity, hdr=HDR)
    after = HDR.light(frame)
    alpha = layer.rgba[..., 3:]
    own = HDR.of_graphics((layer.rgba[..., :3] / np.maximum(alpha, 1e-6)).astype(np.float32))
    expected = before.copy()
    expected[BOX] = before[BOX] * (1 - opacity * alpha) + opacity * alpha * own
    assert np.abs(after - expected).max() < 0.002 * expected.max()
    untouched = np.ones((HEIGHT, WIDTH), bool)
    untouched[BOX] = alpha[..., 0] == 0
    assert (frame[untouched] == hdr_frame()[untouched]).all()


def test_what_hides_a_surface_keeps_its_light_on_hdr() -> None:
    """Where it hides all, the pixels are the frame's own, and brighter than anything in SDR."""
    frame = HDR.signal(np.full((HEIGHT, WIDTH, 3), 3, np.float32))
    seen = in_float(HDR.to_sdr(frame))[0, 0, 0] * 255
    box = slice(40, 140), slice(0, 200)
    share = np.zeros((100, 200, 3), np.float32)
    share[:, 100:] = 1
    hides = Occluder(box, share, share * np.float32(seen), np.full((100, 200, 3), 120, np.float32))
    merge(frame, Layer(BOX, np.full((140, 280, 4), 255, np.uint8)), occluder=hides, hdr=HDR)
    assert HDR.light(frame[60:61, 150:151]) == pytest.approx(3, rel=0.01)
    assert HDR.light(frame[60:61, 50:51]) == pytest.approx(1, rel=0.01)


@pytest.mark.parametrize(
    ("blend", "behind", "light"),
    [("multiply", 0.5, 0.5), ("multiply", 3, 3), ("screen", 0.2, 1), ("screen", 3, 3), ("add", 3, 3)],
)
def test_blending_with_white_on_hdr(blend: Blend, behind: float, light: float) -> None:
    """Highlights stay as far above white as they are."""
    frame = HDR.signal(np.full((HEIGHT, WIDTH, 3), behind, np.float32))
    merge(frame, Layer(BOX, np.full((140, 280, 4), 255, np.uint8)), blend, hdr=HDR)
    assert HDR.light(frame[60:61, 50:51]) == pytest.approx(light, rel=0.01)
