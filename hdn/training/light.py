"""What the light network is taught, and its figures on held-out photographs."""

from collections.abc import Iterable
from dataclasses import replace

import torch
from torch import Tensor

from ..networks.light_network import LightNetwork
from ..synthesis import LightBatch, LitClips, Photos, light_batch
from .data import Clips

CLIPS = LitClips()
# What it is validated on.
KINDS = {
    "usual": CLIPS,
    "moving": replace(CLIPS, shadowed=1, still_shadows=0, still_lamps=0),
    "still": replace(CLIPS, shadowed=1, still_shadows=1, still_lamps=1),
    "even": replace(CLIPS, shadowed=0, mirroring=0, rooms=0, uneven=0),
}
# Light of pictures that are put in the place of the print; what comes out is compared, as it is seen.
PICTURES = (0.01, 0.05, 0.2, 0.5, 1.0)


class LightObjective:
    """How far off pictures of several brightnesses are in the light that is told, in values of pixels."""

    def __init__(self, network: LightNetwork, device: torch.device) -> None:
        self.network = network.to(device)
        self.taught = self.network
        self.uses = 2  # of each clip, which takes longer to draw than to learn from

    def sample(self, photos: Photos, clips: Clips | None, batch: int) -> LightBatch:
        """Drawn clips; real ones teach it nothing."""
        return light_batch(photos, batch, CLIPS)

    def losses(self, batch: LightBatch) -> dict[str, Tensor]:
        """Its losses on a batch, by name."""
        log_gain, glare = self.network(batch.inputs)
        error = off_by(log_gain, glare, batch)
        weight = batch.known.expand_as(error)
        smooth = torch.where(error.abs() < 0.05, error.square() / 0.1, error.abs() - 0.025)
        return {"picture": 10 * (smooth * weight).sum() / weight.sum()}


def off_by(log_gain: Tensor, glare: Tensor, batch: LightBatch) -> Tensor:
    """By how much values of pictures (B, PICTURES, n, n) differ in this light from those in the true one."""
    pictures = torch.tensor(PICTURES, device=glare.device).reshape(1, -1, 1, 1)

    def seen(log_gain: Tensor, glare: Tensor) -> Tensor:
        return (pictures * log_gain.exp() + glare + 1e-4).sqrt().clamp(max=1.1)

    return seen(log_gain, glare) - seen(batch.log_gain, batch.glare)


def light_figures(network: LightNetwork, photos: Photos, batches: Iterable[int], clips: LitClips) -> dict[str, float]:
    """Root mean square errors of pictures in grey levels: in the light that is told, and as if there were none."""
    told = none = count = 0.0
    for size in batches:
        batch = light_batch(photos, size, clips)
        log_gain, glare = network(batch.inputs)
        told += float(((255 * off_by(log_gain, glare, batch)).square() * batch.known).sum())
        none += float(((255 * off_by(0 * log_gain, 0 * glare, batch)).square() * batch.known).sum())
        count += float(batch.known.sum()) * len(PICTURES)
    return {"light error": (told / count) ** 0.5, "error without": (none / count) ** 0.5}
