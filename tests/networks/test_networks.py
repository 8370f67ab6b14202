"""Shapes, equivariance and engines of the networks."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
import torch

from hdn.imaging.homography import from_corners, transform
from hdn.imaging.observation import Observation
from hdn.imaging.quads import side, square
from hdn.networks import torch_engine
from hdn.networks.config import COMPACT, PAPER
from hdn.networks.engine import Engine, _decode
from hdn.networks.geometry import dlt, polar_crop, project
from hdn.networks.loading import load_engine
from hdn.networks.polar import polar_points
from hdn.networks.pytorch import Hdn
from hdn.networks.residual import ResidualNetwork, geometry, standardise
from hdn.networks.similarity import POSES, pose_grid
from hdn.proposal import MODEL, Proposer

from ..scenes import Scene, error, moved, texture


def crops(size: int, seed: int = 0) -> np.ndarray:
    return texture(seed, size, size)


def test_correlation_maps_have_the_paper_s_size(network: Hdn) -> None:
    n = network.similarity
    z = n.encode_template(n.backbone(torch.zeros(1, 3, 127, 127)))
    logits, offsets = n.translation(z, n.encode_search(n.backbone(torch.zeros(1, 3, 255, 255))))
    assert logits.shape == offsets.shape == (1, 2, 25, 25)


def test_on_the_polar_grid_scale_and_rotation_are_shifts() -> None:
    points = torch.from_numpy(polar_points(COMPACT))
    rows, columns = 9, 14
    scale, angle = np.exp(columns * COMPACT.log_scale_per_pixel), rows * COMPACT.radians_per_pixel
    c, s = scale * np.cos(angle), scale * np.sin(angle)
    moved = points @ torch.tensor([[c, s], [-s, c]], dtype=torch.float32)
    inner = moved[:-rows, :-columns]
    torch.testing.assert_close(inner, points[rows:, columns:], atol=1e-3, rtol=1e-4)


def test_polar_crop_looks_about_its_centre() -> None:
    y, x = torch.meshgrid(torch.arange(255.0), torch.arange(255.0), indexing="ij")
    image = torch.stack([x, y, x])[None]
    points = torch.from_numpy(polar_points(COMPACT))
    crop = polar_crop(image, torch.tensor([[10.0, -5.0]]), points)
    torch.testing.assert_close(crop[0, 0], points[..., 0] + 127 + 10, atol=1e-2, rtol=0)
    torch.testing.assert_close(crop[0, 1], points[..., 1] + 127 - 5, atol=1e-2, rtol=0)


def test_each_pose_looks_at_the_template_as_it_would_be_turned_and_scaled_about_its_centre() -> None:
    cells, centre = 16, 63 / COMPACT.stride  # of a crop of 127 px, whose cells lie on every eighth pixel
    y, x = torch.meshgrid(torch.arange(float(cells)), torch.arange(float(cells)), indexing="ij")
    places = torch.stack([x, y])[None]
    kernel = torch.stack([x, y], -1)[4:12, 4:12] - centre
    for (rotation, scale), grid in zip(product(POSES.rotations, POSES.scales), pose_grid(COMPACT), strict=True):
        seen = (
            torch.nn.functional.grid_sample(places, torch.from_numpy(grid[None]), align_corners=False)[0].permute(
                1, 2, 0
            )
            - centre
        )
        c, s = scale * np.cos(rotation), scale * np.sin(rotation)
        turned = seen @ torch.tensor([[c, s], [-s, c]], dtype=torch.float32)
        inside = ((seen + centre > 0) & (seen + centre < cells - 1)).all(-1)
        torch.testing.assert_close(turned[inside], kernel[inside], atol=1e-3, rtol=0)
        assert inside.float().mean() > 0.8


@pytest.mark.parametrize("rotation", [-0.6, 0.0, 0.6])
@pytest.mark.parametrize("scale", [0.75, 1.3])
def test_translation_finds_the_centre_of_a_turned_target(engine: Engine, rotation: float, scale: float) -> None:
    scene = Scene()
    proposer = Proposer(engine, Observation(scene.draw(scene.quad)), scene.quad, frozenset({"similarity"}))
    shift = np.array([14.0, -9.0])
    frame = Observation(scene.draw(moved(scene.quad, (14.0, -9.0), scale, rotation))).colour
    n = COMPACT.search_size
    found = engine.translation(proposer.kernels[0], proposer._crop(frame, proposer._window(n), n))
    assert np.linalg.norm(np.array([found.x, found.y]) * proposer.unit - shift) < 4


def test_the_reference_frame_itself_is_not_moved(engine: Engine) -> None:
    """Whatever error the branches have with a target."""
    scene = Scene()
    first = Observation(scene.draw(scene.quad))
    proposer = Proposer(engine, first, scene.quad, frozenset({"similarity"}))
    proposal = proposer.propose(first.colour, np.eye(3))
    np.testing.assert_allclose(proposal.homography, np.eye(3), atol=1e-9)
    near = moved(scene.quad, (3, -2), 1.02, 0.04)
    start = proposer.propose(Observation(scene.draw(near)).colour, np.eye(3)).homography
    assert error(transform(start, scene.quad), near) < 0.5 * error(scene.quad, near)


@pytest.mark.parametrize("library", ["openvino", "torch"])
@pytest.mark.parametrize("centre", [(30, 40), (290, 60), (120, 215)])
def test_a_survey_finds_the_target_anywhere_in_the_frame(
    network: Hdn, library: str, centre: tuple[float, float]
) -> None:
    """Turned as before, of another size, in part beyond the frame's edge."""
    scene = Scene()
    engine = torch_engine.engine(network, "cpu") if library == "torch" else load_engine(device="cpu")
    proposer = Proposer(engine, Observation(scene.draw(scene.quad)), scene.quad, frozenset({"similarity"}))
    last = moved(scene.quad, (0, 0), 1.0, 0.9)
    there = moved(last, tuple(np.array(centre) - last.mean(0)), 0.7)
    start = proposer.survey(Observation(scene.draw(there)).colour, from_corners(scene.quad, last))
    found = transform(start, scene.quad)
    assert np.linalg.norm(found.mean(0) - there.mean(0)) < 8
    assert error(found, there) < 0.35 * side(there)


