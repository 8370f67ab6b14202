"""Composite quality: its figures against values worked out by hand, and `ar-eval` end to end on a tiny sequence."""

import csv
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from ar_demo.evaluation import cli, report
from ar_demo.evaluation.quality import plain_warp, psnr, quality, regions, ssim
from ar_demo.evaluation.scenes import COMPOSITES, read_scenes
from hdn.benchmark.synthplanar.cli import Setting, generate
from hdn.benchmark.synthplanar.pictures import Pictures
from hdn.errors import InputError

from ..conftest import Main, Run

SQUARE = np.array([[10.0, 10], [29, 10], [29, 29], [10, 29]])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One sequence of SynthPlanar, 6 frames of 256x144."""
    folder = tmp_path_factory.mktemp("made") / "SynthPlanar"
    folder.mkdir()
    generate(folder, "scale", 0, Setting(256, 144, 6), 6, 0, Pictures(None))
    return folder


@pytest.fixture(scope="module")
def evaluated(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What ar-eval leaves of it."""
    out = tmp_path_factory.mktemp("evaluated")
    cli.write(cli.evaluate_all(read_scenes(folder), out), out)
    return out


@pytest.fixture
def main() -> Main:
    return cli.main


def test_psnr_by_hand() -> None:
    truth = np.full((4, 4, 3), 100, np.uint8)
    picture = truth.copy()
    picture[0, 0, 0] = 112  # 144 / 48 values = 3
    everything = np.ones((4, 4), bool)
    assert psnr(picture, truth, everything) == pytest.approx(10 * np.log10(255**2 / 3))
    assert psnr(picture, truth, ~everything) != psnr(picture, truth, ~everything)  # NaN
    rest = everything.copy()
    rest[0, 0] = False
    assert psnr(picture, truth, rest) == pytest.approx(10 * np.log10(255**2 * 12))


def test_ssim_by_hand() -> None:
    a, b = np.full((24, 24), 100, np.uint8), np.full((24, 24), 150, np.uint8)
    c1 = 6.5025
    assert ssim(a, a).min() == pytest.approx(1)
    assert ssim(a, b)[12, 12] == pytest.approx((2 * 100 * 150 + c1) / (100**2 + 150**2 + c1))
    noise = np.random.default_rng(0).integers(0, 256, (64, 64)).astype(np.uint8)
    assert ssim(noise, 255 - noise)[8:-8, 8:-8].mean() < -0.8  # the same structure, upside down
    assert ssim(noise, noise // 2 + 64)[8:-8, 8:-8].mean() == pytest.approx(0.8, abs=0.03)  # 2 * 0.5 / (1 + 0.25)


@pytest.mark.parametrize("quad", [SQUARE, SQUARE[::-1], np.roll(SQUARE, 1, 0)])
def test_regions_by_hand(quad: np.ndarray) -> None:
    inside, edge = regions(quad, (40, 40))
    assert inside.sum() == 20 * 20  # pixel centres on the edge count
    assert inside[10:30, 10:30].all()
    # Rows 7 to 13 and 26 to 32, where 3 px on either side of the edge end; corners are round.
    assert edge[20].nonzero()[0].tolist() == [*range(7, 14), *range(26, 33)]
    assert edge[7, 10]
    assert not edge[7, 7]
    assert edge[8, 8]


def test_a_quad_out_of_the_frame_has_no_quality() -> None:
    frame = np.zeros((40, 40, 3), np.uint8)
    assert quality(frame, frame, SQUARE + 100) is None
    partly = quality(frame, frame, SQUARE + 25)
    assert partly is not None
    assert partly[[1, 3]] == pytest.approx(1)


def test_quality_sees_the_inside_and_the_edge_apart() -> None:
    rng = np.random.default_rng(0)
    truth = rng.integers(0, 256, (40, 40, 3)).astype(np.uint8)
    middle, outside = truth.copy(), truth.copy()
    middle[18:22, 18:22] = 0
    outside[8, 10:30] = 0  # two px off the edge
    (a, _, b, _), (c, _, d, _) = (quality(p, truth, SQUARE) for p in (middle, outside))  # type: ignore[misc]
    assert a < b
    assert c > d
    assert quality(truth, truth, SQUARE) == pytest.approx([10 * np.log10(255**2 * 12), 1] * 2)


def test_the_plain_warp_is_the_ad_itself_where_it_fits_its_pixels() -> None:
    ad = np.random.default_rng(0).integers(0, 256, (20, 20, 3)).astype(np.uint8)
    frame = np.full((40, 40, 3), 7, np.uint8)
    plain_warp(frame, ad, np.array([[9.5, 9.5], [29.5, 9.5], [29.5, 29.5], [9.5, 29.5]]))
    assert (frame[10:30, 10:30] == ad).all()
    frame[10:30, 10:30] = 7
    assert (frame == 7).all()


def test_everything_is_written(folder: Path, evaluated: Path) -> None:
    assert "1 sequences, 6 frames in view" in (evaluated / "quality.md").read_text(encoding="utf-8")
    with (evaluated / "quality.csv").open(encoding="utf-8") as lines:
        rows = list(csv.DictReader(lines))
    assert [(r["attribute"], r["composite"]) for r in rows] == [(a, c) for a in ("all", "scale") for c in COMPOSITES]
    figures = {r["composite"]: {k: float(v) for k, v in r.items() if k[0] in "PS"} for r in rows}
    assert all(8 < f["PSNR inside"] < 50 and 0 < f["SSIM inside"] < 1 for f in figures.values())
    assert figures["true corners"]["SSIM inside"] > figures["plain warp"]["SSIM inside"]
    for kind in ("worst", "median"):
        sheet = cv2.imread(str(evaluated / f"{kind}.png"))
        assert sheet is not None
        assert sheet.shape[1] == 4 * 320


def test_what_was_evaluated_is_kept(
    run: Run, folder: Path, evaluated: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(evaluated, tmp_path, dirs_exist_ok=True)

    def never(*_: object) -> None:
        raise AssertionError("it was there already")

    monkeypatch.setattr(cli, "evaluate", never)
    status, out, err = run(folder, "--out", tmp_path)
    assert (status, err) == (0, "")
    assert (evaluated / "quality.md").read_text(encoding="utf-8") in out
    assert run(folder, "--out", tmp_path, "--quiet")[1] == ""
    assert "it was there already" in run(folder, "--out", tmp_path, "--limit", 3)[2]  # other frames
    monkeypatch.setattr(cli, "digest", lambda _: "other code")
    assert "it was there already" in run(folder, "--out", tmp_path)[2]


def test_true_corners_are_the_truth(folder: Path) -> None:
    (scene,) = read_scenes(folder)
    track = scene.limited(4).true_track()
    assert len(track) == 4
    assert track.counts == {"tracked": 4, "held": 0, "lost": 0}
    assert (track.corners == scene.corners[:4]).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere"], "nowhere is not a folder"),
        (["{empty}"], "holds no sequence of SynthPlanar"),
        (["{folder}", "--only", "x*"], "no sequence is called like 'x*'"),
        (["{folder}", "--limit", "1"], "--limit takes 2 or more"),
        (["{folder}", "--weights", "none.safetensors"], "none.safetensors is missing"),
    ],
)
def test_wrong_input(run: Run, folder: Path, tmp_path: Path, arguments: list[str], message: str) -> None:
    status, out, err = run(*(a.format(folder=folder, empty=tmp_path) for a in arguments), "--out", tmp_path / "out")
    assert (status, out) == (2, "")
    assert message in err
    assert err.startswith("error: ")
    assert err.count("\n") == 1


