"""What each component is taught: from samples to named losses, each with its weight in it; their sum is minimised."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from ..networks.conversion import convert
from ..networks.geometry import dlt, polar_crop, project
from ..networks.openvino import compiled
from ..networks.paper import PaperResidual
from ..networks.polar import polar_points
from ..networks.residual import DESCRIPTOR_STRIDE, Matches, ResidualNetwork, geometry
from ..networks.similarity import SimilarityNetwork
from ..synthesis import (
    Motion,
    Photos,
    ResidualBatch,
    SimilarityBatch,
    residual_batch,
    similarity_batch,
    unlabelled_batch,
)
from . import losses
from .data import Clips
from .light import LightObjective
from .matte import MatteObjective
from .recipes import Recipe

Losses = dict[str, Tensor]
Maps = tuple[Tensor, ...]
Features = Callable[[Tensor], Maps]
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
class BranchBatch:
    """Pairs, by what is known of them and by what the backbone makes of the crops that a branch looks at."""

    motion: Motion
    target: Tensor  # (B, 2) half width and half height of the target's box in the template, px
    positive: Tensor  # (B,) bool
    template: Maps
    search: Maps


class BranchObjective(ABC):
    """What both branches of the similarity component share: samples, and a network that otherwise stays as it is.

    The backbone and the other branch keep their weights and their batch statistics.
    """

    def __init__(self, network: SimilarityNetwork, branch: nn.Module, recipe: Recipe, device: torch.device) -> None:
        self.network, self.recipe, self.config = network.to(device), recipe, network.config
        network.eval().requires_grad_(False)
        self.taught = branch.requires_grad_(True)
        self.uses = recipe.uses
        self.features = frozen_features(network, device)

    def sample(self, photos: Photos, clips: Clips | None, batch: int) -> BranchBatch:
        """Pairs of images; clips teach these branches nothing, as in the paper."""
        config, recipe = self.config, self.recipe
        pairs = similarity_batch(
            photos,
            batch,
            config.template_size,
            config.search_size,
            config.context,
            recipe.negatives,
            recipe.similarity_hiding,
            look=recipe.similarity_look,
            plain=recipe.plain,
        )
        return self.encode(pairs, recipe.centre_jitter)

    def encode(self, pairs: SimilarityBatch, jitter: float) -> BranchBatch:
        """The backbone's maps of what the branch looks at.

        Args: jitter: px that the search's log-polar crop is off the true centre, as standard deviation.
        """
        precision = torch.float16 if self.config.half else torch.float32  # batches are kept, to be used again
        template, search = (tuple(m.to(precision) for m in self.features(crops)) for crops in self.crops(pairs, jitter))
        return BranchBatch(pairs.motion, pairs.target, pairs.positive, template, search)

    @abstractmethod
    def crops(self, pairs: SimilarityBatch, jitter: float) -> tuple[Tensor, Tensor]:
        """Template and search crops that the branch looks at."""


class TranslationObjective(BranchObjective):
    """L_cls and L_reg of the translation branch, and the peak's cross-entropy where the recipe has it."""

    def __init__(self, network: SimilarityNetwork, recipe: Recipe, device: torch.device) -> None:
        super().__init__(network, network.translation, recipe, device)

    def crops(self, pairs: SimilarityBatch, jitter: float) -> tuple[Tensor, Tensor]:
        """Those of the pairs themselves."""
        return pairs.template, pairs.search

    def outputs(self, batch: BranchBatch) -> tuple[Tensor, Tensor]:
        """Score logits (B, 2, n, n) and offsets (B, 2, n, n), in cells."""
        z = self.network.encode_template(single(batch.template))
        x = self.network.encode_search(single(batch.search))
        return self.network.translation(z, x)

    def losses(self, batch: BranchBatch) -> Losses:
        """The parts of the loss."""
        stride, recipe, motion = self.config.stride, self.recipe, batch.motion
        logits, offsets = self.outputs(batch)
        positive = batch.positive[:, None, None]
        points = losses.grid_points(logits.shape[-1], stride, logits.device)
        rotation = motion.rotation if recipe.rotated_labels else torch.zeros_like(motion.rotation)
        label = losses.hamming_labels(points, motion.shift, motion.log_scale.exp(), rotation, batch.target) * positive
        probability = logits.softmax(1)[:, 1]
        parts = {"classification": losses.classification_loss(probability, label, top=recipe.hard_negatives)}
        if recipe.peak:
            cell = (motion.shift - points[0, 0]) / stride
            parts["peak"] = recipe.peak * losses.peak_loss(logits[:, 1] - logits[:, 0], cell, batch.positive)
        if recipe.offset_radius is None:
            near = label > 0.7
        else:
            near = (points - motion.shift[:, None, None]).norm(dim=-1) < recipe.offset_radius * stride
        parts["offset"] = losses.offset_loss(offsets, points, motion.shift, near & positive, stride, recipe.offset_beta)
        return parts