def test_what_is_far_off_is_looked_at_twice(engine: Engine) -> None:
    scene = Scene()
    proposer = Proposer(engine, Observation(scene.draw(scene.quad)), scene.quad, frozenset({"residual"}))
    corners = scene.quad + np.array([[9, 8], [-9, 7], [8, -8], [10, 9]])
    frame = Observation(scene.draw(corners)).colour
    once, length, _ = proposer._run_residual(frame, np.eye(3))
    twice, _, _ = proposer._residual(frame, np.eye(3))
    assert length > MODEL.second_look_px
    assert error(transform(twice, scene.quad), corners) < 0.8 * error(transform(once, scene.quad), corners)


def test_a_crop_without_contrast_has_a_gradient() -> None:
    crop = torch.full((1, 3, 8, 8), 7.0, requires_grad=True)
    standardise(crop).sum().backward()
    assert crop.grad is not None
    assert crop.grad.isfinite().all()


def test_standardised_crops_know_no_gain_and_bias() -> None:
    crop = torch.from_numpy(crops(32)).permute(2, 0, 1)[None].float() / 2.55
    torch.testing.assert_close(standardise(crop * 2 + 10), standardise(crop), atol=0.3, rtol=0)


@pytest.fixture(scope="module")
def pytorch_engine(network: Hdn) -> Engine:
    return torch_engine.engine(network, "cpu")


