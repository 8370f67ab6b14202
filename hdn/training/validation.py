"""Figures of a component on held-out photographs: errors at the paper's ranges, and how well pairs of two different
objects are told from true ones. Always the same pairs for the same number of them."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor, nn

from ..benchmark.metrics import roc_area
from ..networks.geometry import dlt, project
from ..proposal import MODEL as PROPOSAL
from ..synthesis import NOTHING, Hiding, Look, Photos, residual_batch, similarity_batch
from . import losses
from .light import KINDS as LIGHT_KINDS
from .light import LightObjective, light_figures
from .matte import KINDS as MATTE_KINDS
from .matte import MatteObjective, matte_figures
from .objectives import (
    BranchBatch,
    BranchObjective,
    Objective,
    PolarObjective,
    ResidualObjective,
    TranslationObjective,
    bounded,
    outline,
)

VALIDATION_BATCH = 32
VALIDATION_SEED = 1

Figures = dict[str, float]


@dataclass(frozen=True)
class Kind:
    """What pairs are validated on."""

    look: Look
    hiding: Hiding = NOTHING
    plain: float = 0.0


CLEAR = Look(blurred=0, coarse=0, darkened=0)
# Clean pairs differ in light and noise alone; of the hard ones, half each are blurred, dark, of low resolution.
# The other kinds differ from the clean ones by what their names say alone.
KINDS = {
    "clean": Kind(CLEAR),
    "hard": Kind(Look(blurred=0.5, coarse=0.5, darkened=0.5)),
    "bar": Kind(CLEAR, Hiding(bars=1)),
    "sliver": Kind(CLEAR, Hiding(slivers=1)),
    "hand": Kind(CLEAR, Hiding(hands=1)),
    "long blur": Kind(replace(CLEAR, blurred=1, reach=61)),
    "screen": Kind(CLEAR, plain=1),
    "cut": Kind(CLEAR, Hiding(border=1)),
    "template": Kind(CLEAR, Hiding(template=1)),
}
WHILE_TRAINING = ("clean", "hard")


def validate(
    objective: Objective, photos: Photos, pairs: int, kinds: Iterable[str] | None = None
) -> dict[str, Figures]:
    """Figures by name, of so many pairs of each kind; None takes all of KINDS.

    The matte and the light network have kinds of their own, all of which are taken.
    """
    if isinstance(objective, MatteObjective):
        with _evaluating(objective.taught):
            return {
                name: matte_figures(objective.network, photos, _batches(pairs), kind)
                for name, kind in MATTE_KINDS.items()
            }

    if isinstance(objective, LightObjective):
        with _evaluating(objective.taught):
            return {
                name: light_figures(objective.network, photos, _batches(pairs), kind)
                for name, kind in LIGHT_KINDS.items()
            }

    def figures(kind: Kind) -> Figures:
        if isinstance(objective, TranslationObjective):
            return translation_figures(objective, photos, pairs, kind)
        if isinstance(objective, PolarObjective):
            return polar_figures(objective, photos, pairs, kind)
        return residual_figures(objective, photos, pairs, kind)

    with _evaluating(objective.taught):
        return {name: figures(KINDS[name]) for name in (KINDS if kinds is None else kinds)}


@contextmanager
def _evaluating(taught: nn.Module) -> Iterator[None]:
    """Evaluation mode without gradients, the training's chance left as it was."""
    training = taught.training
    taught.eval()
    try:
        with torch.no_grad(), torch.random.fork_rng():
            yield
    finally:
        taught.train(training)


def translation_figures(objective: TranslationObjective, photos: Photos, pairs: int, kind: Kind) -> Figures:
    """Errors of the translation in px of the search crop, and the area under the ROC of its score."""
    columns: list[tuple[Tensor, ...]] = []
    for batch in _branch_batches(objective, photos, pairs, kind):
        shift, score = decode(*objective.outputs(batch), objective.config.stride)
        columns.append(((shift - batch.motion.shift).norm(dim=1), score, batch.positive))
    error, score, positive = _joined(columns)
    return {
        **percentiles("translation px", error[positive]),
        "score AUC": roc_area(score.numpy(), positive.numpy()),
    }


