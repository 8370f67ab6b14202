"""Painters: what a surface asks for gets into frames, of any depth, through one compositor that serves all of them."""

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from ar_demo.compositing.compositor import Compositor, open_compositor
from ar_demo.compositing.opengl import GlCompositor
from ar_demo.errors import InputError, RunError
from ar_demo.rendering.painting import Painter, lit
from ar_demo.scene.conditions import Conditions
from ar_demo.scene.light import GRID, Light
from ar_demo.surface import Surface

SIZE = 320, 240
QUAD = np.array([[60.0, 40], [250, 50], [240, 200], [70, 190]])
LEFT, RIGHT = QUAD * [0.5, 1], QUAD * [0.5, 1] + [160, 0]


@pytest.fixture(params=["opencv", "egl"])
def compositor(request: pytest.FixtureRequest) -> Iterator[Compositor]:
    try:
        compositor = open_compositor(request.param)
    except RunError as error:
        pytest.skip(str(error))
    with compositor:
        yield compositor
        if isinstance(compositor, GlCompositor):
            assert compositor.context.error == "GL_NO_ERROR"


def ad_of(file: Path, colour: tuple[int, int, int]) -> Path:
    cv2.imwrite(str(file), np.full((90, 120, 3), colour[::-1], np.uint8))
    return file