def agree(ours: Engine, theirs: Engine) -> None:
    """Asserts that two engines on the same networks give the same on the same crops."""
    c = ours.config
    template, search, polar = crops(c.template_size), crops(c.search_size, 1), crops(c.polar_size, 2)
    kernels, their_kernels = ours.encode_template(template, polar), theirs.encode_template(template, polar)
    for kernel, their_kernel in zip(kernels, their_kernels, strict=True):
        np.testing.assert_allclose(kernel, their_kernel, atol=1e-3 * np.abs(their_kernel).max())
    for shift, their_shift in (
        (ours.translation(kernels[0], search), theirs.translation(their_kernels[0], search)),
        (ours.polar(kernels[1], polar), theirs.polar(their_kernels[1], polar)),
    ):
        expected = (their_shift.x, their_shift.y, their_shift.score)
        assert (shift.x, shift.y, shift.score) == pytest.approx(expected, abs=0.02)
    before, after = crops(c.residual_size, 2), crops(c.residual_size, 3)
    residual, theirs_says = (e.residual(e.describe(before), after) for e in (ours, theirs))
    np.testing.assert_allclose(residual.offsets, theirs_says.offsets, atol=0.02)
    np.testing.assert_allclose(residual.visible, theirs_says.visible, atol=0.02)


def homography_field(network: ResidualNetwork, offsets: torch.Tensor) -> torch.Tensor:
    """Displacements (1, M, 2) of the points that the network looks up, under given corner offsets."""
    source, _, _ = geometry(network.size, offsets.device)
    corners = torch.from_numpy(square(network.size)) - (network.size - 1) / 2
    return project(dlt(offsets, corners), source) - source


def test_the_fit_follows_exact_matches_and_ignores_those_without_weight(network: Hdn) -> None:
    residual = network.residual
    offsets = torch.tensor([[[5.0, -3], [-4, 6], [2, 8], [-7, -1]]])
    field = homography_field(residual, offsets)
    weight = torch.ones(1, field.shape[1])
    torch.testing.assert_close(residual.fit(field, weight), offsets, atol=0.15, rtol=0)
    weight[:, ::3] = 0
    field[:, ::3] += 20
    torch.testing.assert_close(residual.fit(field, weight), offsets, atol=0.2, rtol=0)


def test_without_trust_the_corners_stay(network: Hdn) -> None:
    field = homography_field(network.residual, torch.full((1, 4, 2), 9.0))
    assert float(network.residual.fit(field, torch.zeros(1, field.shape[1])).abs().max()) < 1e-6


def test_the_fit_is_differentiable(network: Hdn) -> None:
    field = homography_field(network.residual, torch.full((1, 4, 2), 3.0)).double().requires_grad_()
    weight = torch.linspace(0.1, 1, field.shape[1], dtype=torch.float64)[None].requires_grad_()
    assert torch.autograd.gradcheck(lambda f, w: network.residual.fit(f, w), (field, weight), fast_mode=True)


def test_a_map_without_any_score_still_decodes() -> None:
    logits = np.stack([np.full((5, 5), 200), np.full((5, 5), -200)])[None].astype(np.float32)
    shift = _decode(logits, np.zeros((1, 4, 5, 5), np.float32), 8)
    assert np.isfinite([shift.x, shift.y]).all()
    assert shift.score < 1e-6


def test_of_four_offsets_the_first_and_third_are_read() -> None:
    logits = np.zeros((1, 2, 5, 5), np.float32)
    logits[0, 1, 2, 2] = 20
    offsets = np.stack([np.full((5, 5), v, np.float32) for v in (-1, 7, 2, 7)])[None]
    assert _decode(logits, offsets, 8).x == pytest.approx(8, abs=1)
    assert _decode(logits, offsets, 8).y == pytest.approx(-16, abs=1)


def test_openvino_and_pytorch_agree(engine: Engine, pytorch_engine: Engine) -> None:
    agree(engine, pytorch_engine)


def test_openvino_and_pytorch_agree_on_the_paper_s_networks() -> None:
    torch.manual_seed(0)
    # Slimmer, for time; `test_parity` has them in full.
    slim = Hdn(replace(PAPER, channels=16, search_size=143)).eval().requires_grad_(False)
    agree(torch_engine.converted(slim), torch_engine.engine(slim, "cpu"))