def polar_figures(objective: PolarObjective, photos: Photos, pairs: int, kind: Kind) -> Figures:
    """Errors of log-scale and rotation about the true centre, and the area under the ROC of the branch's score."""
    config = objective.config
    columns: list[tuple[Tensor, ...]] = []
    for batch in _branch_batches(objective, photos, pairs, kind):
        shift, score = decode(*objective.outputs(batch), config.stride)
        columns.append((*(shift - objective.truth(batch)).abs().unbind(1), score, batch.positive))
    log_scale, rotation, score, positive = _joined(columns)
    return {
        **percentiles("log-scale", log_scale[positive] * config.log_scale_per_pixel),
        **percentiles("rotation rad", rotation[positive] * config.radians_per_pixel),
        "log-polar score AUC": roc_area(score.numpy(), positive.numpy()),
    }


def residual_figures(objective: ResidualObjective, photos: Photos, pairs: int, kind: Kind) -> Figures:
    """Mean corner errors for offsets up to 12 px, those that negatives are given, and the AUC of what is seen.

    "corners" are those after a second look where the tracker would take one (`Proposer`), "first look" those before.
    """
    network: Any = objective.network
    columns: list[tuple[Tensor, ...]] = []
    for size in _batches(pairs):
        batch = residual_batch(photos, size, network.size, reach=12, **_as_drawn(kind))
        template = network.describe(batch.template)
        offsets, visible = network.conclude(*network.compare(template, batch.search))
        corners = outline(network.size, offsets)
        to_search = dlt(bounded(offsets, network.size), corners)
        more, _ = network.conclude(*network.compare(template, losses.warp(batch.search, to_search)))
        far = offsets.norm(dim=2).mean(1) > PROPOSAL.second_look_px
        settled = torch.where(far[:, None, None], project(to_search, corners + more) - corners, offsets)
        # Of negatives: to where the corners were.
        first, last = ((o - batch.offsets).norm(dim=2).mean(1) for o in (offsets, settled))
        columns.append((first, last, visible.flatten(1).mean(1), batch.positive))
    first, last, visible, positive = _joined(columns)
    return {
        **percentiles("corners px", last[positive]),
        **percentiles("first look px", first[positive]),
        **percentiles("negatives px", last[~positive]),
        "visible AUC": roc_area(visible.numpy(), positive.numpy()),
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


def table(columns: dict[str, Figures]) -> str:
    """A Markdown table with a row for each figure and a column for each set of them."""
    rows = [["", *columns], ["---"] * (len(columns) + 1)]
    names = next(iter(columns.values()))
    rows += [[name, *(f"{figures[name]:.4g}" for figures in columns.values())] for name in names]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _branch_batches(objective: BranchObjective, photos: Photos, pairs: int, kind: Kind) -> Iterator[BranchBatch]:
    """The pairs of both branches, the same ones for either."""
    config = objective.config
    sizes = config.template_size, config.search_size
    for size in _batches(pairs):
        batch = similarity_batch(photos, size, *sizes, config.context, **_as_drawn(kind))
        yield objective.encode(batch, jitter=0)


def _as_drawn(kind: Kind) -> dict[str, Any]:
    """What both kinds of batches take."""
    return {"hiding": kind.hiding, "look": kind.look, "plain": kind.plain, "gentle": 0}


def _batches(pairs: int) -> Iterator[int]:
    """Batch sizes; seeded here, so that both kinds of pairs are drawn alike."""
    torch.manual_seed(VALIDATION_SEED)
    for start in range(0, pairs, VALIDATION_BATCH):
        yield min(VALIDATION_BATCH, pairs - start)


def _joined(columns: list[tuple[Tensor, ...]]) -> list[Tensor]:
    return [torch.cat(column).cpu() for column in zip(*columns, strict=True)]
