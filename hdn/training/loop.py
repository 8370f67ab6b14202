"""The training loop of one component: resumable, seeded, with its progress, curves and validation."""

import logging
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from ..errors import RunError
from ..networks.config import COMPACT, Config
from ..networks.light_network import LightNetwork
from ..networks.matte_network import MatteNetwork
from ..networks.paper import PaperResidual
from ..networks.residual import ResidualNetwork
from ..networks.similarity import SimilarityNetwork
from ..networks.weights import LIGHT, MATTE
from ..synthesis import Photos
from . import curves
from .checkpoint import read_checkpoint, write_checkpoint
from .data import Clips, Pool, find_clips, find_images, split
from .initial import load_backbone, load_start
from .light import LightObjective
from .matte import MatteObjective
from .objectives import Objective, PolarObjective, ResidualObjective, TranslationObjective
from .recipes import Recipe, recipe_of
from .replay import Replay
from .validation import WHILE_TRAINING, Figures, validate

COMPONENTS = ("translation", "polar", "residual")  # of HDN; the matte and the light network are trained alike
STEPS_PER_REPORT = 50  # a line of progress
STEPS_PER_CHECKPOINT = 500  # with a validation
HELD_OUT_IN_MEMORY = 1_000  # images; 0.3 GB

GRADIENT_NORM = 5.0  # to which a step's gradients are cut

log = logging.getLogger(__name__)


@dataclass
class Data:
    """What is trained and validated on, in memory, and where it came from."""

    photos: Pool
    held_out: Photos
    clips: Clips | None
    sources: dict[str, Any]

    @classmethod
    def open(cls, images: list[Path], videos: list[Path], device: torch.device, seed: int) -> "Data":
        """Finds and reads images and clips.

        Raises:
            InputError: none are there, or one cannot be read.
        """
        trained, kept, rule = split(find_images(images))
        clips = Clips(find_clips(videos), device, seed) if videos else None
        photos = Pool(trained, device, seed)
        held_out = Photos.read(kept[:HELD_OUT_IN_MEMORY], device)
        print(f"{len(trained)} images, {len(kept)} {rule}", flush=True)
        if clips is not None:
            print(f"{clips.count} clips, {len(clips)} frames of them", flush=True)
        places = {"images": [str(p) for p in images], "videos": [str(p) for p in videos]}
        return cls(photos, held_out, clips, {**places, "held_out": rule})


def build(
    component: str,
    config: Config,
    recipe: Recipe,
    device: torch.device,
    backbone: Path | None,
    state: dict[str, Tensor] | None = None,
) -> Objective:
    """A network, and what one component of it is to be taught: new, on a given backbone, or with the weights `state`.

    Raises:
        InputError: the backbone's weights cannot be used.
    """
    if component == MATTE:
        matte = MatteNetwork()
        if state is not None:
            matte.load_state_dict(state)
        return MatteObjective(matte, device)
    if component == LIGHT:
        light = LightNetwork()
        if state is not None:
            light.load_state_dict(state)
        return LightObjective(light, device)
    if component == "residual":
        residual = ResidualNetwork(config) if config.residual == "matching" else PaperResidual(config)
        if state is not None:
            residual.load_state_dict(state)
        return ResidualObjective(residual, recipe, device)
    similarity = SimilarityNetwork(config)
    if state is not None:
        similarity.load_state_dict(state)
    elif backbone is not None:
        load_backbone(similarity, backbone)
    else:
        log.warning("the backbone keeps random weights, which no training mends: name some with --backbone")
    objective = TranslationObjective if component == "translation" else PolarObjective
    return objective(similarity, recipe, device)


