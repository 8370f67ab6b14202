"""Grain: measured in frames of which the noise is known, and drawn with the same."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from ar_demo.compositing.layer import Layer, as_box
from ar_demo.rendering.painting import grained
from ar_demo.scene.grain import Grain, GrainMeter

QUAD = np.array([[20.0, 20], [280, 20], [280, 200], [20, 200]])


def measured(deviation: float, width: float = 0.0, colour: bool = False, motion: float = 0.0) -> Grain | None:
    """The grain of grey frames with Gaussian noise of a deviation, softened by a Gaussian of a width."""
    rng, meter, grain = np.random.default_rng(1), GrainMeter(), None
    for number in range(6):
        noise = rng.standard_normal((240, 320, 3 if colour else 1)).astype(np.float32)
        noise = noise if colour else np.repeat(noise, 3, 2)
        if width:
            noise = cv2.GaussianBlur(noise, (0, 0), width)
            noise /= noise.std()
        picture = np.full((240, 320, 3), 120.0) + deviation * noise
        grain = meter.see(picture.round().clip(0, 255).astype(np.uint8), QUAD + number * motion)
    return grain


@pytest.mark.parametrize("motion", [0.0, 3.3])
@pytest.mark.parametrize("deviation", [2.0, 5.0])
def test_the_deviation_is_found(deviation: float, motion: float) -> None:
    grain = measured(deviation, motion=motion)
    assert grain is not None
    assert grain.deviation[3] == pytest.approx(deviation, rel=0.12)
    assert grain.softness == 0


def test_frames_without_noise_have_no_grain() -> None:
    assert measured(0.0) is None


def test_a_single_frame_tells_nothing() -> None:
    assert GrainMeter().see(np.full((240, 320, 3), 120, np.uint8), QUAD) is None


@pytest.mark.parametrize("colour", [False, True])
def test_what_is_drawn_is_as_what_was_measured(colour: bool) -> None:
    """Level, softness and colour of the noise come back."""
    grain = measured(4.0, 0.8, colour)
    assert grain is not None
    noise = 255 * grain.on(np.full((200, 300, 3), 120 / 255, np.float32))
    mean = noise.mean(2)
    assert mean.std() == pytest.approx(4 / np.sqrt(3) if colour else 4, rel=0.15)
    neighbours = float((mean[:, 1:] * mean[:, :-1]).mean() / mean.var())
    assert neighbours == pytest.approx(np.exp(-1 / (4 * 0.8**2)), abs=0.15)
    assert np.corrcoef(noise[..., 0].ravel(), noise[..., 2].ravel())[0, 1] == pytest.approx(0 if colour else 1, abs=0.1)


def test_each_frame_has_another_grain() -> None:
    picture = np.full((50, 60, 3), 0.5, np.float32)
    one, other = (Grain(np.full(8, 3, np.float32), np.eye(3, dtype=np.float32), 0, n).on(picture) for n in (1, 2))
    assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 0.05


def test_grain_stays_within_the_layer(tmp_path: Path) -> None:
    rgba = np.zeros((20, 20, 4), np.uint8)
    rgba[5:15, 5:15] = (100, 100, 100, 255)
    grain = Grain(np.full(8, 6, np.float32), np.eye(3, dtype=np.float32), 0, 1)
    layer = grained(Layer(as_box(0, 0, 20, 20), rgba), grain)
    assert (layer.rgba[0] == 0).all()
    assert layer.rgba[5:15, 5:15, 0].std() > 0.01
    assert (layer.rgba[..., :3] <= layer.rgba[..., 3:]).all()


def test_grain_in_8_bits_is_that_in_float() -> None:
    rng = np.random.default_rng(2)
    rgba = np.dstack([rng.integers(0, 200, (300, 400, 3)), np.full((300, 400), 255)]).astype(np.uint8)
    rgba[:, :50] //= 2  # partly covered
    grain = Grain(np.full(8, 6, np.float32), np.eye(3, dtype=np.float32), 1, 5)
    box = as_box(0, 0, 400, 300)
    shallow, deep = grained(Layer(box, rgba), grain), grained(Layer(box, rgba / np.float32(255)), grain)
    assert shallow.rgba.dtype == np.uint8
    difference = np.abs(shallow.rgba - 255 * deep.rgba)
    assert difference.max() < 1.01
    assert difference.mean() < 0.3
