"""The authors' checkpoint, by its names, to weights of the paper's configuration, and tracking with them."""

import logging
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from hdn import Tracker
from hdn.errors import InputError
from hdn.networks import importing, pytorch, torch_engine
from hdn.networks.config import PAPER

from ..scenes import Scene, moved

# A name of each kind that the released file has, with its shape.
NAMES = {
    "backbone.layer2.0.downsample.0.weight": (512, 256, 3, 3),
    "backbone.layer4.2.bn3.running_var": (2048,),
    "neck.downsample3.downsample.0.weight": (256, 1024, 1, 1),
    "neck_lp.downsample4.downsample.1.bias": (256,),
    "head.cls_weight": (3,),
    "head.box2.cls.conv_kernel.0.weight": (256, 256, 3, 3),
    "head.box4.loc.head.3.bias": (2,),
    "head_lp.box3.loc.conv_search.1.running_mean": (256,),
    "head_lp.box3.loc.head.3.weight": (4, 256, 1, 1),
    "head_lp.loc_scale": (3,),
    "hm_net.ShareFeature.ShareFeature.6.weight": (1, 8, 3, 3),
    "hm_net.backbone.layer3.5.conv2.weight": (256, 256, 3, 3),
    "hm_net.fc.bias": (8,),
}


PARTS = {"template": "conv_kernel", "search": "conv_search", "head": "head"}


def their_name(ours: str) -> str:
    """The authors' name for a tensor of ours."""
    component, name = ours.split(".", 1)
    if component == "residual":
        return "hm_net." + name.replace("extractor.", "ShareFeature.ShareFeature.")
    if name.startswith("backbone."):
        return name
    branch, kind, *rest = name.split(".")
    suffix = {"translation": "", "polar": "_lp"}[branch]
    if kind == "necks":
        level, *rest = rest
        return ".".join([f"neck{suffix}.downsample{level}.downsample", *rest])
    if rest:
        level, part, *rest = rest
        return ".".join([f"head{suffix}.box{level}.{kind}.{PARTS[part]}", *rest])
    return f"head{suffix}.{kind}"


@pytest.fixture(scope="module")
def checkpoint() -> dict[str, Tensor]:
    """Random weights by the authors' names, as their trainer saves them; all kinds of names occur."""
    torch.manual_seed(0)
    tensors = {their_name(name): value for name, value in pytorch.Hdn(PAPER).state_dict().items()}
    assert NAMES.items() <= {name: tuple(value.shape) for name, value in tensors.items()}.items()
    tensors["hm_net.fc.weight"].mul_(0.01)  # small offsets, as of a trained network
    return tensors


@pytest.fixture(scope="module")
def imported(checkpoint: dict[str, Tensor], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("import")
    source, output = folder / "hdn.pth", folder / "hdn_paper.safetensors"
    torch.save({"epoch": 30, "state_dict": {"module." + name: value for name, value in checkpoint.items()}}, source)
    with pytest.raises(SystemExit) as done:
        importing.main([str(source), "-o", str(output)])
    assert done.value.code == 0
    source.unlink()
    return output


@pytest.mark.parametrize("name", NAMES)
def test_every_name_has_its_place(name: str) -> None:
    with torch.device("meta"):
        expected = pytorch.Hdn(PAPER).state_dict()
    assert tuple(expected[importing.our_name(name)].shape) == NAMES[name]


def test_weights_are_kept_to_the_bit(checkpoint: dict[str, Tensor], imported: Path) -> None:
    network = pytorch.load(imported)
    assert network.config is PAPER
    tensors = network.state_dict()
    assert len(tensors) == len(checkpoint)
    for name, value in checkpoint.items():
        assert torch.equal(tensors[importing.our_name(name)], value)


def test_tracker_runs_the_paper_networks(imported: Path) -> None:
    scene = Scene()
    tracker = Tracker(engine=torch_engine.engine(pytorch.load(imported), "cpu"))  # it starts faster than OpenVINO
    tracker.init(scene.draw(scene.quad), scene.quad)
    estimate = tracker.track(scene.draw(moved(scene.quad, (2, -1))))
    # Random networks say anything, and on each processor another thing: no figures.
    assert estimate.state in ("tracked", "held")
    assert estimate.corners.shape == (4, 2)
    assert np.isfinite(estimate.homography).all()
    assert 0 <= estimate.evidence.score <= 1


def test_networks_that_answer_nothing_leave_the_target_where_it_was(checkpoint: dict[str, Tensor]) -> None:
    silent = {name: value.clone() for name, value in checkpoint.items()}
    for name in silent:  # the last layers
        if ".head.3." in name or name.startswith("hm_net.fc."):
            silent[name].zero_()
    scene = Scene()
    tracker = Tracker(engine=torch_engine.engine(importing.to_network(silent), "cpu"))
    tracker.init(scene.draw(scene.quad), scene.quad)
    proposal = tracker.propose(scene.draw(moved(scene.quad, (2, -1))))
    np.testing.assert_allclose(proposal.homography, np.eye(3), atol=1e-6)
    assert proposal.score == proposal.polar_score == pytest.approx(0.5)  # of two equal logits
    assert proposal.residual == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c.pop("hm_net.fc.bias"), r"lacks 1 of 836 tensors \(residual\.fc\.bias\)"),
        (lambda c: c.update({"hm_net.fc.bias": torch.zeros(9)}), r"hm_net\.fc\.bias \(9,\), not \(8,\)"),
        (lambda c: [c.pop(name) for name in list(c)[:900]], "lacks 836 of 836"),
    ],
)
def test_wrong_tensors_are_named(checkpoint: dict[str, Tensor], change: object, message: str) -> None:
    changed = dict(checkpoint)
    change(changed)  # type: ignore[operator]
    with pytest.raises(InputError, match=message):
        importing.to_network(changed)


def test_tensors_of_no_use_are_announced(checkpoint: dict[str, Tensor], caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        importing.to_network({**checkpoint, "mask_head.weight": torch.zeros(1)})
    assert "1 tensors" in caplog.text
    assert "mask_head.weight" in caplog.text


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "missing"),
        (b"no checkpoint", "cannot be read"),
        ({"state_dict": [1, 2]}, "holds no state dict"),
        ({"state_dict": {"weight": np.float64}}, "cannot be read"),
    ],
)
def test_refuses_other_files(tmp_path: Path, content: object, message: str) -> None:
    path = tmp_path / "w.pth"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content is not None:
        torch.save(content, path)
    with pytest.raises(InputError, match=message) as caught:
        importing.read_checkpoint(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("output", ["w.safetensors", "no folder/w.safetensors"])
def test_command_fails_on_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str], output: str) -> None:
    with pytest.raises(SystemExit) as caught:
        importing.main([str(tmp_path / "none.pth"), "-o", str(tmp_path / output)])
    assert caught.value.code == 2
    assert capsys.readouterr().err.count("\n") == 1