def train(
    component: str,
    data: Data,
    out: Path,
    config: Config = COMPACT,
    *,
    recipe: Recipe | None = None,
    steps: int | None = None,
    batch: int | None = None,
    backbone: Path | None = None,
    start: Path | None = None,
    device: torch.device,
    seed: int = 0,
    validation_pairs: int = 512,
) -> dict[str, Figures]:
    """Trains one component, and goes on from `out`/`component`.pt where that is there.

    Besides the checkpoint it leaves curves: `component`.csv, `component`_validation.csv, and `component`.png.

    Args:
        recipe, steps, batch: the configuration's own unless given.
        backbone: weights of the backbone that translation and polar stand on.
        start: a weights file to begin with instead, its backbone included; the schedule begins anew.

    Returns:
        The last validation's figures, by 'clean' and 'hard' pairs, and names.

    Raises:
        InputError: the checkpoint there is of another configuration, component or start, or weights cannot be used.
        RunError: the loss is no number any more.
    """
    recipe = recipe or recipe_of(config)
    recipe = replace(recipe, steps=steps or recipe.steps, batch=batch or recipe.batch)
    steps, batch = recipe.steps, recipe.batch
    torch.manual_seed(seed)
    out.mkdir(parents=True, exist_ok=True)
    checkpoint = out / f"{component}.pt"
    saved = read_checkpoint(checkpoint, component, config, start)
    state = begun_with = None
    if saved is not None:
        state, begun_with = saved["network"], saved.get("start")
    elif start is not None:
        state, begun_with = load_start(start, component, config), str(start)
        print(f"{component}: begins with the weights of {start}", flush=True)
    objective = build(component, config, recipe, device, backbone, state)
    parameters = list(objective.taught.parameters())
    optimizer = torch.optim.AdamW(parameters, weight_decay=recipe.weight_decay)
    done = 0
    history: list[curves.Row] = []
    validations: list[curves.Row] = []
    if saved is not None:
        optimizer.load_state_dict(saved["optimizer"])
        done, history, validations = saved["step"], saved.get("losses", []), saved.get("validations", [])
        torch.manual_seed(seed + done)
        print(f"{component}: goes on from step {done} of {checkpoint}", flush=True)
    plots = True

    def validation(step: int) -> dict[str, Figures]:
        figures = validate(objective, data.held_out, validation_pairs, WHILE_TRAINING)
        validations.append({"step": step} | {f"{k} {n}": v for k, part in figures.items() for n, v in part.items()})
        for name, part in figures.items():
            print(f"step {step}  {name}: " + ", ".join(f"{n} {v:.4g}" for n, v in part.items()), flush=True)
        return figures

    def save(step: int) -> None:
        state = {
            "network": objective.network.state_dict(),
            "optimizer": optimizer.state_dict(),
            "component": component,
            "config": config.name,
            "start": begun_with,
            "recipe": asdict(recipe),
            "step": step,
            "seed": seed,
            **data.sources,
            "losses": history,
            "validations": validations,
        }
        write_checkpoint(checkpoint, state)

    if done >= steps:
        print(f"{component}: {steps} steps are done already; more with --steps", flush=True)
        return validation(done)
    objective.taught.train()
    sums: dict[str, Tensor] = {}
    figures: dict[str, Figures] = {}
    since, clock = done, time.perf_counter()
    samples = Replay(lambda: objective.sample(data.photos, data.clips, batch), objective.uses)
    for step in range(done + 1, steps + 1):
        rate = recipe.rate(step - 1, steps) * (recipe.start_rate if begun_with else 1)
        for group in optimizer.param_groups:
            group["lr"] = rate
        parts = objective.losses(samples.next())  # type: ignore[arg-type]
        loss = torch.stack(list(parts.values())).sum()
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        try:
            nn.utils.clip_grad_norm_(parameters, GRADIENT_NORM, error_if_nonfinite=True)
        except RuntimeError as error:
            raise RunError(f"the loss is no number any more at step {step}: go on from the last checkpoint") from error
        optimizer.step()
        for name, value in {"loss": loss, **parts}.items():
            sums[name] = sums.get(name, torch.zeros_like(value)) + value.detach()
        last = step == steps
        if step % STEPS_PER_REPORT == 0 or last:
            means = {name: float(total) / (step - since) for name, total in sums.items()}
            history.append({"step": step, "rate": rate, **means})
            curves.write_csv(history, out / f"{component}.csv")
            seconds = time.perf_counter() - clock
            speed, left = (step - since) * batch / seconds, (steps - step) * seconds / (step - since)
            detail = ", ".join(f"{name} {value:.3f}" for name, value in means.items() if name != "loss")
            print(
                f"{component} {step}/{steps}  loss {means['loss']:.3f} ({detail})  "
                f"{speed:.0f} samples/s, {left / 60:.0f} min to go",
                flush=True,
            )
            data.photos.refresh()
            sums, since, clock = {}, step, time.perf_counter()
        if step % STEPS_PER_CHECKPOINT == 0 or last:
            figures = validation(step)
            save(step)
            curves.write_csv(validations, out / f"{component}_validation.csv")
            plots = plots and curves.plot(history, validations, out / f"{component}.png")
            clock = time.perf_counter()
    return figures
