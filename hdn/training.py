"""Training of the two components, each on samples of its own; resumable, seeded."""

import argparse
import csv
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from . import losses, weights
from .compilation import compiled, convert
from .config import COMPACT, Config
from .errors import InputError
from .homography import dlt
from .polar import polar_crop, polar_points
from .residual import STRIDE, ResidualNetwork, geometry
from .similarity import SimilarityNetwork
from .synthesis import Photos, ResidualBatch, SimilarityBatch, project, residual_batch, similarity_batch

HELD_OUT = ("kodak", "clic2025", "urban100")  # folders of photographs that training never sees
SUFFIXES = {".webp", ".jpg", ".jpeg", ".png"}

Features = Callable[[Tensor], tuple[Tensor, ...]]


def find_images(folders: list[Path], held_out: bool) -> list[Path]:
    """Images under the folders, sorted: those of the held-out sources, or all the others."""
    paths = sorted(p for folder in folders for p in folder.rglob("*") if p.suffix.lower() in SUFFIXES)
    chosen = [p for p in paths if any(part in HELD_OUT for part in p.parts) == held_out]
    if not chosen:
        kind = f"held-out images ({', '.join(HELD_OUT)})" if held_out else "images"
        raise InputError(f"no {kind} under {', '.join(map(str, folders)) or 'no folder'}: name folders with --images")
    return chosen


def frozen_features(network: SimilarityNetwork, device: torch.device) -> Features:
    """The backbone's maps without gradients; on a CPU by OpenVINO, which is about twice as fast there."""
    if device.type == "cuda":

        def on_gpu(crops: Tensor) -> tuple[Tensor, ...]:
            with torch.no_grad(), torch.autocast("cuda", torch.bfloat16):
                return tuple(m.float() for m in network.backbone(crops))

        return on_gpu

    run = compiled(convert(network.backbone, torch.zeros(1, 3, 127, 127)), torch.get_num_threads())

    def on_cpu(crops: Tensor) -> tuple[Tensor, ...]:
        return tuple(torch.from_numpy(maps) for maps in run(crops.contiguous().numpy()))

    return on_cpu