class PolarObjective(BranchObjective):
    """L_cls2 and L_reg2 of the log-polar branch."""

    def __init__(self, network: SimilarityNetwork, recipe: Recipe, device: torch.device) -> None:
        super().__init__(network, network.polar, recipe, device)
        self.points = torch.from_numpy(polar_points(self.config)).to(device)

    def crops(self, pairs: SimilarityBatch, jitter: float) -> tuple[Tensor, Tensor]:
        """The log-polar ones, of the search about the true centre give or take the jitter."""
        shift = pairs.motion.shift
        return (
            polar_crop(pairs.template, torch.zeros_like(shift), self.points),
            polar_crop(pairs.search, shift + pairs.jitter * jitter, self.points),
        )

    def outputs(self, batch: BranchBatch) -> tuple[Tensor, Tensor]:
        """Score logits (B, 2, n, n) and offsets (B, 2, n, n), in cells, of log-scale and rotation."""
        z = self.network.encode_polar_template(single(batch.template))
        x = self.network.encode_polar_search(single(batch.search))
        logits, offsets = self.network.polar(z, x)
        if offsets.shape[1] == 4:  # of which the paper's head uses the first and the third
            offsets = offsets[:, ::2]
        return logits, offsets

    def losses(self, batch: BranchBatch) -> Losses:
        """The parts of the loss."""
        stride = self.config.stride
        logits, offsets = self.outputs(batch)
        positive, truth = batch.positive[:, None, None], self.truth(batch)
        points = losses.grid_points(logits.shape[-1], stride, logits.device)
        label = torch.where(positive, losses.polar_labels(points, truth, stride), 0)
        near = ((points - truth[:, None, None]).norm(dim=-1) < 1.5 * stride) & positive
        return {
            "polar classification": losses.polar_classification_loss(logits, label),
            "polar offset": losses.offset_loss(offsets, points, truth, near, stride, self.recipe.offset_beta),
        }

    def truth(self, batch: BranchBatch) -> Tensor:
        """Shift (B, 2) of the log-polar crop, px: log-scale along x, rotation along y."""
        config, motion = self.config, batch.motion
        return torch.stack(
            [motion.log_scale / config.log_scale_per_pixel, motion.rotation / config.radians_per_pixel], 1
        )


class ResidualObjective:
    """L_Lambda of the residual component, with what either network needs besides."""

    def __init__(self, network: Residual, recipe: Recipe, device: torch.device) -> None:
        self.network, self.recipe = network.to(device), recipe
        self.taught: nn.Module = self.network
        self.uses = 1  # all of the network is trained: what a sample keeps is its pixels, which are cheap

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
            recipe.residual_hiding,
            look=recipe.residual_look,
            plain=recipe.plain,
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
        truth = project(torch.linalg.inv(dlt(batch.offsets, outline(size, offsets))), corners) - corners
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
        points = source.expand(len(clear), 1, -1, -1) * (2 / size)
        known = F.grid_sample(batch.known, points, align_corners=False)[:, 0, 0]
        visible = clear * known * within * (batch.positive & batch.labelled)[:, None]
        seen = visible > 0.5
        n = round(len(cells) ** 0.5)
        found = losses.matching_loss(matches.probability, (place - cells[0]) / DESCRIPTOR_STRIDE, seen, n)
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


Objective = TranslationObjective | PolarObjective | ResidualObjective | MatteObjective | LightObjective


def single(maps: Maps) -> Maps:
    """Maps in single precision."""
    return tuple(m.float() for m in maps)


def outline(size: int, like: Tensor) -> Tensor:
    """Corners (4, 2) of a square crop, px from its centre."""
    return like.new_tensor([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (size / 2)


def bounded(offsets: Tensor, size: int) -> Tensor:
    """Offsets that leave a quad convex, as a warp by it must be; beyond a fifth of the side they are cut."""
    return offsets.clamp(-0.2 * size, 0.2 * size)
