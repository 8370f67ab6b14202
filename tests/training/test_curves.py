"""The curves of a training, as files."""

import logging
import sys
from pathlib import Path

import cv2
import pytest

from hdn.training import curves

# The triplet loss came with clips, when the training was resumed.
LOSSES: list[curves.Row] = [
    {"step": 50, "rate": 1e-3, "loss": 3.0, "corner": 3.0},
    {"step": 100, "rate": 2e-3, "loss": 2.5, "corner": 2.0, "triplet clips": 0.5},
]
VALIDATIONS: list[curves.Row] = [
    {"step": 100, "clean corners px median": 1.0, "clean corners px p90": 2.0, "clean visible AUC": 0.9}
]


def test_csv_has_a_column_for_each_name(tmp_path: Path) -> None:
    curves.write_csv(LOSSES, tmp_path / "a.csv")
    lines = (tmp_path / "a.csv").read_text().splitlines()
    assert lines == ["step,rate,loss,corner,triplet clips", "50,0.001,3,3,", "100,0.002,2.5,2,0.5"]


def test_plot_has_a_panel_for_losses_and_for_each_figure(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    sizes = []
    for validations in ([], VALIDATIONS):
        assert curves.plot(LOSSES, validations, tmp_path / "a.png")
        sizes.append(cv2.imread(str(tmp_path / "a.png")).shape[1])
    assert sizes == [500, 1500]  # errors and areas stand apart


def test_without_matplotlib_it_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with caplog.at_level(logging.WARNING):
        assert not curves.plot(LOSSES, VALIDATIONS, tmp_path / "a.png")
    assert "Matplotlib is not installed" in caplog.text
    assert not (tmp_path / "a.png").exists()
