"""The matte network as it ships: what it says of drawn pairs, and that both engines say the same."""

import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from hdn.errors import InputError
from hdn.imaging.arrays import Image
from hdn.networks import conversion, loading, matte_network, torch_engine
from hdn.networks.engine import Engine
from hdn.networks.matte import Matte
from hdn.networks.weights import MATTE_FILE_NAME, shipped

from ..scenes import texture

SIZE = Matte.size


@pytest.fixture(scope="module")
def matte() -> Matte:
    return loading.load_matte(device="cpu")


@pytest.fixture(scope="module")
def poster() -> Image:
    return texture(3, SIZE, SIZE)


def hand() -> tuple[Image, Image]:
    """A drawn hand that reaches in from below: its picture, and its mask (0 or 255)."""
    mask = np.zeros((SIZE, SIZE), np.uint8)
    cv2.line(mask, (70, SIZE + 20), (66, 92), 255, 44)
    for i, tip in enumerate([(44, 42), (58, 30), (73, 30), (88, 44)]):
        cv2.line(mask, (50 + 11 * i, 90), tip, 255, 9)
    shade = 1 - 0.4 * np.clip(1 - cv2.distanceTransform(mask, cv2.DIST_L2, 5) / 8, 0, 1)
    return (np.array([208, 158, 132]) * shade[..., None]).astype(np.uint8), mask


def under_other_light(crop: Image) -> Image:
    """Dimmed towards one side, with a soft shadow over a corner, half a pixel off and blurred a little."""
    x, y = np.meshgrid(np.arange(SIZE), np.arange(SIZE))
    light = 1.1 - 0.35 * x / SIZE - 0.3 / (1 + np.exp((x + y - 90) / 6))
    moved = cv2.warpAffine(crop, np.float32([[1, 0, 0.5], [0, 1, 0.3]]), (SIZE, SIZE), borderMode=cv2.BORDER_REPLICATE)
    return np.clip(cv2.GaussianBlur(moved, (0, 0), 0.8) * light[..., None] + 6, 0, 255).astype(np.uint8)


def test_light_hides_nothing(matte: Matte, poster: Image) -> None:
    seen = matte(under_other_light(poster), poster)
    assert seen.shape == (SIZE, SIZE)
    assert seen.dtype == np.float32
    assert (seen > 0.5).mean() > 0.97


def test_a_hand_is_found(matte: Matte, poster: Image) -> None:
    picture, mask = hand()
    lit = under_other_light(poster)
    lit[mask > 0] = picture[mask > 0]
    hidden = matte(cv2.GaussianBlur(lit, (0, 0), 0.7), poster) < 0.5
    both, either = (hidden & (mask > 0)).sum(), (hidden | (mask > 0)).sum()
    assert both / either > 0.75


def test_another_surface_hides_it(matte: Matte, poster: Image) -> None:
    assert (matte(texture(8, SIZE, SIZE), poster) < 0.5).mean() > 0.8


def test_what_is_not_known_does_not_matter(matte: Matte, poster: Image) -> None:
    valid = np.zeros((SIZE, SIZE), np.uint8)
    valid[:, :80] = 255
    frame = under_other_light(poster)
    other = frame.copy()
    other[:, 80:] = 255
    seen = matte(frame, poster, valid)
    assert np.array_equal(seen, matte(other, poster, valid))
    assert (seen[:, 80:] == 0).all()
    assert (seen[:, :80] > 0.5).mean() > 0.95


def test_openvino_computes_what_pytorch_does(matte: Matte, poster: Image) -> None:
    theirs = torch_engine.matte(matte_network.load(shipped(MATTE_FILE_NAME)), "cpu")
    valid = np.ones((SIZE, SIZE), np.uint8)
    valid[:30] = 0
    picture, mask = hand()
    frame = np.where(mask[..., None] > 0, picture, poster)
    np.testing.assert_allclose(matte(frame, poster, valid), theirs(frame, poster, valid), atol=2e-3)


def test_the_engine_reads_it_when_first_asked(engine: Engine, matte: Matte, poster: Image) -> None:
    fresh = Engine(engine.config, engine.functions, engine.description)
    assert not [value for value in vars(fresh).values() if isinstance(value, Matte)]
    np.testing.assert_array_equal(fresh.matte(poster[::-1], poster), matte(poster[::-1], poster))


@pytest.mark.parametrize("crop", [np.zeros((64, 64, 3), np.uint8), np.zeros((SIZE, SIZE, 3), np.float32)])
def test_crops_of_another_kind_are_refused(matte: Matte, poster: Image, crop: Image) -> None:
    with pytest.raises(ValueError, match=r"make it uint8 \(128, 128, 3\)"):
        matte(crop, poster)


def test_its_files_are_small() -> None:
    assert shipped(MATTE_FILE_NAME).stat().st_size < 2e6


def test_weights_of_hdn_are_refused() -> None:
    with pytest.raises(InputError, match="configuration 'compact': this version knows matte"):
        loading.load_matte(shipped())


def test_its_networks_are_made_again_from_the_weights(tmp_path: Path, matte: Matte, poster: Image) -> None:
    path = tmp_path / "w.safetensors"
    shutil.copy(shipped(MATTE_FILE_NAME), path)
    converted = loading.load_matte(path, "cpu")
    assert conversion.pack_ir(path) == path.with_suffix(".openvino.zip")
    again = loading.load_matte(path, "cpu")
    expected = matte(poster[::-1], poster)
    for other in (converted, again):
        np.testing.assert_allclose(other(poster[::-1], poster), expected, atol=2e-3)


def test_weights_of_another_shape_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    matte_network.save(torch.nn.Conv2d(3, 4, 3), path, {})
    with pytest.raises(InputError, match="does not fit the matte network"):
        matte_network.load(path)


def test_the_shipped_network_is_loaded_once_in_each_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """For a tracker and for the drawing of ads; not for two threads, which would run one at the same time."""
    loaded: list[str] = []

    def load(device: str) -> object:
        loaded.append(device)
        return object()

    monkeypatch.setattr(loading, "load_matte", load)

    def use() -> tuple[object, object]:
        return loading.shared_matte("cpu"), loading.shared_matte("cpu")

    with ThreadPoolExecutor(1) as one, ThreadPoolExecutor(1) as other:
        first, again = one.submit(use).result()
        assert first is again
        assert other.submit(use).result()[0] is not first
    assert loaded == ["cpu", "cpu"]
