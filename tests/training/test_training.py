"""Training runs, resumes and packs in both configurations, on a handful of pictures."""

import csv
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from safetensors import safe_open

from hdn.benchmark.metrics import roc_area
from hdn.errors import InputError
from hdn.networks import pytorch, weights
from hdn.networks.config import COMPACT, PAPER, Config
from hdn.networks.residual import ResidualNetwork
from hdn.networks.similarity import SimilarityNetwork
from hdn.synthesis import residual_batch
from hdn.training import ablation, curves, objectives, validation
from hdn.training.cli import main
from hdn.training.initial import adapted, load_backbone
from hdn.training.loop import COMPONENTS, Data, train
from hdn.training.objectives import BranchObjective, Objective, PolarObjective, ResidualObjective, TranslationObjective
from hdn.training.packing import pack
from hdn.training.recipes import RECIPES
from hdn.training.validation import Figures, percentiles

from ..scenes import texture

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
    pytorch.save(pytorch.Hdn(), path, {})
    return path


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


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without what takes longer than the training here: converting the backbone, and drawing curves."""
    monkeypatch.setattr(objectives, "frozen_features", lambda network, _: network.backbone)
    monkeypatch.setattr(curves, "plot", lambda *_: True)


def run(
    component: str, data: Data, out: Path, steps: int, config: Config = COMPACT, start: Path | None = None
) -> dict[str, Figures]:
    return train(component, data, out, config, steps=steps, batch=3, validation_pairs=3, start=start, device=CPU)


@pytest.mark.parametrize("component", COMPONENTS)
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
    assert any(name.endswith("running_mean") for name in moved)
    if component != "residual":
        assert all(name.startswith(f"{component}.") for name in moved)  # all else is frozen, batch statistics too
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
        ("translation", {"classification", "offset"}),
        ("polar", {"polar classification", "polar offset"}),
        ("residual", {"negative", "triplet images", "triplet clips", "corner"}),
    ],
)
@pytest.mark.usefixtures("quick")
def test_the_paper_s_configuration_trains(component: str, losses: set[str], data: Data, tmp_path: Path) -> None:
    figures = run(component, data, tmp_path, 1, SLIM["paper"])
    assert {len(part) for part in figures.values()} == {{"translation": 3, "polar": 5, "residual": 7}[component]}
    state = torch.load(tmp_path / f"{component}.pt", weights_only=True)
    assert (state["config"], state["recipe"]["decay"]) == ("paper", "exponential")
    with open(tmp_path / f"{component}.csv", newline="") as file:
        assert set(next(csv.DictReader(file))) == losses | {"step", "rate", "loss"}


@pytest.mark.usefixtures("quick")
def test_a_seed_gives_the_same_losses(data: Data, tmp_path: Path) -> None:
    for name in ("a", "b"):
        run("residual", data, tmp_path / name, 1)
    assert (tmp_path / "a/residual.csv").read_text() == (tmp_path / "b/residual.csv").read_text()


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(("objective", "branch"), [(TranslationObjective, "translation"), (PolarObjective, "polar")])
def test_a_branch_alone_is_taught(objective: type[BranchObjective], branch: str) -> None:
    network = SimilarityNetwork(COMPACT)
    objective(network, RECIPES["compact"], CPU).taught.train()  # type: ignore[call-arg]
    assert {name.split(".")[0] for name, p in network.named_parameters() if p.requires_grad} == {branch}
    assert {name.split(".")[0] for name, module in network.named_modules() if module.training} == {branch}


@pytest.mark.parametrize(("component", "config"), [("residual", PAPER), ("polar", COMPACT)])
def test_another_configuration_or_component_does_not_resume(
    component: str, config: Config, data: Data, tmp_path: Path
) -> None:
    state = {"component": "residual", "config": "compact"}
    torch.save(state, tmp_path / f"{component}.pt")
    with pytest.raises(InputError, match="is of the residual component, configuration compact"):
        run(component, data, tmp_path, 1, config)


@pytest.mark.usefixtures("quick")
def test_begins_with_given_weights_and_keeps_their_name(
    data: Data, tmp_path: Path, shipped: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run("polar", data, tmp_path, 1, start=shipped)
    assert f"polar: begins with the weights of {shipped}" in capsys.readouterr().out
    first = torch.load(tmp_path / "polar.pt", weights_only=True)
    assert (first["step"], first["start"]) == (1, str(shipped))
    given = pytorch.load(shipped).similarity.state_dict()
    moved = {name: value for name, value in first["network"].items() if not torch.equal(value, given[name])}
    assert all(name.startswith("polar.") for name in moved)
    with open(tmp_path / "polar.csv", newline="") as file:
        assert float(next(csv.DictReader(file))["rate"]) == pytest.approx(2e-3 / 200 / 4)
    # One step at the schedule's first rate, a hundredth of the highest, goes no farther.
    assert all((value - given[name]).abs().max() < 1e-3 for name, value in moved.items() if name.endswith("weight"))

    run("polar", data, tmp_path, 2)
    then = torch.load(tmp_path / "polar.pt", weights_only=True)
    assert (then["step"], then["start"]) == (2, str(shipped))  # goes on with or without the option
    other = shipped.with_name("other.safetensors")
    with pytest.raises(InputError, match=f"began with {shipped}, not with {other}"):
        run("polar", data, tmp_path, 3, start=other)


def test_weights_of_another_configuration_are_no_start(data: Data, tmp_path: Path, shipped: Path) -> None:
    with pytest.raises(InputError, match="is of configuration compact: name weights of paper"):
        run("residual", data, tmp_path, 1, PAPER, shipped)


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


def test_packs_each_component_from_its_own_checkpoint(tmp_path: Path) -> None:
    torch.manual_seed(1)
    trained = {component: pytorch.Hdn() for component in COMPONENTS}
    backbone = trained["translation"].similarity.backbone
    trained["polar"].similarity.backbone = backbone
    paths = [tmp_path / f"{component}.pt" for component in COMPONENTS]
    states = []
    for step, path in enumerate(paths):
        network = trained[path.stem]
        part = network.residual if path.stem == "residual" else network.similarity
        states.append({"network": part.state_dict(), "config": "compact", "step": step, "seed": 3})
    states[1]["start"] = "somewhere/w.safetensors"
    for state, path in zip(states, paths, strict=True):
        torch.save(state, path)

    written = pack(*paths, tmp_path)  # type: ignore[call-arg]
    assert written == tmp_path / "hdn_compact.safetensors"
    packed = pytorch.load(written)
    for ours, theirs in (
        (packed.similarity.backbone, backbone),
        (packed.similarity.translation, trained["translation"].similarity.translation),
        (packed.similarity.polar, trained["polar"].similarity.polar),
        (packed.residual, trained["residual"].residual),
    ):
        torch.testing.assert_close(ours.state_dict(), theirs.state_dict(), rtol=1e-3, atol=1e-6)
    with safe_open(written, framework="pt") as file:
        assert file.metadata() == {
            "config": "compact",
            "translation": "0 steps, seed 3",
            "polar": "1 steps, seed 3, begun with w.safetensors",
            "residual": "2 steps, seed 3",
        }

    torch.save(states[1] | {"network": pytorch.Hdn().similarity.state_dict()}, paths[1])
    with pytest.raises(InputError, match=r"polar\.pt stands on another backbone than .*translation\.pt"):
        pack(*paths, tmp_path)  # type: ignore[call-arg]
    torch.save(states[2] | {"config": "paper"}, paths[2])
    with pytest.raises(InputError, match=r"residual\.pt is of configuration paper"):
        pack(*paths, tmp_path)  # type: ignore[call-arg]
    paths[0].unlink()
    with pytest.raises(InputError, match=r"translation\.pt is missing: run hdn-train translation"):
        pack(*paths, tmp_path)  # type: ignore[call-arg]


def test_a_backbone_in_half_precision_is_the_same_one(tmp_path: Path) -> None:
    network = pytorch.Hdn()
    rounded = {n: v.half().float() if v.is_floating_point() else v for n, v in network.similarity.state_dict().items()}
    parts = {
        "translation": network.similarity.state_dict(),
        "polar": rounded,
        "residual": network.residual.state_dict(),
    }
    for component, state in parts.items():
        torch.save({"network": state, "config": "compact", "step": 1, "seed": 0}, tmp_path / f"{component}.pt")
    assert pack(*(tmp_path / f"{component}.pt" for component in COMPONENTS), tmp_path).exists()  # type: ignore[call-arg]


def test_a_usual_resnet_50_sees_what_ours_sees() -> None:
    torch.manual_seed(0)
    ours = pytorch.Hdn(SLIM["paper"]).similarity.backbone.state_dict()
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
    similarity = pytorch.Hdn().similarity
    load_backbone(similarity, shipped)
    expected = pytorch.load(shipped).similarity.backbone.state_dict()
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
    scores, positive = np.array([0.9, 0.5, 0.1, 0.5]), np.array([True, True, False, False])
    assert roc_area(scores, positive) == pytest.approx(3.5 / 4)


@pytest.mark.usefixtures("quick")
def test_validate_prints_the_same_table_each_time(
    images: Path, shipped: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(weights, "shipped", lambda: shipped)
    monkeypatch.setattr(validation, "KINDS", {name: validation.KINDS[name] for name in ("clean", "bar", "screen")})
    tables = []
    for _ in range(2):
        with pytest.raises(SystemExit) as status:
            main(["validate", "--weights", "shipped", "--images", str(images), "--pairs", "2"])
        assert status.value.code == 0
        tables.append(capsys.readouterr().out)
    assert tables[0] == tables[1]
    assert "2 images, of held-out sources" in tables[0]
    for name in ("| clean | bar | screen |", "translation px median", "rotation rad p90", "| score AUC",
                 "log-polar score AUC", "corners px p90", "visible AUC"):  # fmt: skip
        assert name in tables[0]


@pytest.mark.parametrize("component", ["residual", "translation"])
@pytest.mark.parametrize("kind", validation.KINDS)
def test_a_kind_is_drawn_as_it_says(component: str, kind: str, data: Data, monkeypatch: pytest.MonkeyPatch) -> None:
    """The pairs of a kind are what is drawn for either component, and nothing else is."""
    asked: list[dict[str, object]] = []

    class Drawn(Exception):
        pass

    def draw(*_: object, **options: object) -> None:
        asked.append(options)
        raise Drawn

    name = "residual_batch" if component == "residual" else "similarity_batch"
    monkeypatch.setattr(validation, name, draw)
    monkeypatch.setattr(objectives, "frozen_features", lambda network, _: network.backbone)
    if component == "residual":
        objective: Objective = ResidualObjective(ResidualNetwork(COMPACT), RECIPES["compact"], CPU)
    else:
        objective = TranslationObjective(SimilarityNetwork(COMPACT), RECIPES["compact"], CPU)
    with pytest.raises(Drawn):
        validation.validate(objective, data.held_out, 4, [kind])
    wanted = validation.KINDS[kind]
    drawn = {key: asked[0][key] for key in ("hiding", "look", "plain", "gentle")}
    assert drawn == {"hiding": wanted.hiding, "look": wanted.look, "plain": wanted.plain, "gentle": 0}


def test_what_the_template_hides_is_not_taught_as_seen(data: Data) -> None:
    torch.manual_seed(0)
    objective = ResidualObjective(ResidualNetwork(COMPACT), RECIPES["compact"], CPU)
    batch = residual_batch(data.held_out, 4, COMPACT.residual_size, reach=4, negatives=0)
    matches = objective.network.match(*objective.network.describe(torch.cat([batch.template, batch.search])).chunk(2))
    batch.known[:, :, :, :64] = 0
    _, visible = objective._match_parts(matches, batch, COMPACT.residual_size)
    seen = visible.unflatten(1, (16, 16))
    assert (seen[:, :, :8] == 0).all()
    assert (seen[:, 4:-4, 8:12] > 0.99).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["residual", "--out", "o"], "no images under no folder"),
        (["residual", "--out", "o", "--images", "missing"], "--images missing is not a folder"),
        (["residual", "--out", "o", "--steps", "0"], "--steps takes 1 or more"),
        (["residual", "--out", "o", "--device", "warp"], "--device warp cannot be used"),
        (["residual", "--out", "o", "--config", "huge"], "invalid choice: 'huge'"),
        (["pack", "--out", "nowhere"], "nowhere/translation.pt is missing"),
        (["polar", "--out", "o", "--start", "no.safetensors"], "--start no.safetensors is missing"),
        (["polar", "--out", "o", "--start", "a", "--backbone", "b"], "leave --backbone out"),
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


FIGURE = {"translation": "translation px median", "polar": "rotation rad median", "residual": "corners px median"}


def test_the_ablation_trains_each_variant_once_and_reports(
    data: Data, tmp_path: Path, shipped: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trained = []
    network = pytorch.load(shipped)

    def fake(component: str, data: Data, out: Path, *args: object, **options: object) -> dict[str, Figures]:
        trained.append((component, out.name, options["recipe"]))
        out.mkdir(parents=True)
        part = network.residual if component == "residual" else network.similarity
        torch.save({"network": part.state_dict(), "config": "compact", "step": 2, "seed": 0}, out / f"{component}.pt")
        return {look: {FIGURE[component]: float(len(trained))} for look in ("clean", "hard")}

    monkeypatch.setattr(ablation, "train", fake)
    settings = {"steps": 2, "batch": 3, "backbone": None, "device": CPU, "seed": 5}
    report = ablation.run(data, tmp_path, COMPACT, **settings)  # type: ignore[arg-type]
    assert [name for _, name, _ in trained] == [*ablation.TRANSLATION, "full", *ablation.RESIDUAL]
    assert len({recipe for _, _, recipe in trained}) == 7  # polar's is the full one of translation
    text = report.read_text()
    assert "2 steps of 3 pairs, seed 5" in text
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines() if line[2:3].isdigit()]
    assert [row[0] for row in rows] == [*"12345678"] * 2
    values = {row[1]: [cell for cell in row[2:] if cell] for row in rows}  # of translation, polar and residual
    assert values["similarity only"] == ["1", "4"]
    assert values["residual only"] == ["5"]
    assert values["without rotated labels"] == ["3", "4", "5"]
    assert values["supervised"] == ["1", "4", "6"]
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


@pytest.mark.usefixtures("quick")
def test_translation_variants_change_the_labels_and_the_negatives(data: Data) -> None:
    network = SimilarityNetwork(COMPACT)
    values = {}
    for variant, changes in ablation.TRANSLATION.items():
        objective = TranslationObjective(network, replace(RECIPES["compact"], **changes), CPU)
        torch.manual_seed(3)
        values[variant] = float(objective.losses(objective.sample(data.photos, None, 4))["classification"].detach())
    assert len(set(values.values())) == 3
    assert values["no-hard-negatives"] < values["full"]  # easy negatives dilute the loss
