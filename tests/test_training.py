"""Training runs, improves, resumes and packs, on a handful of pictures."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from hdn import training, weights
from hdn.errors import InputError

from .scenes import texture


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("images")
    for source, count in (("bsds500", 6), ("kodak", 2)):
        (folder / source).mkdir()
        for i in range(count):
            cv2.imwrite(str(folder / source / f"{i}.png"), texture(i, 200, 160))
    return folder


def run(component: str, images: Path, out: Path, steps: int) -> None:
    training.train(
        component, [images], out, steps=steps, batch_size=4, rate=1e-3, search_size=191, backbone=None,
        device=torch.device("cpu"), validation_batches=1,
    )  # fmt: skip


def test_held_out_sources_are_never_trained_on(images: Path) -> None:
    trained, held_out = (training.find_images([images], held_out=flag) for flag in (False, True))
    assert {p.parent.name for p in trained} == {"bsds500"}
    assert {p.parent.name for p in held_out} == {"kodak"}


def test_no_images(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no images"):
        training.find_images([tmp_path], held_out=False)


def test_trains_resumes_and_packs(images: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for component in ("similarity", "residual"):
        run(component, images, tmp_path, 2)
        first = torch.load(tmp_path / f"{component}.pt", weights_only=True)
        assert (first["step"], first["config"], first["seed"]) == (2, "compact", 0)
        run(component, images, tmp_path, 3)
        then = torch.load(tmp_path / f"{component}.pt", weights_only=True)
        assert then["step"] == 3
        moved = [n for n, v in then["network"].items() if not torch.equal(v, first["network"][n])]
        assert moved
        assert not any("backbone" in name for name in moved)  # frozen, batch statistics too
    assert "shift px" in capsys.readouterr().out
    weights.pack(tmp_path, tmp_path / "w.safetensors")
    packed = weights.load(tmp_path / "w.safetensors").residual.state_dict()
    np.testing.assert_allclose(
        packed["regressor.3.weight"].numpy(), then["network"]["regressor.3.weight"].numpy(), rtol=1e-3, atol=1e-6
    )


def test_packing_needs_both_components(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"similarity\.pt is missing"):
        weights.pack(tmp_path, tmp_path / "w.safetensors")
