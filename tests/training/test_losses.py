import math

import pytest
import torch

from hdn.networks.geometry import dlt
from hdn.training import losses


def test_grid_points_are_the_shifts_that_cells_stand_for() -> None:
    points = losses.grid_points(25, 8, torch.device("cpu"))
    assert points[12, 12].tolist() == [0, 0]
    assert points[12, 15].tolist() == [24, 0]
    assert points[0, 12].tolist() == [0, -96]


def test_hamming_labels_peak_at_the_target_and_turn_with_it() -> None:
    points = losses.grid_points(25, 8, torch.device("cpu"))
    half = torch.tensor([[40.0, 20.0]])
    args = (torch.tensor([[16.0, -8.0]]), torch.ones(1))
    upright = losses.hamming_labels(points, *args, torch.zeros(1), half)[0]
    assert upright[11, 14] == pytest.approx(1.0)
    assert upright[11, 17] == pytest.approx(0.54 + 0.46 * math.cos(math.pi * 24 / 40), abs=1e-5)
    assert upright[14, 14] == 0  # 24 px below the centre of a box of half height 20
    turned = losses.hamming_labels(points, *args, torch.tensor([math.pi / 2]), half)[0]
    assert turned[14, 14] == pytest.approx(float(upright[11, 17]), abs=1e-5)
    assert turned[11, 17] == 0


def test_classification_loss_by_hand() -> None:
    label = torch.tensor([[[0.9, 0.1, 0.0, 0.0]]])
    probability = torch.tensor([[[0.6, 0.5, 0.2, 0.1]]])
    expected = (-math.log(0.5) - math.log(0.8)) / 2 + 0.3
    assert float(losses.classification_loss(probability, label, top=2)) == pytest.approx(expected, abs=1e-5)


def test_classification_loss_of_a_negative_pair_has_no_positive_term() -> None:
    probability = torch.full((1, 2, 2), 0.5)
    loss = losses.classification_loss(probability, torch.zeros(1, 2, 2))
    assert float(loss) == pytest.approx(-math.log(0.5), abs=1e-5)


def test_offset_loss_by_hand() -> None:
    points = losses.grid_points(3, 8, torch.device("cpu"))
    truth = torch.tensor([[4.0, 0.0]])
    where = torch.zeros(1, 3, 3, dtype=torch.bool)
    where[0, 1, 1] = True
    offsets = torch.zeros(1, 2, 3, 3)
    # The centre cell shall say (0 - 4) / 8 = -0.5 along x; zero is 0.5 off: smooth l1 with beta 0.2 gives 0.4.
    assert float(losses.offset_loss(offsets, points, truth, where, 8)) == pytest.approx(0.4 / 2)
    offsets[0, 0, 1, 1] = -0.5
    assert float(losses.offset_loss(offsets, points, truth, where, 8)) == 0


def test_polar_labels_ignore_what_lies_between() -> None:
    points = losses.grid_points(9, 8, torch.device("cpu"))
    labels = losses.polar_labels(points, torch.tensor([[8.0, 0.0]]), 8)[0]
    assert labels[4, 5] == 1
    assert labels[4, 6] == -1
    assert labels[4, 7] == 0


def test_polar_classification_weighs_both_kinds_the_same() -> None:
    labels = torch.tensor([[[1, 0], [0, -1]]])
    logits = torch.zeros(1, 2, 2, 2)
    logits[0, 1, 0, 0] = 2.0
    expected = (math.log(2) + math.log(1 + math.exp(-2))) / 2
    assert float(losses.polar_classification_loss(logits, labels)) == pytest.approx(expected, abs=1e-5)


def test_corner_and_negative_losses_by_hand() -> None:
    offsets = torch.tensor([[[3.0, -4.0], [0, 0], [0, 0], [0, 0]]])
    assert float(losses.corner_loss(offsets, torch.zeros(1, 4, 2))) == pytest.approx(7 / 4)
    assert float(losses.negative_loss(offsets)) == pytest.approx((2.5 + 3.5) / 8)


def test_triplet_loss_vanishes_once_the_warp_is_nearer_by_the_margin() -> None:
    search, template = torch.zeros(1, 1, 2, 2), torch.full((1, 1, 2, 2), 3.0)
    assert float(losses.triplet_loss(search, search + 1.5, template)) == 0
    assert float(losses.triplet_loss(search, search + 2.5, template)) == pytest.approx(0.5)


