"""What each component is taught: from samples to named losses, each with its weight in it; their sum is minimised."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from .. import losses
from ..compilation import compiled, convert
from ..homography import dlt
from ..paper import PaperResidual, through
from ..polar import polar_crop, polar_points
from ..residual import STRIDE, Matches, ResidualNetwork, geometry
from ..similarity import SimilarityNetwork
from ..synthesis import (
    Photos,
    ResidualBatch,
    SimilarityBatch,
    project,
    residual_batch,
    similarity_batch,
    unlabelled_batch,
)
from .data import Clips
from .recipes import Recipe

Losses = dict[str, Tensor]
Features = Callable[[Tensor], tuple[Tensor, ...]]
Residual = ResidualNetwork | PaperResidual


def frozen_features(network: SimilarityNetwork, device: torch.device) -> Features:
    """The backbone's maps without gradients; on a CPU by OpenVINO, which is about twice as fast there."""
    if device.type != "cpu":

        def on_gpu(crops: Tensor) -> tuple[Tensor, ...]:
            with torch.no_grad(), torch.autocast(device.type, torch.bfloat16, enabled=network.config.half):
                return tuple(m.float() for m in network.backbone(crops))

        return on_gpu

    run = compiled(convert(network.backbone, torch.zeros(1, 3, 127, 127)), torch.get_num_threads())

    def on_cpu(crops: Tensor) -> tuple[Tensor, ...]:
        return tuple(torch.from_numpy(maps) for maps in run(crops.contiguous().numpy()))

    return on_cpu


@dataclass
class SimilarityOutputs:
    """Score logits (B, 2, n, n) and offsets (B, 2, n, n), in cells, of both branches."""

    logits: Tensor
    offsets: Tensor
    polar_logits: Tensor
    polar_offsets: Tensor  # of log-scale and rotation


