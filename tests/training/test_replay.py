"""Samples that are used again."""

from collections import Counter
from itertools import count

import pytest
import torch

from hdn.training import replay
from hdn.training.replay import Replay


def test_one_in_three_is_new_and_the_others_are_of_those_before() -> None:
    torch.manual_seed(0)
    numbers = count()
    samples = Replay(lambda: next(numbers), 3)
    drawn = [samples.next() for _ in range(300)]
    assert drawn[::3] == list(range(100))
    assert all(again < 1 + i // 3 for i, again in enumerate(drawn))


def test_used_once_each_is_new_and_none_is_kept() -> None:
    numbers = count()
    samples = Replay(lambda: next(numbers), 1)
    assert [samples.next() for _ in range(5)] == [0, 1, 2, 3, 4]
    assert not samples.kept


def test_no_more_are_kept_than_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(replay, "BATCHES_KEPT", 10)
    torch.manual_seed(0)
    numbers = count()
    samples = Replay(lambda: next(numbers), 2)
    uses = Counter(samples.next() for _ in range(1000))
    assert len(samples.kept) == 10
    assert min(uses) == 0
    assert len(uses) == 500
    assert max(samples.kept) > 450  # the old ones give way