def test_matching_loss_is_the_cross_entropy_of_the_four_cells_around_the_truth() -> None:
    probability = torch.full((1, 1, 9), 0.05)
    probability[0, 0, 4], probability[0, 0, 5] = 0.4, 0.25
    target = torch.tensor([[[1.25, 1.0]]])
    loss = losses.matching_loss(probability, target, torch.tensor([[True]]), 3)
    assert float(loss) == pytest.approx(-0.75 * math.log(0.4) - 0.25 * math.log(0.25))
    assert float(losses.matching_loss(probability, target, torch.tensor([[False]]), 3)) == 0


def test_peak_loss_counts_positives_only() -> None:
    score = torch.zeros(2, 3, 3)
    score[0, 2, 1] = math.log(8)
    target = torch.tensor([[1.0, 2.0], [0.0, 0.0]])
    assert float(losses.peak_loss(score, target, torch.tensor([True, False]))) == pytest.approx(math.log(2))
    assert float(losses.peak_loss(score, target, torch.tensor([True, True]))) == pytest.approx(
        (math.log(2) + math.log(9)) / 2
    )


CORNERS = torch.tensor([[-8.0, -8], [8, -8], [8, 8], [-8, 8]], dtype=torch.float64)


def picture(seed: int, channels: int = 1) -> torch.Tensor:
    """Smooth random maps (1, C, 16, 16), double precision."""
    coarse = torch.rand(1, channels, 5, 5, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return torch.nn.functional.interpolate(coarse, (16, 16), mode="bicubic", align_corners=False) * 4


def test_the_warp_shows_what_the_homography_says() -> None:
    crops = picture(0, 2)
    shift = torch.eye(3, dtype=torch.float64)[None].clone()
    torch.testing.assert_close(losses.warp(crops, shift), crops)
    shift[0, 0, 2] = 3  # each pixel shows what is 3 px to its right
    moved = losses.warp(crops, shift)
    torch.testing.assert_close(moved[..., :-3], crops[..., 3:])
    torch.testing.assert_close(moved[..., -3:], crops[..., -1:].expand(-1, -1, -1, 3))  # the edge goes on


def test_gradients_of_the_triplet_loss_flow_through_dlt_and_warp() -> None:
    template, search = picture(1), picture(2)
    offsets = torch.tensor([[[0.7, -0.4], [-0.3, 0.9], [0.5, 0.6], [-0.8, 0.2]]], dtype=torch.float64)

    def loss(offsets: torch.Tensor, template: torch.Tensor) -> torch.Tensor:
        to_template = torch.linalg.inv(dlt(offsets, CORNERS))
        return losses.triplet_loss(search, losses.warp(template, to_template), template, margin=9.0)

    assert torch.autograd.gradcheck(loss, (offsets.requires_grad_(), template.requires_grad_()))


def test_gradients_of_the_corner_loss_flow_through_dlt() -> None:
    offsets = torch.tensor([[[0.7, -0.4], [-0.3, 0.9], [0.5, 0.6], [-0.8, 0.2]]], dtype=torch.float64)
    truth = torch.zeros(1, 4, 2, dtype=torch.float64)

    def loss(offsets: torch.Tensor) -> torch.Tensor:
        matrix = torch.linalg.inv(dlt(offsets, CORNERS))  # as corners of the other crop: there and back
        back = torch.nn.functional.pad(CORNERS, (0, 1), value=1.0) @ matrix.transpose(1, 2)
        return losses.corner_loss(back[..., :2] / back[..., 2:] - CORNERS, truth)

    assert torch.autograd.gradcheck(loss, (offsets.requires_grad_(),))


def test_the_triplet_loss_leads_to_the_true_motion() -> None:
    """What is unsupervised about it: corners are found from the pictures alone."""
    torch.manual_seed(0)
    template = picture(3)
    truth = torch.tensor([[[1.0, 0.5], [0.6, -0.8], [-0.7, 0.4], [0.5, 0.9]]], dtype=torch.float64)
    search = losses.warp(template, torch.linalg.inv(dlt(truth, CORNERS)))
    offsets = torch.zeros_like(truth).requires_grad_()
    optimizer = torch.optim.Adam([offsets], 0.05)
    for _ in range(120):
        optimizer.zero_grad()
        warped = losses.warp(template, torch.linalg.inv(dlt(offsets, CORNERS)))
        losses.triplet_loss(search, warped, template).backward()
        optimizer.step()
    assert float((offsets - truth).detach().abs().mean()) < 0.3