def frame_of(dtype: type = np.uint8) -> np.ndarray:
    """Fine noise around a mid grey."""
    grey = np.random.default_rng(0).integers(60, 180, (SIZE[1], SIZE[0], 3))
    return (grey * (np.iinfo(dtype).max // 255)).astype(dtype)


def painted(
    compositor: Compositor, frame: np.ndarray, conditions: Conditions | None = None, **surface: Any
) -> np.ndarray:
    with Painter(Surface(**surface), QUAD, SIZE, compositor) as painter:
        painter.draw(frame, QUAD, 1.0, Fraction(0), conditions)
    return frame


def test_one_compositor_serves_several_surfaces(compositor: Compositor, tmp_path: Path) -> None:
    red, green = ad_of(tmp_path / "r.png", (200, 30, 20)), ad_of(tmp_path / "g.png", (20, 190, 30))
    frame = frame_of()
    with (
        Painter(Surface(red), LEFT, SIZE, compositor) as one,
        Painter(Surface(green), RIGHT, SIZE, compositor) as other,
    ):
        for _ in range(3):
            one.draw(frame, LEFT, 1.0, Fraction(0))
            other.draw(frame, RIGHT, 1.0, Fraction(0))
    assert frame[120, 78] == pytest.approx([200, 30, 20], abs=1)
    assert frame[120, 238] == pytest.approx([20, 190, 30], abs=1)
    # And goes on when a painter is closed.
    assert painted(compositor, frame_of(), ad=red)[120, 155] == pytest.approx([200, 30, 20], abs=1)


def test_what_is_kept_of_a_picture_goes_with_it(compositor: Compositor) -> None:
    kept = compositor._textures if isinstance(compositor, GlCompositor) else compositor._mipmaps  # type: ignore[attr-defined]
    for value in range(5):
        picture = np.full((50, 60, 3), value, np.uint8)
        layer = compositor.draw(picture, QUAD, SIZE)
        assert layer is not None
        assert (layer.rgba[70, 90] == [value, value, value, 255]).all()
        assert len(kept._kept) == 1
        del picture
    assert len(kept._kept) == 0


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_an_ad_in_a_light(compositor: Compositor, tmp_path: Path, dtype: type) -> None:
    """A gain of a quarter of the light is half of the value; to a fraction of a level where there are more."""
    light = Light(np.full((GRID, GRID, 3), 0.25, np.float32), np.zeros((GRID, GRID), np.float32))
    ad = ad_of(tmp_path / "ad.png", (201, 101, 51))
    frame = painted(compositor, frame_of(dtype), Conditions(light, None, np.zeros((2, 2))), ad=ad)
    scale = np.iinfo(dtype).max / 255
    assert frame[120, 155] / scale == pytest.approx([100.5, 50.5, 25.5], abs=0.51 if dtype is np.uint8 else 0.01)


def test_much_the_same_light_is_not_worked_out_anew(compositor: Compositor, tmp_path: Path) -> None:
    def light(gain: float) -> Light:
        return Light(np.full((GRID, GRID, 3), gain, np.float32), np.zeros((GRID, GRID), np.float32))

    with Painter(Surface(ad_of(tmp_path / "ad.png", (200, 100, 50))), QUAD, SIZE, compositor) as painter:
        pictures = []
        for gain in (0.5, 0.5001, 0.9):
            painter.layer(frame_of(), QUAD, Fraction(0), light(gain))
            assert painter._lit is not None
            pictures.append(painter._lit[2])
    assert pictures[0] is pictures[1]
    assert pictures[1] is not pictures[2]


def test_an_inset_ad_is_in_the_light_of_its_own_place(compositor: Compositor, tmp_path: Path) -> None:
    ad = ad_of(tmp_path / "ad.png", (200, 200, 200))
    gain = np.repeat(np.linspace(0.2, 1, GRID, dtype=np.float32)[None, :, None], GRID, 0)  # dark on the left
    light = Light(np.repeat(gain, 3, 2), np.zeros((GRID, GRID), np.float32))
    conditions = Conditions(light, None, np.zeros((2, 2)))
    whole = painted(compositor, frame_of(), conditions, ad=ad)
    inset = painted(compositor, frame_of(), conditions, ad=ad, inset=40)
    inside = np.s_[100:140, 110:200]
    assert np.abs(whole[inside].astype(int) - inset[inside]).max() <= 3


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("channels", [3, 4])
def test_lit_pictures_are_within_white_and_keep_their_alpha(dtype: type, channels: int) -> None:
    unit = 1 if dtype is np.float32 else np.iinfo(dtype).max
    picture = np.full((6, 8, channels), 0.8 * unit).astype(dtype)
    light = Light(np.full((6, 8, 3), 4.0, np.float32), np.zeros((6, 8), np.float32))
    bright = lit(picture, light)
    assert bright.dtype == np.float32
    assert bright.shape == picture.shape
    assert (bright[..., :3] == 1).all()
    assert bright[..., 3:] == pytest.approx(0.8, abs=0.003)


def test_a_picture_lit_in_8_bits_is_that_in_float_rounded() -> None:
    picture = np.random.default_rng(0).integers(0, 256, (300, 200, 4), np.uint8)
    gain = np.linspace(0.3, 1.6, 200, dtype=np.float32)[None, :, None] * np.ones((300, 1, 3), np.float32)
    light = Light(gain, np.full((300, 200), 0.05, np.float32))
    shallow, deep = (lit(picture, light, deep) for deep in (False, True))
    assert shallow.dtype == np.uint8
    assert np.abs(shallow - 255 * deep).max() < 0.51


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("effect", ["mosaic", "blur", "outline"])
def test_effects_are_layers_too(compositor: Compositor, effect: str, dtype: type) -> None:
    frame = painted(compositor, frame_of(dtype), effect=effect)
    before, white = frame_of(dtype), np.iinfo(dtype).max
    inside = np.s_[80:160, 100:210]
    if effect == "outline":
        assert (frame[inside] == before[inside]).all()
        on_edge = (QUAD[0] + QUAD[1]) / 2
        x, y = np.round(on_edge).astype(int)
        assert frame[y, x] / white == pytest.approx(np.array([0, 230, 118]) / 255, abs=0.12)
    else:
        assert frame[inside].std() < 0.5 * before[inside].std()  # what was fine is gone
        assert frame[inside].mean() == pytest.approx(before[inside].mean(), rel=0.03)
    assert (frame[:30] == before[:30]).all()
    assert (frame[210:] == before[210:]).all()


def test_an_outline_out_of_the_frame_is_nothing(compositor: Compositor) -> None:
    frame = frame_of()
    with Painter(Surface(effect="outline"), QUAD, SIZE, compositor) as painter:
        painter.draw(frame, QUAD + 1000, 1.0, Fraction(0))
        painter.draw(frame, np.full((4, 2), np.nan), 1.0, Fraction(0))
    assert (frame == frame_of()).all()


def test_a_surface_is_blended_as_it_asks(compositor: Compositor, tmp_path: Path) -> None:
    ad = ad_of(tmp_path / "ad.png", (255, 128, 0))
    frame = painted(compositor, frame_of(), ad=ad, blend="multiply")
    assert frame[120, 155] == pytest.approx(frame_of()[120, 155] * [1, 128 / 255, 0], abs=0.51)


def test_what_is_multiplied_is_in_the_light_of_the_surface_alone(compositor: Compositor, tmp_path: Path) -> None:
    ad = ad_of(tmp_path / "r.png", (200, 30, 20))
    dim = Light(np.full((GRID, GRID, 3), 0.25, np.float32), np.zeros((GRID, GRID), np.float32))
    conditions = Conditions(dim, None, np.zeros((2, 2)))
    frame = frame_of()
    lit_once = painted(compositor, frame.copy(), conditions, ad=ad, blend="multiply")
    np.testing.assert_array_equal(lit_once, painted(compositor, frame.copy(), ad=ad, blend="multiply"))
    assert np.abs(painted(compositor, frame.copy(), conditions, ad=ad).astype(int) - lit_once).max() > 20


def test_an_ad_is_needed(compositor: Compositor) -> None:
    with pytest.raises(InputError, match="no ad is given"):
        Painter(Surface(), QUAD, SIZE, compositor)
