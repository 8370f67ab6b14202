"""The matte network trains, goes on and is packed, on a handful of pictures; its figures are what they say."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor, nn

from hdn.networks import loading
from hdn.networks.config import MATTE_SIZE
from hdn.networks.matte_network import MatteNetwork
from hdn.synthesis import MatteBatch, MattePairs, Photos, matte_batch
from hdn.training import matte
from hdn.training.matte import KINDS, MatteObjective, matte_figures

from ..scenes import texture

CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def photos(images: Path) -> Photos:
    return Photos.read(sorted(images.rglob("*.png")))


def command(*arguments: object) -> str:
    """What a run of hdn-train prints.

    In a process of its own: PyTorch 2.13's oneDNN has been seen to break off there on a processor with AMX.
    """
    code = "from hdn.training.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=300,
        env=os.environ | {"ONEDNN_MAX_CPU_ISA": "AVX2"},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_trains_goes_on_is_packed_and_validated(images: Path, tmp_path: Path) -> None:
    small = ("--out", tmp_path, "--batch", 2, "--pairs", 2, "--threads", 1)
    command("matte", "--images", images, "--steps", 1, *small)
    first = torch.load(tmp_path / "matte.pt", weights_only=True)
    assert (first["component"], first["step"], first["held_out"]) == ("matte", 1, "held out: kodak")
    assert "goes on from step 1" in command("matte", "--images", images, "--steps", 2, *small)
    then = torch.load(tmp_path / "matte.pt", weights_only=True)
    assert not torch.equal(then["network"]["stem.0.weight"], first["network"]["stem.0.weight"])
    assert set(then["losses"][-1]) == {"step", "rate", "loss", "entropy", "dice"}

    command("pack", "--matte", tmp_path)
    weights = tmp_path / "hdn_matte.safetensors"
    crop = texture(1, MATTE_SIZE, MATTE_SIZE)
    assert loading.load_matte(weights, "cpu")(crop, crop).shape == (MATTE_SIZE, MATTE_SIZE)
    table = command("validate", "--weights", weights, "--images", images, "--pairs", 2)
    assert f"| {' | '.join(['', *KINDS])} |".strip() in table
    assert "hidden IoU" in table
    again = command("matte", "--images", images, "--steps", 1, "--start", weights, "--out", tmp_path / "b", *small[2:])
    assert f"begins with the weights of {weights}" in again


def test_a_batch_is_what_its_shares_say(photos: Photos) -> None:
    torch.manual_seed(0)
    nothing = MattePairs(negative=0, occluded=0, covered=0, cut=0, framed=0)
    batch = matte_batch(photos, 4, 64, nothing)
    assert batch.frame.shape == batch.template.shape == (4, 3, 64, 64)
    assert batch.frame.max() > 64
    assert (batch.seen == 1).all()
    assert (batch.valid == 1).all()
    assert (batch.around == 0).all()
    for shares in (MattePairs(negative=1), MattePairs(covered=1, negative=0)):
        assert (matte_batch(photos, 4, 64, shares).seen < 0.02).all()
    occluded = matte_batch(photos, 12, 64, MattePairs(negative=0, occluded=1, covered=0, cut=1))
    assert 0.05 < (occluded.seen < 0.5).float().mean() < 0.8
    assert 0.1 < occluded.valid.mean() < 0.95


def test_a_framed_surface_is_seen_with_what_is_around_it(photos: Photos) -> None:
    torch.manual_seed(0)
    batch = matte_batch(photos, 4, 64, MattePairs(negative=0, occluded=0, covered=0, cut=0, framed=1))
    assert (batch.valid[..., 7:-7, 7:-7] == 1).all()
    assert (batch.valid[..., :6] == 0).all()
    assert (batch.around == 1 - batch.valid).all()
    elsewhere = (batch.frame - batch.template).abs().mean(1, keepdim=True)
    assert elsewhere[batch.around == 1].mean() > 1.2 * elsewhere[batch.valid == 1].mean()


def test_without_light_blur_and_occluders_pairs_are_alike(photos: Photos) -> None:
    torch.manual_seed(0)
    plain = MattePairs(negative=0, occluded=0, covered=0, blurred=0, coarse=0, darkened=0, light=0, far=0, cut=0)
    plain = replace(plain, framed=0)
    batch = matte_batch(photos, 6, 64, plain)
    frame, template = (x - x.mean((2, 3), keepdim=True) for x in (batch.frame, batch.template))
    alike = (frame * template).sum((1, 2, 3)) / (frame.flatten(1).norm(dim=1) * template.flatten(1).norm(dim=1))
    assert alike.median() > 0.8


class Always(nn.Module):
    """Says of all pixels the same."""

    def __init__(self, logit: float) -> None:
        super().__init__()
        self.logit = logit

    def forward(self, frame: Tensor, template: Tensor, valid: Tensor, around: Tensor) -> Tensor:
        return torch.full_like(valid, self.logit)


def test_figures_by_hand(photos: Photos, monkeypatch: pytest.MonkeyPatch) -> None:
    crop = torch.zeros(1, 3, 4, 4)
    seen, valid = torch.ones(1, 1, 4, 4), torch.ones(1, 1, 4, 4)
    seen[..., :2, :] = 0  # half is hidden, and a quarter of that is beyond the frame
    valid[..., 0, :2] = 0
    monkeypatch.setattr(matte, "matte_batch", lambda *_: MatteBatch(crop, crop, valid, 1 - valid, seen))
    all_hidden = matte_figures(Always(-3), photos, [1, 1], MattePairs())  # type: ignore[arg-type]
    assert all_hidden == {"hidden IoU": pytest.approx(6 / 14), "hidden kept": 1.0, "surface seen": 0.0}
    all_seen = matte_figures(Always(3), photos, [1], MattePairs())  # type: ignore[arg-type]
    assert all_seen == {"hidden IoU": 0.0, "hidden kept": 0.0, "surface seen": 1.0}


def test_what_is_not_known_teaches_nothing(photos: Photos) -> None:
    torch.manual_seed(0)
    objective = MatteObjective(MatteNetwork().eval(), CPU)
    objective.half = False
    batch = matte_batch(photos, 2, 64, MattePairs(cut=1))
    with torch.no_grad():
        before = objective.losses(batch)
        beyond = batch.valid == 0
        batch.frame = torch.where(beyond & (batch.around == 0), 255.0, batch.frame)
        batch.template = torch.where(beyond, 255.0, batch.template)
        batch.seen = torch.where(beyond, 0.5, batch.seen)
        after = objective.losses(batch)
    for name, value in before.items():
        torch.testing.assert_close(after[name], value)


def test_single_precision_where_the_processor_may_not_use_bfloat16(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cpu, "_is_avx512_bf16_supported", lambda: True)
    monkeypatch.setenv("ONEDNN_MAX_CPU_ISA", "AVX2")
    assert not MatteObjective(MatteNetwork(), CPU).half
    monkeypatch.delenv("ONEDNN_MAX_CPU_ISA")
    assert MatteObjective(MatteNetwork(), CPU).half
