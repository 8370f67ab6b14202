"""`hdn-train`: trains a component, validates and packs weights, runs the ablation."""

import argparse
import logging
import sys
from collections.abc import Sequence
from pathlib import Path

import torch

from ..commandline import Parser, run
from ..errors import InputError
from ..networks import light_network, matte_network, pytorch
from ..networks.config import COMPACT, CONFIGS
from ..networks.conversion import pack_ir
from ..networks.weights import FILE_NAME, LIGHT, LIGHT_FILE_NAME, MATTE, MATTE_FILE_NAME, architecture, shipped
from ..synthesis import Photos
from . import ablation
from .checkpoint import read_checkpoint
from .data import find_images, held_out
from .initial import load_start
from .light import LightObjective
from .loop import COMPONENTS, HELD_OUT_IN_MEMORY, Data, train
from .matte import MatteObjective
from .objectives import Objective, PolarObjective, ResidualObjective, TranslationObjective
from .packing import pack, pack_light, pack_matte
from .recipes import recipe_of
from .validation import Figures, table, validate

SHIPPED = {
    "shipped": FILE_NAME,
    "matte": MATTE_FILE_NAME,
    "light": LIGHT_FILE_NAME,
}  # what `validate` takes for the files that ship


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of hdn-train."""
    sys.exit(run(_command, arguments, "the last checkpoint is kept, the same command goes on from there"))


def _command(arguments: Sequence[str] | None) -> int:
    options = _parser().parse_args(arguments)
    logging.basicConfig(format="%(levelname)s: %(message)s", level=logging.WARNING)
    options.run(options)
    return 0


def _parser() -> Parser:
    parser = Parser(
        prog="hdn-train",
        description="Train a component of HDN on folders of images and clips, or say what weights reach. "
        "The same command after an interruption goes on from the last checkpoint.",
        epilog="Exit status: 0 done, 1 failed while working, 2 wrong input. See docs/training.md.",
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for component in COMPONENTS:
        command = commands.add_parser(component, help=f"train the {component} component", description="")
        _add_training(command)
        _add_network(command)
        _add_start(command)
        command.set_defaults(run=_train)

    for name, tells in ((MATTE, "what hides a surface"), (LIGHT, "how a surface's first view is lit")):
        command = commands.add_parser(name, help=f"train the network that tells {tells}", description="")
        _add_training(command)
        _add_start(command)
        command.set_defaults(run=_train, videos=[], config=COMPACT.name, backbone=None)

    command = commands.add_parser("ablation", help="train the rows of the paper's ablation table", description="")
    _add_training(command)
    _add_network(command)
    command.set_defaults(run=_ablate)

    command = commands.add_parser(
        "pack",
        help="checkpoints into a weights file",
        description="Write a weights file, and beside it its networks for OpenVINO, which run without PyTorch.",
    )
    source = command.add_mutually_exclusive_group(required=True)
    source.add_argument("--out", type=Path, metavar="DIR", help="folder of the three checkpoints, and for the file")
    source.add_argument("--matte", type=Path, metavar="DIR", help="folder of the matte's checkpoint, and for its file")
    source.add_argument("--light", type=Path, metavar="DIR", help="the same of the light network")
    source.add_argument("--weights", type=Path, metavar="FILE", help="a weights file, that lacks those networks alone")
    command.set_defaults(run=_pack)

    command = commands.add_parser("validate", help="errors of weights on held-out images", description="")
    command.add_argument(
        "--weights", required=True, metavar="FILE", help="a weights file, or 'shipped', 'matte' or 'light'"
    )
    command.add_argument("--images", type=Path, nargs="+", required=True, metavar="DIR", help="of them the held-out")
    _add_machine(command)
    command.set_defaults(run=_validate)
    return parser


def _add_training(command: argparse.ArgumentParser) -> None:
    add = command.add_argument
    add("--images", type=Path, nargs="+", default=[], metavar="DIR", help="trees of images")
    add("--out", type=Path, required=True, metavar="DIR", help="for checkpoints, curves and reports")
    add("--steps", type=int, metavar="N", help="default: the recipe's")
    add("--batch", type=int, metavar="N", help="default: the recipe's")
    add("--seed", type=int, default=0, metavar="N", help="default 0")
    _add_machine(command)


def _add_network(command: argparse.ArgumentParser) -> None:
    add = command.add_argument
    add("--videos", type=Path, nargs="+", default=[], metavar="DIR", help="trees of videos or folders of frames")
    add("--config", choices=list(CONFIGS), default=COMPACT.name, help="default compact")
    add("--backbone", type=Path, metavar="FILE", help="its ImageNet weights (default for compact: the shipped ones)")


def _add_start(command: argparse.ArgumentParser) -> None:
    command.add_argument("--start", type=Path, metavar="FILE", help="begin with the weights of this file")


def _add_machine(command: argparse.ArgumentParser) -> None:
    command.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu", help="cpu, cuda, cuda:1")
    command.add_argument("--threads", type=int, metavar="N", help="on a CPU (default: all)")
    command.add_argument(
        "--pairs", type=int, default=512, metavar="N", help="to validate on, of each kind (default 512)"
    )


def _machine(options: argparse.Namespace) -> torch.device:
    """The device, ready; threads and pairs are checked with it."""
    if options.pairs < 1:
        raise InputError("--pairs takes 1 or more")
    if options.threads is not None:
        if options.threads < 1:
            raise InputError("--threads takes 1 or more")
        torch.set_num_threads(options.threads)
    try:
        device = torch.device(options.device)
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError) as error:
        reason = str(error).split("\n")[0]
        raise InputError(f"--device {options.device} cannot be used ({reason}): leave it out, or name cpu") from error
    return device


def _check_budget(options: argparse.Namespace) -> None:
    if (options.steps is not None and options.steps < 1) or (options.batch is not None and options.batch < 2):
        raise InputError("--steps takes 1 or more, --batch 2 or more")


def _backbone(options: argparse.Namespace) -> Path | None:
    """Of the compact configuration the shipped weights have it, as ImageNet's classifier left it."""
    return options.backbone or (shipped() if options.config == COMPACT.name else None)


