"""`hdn-analyse`: its numbers against independent computations, its files, its errors."""

import csv
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image as Pillow

from hdn.analysis import cli, conditioning, rsew
from hdn.imaging.arrays import Array
from hdn.imaging.homography import transform
from hdn.networks.config import COMPACT, PAPER, Config
from hdn.synthesis import decomposition


def by_hand(x: Array) -> Array:
    """Eq. 2, written out."""
    t1, t2, gamma, theta, k1, k2, nu1, nu2 = x
    similarity = [
        [gamma * np.cos(theta), -gamma * np.sin(theta), t1],
        [gamma * np.sin(theta), gamma * np.cos(theta), t2],
        [0, 0, 1],
    ]
    return np.array(similarity) @ np.array([[k1, k2, 0], [0, 1 / k1, 0], [nu1, nu2, 1]])


def offsets(x: Array, corners: Array) -> Array:
    """Displacements of the corners in one vector (2 P,)."""
    return (transform(by_hand(x), corners) - corners).ravel()


def numerical_condition(x: Array, given: int, corners: Array, measure: tuple[Array, Array]) -> float:
    """The definition, with central differences for the Jacobian and its singular values for the norm."""
    zero, unit = measure
    x = np.concatenate([conditioning.IDENTITY[:given], x[given:]])
    steps = 1e-6 * np.maximum(np.abs(x), 1e-3)
    columns = [
        (offsets(x + h * e, corners) - offsets(x - h * e, corners)) / (2 * h) * u
        for h, e, u in zip(steps[given:], np.eye(8)[given:], unit[given:], strict=True)
    ]
    jacobian = np.stack(columns, 1)
    frobenius = np.sqrt(np.square(np.linalg.svd(jacobian, compute_uv=False)).sum())
    return float(np.linalg.norm(((x - zero) / unit)[given:]) * frobenius / np.linalg.norm(offsets(x, corners)))


def condition(x: Array, setting: str, corners: str, measure: str) -> Array:
    given = conditioning.GIVEN[setting]
    sensed = conditioning.sensitivity(x, given, conditioning.CORNERS[corners])
    return conditioning.condition_numbers(x, given, sensed, conditioning.MEASURES[measure])


@pytest.mark.parametrize("measure", conditioning.MEASURES)
@pytest.mark.parametrize("corners", conditioning.CORNERS)
@pytest.mark.parametrize("setting", conditioning.GIVEN)
def test_condition_numbers_against_central_differences(setting: str, corners: str, measure: str) -> None:
    x = conditioning.sample(20, seed=3)
    arguments = conditioning.GIVEN[setting], conditioning.CORNERS[corners], conditioning.MEASURES[measure]
    expected = [numerical_condition(row, *arguments) for row in x]
    np.testing.assert_allclose(condition(x, setting, corners, measure), expected, rtol=1e-5)


def test_jacobian_against_automatic_differentiation() -> None:
    corner = torch.tensor([-63.5, 20.0], dtype=torch.float64)

    def moved(x: torch.Tensor) -> torch.Tensor:
        matrix = decomposition(x[2:3], x[3:4], x[None, :2], x[None, 4:])[0]
        point = matrix[:, :2] @ corner + matrix[:, 2]
        return point[:2] / point[2] - corner

    for x in conditioning.sample(5, seed=4):
        displacement, jacobian = conditioning.displacements(x[None], corner.numpy())
        np.testing.assert_allclose(displacement[:, 0], moved(torch.from_numpy(x)), rtol=1e-9)
        expected = torch.autograd.functional.jacobian(moved, torch.from_numpy(x))
        np.testing.assert_allclose(jacobian[:, :, 0].T, expected, rtol=1e-9, atol=1e-9)


def test_what_the_given_parameters_are_makes_no_difference() -> None:
    x = conditioning.sample(50, seed=5)
    other = x.copy()
    other[:, :4] = conditioning.sample(50, seed=6)[:, :4]
    one, two = (condition(p, "similarity given", "four corners", "x from the identity") for p in (x, other))
    np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize("measure", ["x as listed", "x from the identity"])
@pytest.mark.parametrize("corners", conditioning.CORNERS)
def test_decomposition_lowers_the_condition_numbers(corners: str, measure: str) -> None:
    x = conditioning.sample(20_000, seed=0)
    nothing, translation, similarity = (
        np.quantile(condition(x, setting, corners, measure), [0.5, 0.99]) for setting in conditioning.GIVEN
    )
    assert (nothing > 10 * translation).all()  # "drops in a remarkable magnitude"
    assert (translation > 1.2 * similarity).all()


def test_in_units_of_their_ranges_much_less_is_gained() -> None:
    x = conditioning.sample(20_000, seed=0)
    medians = [np.median(condition(x, s, "one corner", "x in its ranges")) for s in conditioning.GIVEN]
    assert medians == sorted(medians, reverse=True)
    assert medians[0] < 2 * medians[2]


