"""The networks that ship as OpenVINO IR: of the shipped weights, and the same as PyTorch's."""

import logging
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch

from hdn.errors import InputError
from hdn.networks import conversion, loading, pytorch, torch_engine
from hdn.networks.config import COMPACT, PAPER
from hdn.networks.engine import Engine
from hdn.networks.openvino import read_ir
from hdn.networks.weights import FILE_NAME, shipped

from ..scenes import texture


def crop(seed: int, height: int, width: int | None = None) -> np.ndarray:
    return texture(seed, width or height, height)[None]


def test_it_is_that_of_the_shipped_weights() -> None:
    assert read_ir(shipped()) is not None


def test_it_computes_what_pytorch_does(engine: Engine, network: pytorch.Hdn) -> None:
    c, ours, theirs = COMPACT, engine.functions, torch_engine.engine(network, "cpu").functions
    for seed in range(3):
        template, polar = crop(seed, c.template_size), crop(seed + 10, c.polar_size)
        kernel, polar_kernel, described = (
            ours.encode(template)[0],
            ours.encode_polar(polar)[0],
            ours.describe(crop(seed + 20, c.residual_size))[0],
        )
        for name, inputs in {
            "encode": (template,),
            "encode_polar": (polar,),
            "describe": (crop(seed + 20, c.residual_size),),
            "translation": (kernel, crop(seed + 30, c.search_size)),
            "survey": (kernel, crop(seed + 40, 239, 303)),
            "polar": (polar_kernel, crop(seed + 50, c.polar_size)),
            "compare": (described, crop(seed + 20, c.residual_size)),
        }.items():
            found, expected = (getattr(functions, name)(*inputs) for functions in (ours, theirs))
            assert len(found) == len(expected)
            for one, other in zip(found, expected, strict=True):
                assert one.dtype == np.float32
                np.testing.assert_allclose(one, other, atol=2e-4 * np.abs(other).max(), err_msg=name)


def test_the_conclusion_is_that_of_training(network: pytorch.Hdn, engine: Engine) -> None:
    described = engine.describe(crop(1, COMPACT.residual_size)[0])
    outputs = engine.functions.compare(described, crop(2, COMPACT.residual_size))
    offsets, visible = engine.functions.conclude(*outputs)
    expected, seen = network.residual.conclude(*(torch.from_numpy(x).double() for x in outputs))
    np.testing.assert_allclose(offsets, expected[0].numpy(), atol=1e-5)
    np.testing.assert_allclose(visible, seen[0].numpy(), atol=1e-6)


def test_it_is_made_again_from_the_weights(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / FILE_NAME
    shutil.copy(shipped(), path)
    assert read_ir(path) is None
    with caplog.at_level(logging.INFO):
        converted = loading.load_engine(path, "cpu")
    assert "converted by PyTorch" in caplog.text
    conversion.pack_ir(path)
    caplog.clear()
    with caplog.at_level(logging.INFO):
        again = loading.load_engine(path, "cpu")
    assert not caplog.text
    template, polar = crop(0, COMPACT.template_size)[0], crop(1, COMPACT.polar_size)[0]
    for one, other in zip(
        converted.encode_template(template, polar), again.encode_template(template, polar), strict=True
    ):
        np.testing.assert_allclose(one, other, atol=1e-5 * np.abs(other).max())


def test_it_is_not_taken_for_other_weights(tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    pytorch.save(pytorch.Hdn(), path, {})
    shutil.copy(shipped().with_suffix(".openvino.zip"), tmp_path / "w.openvino.zip")
    assert read_ir(path) is None


def test_the_paper_s_weights_have_none(tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    pytorch.save(pytorch.Hdn(PAPER), path, {})
    with pytest.raises(InputError, match="runs with PyTorch alone"):
        conversion.pack_ir(path)


def test_without_a_driver_of_cuda_the_device_is_the_cpu(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loading, "_may_have_cuda", lambda: False)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: pytest.fail("PyTorch was asked"))
    assert loading.choose_device("auto") == loading.choose_device("cpu") == "cpu"


@pytest.mark.parametrize("there", [True, False])
def test_with_a_driver_pytorch_is_asked(monkeypatch: pytest.MonkeyPatch, there: bool) -> None:
    monkeypatch.setattr(loading, "_may_have_cuda", lambda: True)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: there)
    assert loading.choose_device("auto") == ("cuda" if there else "cpu")
