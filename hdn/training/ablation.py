"""The rows of the paper's ablation table, as changes of a recipe; each is trained and validated at one budget."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from ..errors import InputError
from ..networks.config import Config
from .curves import Row
from .loop import Data, train
from .packing import pack
from .recipes import ALL_NEGATIVES, recipe_of

# Fields of the recipe that differ from the full one.
TRANSLATION: dict[str, dict[str, Any]] = {
    "full": {},
    "no-hard-negatives": {"hard_negatives": ALL_NEGATIVES},
    "upright-labels": {"rotated_labels": False},
}
POLAR: dict[str, dict[str, Any]] = {"full": {}}  # it has neither hard negatives nor labels that turn
RESIDUAL: dict[str, dict[str, Any]] = {
    "full": {"triplet_images": 1.0},
    "supervised": {"clips": 0.0, "triplet_images": 0.0},
    "unsupervised": {"corner": 0.0, "matches": 0.0, "triplet_images": 1.0},
    "no-negatives": {"triplet_images": 1.0, "negatives": 0.0, "negative": 0.0},
}

# Number in the paper's table, name, and the variants of translation, which polar goes with, and of residual.
ROWS = [
    (1, "similarity only", "full", None),
    (2, "residual only", None, "full"),
    (3, "supervised", "full", "supervised"),
    (4, "unsupervised", "full", "unsupervised"),
    (5, "without hard negatives", "no-hard-negatives", "full"),
    (6, "without rotated labels", "upright-labels", "full"),
    (7, "without negative loss", "full", "no-negatives"),
    (8, "full", "full", "full"),
]
FIGURES = [
    "translation px median",
    "translation px p90",
    "log-scale median",
    "rotation rad median",
    "score AUC",
    "corners px median",
    "corners px p90",
    "negatives px p90",
    "visible AUC",
]


def run(
    data: Data,
    out: Path,
    config: Config,
    *,
    steps: int,
    batch: int | None,
    backbone: Path | None,
    device: torch.device,
    seed: int,
    validation_pairs: int = 512,
) -> Path:
    """Trains each variant of each component once, or goes on with it, and writes `out`/ablation.md.

    A row's weights are packed into `out`/NAME.safetensors, for tracking with them.

    Raises:
        InputError: there are no clips, without which rows 3, 4 and 8 would not differ as they should.
    """
    if data.clips is None:
        raise InputError("the ablation compares training with and without clips: name some with --videos")
    figures: dict[tuple[str, str], dict[str, Row]] = {}
    for component, variants in (("translation", TRANSLATION), ("polar", POLAR), ("residual", RESIDUAL)):
        for name, changes in variants.items():
            print(f"{component}, {name}", flush=True)
            figures[component, name] = train(
                component,
                data,
                out / component / name,
                config,
                recipe=replace(recipe_of(config), **changes),
                steps=steps,
                batch=batch,
                backbone=backbone,
                device=device,
                seed=seed,
                validation_pairs=validation_pairs,
            )
    sections = []
    for look in ("clean", "hard"):
        lines = [["No.", "", *FIGURES], ["---"] * (len(FIGURES) + 2)]
        for number, title, translation, residual in ROWS:
            known = figures["translation", translation][look] | figures["polar", "full"][look] if translation else {}
            known = known | figures["residual", residual][look] if residual else known
            lines.append([str(number), title, *(f"{known[f]:.4g}" if f in known else "" for f in FIGURES)])
        sections.append(f"## {look.capitalize()} pairs\n\n" + "\n".join(f"| {' | '.join(line)} |" for line in lines))
    for _, title, translation, residual in ROWS:
        if translation and residual:
            pack(
                out / "translation" / translation / "translation.pt",
                out / "polar" / "full" / "polar.pt",
                out / "residual" / residual / "residual.pt",
                out / f"{title.replace(' ', '-')}.safetensors",
            )
    report = out / "ablation.md"
    used = batch or recipe_of(config).batch
    report.write_text(
        f"# Ablation, configuration {config.name}\n\n"
        f"Each component trained for {steps} steps of {used} pairs, seed {seed}; validated on {validation_pairs} pairs "
        f"of each kind, of {len(data.held_out)} images ({data.sources['held_out']}), motions over the paper's ranges, "
        f"corner offsets to 12 px.\n"
        f"Numbers are those of the paper's table. Rows 1 and 2 share their components with row 8: what the stages are "
        f"worth shows in tracking alone.\n\n" + "\n\n".join(sections) + "\n"
    )
    return report