def test_larger_motions_are_worse_and_decomposition_keeps_them_far_lower() -> None:
    _, way = conditioning.degrees()
    curves = [condition(way, setting, "four corners", "x from the identity") for setting in conditioning.GIVEN]
    assert (np.diff(curves[0]) > 0).all()
    assert (curves[0] > 30 * curves[1]).all()
    assert (curves[1] > curves[2]).all()
    assert curves[2][-1] - curves[2][0] < 0.01 * (curves[0][-1] - curves[0][0])


def test_ranges_hold_the_identity() -> None:
    assert (conditioning.LOW < conditioning.IDENTITY).all()
    assert (conditioning.IDENTITY < conditioning.HIGH).all()
    assert not conditioning.displacements(conditioning.IDENTITY[None], np.array([5.0, 7.0]))[0].any()
    ratio, way = conditioning.degrees(4)
    assert ratio.tolist() == [0.25, 0.5, 0.75, 1]
    np.testing.assert_allclose(way[-1], conditioning.HIGH)


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as stop:
        cli.main([str(a) for a in arguments])
    assert isinstance(stop.value.code, int)
    return stop.value.code


def test_condition_number_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for folder in ("one", "two"):
        assert run("condition-number", "--samples", 300, "--out", tmp_path / folder) == 0
    assert "translation given" in capsys.readouterr().out
    files = sorted(p.name for p in (tmp_path / "one").iterdir())
    stem = "condition-number"
    assert files == [f"{stem}-degree.csv", f"{stem}-samples.csv", f"{stem}-summary.csv", f"{stem}.png"]
    for name in files:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    assert Pillow.open(tmp_path / "one" / f"{stem}.png").size[0] > 600

    with (tmp_path / "one" / f"{stem}-samples.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 900
    corners, measure = conditioning.CORNERS[conditioning.SHOWN[0]], conditioning.MEASURES[conditioning.SHOWN[1]]
    for row in rows[::100]:
        x = np.array([float(row[p]) for p in conditioning.PARAMETERS])
        given = conditioning.GIVEN[row["setting"]]
        assert float(row["condition"]) == pytest.approx(numerical_condition(x, given, corners, measure), rel=1e-4)
        assert float(row["displacement"]) == pytest.approx(np.linalg.norm(offsets(x, corners)), rel=1e-6)


def test_seed_changes_the_draw() -> None:
    assert not np.array_equal(conditioning.sample(3, 1), conditioning.sample(3, 2))


@pytest.mark.parametrize("shift", [(0, 0), (7, 0), (0, -31), (-4, 63)])
def test_measured_shift_is_that_of_a_rolled_image(shift: tuple[int, int]) -> None:
    crop = rsew.log_polar(rsew.crop(rsew.read_image(None), 127, 1, 0), COMPACT)
    rolled = np.roll(crop, shift, (1, 0))
    # What leaves at one end of the columns comes in at the other here, which a warp does not do.
    np.testing.assert_allclose(rsew.measured_shift(crop, rolled), shift, atol=0.35)


@pytest.mark.parametrize(("config", "tolerance"), [(COMPACT, 0.35), (PAPER, 0.8)], ids=lambda v: getattr(v, "name", v))
def test_rotation_and_scale_are_the_predicted_shifts(config: Config, tolerance: float) -> None:
    seen = rsew.views(rsew.read_image(None), config)
    assert len(seen) == len(rsew.MOTIONS)
    for view in seen:
        np.testing.assert_allclose(view.measured, view.predicted, atol=tolerance)
    # One row more for each step of angle, one column more for each of log-scale.
    turned = next(v for v in seen if v.rotation == -0.7 and v.scale == 1)
    assert turned.measured[1] == pytest.approx(-0.7 / (2 * np.pi / config.polar_size), abs=0.2)
    larger = next(v for v in seen if v.rotation == 0 and v.scale == 1.38)
    assert larger.measured[0] > 8


def test_crop_turns_as_the_decomposition_does() -> None:
    """A spot to the right of the centre comes to lie below it after a quarter turn, and twice as far at scale 2."""
    image = np.zeros((300, 300, 3), np.uint8)
    image[145:156, 185:196] = 255  # centred 40.5 px right of the middle
    crop = rsew.crop(image, 100, 2, np.pi / 2)  # two image px per crop px
    rows, columns = np.nonzero(crop[..., 0] > 127)
    assert (columns.mean(), rows.mean()) == pytest.approx((49.5, 49.5 + 40.5), abs=1)


def test_rsew_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "mine.png"
    Pillow.fromarray(rsew.read_image(None)[:300]).save(file)
    assert run("rsew", "--image", file, "--config", "paper", "--out", tmp_path / "out") == 0
    assert "measured" in capsys.readouterr().out
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["rsew-paper.png"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["rsew", "--image", "missing.png"], "missing.png cannot be read as an image"),
        (["condition-number", "--samples", "0"], "'0' is not a whole number"),
        (["condition-number", "--image", "a.png"], "unrecognized"),
        (["fourier"], "condition-number"),
        ([], "required"),
    ],
)
def test_wrong_input_is_said_in_one_line(
    arguments: list[str],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(*arguments) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.rstrip().count("\n") == 0


def test_needs_matplotlib(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert run("rsew", "--out", tmp_path) == 2
    assert "Matplotlib" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