def test_a_sequence_without_its_true_clip_is_refused(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "scale-01.json").write_text((folder / "scale-01.json").read_text())
    with pytest.raises(InputError, match=r"scale-01\.mp4 is missing"):
        read_scenes(tmp_path)


@pytest.mark.usefixtures("shared_networks")
def test_the_report_says_everything(
    folder: Path, evaluated: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(evaluated, tmp_path / "out" / "composites")
    monkeypatch.setattr(report, "DEGRADATIONS", {"dark": "at night"})
    monkeypatch.setattr(report, "_make_clips", lambda *_: folder)
    monkeypatch.setattr(report, "ALL", ("ecc", "flow"))
    monkeypatch.setattr(report, "COMPARED", ("ar-track", "flow"))
    monkeypatch.setattr(report, "WORKERS", 1)  # another process would have to load all modules
    written = tmp_path / "docs.md"
    with pytest.raises(SystemExit) as stop:
        report.main([str(folder), "--out", str(tmp_path / "out"), "--report", str(written), "--clip-frames", "5"])
    assert stop.value.code == 0, capsys.readouterr().err
    text = written.read_text(encoding="utf-8")
    titles = ("SynthPlanar", "SynthPlanar, interrupted views", "real clips")
    others = ("Composites: SynthPlanar", "Composites: what has to pass for real", "Published figures, for orientation")
    for line in (*(f"Tracking: {title}" for title in titles), *others):
        assert f"\n## {line}\n" in text
    assert "dark: at night" in text
    assert "the first 5 frames of each" in text
    assert "**Not measured here.**" in text
    harder = text.split("### The same clips made harder")[1]
    for title in ("Average precision, mean", "P<=5, mean", "Share of the frames called `tracked`"):
        table = harder.split(f"{title}")[1].split("\n\n")[1].splitlines()
        assert table[0] == "| tracker | clean | dark | all |"
        assert [line.split(" | ")[0] for line in table[2:]] == ["| ar-track", "| flow"]
    shown = [part.split(")")[0] for part in text.split("](")[1:]]
    assert len(shown) == 7
    for name in shown:
        assert 0 < (tmp_path / name).stat().st_size < 100_000
