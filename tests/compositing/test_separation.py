"""Separation: the layer, laid over the frame again, makes the same picture, with no more alpha than it takes."""

import numpy as np
import pytest

from ar_demo.choices import Blend
from ar_demo.compositing.layer import Layer
from ar_demo.compositing.merge import merge
from ar_demo.compositing.separation import Insert, straight
from ar_demo.media.srgb import to_coded, to_linear
from ar_demo.scene.occlusion import Occluder
from hdn.imaging.arrays import Floats

HEIGHT, WIDTH = 60, 80
BOX = slice(10, 50), slice(20, 70)
SHAPE = BOX[0].stop - BOX[0].start, BOX[1].stop - BOX[1].start


def smooth(seed: int, *shape: int) -> Floats:
    return np.random.default_rng(seed).random(shape).astype(np.float32)


def frame_of() -> np.ndarray:
    frame = smooth(0, HEIGHT, WIDTH, 3)
    frame[12:16], frame[16:20] = 0, 1
    return np.rint(frame * 255).astype(np.uint16) * 257


def layer_of(seed: int = 1) -> Layer:
    alpha = np.clip(1.4 * smooth(seed, *SHAPE, 1) - 0.2, 0, 1)
    return Layer(BOX, np.concatenate([smooth(seed + 1, *SHAPE, 3) * alpha, alpha], 2))


def occluder_before(frame: np.ndarray) -> Occluder:
    """Over half the box, wholly at its left and ever less to its right, mixed with what was there as it is unmixed."""
    share = np.broadcast_to(np.clip(np.linspace(2, 0, 25, dtype=np.float32), 0, 1)[None, :, None], (40, 25, 3))
    box = BOX[0], slice(20, 45)
    behind = (1 - share) * 255 * smooth(9, 40, 25, 3)
    seen = frame[box] / np.float32(257)
    return Occluder(box, share.copy(), np.maximum(seen - behind, 0), np.divide(behind, 1 - share + 1e-6))


def inserted(blend: Blend = "normal", opacity: float = 1.0, hidden: bool = False) -> tuple[np.ndarray, Insert]:
    """A frame before a layer is laid on it, and what was laid on."""
    before = frame_of()
    after, cover = before.copy(), np.zeros((HEIGHT, WIDTH), np.float32)
    occluder = occluder_before(before) if hidden else None
    box = merge(after, layer_of(), blend, opacity, occluder=occluder, cover=cover)
    assert box is not None
    return before, Insert.of(before, after, cover, [box])


def laid_over(before: np.ndarray, insert: Insert, layer: Floats, linear: bool = False) -> np.ndarray:
    """In 8 bits, as many a program has them."""
    ground = (before[insert.box] / 65535).astype(np.float32)
    ground = to_linear(ground) if linear else ground
    result = layer[..., :3] + (1 - layer[..., 3:]) * ground
    return np.rint((to_coded(result) if linear else result) * 255)


@pytest.mark.parametrize("linear", [False, True])
@pytest.mark.parametrize("hidden", [False, True])
@pytest.mark.parametrize("blend", ["normal", "multiply", "screen", "overlay", "soft-light", "add"])
def test_it_makes_the_same_picture_again(blend: Blend, hidden: bool, linear: bool) -> None:
    before, insert = inserted(blend, 0.8, hidden)
    wanted = np.rint(insert.after / 257)
    layer = insert.layer(65535, to_linear if linear else None)
    assert (layer >= 0).all()
    assert (layer[..., :3] <= layer[..., 3:]).all()
    assert np.abs(laid_over(before, insert, layer, linear) - wanted).max() <= 1


@pytest.mark.parametrize("premultiplied", [False, True])
def test_eight_bits_are_enough_for_eight_bits(premultiplied: bool) -> None:
    before, insert = inserted("overlay", 0.9, hidden=True)
    layer = insert.layer(255)
    if premultiplied:
        kept = np.rint(layer * 255) / np.float32(255)
    else:
        kept = np.rint(straight(layer) * 255) / np.float32(255)
        kept[..., :3] *= kept[..., 3:]
    assert np.abs(laid_over(before, insert, kept) - np.rint(insert.after / 257)).max() <= 1


def test_what_is_laid_over_as_it_is_keeps_its_colours_and_alpha() -> None:
    _, insert = inserted()
    assert insert.layer(65535) == pytest.approx(layer_of().rgba, abs=2e-3)


def test_what_hides_an_insert_is_not_in_the_layer() -> None:
    _, insert = inserted(hidden=True)
    layer = insert.layer(65535)
    assert not layer[:, :12].any()
    free = layer_of().rgba[:, 25:]
    assert layer[:, 25:] == pytest.approx(free, abs=2e-3)
    soft = layer[:, 13:24, 3] / np.maximum(layer_of().rgba[:, 13:24, 3], 0.05)
    assert (np.diff(np.median(soft, 0)) > 0).all()  # ever less hidden


def test_later_layers_cover_what_is_left() -> None:
    before = frame_of()
    after, cover = before.copy(), np.zeros((HEIGHT, WIDTH), np.float32)
    boxes = [merge(after, layer_of(seed), opacity=0.5, cover=cover) for seed in (1, 5)]
    first, second = (0.5 * layer_of(seed).rgba[..., 3] for seed in (1, 5))
    assert cover[BOX] == pytest.approx(first + second - first * second, abs=1e-6)
    insert = Insert.of(before, after, cover, [box for box in boxes if box])
    assert np.abs(laid_over(before, insert, insert.layer(65535)) - np.rint(after[BOX] / 257)).max() <= 1


def test_no_insert_is_an_empty_layer() -> None:
    insert = Insert.of(frame_of(), frame_of(), np.zeros((HEIGHT, WIDTH), np.float32), [])
    whole = insert.framed(insert.layer(255))
    assert whole.shape == (HEIGHT, WIDTH, 4)
    assert not whole.any()