def _train(options: argparse.Namespace) -> None:
    _check_budget(options)
    device, component = _machine(options), options.command
    if options.start and options.backbone:
        raise InputError("--start brings a backbone of its own: leave --backbone out")
    if options.videos and component != "residual":
        logging.warning("clips teach the residual component alone: --videos are not read")
        options.videos = []
    config = CONFIGS[options.config]
    # What cannot be used is refused before all images are read.
    saved = read_checkpoint(options.out / f"{component}.pt", component, config, options.start)
    if options.start and saved is None:
        load_start(options.start, component, config)
    done = saved["step"] if saved else 0
    train(
        component,
        Data.open(options.images, options.videos, device, options.seed + done),
        options.out,
        config,
        steps=options.steps,
        batch=options.batch,
        backbone=_backbone(options),
        start=options.start,
        device=device,
        seed=options.seed,
        validation_pairs=options.pairs,
    )


def _ablate(options: argparse.Namespace) -> None:
    _check_budget(options)
    device, config = _machine(options), CONFIGS[options.config]
    report = ablation.run(
        Data.open(options.images, options.videos, device, options.seed),
        options.out,
        config,
        steps=options.steps or recipe_of(config).steps,
        batch=options.batch,
        backbone=_backbone(options),
        device=device,
        seed=options.seed,
        validation_pairs=options.pairs,
    )
    print(f"Written to {report}")


def _pack(options: argparse.Namespace) -> None:
    if options.weights:
        path = pack_ir(options.weights)
    elif options.matte:
        path = pack_matte(options.matte / "matte.pt", options.matte)
    elif options.light:
        path = pack_light(options.light / "light.pt", options.light)
    else:
        path = pack(options.out / "translation.pt", options.out / "polar.pt", options.out / "residual.pt", options.out)
    print(f"Written to {path}")


def _validate(options: argparse.Namespace) -> None:
    device = _machine(options)
    objectives = _objectives(
        shipped(SHIPPED[options.weights]) if options.weights in SHIPPED else Path(options.weights), device
    )
    found = find_images(options.images)
    kept = [p for p in found if held_out(p)]
    print(f"{len(kept or found)} images, {'of held-out sources' if kept else 'none of them of a held-out source'}")
    photos = Photos.read((kept or found)[:HELD_OUT_IN_MEMORY], device)
    columns: dict[str, Figures] = {}
    for objective in objectives:
        for name, figures in validate(objective, photos, options.pairs).items():
            columns.setdefault(name, {}).update(figures)
    print(table(columns))


def _objectives(path: Path, device: torch.device) -> list[Objective]:
    """What the networks of a weights file are taught."""
    kind = architecture(path, [*CONFIGS, MATTE, LIGHT])
    if kind == MATTE:
        return [MatteObjective(matte_network.load(path), device)]
    if kind == LIGHT:
        return [LightObjective(light_network.load(path), device)]
    network = pytorch.load(path)
    recipe = recipe_of(network.config)
    return [
        TranslationObjective(network.similarity, recipe, device),
        PolarObjective(network.similarity, recipe, device),
        ResidualObjective(network.residual, recipe, device),
    ]
