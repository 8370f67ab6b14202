"""Shadows and glare of the first view: what the network says is taken off the print and put on the ad."""

import cv2
import numpy as np
import pytest

from ar_demo.scene.conditions import Appearance
from ar_demo.scene.first_light import FirstLight, LightStudy
from ar_demo.scene.light import FINE, Light
from hdn.imaging.arrays import Floats, Image
from hdn.networks.lighting import FirstLight as Found
from hdn.networks.lighting import Lighting
from hdn.networks.loading import load_lighting, load_matte
from hdn.networks.matte import Matte

from ..scenes import Scene

SCENE = Scene(640, 480, seed=3)
SCENE.quad = np.array([[200.0, 140], [440, 148], [432, 332], [204, 320]])


@pytest.fixture(scope="module")
def matte() -> Matte:
    return load_matte()


@pytest.fixture(scope="module")
def lighting() -> Lighting:
    return load_lighting()


def in_shadow(frame: Image, edge: float) -> Image:
    """A frame of which what is left of `edge`, px, gets 40 % of the light."""
    light = np.interp(np.arange(frame.shape[1]), [edge - 3, edge + 3], [0.4, 1.0])
    return np.asarray(frame * np.sqrt(light)[None, :, None], np.uint8)


def with_lamp(frame: Image, x: float, y: float = 240.0) -> Image:
    """A frame in which a lamp is mirrored."""
    rows, columns = np.mgrid[: frame.shape[0], : frame.shape[1]].astype(np.float32)
    spot = 0.5 * np.exp(-0.5 * ((columns - x) ** 2 + (rows - y) ** 2) / 35**2)
    return np.asarray(np.sqrt(np.minimum((frame / 255.0) ** 2 + spot[..., None], 1)) * 255, np.uint8)


def told(frames: list[Image], matte: Matte, lighting: Lighting) -> FirstLight | None:
    study = LightStudy(frames[0], SCENE.quad, matte, lighting)
    for frame in frames[1:]:
        study.see(frame, SCENE.quad)
    return study.light()


def test_a_shadow_that_goes_on_is_told_from_the_print(matte: Matte, lighting: Lighting) -> None:
    frame = SCENE.draw(SCENE.quad)
    light = told([in_shadow(frame, x) for x in (320, 250, 180, 120, 60, 0, 0, 380, 420)], matte, lighting)
    assert light is not None
    gain = light.moving.gain.mean(2)
    assert gain[:, :6].mean() < 0.65 * gain[:, -6:].mean()
    assert gain[:, -6:].mean() == pytest.approx(1, abs=0.25)
    np.testing.assert_array_equal(light.staying.gain, 1)


def test_a_lamp_that_moves_on_is_told_from_the_print(matte: Matte, lighting: Lighting) -> None:
    frame = SCENE.draw(SCENE.quad)
    light = told([with_lamp(frame, x) for x in (320, 200, 100, 0, -100, -100, 420, 520, 600)], matte, lighting)
    assert light is not None
    assert light.moving.gloss[8:16, 8:16].mean() > 0.15
    assert light.moving.gloss[:, :3].mean() < 0.08


def test_where_light_is_even_little_is_made_of_it(matte: Matte, lighting: Lighting) -> None:
    frame = SCENE.draw(SCENE.quad)
    light = told([np.asarray(frame * k, np.uint8) for k in (1, 0.97, 1.02, 0.9, 0.95, 1)], matte, lighting)
    assert light is not None
    for part in (light.moving, light.staying):
        assert np.abs(np.log(part.gain)).mean() < 0.2
        assert part.gloss.mean() < 0.05


def test_with_too_few_views_nothing_is_told(matte: Matte, lighting: Lighting) -> None:
    frame = SCENE.draw(SCENE.quad)
    assert told([frame, frame], matte, lighting) is None
    away = SCENE.quad + 2000
    study = LightStudy(frame, SCENE.quad, matte, lighting)
    for _ in range(8):
        study.see(frame, away)
        study.see(frame, np.full((4, 2), np.nan))
    assert study.light() is None


class Says(Lighting):
    """Says the same of any views."""

    def __init__(self, gain: Floats, glare: Floats) -> None:
        self.found = Found(gain, glare)

    def __call__(self, views: object, known: object) -> Found:
        return self.found


@pytest.mark.parametrize("moves", [True, False])
def test_what_goes_away_is_told_from_what_stays(matte: Matte, moves: bool) -> None:
    gain = np.ones((24, 24), np.float32)
    gain[:, :12] = 0.4
    frame = SCENE.draw(SCENE.quad)
    edges = (320, 100, 0, 0, 0, 80) if moves else (320,) * 6
    frames = [in_shadow(frame, x) for x in edges]
    light = told(frames, matte, Says(gain, np.zeros_like(gain)))
    assert light is not None
    assert (light.moving.gain.min() < 0.5) == moves
    assert (light.staying.gain.min() < 0.5) != moves


@pytest.mark.parametrize("stays", [True, False])
def test_an_ad_gets_the_shadow_of_the_first_view_and_loses_it_as_it_moves_on(matte: Matte, stays: bool) -> None:
    frame = SCENE.draw(SCENE.quad)
    first, then = in_shadow(frame, 320), in_shadow(frame, 320 if stays else -50)
    gain = np.ones((24, 24, 3), np.float32)
    gain[:, :12] = 0.4
    shadow, none = (
        Light(gain, np.zeros((24, 24), np.float32)),
        Light(np.ones_like(gain), np.zeros((24, 24), np.float32)),
    )
    light = FirstLight(none, shadow) if stays else FirstLight(shadow, none)
    appearance = Appearance(first, SCENE.quad, matte, grain=False, first_light=light)
    for now, is_dark in ((first, True), (then, stays)):
        for _ in range(5):
            seen = appearance.see(now, SCENE.quad, 0.3).light.resized(FINE, FINE).gain.mean(2)
        assert seen[:, 40:].mean() == pytest.approx(1, abs=0.2)
        assert seen[:, 4:24].mean() == pytest.approx(0.4 if is_dark else 1, abs=0.2)


def test_light_is_taken_off_a_picture_but_for_what_is_clipped() -> None:
    rng = np.random.default_rng(0)
    picture = cv2.GaussianBlur(rng.integers(0, 200, (40, 60, 3)).astype(np.uint8), (0, 0), 2)
    light = Light(np.full((40, 60, 3), 0.5, np.float32), np.full((40, 60), 0.1, np.float32))
    lit = np.asarray(np.clip(light.on(np.asarray(picture, np.uint8)) + 0.5, 0, 255), np.uint8)
    assert np.abs(light.off(lit).astype(int) - picture).max() <= 3
    white = np.full((40, 60, 3), 255, np.uint8)
    np.testing.assert_array_equal(light.off(white), white)


def test_no_shadow_falls_on_a_screen_but_a_lamp_is_mirrored_in_it(matte: Matte) -> None:
    frame = SCENE.draw(SCENE.quad)
    gain = np.ones((24, 24, 3), np.float32)
    gain[:, :12] = 0.4
    none = Light(np.ones_like(gain), np.zeros((24, 24), np.float32))
    wrong = FirstLight(none, Light(gain, np.zeros((24, 24), np.float32)))
    screen = Appearance(frame, SCENE.quad, matte, grain=False, first_light=wrong, kind="screen")
    for _ in range(4):
        light = screen.see(with_lamp(frame, 320), SCENE.quad, 0.3).light
    assert np.ptp(light.gain.mean(2)) < 0.02
    assert light.gloss.max() > 0.25
    assert light.gloss.min() < 0.06