def similarity_outputs(
    network: SimilarityNetwork, features: Features, batch: SimilarityBatch, points: Tensor, jitter: float
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Translation logits and offsets, log-polar logits and offsets, each (B, 2, n, n)."""
    centre = batch.motion.shift + torch.randn_like(batch.motion.shift) * jitter
    polar = torch.cat(
        [
            polar_crop(batch.template, torch.zeros_like(centre), points),
            polar_crop(batch.search, centre, points),
        ]
    )
    z = network.encode_template(features(batch.template))
    x = network.encode_search(features(batch.search))
    template_maps, search_maps = zip(*(m.chunk(2) for m in features(polar)), strict=True)
    z_polar = network.encode_polar_template(template_maps)
    x_polar = network.encode_polar_search(search_maps)
    return *network.translation(z, x), *network.polar(z_polar, x_polar)


def similarity_loss(config: Config, outputs: tuple[Tensor, ...], batch: SimilarityBatch) -> Tensor:
    """L_s (paper): both branches' classification and offset losses."""
    logits, offsets, polar_logits, polar_offsets = outputs
    motion, positive = batch.motion, batch.positive[:, None, None]
    points = losses.grid_points(logits.shape[-1], config.stride, logits.device)
    label = (
        losses.hamming_labels(points, motion.shift, motion.log_scale.exp(), motion.rotation, batch.target) * positive
    )
    probability = logits.softmax(1)[:, 1]
    near = (points - motion.shift[:, None, None]).norm(dim=-1) < 2 * config.stride
    loss = losses.classification_loss(probability, label)
    loss = loss + losses.peak_loss(
        logits[:, 1] - logits[:, 0], (motion.shift - points[0, 0]) / config.stride, batch.positive
    )
    loss = loss + losses.offset_loss(offsets, points, motion.shift, near & positive, config.stride)

    truth = polar_truth(config, batch)
    points = losses.grid_points(polar_logits.shape[-1], config.stride, logits.device)
    label = torch.where(positive, losses.polar_labels(points, truth, config.stride), 0)
    near = ((points - truth[:, None, None]).norm(dim=-1) < 1.5 * config.stride) & positive
    loss = loss + losses.polar_classification_loss(polar_logits, label)
    return loss + losses.offset_loss(polar_offsets, points, truth, near, config.stride)


def polar_truth(config: Config, batch: SimilarityBatch) -> Tensor:
    """Shift (B, 2) of the log-polar crop, px: log-scale along x, rotation along y."""
    per_pixel = torch.tensor([config.log_scale_per_pixel, config.radians_per_pixel], device=batch.search.device)
    return torch.stack([batch.motion.log_scale, batch.motion.rotation], 1) / per_pixel


def decode(logits: Tensor, offsets: Tensor, stride: int) -> tuple[Tensor, Tensor]:
    """Shift (B, 2) in px at the most probable cell, and its probability (B,)."""
    b, _, n, _ = logits.shape
    best = logits.softmax(1)[:, 1].flatten(1).max(1)
    points = losses.grid_points(n, stride, logits.device).reshape(-1, 2)[best.indices]
    at = offsets.flatten(2).gather(2, best.indices[:, None, None].expand(b, 2, 1))[..., 0]
    return points - at * stride, best.values


def residual_loss(network: ResidualNetwork, batch: ResidualBatch) -> Tensor:
    """The paper's corner and negative losses, and what teaches the matches: where points are, and which are seen."""
    size = batch.template.shape[-1]
    template, search = network.describe(torch.cat([batch.template, batch.search])).chunk(2)
    matches = network.match(template, search)
    offsets = network.fit(matches.displacement, matches.weight)
    source, cells, _ = geometry(size, offsets.device)
    corners = torch.tensor([[-1.0, -1], [1, -1], [1, 1], [-1, 1]], device=offsets.device) * size / 2
    place = project(dlt(batch.offsets, corners), source)  # (B, M, 2) true places, px from the crop's centre
    within = (place.abs() < size / 2 - 2).all(2)
    clear = F.grid_sample(batch.clear, place[:, None] * (2 / size), align_corners=False)[:, 0, 0]
    visible = clear * within * batch.positive[:, None]
    n = round(len(cells) ** 0.5)
    seen = visible > 0.5
    matching = losses.matching_loss(matches.probability, (place - cells[0]) / STRIDE, seen, n)
    moved = F.smooth_l1_loss(matches.displacement[seen], (place - source)[seen], beta=0.5)
    visibility = F.binary_cross_entropy_with_logits(matches.visible, visible)
    positive = batch.positive & (visible.mean(1) > 0.15)
    corner = losses.corner_loss(offsets[positive], batch.offsets[positive])
    return losses.negative_loss(offsets[~batch.positive]) + 0.25 * corner + 0.5 * matching + moved + visibility


def percentiles(name: str, errors: Tensor) -> str:
    middle, high = (float(v) for v in torch.quantile(errors, torch.tensor([0.5, 0.9])))
    return f"{name} {middle:.3f} / {high:.3f}"


def roc_area(positive: Tensor, negative: Tensor) -> float:
    """Probability that a positive pair scores above a negative one."""
    return float((positive[:, None] > negative[None]).float().mean())


@torch.no_grad()
def validate_similarity(network: SimilarityNetwork, features: Features, photos: Photos, batches: int) -> str:
    """Median / 90th percentile of the errors on held-out photographs at the paper's ranges."""
    config, points = network.config, torch.from_numpy(polar_points(network.config)).to(photos.device)
    network.eval()
    columns: list[tuple[Tensor, ...]] = []
    with torch.random.fork_rng():
        torch.manual_seed(1)
        for _ in range(batches):
            batch = similarity_batch(
                photos, 32, config.template_size, config.search_size, config.context, occluded=0, gentle=0
            )
            outputs = similarity_outputs(network, features, batch, points, jitter=0)
            shift, score = decode(outputs[0], outputs[1], config.stride)
            polar, polar_score = decode(outputs[2], outputs[3], config.stride)
            off = (polar - polar_truth(config, batch)).abs().cpu()
            error = (shift - batch.motion.shift).norm(dim=1).cpu()
            columns.append((error, off[:, 0], off[:, 1], score.cpu(), polar_score.cpu(), batch.positive.cpu()))
    network.train()
    shift, log_scale, rotation, score, polar_score, positive = (torch.cat(c) for c in zip(*columns, strict=True))
    return ", ".join(
        [
            percentiles("shift px", shift[positive]),
            percentiles("log-scale", log_scale[positive] * config.log_scale_per_pixel),
            percentiles("rotation rad", rotation[positive] * config.radians_per_pixel),
            f"score AUC {roc_area(score[positive], score[~positive]):.3f}",
            f"polar AUC {roc_area(polar_score[positive], polar_score[~positive]):.3f}",
        ]
    )


@torch.no_grad()
def validate_residual(network: ResidualNetwork, photos: Photos, size: int, batches: int) -> str:
    """Median / 90th percentile of the mean corner error on held-out photographs."""
    network.eval()
    errors, norms, seen, truly = [], [], [], []
    with torch.random.fork_rng():
        torch.manual_seed(1)
        for _ in range(batches):
            batch = residual_batch(photos, 32, size, reach=12, occluded=0, gentle=0)
            template, search = (network.describe(x) for x in (batch.template, batch.search))
            matches = network.match(template, search)
            offsets = network.fit(matches.displacement, matches.weight)
            seen.append(matches.visible.sigmoid().mean(1).cpu())
            truly.append(batch.positive.cpu())
            positive = batch.positive
            errors.append((offsets - batch.offsets)[positive].norm(dim=2).mean(1).cpu())
            norms.append(offsets[~positive].norm(dim=2).mean(1).cpu())
    network.train()
    visible, positives = torch.cat(seen), torch.cat(truly)
    area = roc_area(visible[positives], visible[~positives])
    corners, negatives = percentiles("corner px", torch.cat(errors)), percentiles("negatives px", torch.cat(norms))
    return f"{corners}, {negatives}, visible AUC {area:.3f}"


def train(
    component: str,
    folders: list[Path],
    out: Path,
    config: Config = COMPACT,
    *,
    steps: int,
    batch_size: int,
    rate: float,
    search_size: int,
    backbone: Path | None,
    device: torch.device,
    seed: int = 0,
    validation_batches: int = 16,
) -> None:
    """Trains one component; goes on from `out`/`component`.pt where that is there.

    The learning rate warms up over 200 steps and then falls along a cosine to zero at `steps`.
    """
    torch.manual_seed(seed)
    out.mkdir(parents=True, exist_ok=True)
    checkpoint = out / f"{component}.pt"
    photos = Photos(find_images(folders, held_out=False), device)
    held_out = Photos(find_images(folders, held_out=True), device)
    print(f"{component}: {len(photos)} images, {len(held_out)} held out", flush=True)

    network: nn.Module
    if component == "similarity":
        similarity = SimilarityNetwork(config).to(device)
        if backbone:
            similarity.backbone.load_imagenet(backbone)
        similarity.backbone.requires_grad_(False)
        network = similarity
    else:
        residual = ResidualNetwork(config).to(device)
        network = residual
    parameters = [p for p in network.parameters() if p.requires_grad]
    optimizer = torch.optim.AdamW(parameters, rate, weight_decay=1e-4)
    schedule = torch.optim.lr_scheduler.LambdaLR(
        optimizer, lambda step: min((step + 1) / 200, 0.5 + 0.5 * math.cos(math.pi * min(step / steps, 1)))
    )
    start = 0
    if checkpoint.exists():
        saved = torch.load(checkpoint, map_location=device, weights_only=True)
        network.load_state_dict(saved["network"])
        optimizer.load_state_dict(saved["optimizer"])
        schedule.load_state_dict(saved["schedule"])
        start = saved["step"]
        torch.manual_seed(seed + start)
    network.train()
    if component == "similarity":
        similarity.backbone.eval()
        features = frozen_features(similarity, device)
        points = torch.from_numpy(polar_points(config)).to(device)

    def loss_of_a_batch() -> Tensor:
        if component == "similarity":
            batch = similarity_batch(photos, batch_size, config.template_size, search_size, config.context)
            return similarity_loss(config, similarity_outputs(similarity, features, batch, points, 3.0), batch)
        return residual_loss(residual, residual_batch(photos, batch_size, config.residual_size, reach=16, occluded=0.4))

    def validation() -> str:
        if component == "similarity":
            line = validate_similarity(similarity, features, held_out, validation_batches)
            similarity.backbone.eval()
            return line
        return validate_residual(residual, held_out, config.residual_size, validation_batches)

    def save(step: int) -> None:
        state = {
            "network": network.state_dict(),
            "optimizer": optimizer.state_dict(),
            "schedule": schedule.state_dict(),
            "step": step,
            "config": config.name,
            "images": [str(f) for f in folders],
            "seed": seed,
        }
        torch.save(state, checkpoint.with_suffix(".tmp"))
        checkpoint.with_suffix(".tmp").replace(checkpoint)

    with open(out / f"{component}.csv", "a", newline="") as log:
        writer = csv.writer(log)
        clock, total = time.perf_counter(), 0.0
        for step in range(start + 1, steps + 1):
            loss = loss_of_a_batch()
            optimizer.zero_grad(set_to_none=True)
            loss.backward()
            nn.utils.clip_grad_norm_(parameters, 5.0)
            optimizer.step()
            schedule.step()
            total += float(loss.detach())
            if step % 50 == 0:
                speed = 50 * batch_size / (time.perf_counter() - clock)
                writer.writerow([step, total / 50, schedule.get_last_lr()[0]])
                log.flush()
                print(f"step {step}/{steps}  loss {total / 50:.3f}  {speed:.0f} samples/s", flush=True)
                clock, total = time.perf_counter(), 0.0
            if step % 500 == 0 or step == steps:
                save(step)
                print(f"step {step}  {validation()}", flush=True)
                clock = time.perf_counter()


def main() -> None:
    parser = argparse.ArgumentParser(prog="hdn-train", description="Train a component of HDN on folders of images.")
    parser.add_argument(
        "component", choices=["similarity", "residual", "pack"], help="pack: both into one weights file"
    )
    parser.add_argument("--images", type=Path, nargs="+", default=[], metavar="DIR")
    parser.add_argument("--out", type=Path, required=True, help="folder for the checkpoint and the loss curve")
    parser.add_argument("--steps", type=int, default=5000)
    parser.add_argument("--batch", type=int, default=32)
    parser.add_argument("--rate", type=float, default=2e-3, help="peak learning rate")
    parser.add_argument("--search-size", type=int, default=191, help="px; smaller than at tracking time is faster")
    parser.add_argument("--backbone", type=Path, help="ImageNet weights of EfficientNet-Lite0 (.pth)")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--threads", type=int, default=torch.get_num_threads())
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    try:
        _run(options)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)


def _run(options: argparse.Namespace) -> None:
    if options.component == "pack":
        weights.pack(options.out, options.out / weights.FILE_NAME)
        return
    torch.set_num_threads(options.threads)
    train(
        options.component,
        options.images,
        options.out,
        steps=options.steps,
        batch_size=options.batch,
        rate=options.rate,
        search_size=options.search_size,
        backbone=options.backbone,
        device=torch.device(options.device),
        seed=options.seed,
    )


if __name__ == "__main__":
    main()
