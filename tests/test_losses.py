import math

import pytest
import torch

from hdn import losses


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
