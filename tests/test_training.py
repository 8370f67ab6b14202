"""Training runs, resumes and packs in both configurations, on a handful of pictures."""

import csv
from dataclasses import replace
from pathlib import Path

import cv2
import pytest
import torch

from hdn import weights
from hdn.config import COMPACT, PAPER, Config
from hdn.errors import InputError
from hdn.residual import ResidualNetwork
from hdn.similarity import SimilarityNetwork
from hdn.training import ablation, objectives
from hdn.training.backbones import adapted, load_backbone
from hdn.training.cli import main
from hdn.training.loop import Data, train
from hdn.training.objectives import ResidualObjective, SimilarityObjective
from hdn.training.packing import pack
from hdn.training.recipes import RECIPES
from hdn.training.validation import Figures, percentiles, roc_area

from .scenes import texture

CPU = torch.device("cpu")
# Slimmer, for time; `test_parity` has it in full.
SLIM = {
    "compact": COMPACT,
    "paper": replace(
        PAPER, channels=8, template_size=71, search_size=143, polar_size=63, polar_reach=3, residual_size=63
    ),
}


@pytest.fixture(scope="module")
def shipped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A weights file as it ships, but of an untrained network."""
    torch.manual_seed(0)
    path = tmp_path_factory.mktemp("weights") / weights.FILE_NAME
    weights.save(weights.Hdn(), path, {})
    return path


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("images")
    for source, count in (("bsds500", 4), ("kodak", 2)):
        (folder / source).mkdir()
        for i in range(count):
            cv2.imwrite(str(folder / source / f"{i}.png"), texture(i, 200, 160))
    return folder


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clips") / "GOT-10k_Train_000001"
    folder.mkdir()
    picture = texture(7, 220, 160)
    for i in range(4):
        cv2.imwrite(str(folder / f"{i + 1:08}.jpg"), picture[:, 2 * i : 2 * i + 200])
    return folder.parent


@pytest.fixture(scope="module")
def data(images: Path, clips: Path) -> Data:
    return Data.open([images], [clips], CPU, 0)


def run(component: str, data: Data, out: Path, steps: int, config: Config = COMPACT) -> dict[str, Figures]:
    return train(component, data, out, config, steps=steps, batch=3, validation_pairs=3, device=CPU)


@pytest.mark.parametrize("component", ["similarity", "residual"])
def test_trains_and_resumes(component: str, data: Data, tmp_path: Path) -> None:
    figures = run(component, data, tmp_path, 1)
    first = torch.load(tmp_path / f"{component}.pt", weights_only=True)
    assert [first[key] for key in ("component", "config", "seed", "step")] == [component, "compact", 0, 1]
    assert first["recipe"]["steps"] == 1
    assert first["images"] == data.sources["images"]
    assert first["held_out"] == "held out: kodak"
    assert set(figures) == {"clean", "hard"}

    run(component, data, tmp_path, 2)
    then = torch.load(tmp_path / f"{component}.pt", weights_only=True)
    assert then["step"] == 2
    moved = [n for n, v in then["network"].items() if not torch.equal(v, first["network"][n])]
    assert moved
    if component == "similarity":
        assert not any("backbone" in name for name in moved)  # frozen, batch statistics too
    with open(tmp_path / f"{component}.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["step"] for row in rows] == ["1", "2"]
    parts = sum(float(value) for name, value in rows[1].items() if name not in ("step", "rate", "loss"))
    assert parts == pytest.approx(float(rows[1]["loss"]), rel=1e-4)
    with open(tmp_path / f"{component}_validation.csv", newline="") as file:
        assert len(list(csv.DictReader(file))) == 2
    assert cv2.imread(str(tmp_path / f"{component}.png")) is not None


@pytest.mark.parametrize(
    ("component", "losses"),
    [
        ("similarity", {"classification", "offset", "polar classification", "polar offset"}),
        ("residual", {"negative", "triplet images", "triplet clips", "corner"}),
    ],
)
def test_the_paper_s_configuration_trains(
    component: str, losses: set[str], data: Data, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # To convert a ResNet-50 would take longer than all else here.
    monkeypatch.setattr(objectives, "frozen_features", lambda network, _: network.backbone)
    figures = run(component, data, tmp_path, 1, SLIM["paper"])
    assert {len(part) for part in figures.values()} == {8 if component == "similarity" else 5}
    state = torch.load(tmp_path / f"{component}.pt", weights_only=True)
    assert (state["config"], state["recipe"]["decay"]) == ("paper", "exponential")
    with open(tmp_path / f"{component}.csv", newline="") as file:
        assert set(next(csv.DictReader(file))) == losses | {"step", "rate", "loss"}


def test_a_seed_gives_the_same_losses(data: Data, tmp_path: Path) -> None:
    for name in ("a", "b"):
        run("residual", data, tmp_path / name, 1)
    assert (tmp_path / "a/residual.csv").read_text() == (tmp_path / "b/residual.csv").read_text()


@pytest.mark.parametrize(("component", "config"), [("residual", PAPER), ("similarity", COMPACT)])
def test_another_configuration_or_component_does_not_resume(
    component: str, config: Config, data: Data, tmp_path: Path
) -> None:
    state = {"component": "residual", "config": "compact"}
    torch.save(state, tmp_path / f"{component}.pt")
    with pytest.raises(InputError, match="is of the residual component, configuration compact"):
        run(component, data, tmp_path, 1, config)


def test_the_compact_rate_warms_up_and_falls_to_zero() -> None:
    recipe = RECIPES["compact"]
    assert recipe.rate(0, 1000) == pytest.approx(2e-3 / 200)
    assert recipe.rate(500, 1000) == pytest.approx(1e-3)
    assert recipe.rate(1000, 1000) == pytest.approx(0)


def test_the_paper_s_rate_is_as_it_says() -> None:
    recipe = RECIPES["paper"]
    steps = 30 * 100
    assert recipe.rate(0, steps) == pytest.approx(0.001)
    assert recipe.rate(99, steps) == pytest.approx(0.005, rel=0.01)
    assert recipe.rate(100, steps) == recipe.rate(199, steps) == pytest.approx(0.0012)
    assert recipe.rate(200, steps) == pytest.approx(0.0012 * 0.8)
    assert recipe.rate(steps - 1, steps) == pytest.approx(2e-6, rel=0.2)


def test_packs_two_checkpoints_of_one_configuration(tmp_path: Path, shipped: Path) -> None:
    network = weights.load(shipped)
    paths = [tmp_path / f"{component}.pt" for component in ("similarity", "residual")]
    for path in paths:
        state = {"network": getattr(network, path.stem).state_dict(), "config": "compact", "step": 7, "seed": 3}
        torch.save(state, path)
    written = pack(*paths, tmp_path)  # type: ignore[call-arg]
    assert written == tmp_path / "hdn_compact.safetensors"
    packed = weights.load(written).state_dict()
    torch.testing.assert_close(packed, network.state_dict(), rtol=1e-3, atol=1e-6)
    torch.save(state | {"config": "paper"}, paths[1])
    with pytest.raises(InputError, match="is of configuration paper"):
        pack(*paths, tmp_path / "w.safetensors")  # type: ignore[call-arg]
    paths[0].unlink()
    with pytest.raises(InputError, match=r"similarity\.pt is missing: run hdn-train similarity"):
        pack(*paths, tmp_path / "w.safetensors")  # type: ignore[call-arg]


def test_a_usual_resnet_50_sees_what_ours_sees() -> None:
    torch.manual_seed(0)
    ours = weights.Hdn(SLIM["paper"]).similarity.backbone.state_dict()
    usual = {name: value.clone() for name, value in ours.items()} | {"fc.weight": torch.zeros(1000, 2048)}
    for stage in (2, 3, 4):
        name = f"layer{stage}.0.downsample.0.weight"
        usual[name] = usual[name][:, :, 1:2, 1:2].clone()
    theirs = adapted(usual)
    for stage in (2, 3, 4):
        assert theirs[f"layer{stage}.0.downsample.0.weight"].shape[2:] == (3, 3)
    rgb = torch.rand(1, 3, 15, 15)
    normal = (rgb - torch.tensor([0.485, 0.456, 0.406])[:, None, None]) / torch.tensor([0.229, 0.224, 0.225])[
        :, None, None
    ]
    wanted = torch.conv2d(normal, usual["conv1.weight"]) - usual["bn1.running_mean"][:, None, None]
    got = torch.conv2d(rgb.flip(1) * 255, theirs["conv1.weight"]) - theirs["bn1.running_mean"][:, None, None]
    torch.testing.assert_close(got, wanted, atol=1e-4, rtol=1e-4)


def test_a_weights_file_of_ours_gives_its_backbone(shipped: Path) -> None:
    similarity = weights.Hdn().similarity
    load_backbone(similarity, shipped)
    expected = weights.load(shipped).similarity.backbone.state_dict()
    torch.testing.assert_close(similarity.backbone.state_dict(), expected, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("config", SLIM.values(), ids=SLIM)
def test_a_backbone_that_does_not_fit_is_named(config: Config, tmp_path: Path, shipped: Path) -> None:
    torch.save({"a": torch.zeros(1)}, tmp_path / "b.pth")
    (tmp_path / "b.safetensors").write_bytes(b"none")
    similarity = SimilarityNetwork(config)
    for path in (tmp_path / "b.pth", tmp_path / "b.safetensors", *([shipped] if config.name == "paper" else [])):
        with pytest.raises(InputError, match=f"{path.name} does not fit the backbone {config.backbone}"):
            load_backbone(similarity, path)
    with pytest.raises(InputError, match=r"none\.pth are missing"):
        load_backbone(similarity, tmp_path / "none.pth")


def test_percentiles_and_roc_area_by_hand() -> None:
    assert percentiles("x", torch.arange(11.0)) == {"x median": 5, "x p90": 9}
    assert roc_area(torch.tensor([0.9, 0.5]), torch.tensor([0.1, 0.5])) == pytest.approx(3.5 / 4)


def test_validate_prints_the_same_table_each_time(
    images: Path, shipped: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(weights, "shipped", lambda: shipped)
    tables = []
    for _ in range(2):
        with pytest.raises(SystemExit) as status:
            main(["validate", "--weights", "shipped", "--images", str(images), "--pairs", "4"])
        assert status.value.code == 0
        tables.append(capsys.readouterr().out)
    assert tables[0] == tables[1]
    assert "2 images, of held-out sources" in tables[0]
    for name in ("clean | hard", "translation px median", "rotation rad p90", "corners px p90", "visible AUC"):
        assert name in tables[0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["residual", "--out", "o"], "no images under no folder"),
        (["residual", "--out", "o", "--images", "missing"], "--images missing is not a folder"),
        (["residual", "--out", "o", "--steps", "0"], "--steps takes 1 or more"),
        (["residual", "--out", "o", "--device", "warp"], "--device warp cannot be used"),
        (["residual", "--out", "o", "--config", "huge"], "invalid choice: 'huge'"),
        (["pack", "--out", "nowhere"], "nowhere/similarity.pt is missing"),
        (["validate", "--weights", "no.safetensors", "--images", "."], "no.safetensors is missing"),
        ([], "required: COMMAND"),
    ],
)
def test_errors_take_one_line(
    arguments: list[str],
    message: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as status:
        main(arguments)
    assert status.value.code == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_the_ablation_trains_each_variant_once_and_reports(
    data: Data, tmp_path: Path, shipped: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trained = []
    network = weights.load(shipped)

    def fake(component: str, data: Data, out: Path, *args: object, **options: object) -> dict[str, Figures]:
        trained.append((component, out.name, options["recipe"]))
        out.mkdir(parents=True)
        state = {"network": getattr(network, component).state_dict(), "config": "compact", "step": 2, "seed": 0}
        torch.save(state, out / f"{component}.pt")
        return {look: {"corners px median": float(len(trained))} for look in ("clean", "hard")}

    monkeypatch.setattr(ablation, "train", fake)
    settings = {"steps": 2, "batch": 3, "backbone": None, "device": CPU, "seed": 5}
    report = ablation.run(data, tmp_path, COMPACT, **settings)  # type: ignore[arg-type]
    assert [name for _, name, _ in trained] == [*ablation.SIMILARITY, *ablation.RESIDUAL]
    assert len({recipe for _, _, recipe in trained}) == 7
    text = report.read_text()
    assert "2 steps of 3 pairs, seed 5" in text
    assert text.count("| 8 | full |") == 2
    assert (tmp_path / "without-rotated-labels.safetensors").exists()
    with pytest.raises(InputError, match="name some with --videos"):
        ablation.run(replace(data, clips=None), tmp_path, COMPACT, **settings)  # type: ignore[arg-type]


@pytest.mark.parametrize("variant", ablation.RESIDUAL)
def test_a_residual_variant_has_the_losses_that_its_name_says(variant: str, data: Data) -> None:
    torch.manual_seed(0)
    recipe = replace(RECIPES["compact"], **ablation.RESIDUAL[variant])
    objective = ResidualObjective(ResidualNetwork(COMPACT), recipe, CPU)
    batch = objective.sample(data.photos, data.clips, 12)
    assert int((~batch.labelled).sum()) == (0 if variant == "supervised" else 3)
    assert bool((~batch.positive).any()) == (variant != "no-negatives")
    parts = {name: float(value.detach()) for name, value in objective.losses(batch).items()}
    assert (parts.get("triplet clips", 0) > 0) == (variant != "supervised")
    assert (parts["matching"] > 0) == (parts["corner"] > 0) == (variant != "unsupervised")
    assert (parts["negative"] > 0) == (variant != "no-negatives")


def test_similarity_variants_change_the_labels_and_the_negatives(data: Data, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(objectives, "frozen_features", lambda network, _: network.backbone)
    network = SimilarityNetwork(COMPACT)
    values = {}
    for variant, changes in ablation.SIMILARITY.items():
        objective = SimilarityObjective(network, replace(RECIPES["compact"], **changes), CPU)
        torch.manual_seed(3)
        values[variant] = float(objective.losses(objective.sample(data.photos, None, 4))["classification"].detach())
    assert len(set(values.values())) == 3
    assert values["no-hard-negatives"] < values["full"]  # easy negatives dilute the loss