class SimilarityObjective:
    """L_s of the similarity component, whose backbone stays as it is."""

    name = "similarity"

    def __init__(self, network: SimilarityNetwork, recipe: Recipe, device: torch.device) -> None:
        self.network, self.recipe, self.config = network.to(device), recipe, network.config
        network.backbone.requires_grad_(False)
        self.training(False)
        self.features = frozen_features(network, device)
        self.points = torch.from_numpy(polar_points(self.config)).to(device)

    def training(self, mode: bool) -> None:
        """Batch statistics on or off; the backbone's never change."""
        self.network.train(mode)
        self.network.backbone.eval()

    def sample(self, photos: Photos, clips: Clips | None, batch: int) -> SimilarityBatch:
        """Pairs of images; clips teach this component nothing, as in the paper."""
        config, recipe = self.config, self.recipe
        return similarity_batch(
            photos,
            batch,
            config.template_size,
            config.search_size,
            config.context,
            recipe.negatives,
            recipe.similarity_occluded,
            look=recipe.look,
        )

    def outputs(self, batch: SimilarityBatch, jitter: float) -> SimilarityOutputs:
        """Both branches on a batch, the log-polar crop taken about the true centre, give or take a jitter in px."""
        network, shift = self.network, batch.motion.shift
        centre = shift + torch.randn_like(shift) * jitter
        polar = [
            polar_crop(batch.template, torch.zeros_like(centre), self.points),
            polar_crop(batch.search, centre, self.points),
        ]
        z = network.encode_template(self.features(batch.template))
        x = network.encode_search(self.features(batch.search))
        template_maps, search_maps = zip(*(m.chunk(2) for m in self.features(torch.cat(polar))), strict=True)
        polar_logits, polar_offsets = network.polar(
            network.encode_polar_template(template_maps), network.encode_polar_search(search_maps)
        )
        if polar_offsets.shape[1] == 4:  # of which the paper's head uses the first and the third
            polar_offsets = polar_offsets[:, ::2]
        logits, offsets = network.translation(z, x)
        return SimilarityOutputs(logits, offsets, polar_logits, polar_offsets)

    def losses(self, batch: SimilarityBatch) -> Losses:
        """The parts of L_s: L_cls, L_reg, L_cls2 and L_reg2, and the peak's cross-entropy where the recipe has it."""
        config, recipe, motion = self.config, self.recipe, batch.motion
        outputs = self.outputs(batch, recipe.centre_jitter)
        positive = batch.positive[:, None, None]

        points = losses.grid_points(outputs.logits.shape[-1], config.stride, outputs.logits.device)
        rotation = motion.rotation if recipe.rotated_labels else torch.zeros_like(motion.rotation)
        label = losses.hamming_labels(points, motion.shift, motion.log_scale.exp(), rotation, batch.target) * positive
        probability = outputs.logits.softmax(1)[:, 1]
        parts = {"classification": losses.classification_loss(probability, label, top=recipe.hard_negatives)}
        if recipe.peak:
            score = outputs.logits[:, 1] - outputs.logits[:, 0]
            cell = (motion.shift - points[0, 0]) / config.stride
            parts["peak"] = recipe.peak * losses.peak_loss(score, cell, batch.positive)
        if recipe.offset_radius is None:
            near = label > 0.7
        else:
            near = (points - motion.shift[:, None, None]).norm(dim=-1) < recipe.offset_radius * config.stride
        parts["offset"] = losses.offset_loss(
            outputs.offsets, points, motion.shift, near & positive, config.stride, recipe.offset_beta
        )

        truth = self.polar_truth(batch)
        points = losses.grid_points(outputs.polar_logits.shape[-1], config.stride, outputs.logits.device)
        label = torch.where(positive, losses.polar_labels(points, truth, config.stride), 0)
        parts["polar classification"] = losses.polar_classification_loss(outputs.polar_logits, label)
        near = ((points - truth[:, None, None]).norm(dim=-1) < 1.5 * config.stride) & positive
        parts["polar offset"] = losses.offset_loss(
            outputs.polar_offsets, points, truth, near, config.stride, recipe.offset_beta
        )
        return parts

    def polar_truth(self, batch: SimilarityBatch) -> Tensor:
        """Shift (B, 2) of the log-polar crop, px: log-scale along x, rotation along y."""
        config, motion = self.config, batch.motion
        return torch.stack(
            [motion.log_scale / config.log_scale_per_pixel, motion.rotation / config.radians_per_pixel], 1
        )


