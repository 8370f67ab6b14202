"""The light network trains, goes on and is packed, on a handful of pictures; its clips are what they are called."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from hdn.networks import loading
from hdn.networks.config import LIGHT_SIZE
from hdn.networks.lighting import INNER
from hdn.synthesis import LitClips, Photos, light_batch
from hdn.training.light import off_by

from .test_matte import command

NOTHING = LitClips(shadowed=0, mirroring=0, rooms=0, uneven=0, shining=0, hidden=0)


@pytest.fixture
def photos() -> Photos:
    torch.manual_seed(0)
    return Photos(torch.randint(40, 220, (6, 3, 304, 304), dtype=torch.uint8))


def test_it_trains_goes_on_and_is_packed(tmp_path: Path) -> None:
    for folder, count in (("kodak", 2), ("train", 2)):
        (tmp_path / "images" / folder).mkdir(parents=True)
        for k in range(count):
            picture = np.random.default_rng(k).integers(0, 255, (64, 64, 3), np.uint8)
            cv2.imwrite(str(tmp_path / "images" / folder / f"{k}.png"), picture)
    small = ("--batch", 2, "--threads", 1, "--pairs", 2, "--out", tmp_path)
    command("light", "--images", tmp_path / "images", "--steps", 1, *small)
    assert "goes on from step 1" in command("light", "--images", tmp_path / "images", "--steps", 2, *small)
    command("pack", "--light", tmp_path)
    lighting = loading.load_lighting(tmp_path / "hdn_light.safetensors")
    view, known = np.full((LIGHT_SIZE, LIGHT_SIZE, 3), 99, np.uint8), np.ones((LIGHT_SIZE, LIGHT_SIZE), np.uint8)
    assert lighting([view] * 4, [known] * 4).gain.shape == (24, 24)


def test_even_light_is_even(photos: Photos) -> None:
    batch = light_batch(photos, 4, NOTHING)
    inner = batch.log_gain[..., INNER, INNER]
    assert inner.flatten(1).std(1).max() < 1e-3
    assert batch.glare.max() == 0
    assert (batch.known[..., INNER, INNER] == 1).all()
    assert batch.known.sum() == 4 * 24 * 24


def test_shadows_and_lamps_lie_where_it_is_said(photos: Photos) -> None:
    shadowed = light_batch(photos, 8, LitClips(shadowed=1, mirroring=0, rooms=0, uneven=0, shining=0))
    assert (shadowed.log_gain[..., INNER, INNER].flatten(1).std(1) > 0.02).float().mean() > 0.4
    assert shadowed.glare.max() == 0
    assert light_batch(photos, 8, LitClips(shadowed=0, mirroring=1, uneven=0)).glare.max() > 0.1


def test_errors_are_those_of_pictures_in_the_light(photos: Photos) -> None:
    batch = light_batch(photos, 2, NOTHING)
    assert off_by(batch.log_gain, batch.glare, batch).abs().max() == 0
    darker = off_by(batch.log_gain + np.log(0.25), batch.glare, batch)  # half the value
    white = darker[:, -1] / (batch.log_gain[:, 0].exp() + 1e-4).sqrt().clamp(max=1.1)
    assert white.mean() == pytest.approx(-0.5, abs=0.06)
