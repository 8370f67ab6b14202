"""Figures of a component on held-out photographs: errors at the paper's ranges without occluders, and how well pairs
of two different objects are told from true ones. Always the same pairs for the same number of them."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch
from torch import Tensor

from .. import losses
from ..synthesis import Look, Photos, residual_batch, similarity_batch
from .objectives import Objective, ResidualObjective, SimilarityObjective

# Clean pairs differ in light and noise alone; of the hard ones, half each are blurred, dark, of low resolution.
LOOKS = {
    "clean": Look(blurred=0, coarse=0, darkened=0),
    "hard": Look(blurred=0.5, coarse=0.5, darkened=0.5),
}
BATCH = 32
SEED = 1

Figures = dict[str, float]


def validate(objective: Objective, photos: Photos, pairs: int) -> dict[str, Figures]:
    """Figures by name, of clean and of hard pairs, so many of each."""
    figures = similarity_figures if isinstance(objective, SimilarityObjective) else residual_figures
    with _evaluating(objective):
        return {name: figures(objective, photos, pairs, look) for name, look in LOOKS.items()}  # type: ignore[arg-type]


@contextmanager
def _evaluating(objective: Objective) -> Iterator[None]:
    """Evaluation mode without gradients, the training's chance left as it was."""
    training = objective.network.training
    objective.training(False)
    try:
        with torch.no_grad(), torch.random.fork_rng():
            yield
    finally:
        objective.training(training)


def similarity_figures(objective: SimilarityObjective, photos: Photos, pairs: int, look: Look) -> Figures:
    """Errors of translation, log-scale and rotation, and the area under the ROC of both branches' scores."""
    config = objective.config
    columns: list[tuple[Tensor, ...]] = []
    for size in _batches(pairs):
        batch = similarity_batch(
            photos, size, config.template_size, config.search_size, config.context, occluded=0, gentle=0, look=look
        )
        outputs = objective.outputs(batch, jitter=0)
        shift, score = decode(outputs.logits, outputs.offsets, config.stride)
        polar, polar_score = decode(outputs.polar_logits, outputs.polar_offsets, config.stride)
        off = (polar - objective.polar_truth(batch)).abs()
        error = (shift - batch.motion.shift).norm(dim=1)
        columns.append((error, off[:, 0], off[:, 1], score, polar_score, batch.positive))
    error, log_scale, rotation, score, polar_score, positive = _joined(columns)
    return {
        **percentiles("translation px", error[positive]),
        **percentiles("log-scale", log_scale[positive] * config.log_scale_per_pixel),
        **percentiles("rotation rad", rotation[positive] * config.radians_per_pixel),
        "score AUC": roc_area(score[positive], score[~positive]),
        "log-polar score AUC": roc_area(polar_score[positive], polar_score[~positive]),
    }


def residual_figures(objective: ResidualObjective, photos: Photos, pairs: int, look: Look) -> Figures:
    """Mean corner errors for offsets up to 12 px, those that negatives are given, and the AUC of what is seen."""
    network: Any = objective.network
    columns: list[tuple[Tensor, ...]] = []
    for size in _batches(pairs):
        batch = residual_batch(photos, size, network.size, reach=12, occluded=0, gentle=0, look=look)
        offsets, visible = network.conclude(*network.compare(network.describe(batch.template), batch.search))
        distance = (offsets - batch.offsets).norm(dim=2).mean(1)  # of negatives: to where the corners were
        columns.append((distance, visible.flatten(1).mean(1), batch.positive))
    distance, visible, positive = _joined(columns)
    return {
        **percentiles("corners px", distance[positive]),
        **percentiles("negatives px", distance[~positive]),
        "visible AUC": roc_area(visible[positive], visible[~positive]),
    }


def decode(logits: Tensor, offsets: Tensor, stride: int) -> tuple[Tensor, Tensor]:
    """Shift (B, 2) in px at the most probable cell, and its probability (B,)."""
    b, _, n, _ = logits.shape
    best = logits.softmax(1)[:, 1].flatten(1).max(1)
    points = losses.grid_points(n, stride, logits.device).reshape(-1, 2)[best.indices]
    at = offsets.flatten(2).gather(2, best.indices[:, None, None].expand(b, 2, 1))[..., 0]
    return points - at * stride, best.values


def percentiles(name: str, errors: Tensor) -> Figures:
    """Median and 90th percentile; NaN of nothing."""
    shares = torch.tensor([0.5, 0.9])
    middle, high = torch.quantile(errors, shares).tolist() if len(errors) else (float("nan"),) * 2
    return {f"{name} median": middle, f"{name} p90": high}


def roc_area(positive: Tensor, negative: Tensor) -> float:
    """Probability that a positive pair scores above a negative one, ties counting half; NaN of nothing."""
    difference = positive[:, None] - negative[None]
    return float(((difference > 0).float() + (difference == 0).float() / 2).mean())


def table(columns: dict[str, Figures]) -> str:
    """A Markdown table with a row for each figure and a column for each set of them."""
    rows = [["", *columns], ["---"] * (len(columns) + 1)]
    names = next(iter(columns.values()))
    rows += [[name, *(f"{figures[name]:.4g}" for figures in columns.values())] for name in names]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _batches(pairs: int) -> Iterator[int]:
    """Batch sizes; seeded here, so that both kinds of pairs are drawn alike."""
    torch.manual_seed(SEED)
    for start in range(0, pairs, BATCH):
        yield min(BATCH, pairs - start)


def _joined(columns: list[tuple[Tensor, ...]]) -> list[Tensor]:
    return [torch.cat(column).cpu() for column in zip(*columns, strict=True)]
