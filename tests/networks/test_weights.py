from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file

from hdn.errors import InputError
from hdn.networks import pytorch
from hdn.networks.config import PAPER
from hdn.networks.weights import shipped


def test_round_trip_is_half_precision(network: pytorch.Hdn, tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    pytorch.save(network, path, {"made": "by a test"})
    again = pytorch.load(path).state_dict()
    for name, value in network.state_dict().items():
        torch.testing.assert_close(again[name], value, atol=0, rtol=1e-3)


def test_the_paper_s_stay_in_single_precision(tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    network = pytorch.Hdn(PAPER)
    variance = torch.full((64,), 1e5)  # as of its inputs of 0..255; half precision ends at 65504
    network.similarity.backbone.bn1.running_var.copy_(variance)
    pytorch.save(network, path, {})
    again = pytorch.load(path)
    assert again.config is PAPER
    assert torch.equal(again.similarity.backbone.bn1.running_var, variance)


def test_shipped_weights_are_small() -> None:
    assert shipped().stat().st_size < 15e6


def test_missing(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="missing"):
        pytorch.load(tmp_path / "none.safetensors")


def test_not_weights(tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    path.write_bytes(b"nothing of the kind")
    with pytest.raises(InputError, match="not a safetensors file"):
        pytorch.load(path)


@pytest.mark.parametrize(("config", "message"), [("huge", "configuration 'huge'"), ("compact", "does not fit")])
def test_another_architecture(tmp_path: Path, config: str, message: str) -> None:
    path = tmp_path / "w.safetensors"
    save_file({"a": torch.zeros(2)}, path, {"config": config})
    with pytest.raises(InputError, match=message):
        pytorch.load(path)