class ResidualObjective:
    """L_Lambda of the residual component, with what either network needs besides."""

    name = "residual"

    def __init__(self, network: Residual, recipe: Recipe, device: torch.device) -> None:
        self.network, self.recipe = network.to(device), recipe

    def training(self, mode: bool) -> None:
        """Batch statistics on or off."""
        self.network.train(mode)

    def sample(self, photos: Photos, clips: Clips | None, batch: int) -> ResidualBatch:
        """Pairs of images with known offsets, and a share of pairs of frames without."""
        recipe, size = self.recipe, self.network.size
        unlabelled = min(max(round(batch * recipe.clips), 1), batch - 1) if clips is not None and recipe.clips else 0
        samples = residual_batch(
            photos,
            batch - unlabelled,
            size,
            recipe.reach,
            recipe.negatives,
            recipe.residual_occluded,
            look=recipe.look,
        )
        if clips is None or not unlabelled:
            return samples
        return samples + unlabelled_batch(clips, *clips.pairs(unlabelled, recipe.gap), size)

    def losses(self, batch: ResidualBatch) -> Losses:
        """The parts of L_Lambda; for the compact network also what teaches its matches."""
        if isinstance(self.network, PaperResidual):
            return self._paper_losses(self.network, batch)
        return self._matching_losses(self.network, batch)

    def _paper_losses(self, network: PaperResidual, batch: ResidualBatch) -> Losses:
        """The paper's network: offsets of its own corners, from the search crop to the template's."""
        size = network.size
        template, search = network.prepare(batch.template), network.prepare(batch.search)
        offsets, embedded_template, embedded_search = network(template, search)
        corners = offsets.new_tensor([[0, 0], [0, size], [size, size], [size, 0]]) - (size - 1) / 2
        truth = through(torch.linalg.inv(dlt(batch.offsets, outline(size, offsets))), corners[None]) - corners
        to_template = dlt(bounded(offsets, size), corners)
        warped = network.extractor(losses.warp(template, to_template))
        parts = self._common(batch, offsets, truth, batch.positive)
        return parts | self._triplets(batch, embedded_search, warped, embedded_template)

    def _matching_losses(self, network: ResidualNetwork, batch: ResidualBatch) -> Losses:
        """The compact network: its points' matches are taught as well, and which of them are seen."""
        size = network.size
        template, search = network.describe(torch.cat([batch.template, batch.search])).chunk(2)
        matches = network.match(template, search)
        offsets = network.fit(matches.displacement, matches.weight)
        parts, visible = self._match_parts(matches, batch, size)
        shown = batch.positive & (visible.mean(1) > 0.15)
        parts |= self._common(batch, offsets, batch.offsets, shown)
        if not self.recipe.triplet_images and batch.labelled.all():
            return parts
        to_template = torch.linalg.inv(dlt(bounded(offsets, size), outline(size, offsets)))
        warped = network.describe(losses.warp(batch.template, to_template))
        return parts | self._triplets(batch, search, warped, template)

    def _match_parts(self, matches: Matches, batch: ResidualBatch, size: int) -> tuple[Losses, Tensor]:
        """Losses of the matches, and how far each point is truly seen (B, M)."""
        source, cells, _ = geometry(size, batch.template.device)
        place = project(dlt(batch.offsets, outline(size, batch.offsets)), source)  # (B, M, 2) px from the crop's centre
        within = (place.abs() < size / 2 - 2).all(2)
        clear = F.grid_sample(batch.clear, place[:, None] * (2 / size), align_corners=False)[:, 0, 0]
        visible = clear * within * (batch.positive & batch.labelled)[:, None]
        seen = visible > 0.5
        n = round(len(cells) ** 0.5)
        found = losses.matching_loss(matches.probability, (place - cells[0]) / STRIDE, seen, n)
        moved = F.smooth_l1_loss(matches.displacement[seen], (place - source)[seen], beta=0.5, reduction="sum")
        moved = moved / (2 * seen.sum()).clamp_min(1)
        known = batch.labelled
        visibility = F.binary_cross_entropy_with_logits(matches.visible[known], visible[known])
        weight = self.recipe.matches
        return {"matching": 0.5 * weight * found, "moved": weight * moved, "visibility": weight * visibility}, visible

    def _common(self, batch: ResidualBatch, offsets: Tensor, truth: Tensor, positive: Tensor) -> Losses:
        """Corner loss of labelled positives, and the negatives' loss."""
        known = positive & batch.labelled
        return {
            "corner": self.recipe.corner * losses.corner_loss(offsets[known], truth[known]),
            "negative": self.recipe.negative * losses.negative_loss(offsets[~batch.positive]),
        }

    def _triplets(self, batch: ResidualBatch, search: Tensor, warped: Tensor, template: Tensor) -> Losses:
        """The unsupervised loss, of positive pairs with and without labels; maps (B, C, m, m)."""
        parts = {}
        for name, weight, rows in (
            ("triplet images", self.recipe.triplet_images, batch.positive & batch.labelled),
            ("triplet clips", self.recipe.triplet_clips, ~batch.labelled),
        ):
            if weight:
                parts[name] = weight * losses.triplet_loss(search[rows], warped[rows], template[rows])
        return parts


Objective = SimilarityObjective | ResidualObjective


def outline(size: int, like: Tensor) -> Tensor:
    """Corners (4, 2) of a square crop, px from its centre."""
    return like.new_tensor([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (size / 2)


def bounded(offsets: Tensor, size: int) -> Tensor:
    """Offsets that leave a quad convex, as a warp by it must be; beyond a fifth of the side they are cut."""
    return offsets.clamp(-0.2 * size, 0.2 * size)
