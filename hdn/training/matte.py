"""What the matte network is taught, and its figures on held-out photographs."""

import os
from collections.abc import Iterable
from dataclasses import dataclass, replace

import torch
import torch.nn.functional as F
from torch import Tensor

from ..networks.config import MATTE_SIZE
from ..networks.matte_network import MatteNetwork
from ..synthesis import MatteBatch, MattePairs, Photos, matte_batch
from .data import Clips

PAIRS = MattePairs()
# What it is validated on, by what the pairs have most of.
KINDS = {
    "usual": PAIRS,
    "light": replace(PAIRS, negative=0, occluded=0, covered=0),
    "blurred": replace(PAIRS, blurred=1, negative=0, covered=0),
    "misaligned": replace(PAIRS, far=1, negative=0, covered=0),
    "dark": replace(PAIRS, darkened=1, negative=0, covered=0),
    "covered": replace(PAIRS, negative=0, covered=1),
    "whole crop": replace(PAIRS, framed=0, negative=0, covered=0),
    "framed": replace(PAIRS, framed=1, negative=0, covered=0),
    "negative": replace(PAIRS, negative=1, occluded=0, covered=0),
}


@dataclass(frozen=True)
class MatteTeaching:
    """How the matte network is taught."""

    dice: float = 1.0  # weight of the Dice loss against the cross-entropy's
    hidden: float = 1.5  # what a hidden pixel counts in the cross-entropy against one that is seen: fewer are
    uses: int = 2  # of each pair, which takes about as long to draw as to learn from


TEACHING = MatteTeaching()


class MatteObjective:
    """Cross-entropy and Dice loss (Milletari et al., 3DV 2016) of what hides the surface, where it is known."""

    def __init__(self, network: MatteNetwork, device: torch.device) -> None:
        # Channels last, and bfloat16 where the processor has it, halve the time of a step each; without the processor's
        # own instructions for it, which oneDNN can be told to leave out, bfloat16 takes seven times as long.
        self.network = network.to(device).to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.taught = self.network
        self.uses = TEACHING.uses
        quick = torch.cpu._is_avx512_bf16_supported() and not os.environ.get("ONEDNN_MAX_CPU_ISA", "").startswith(
            "AVX2"
        )
        self.half = device.type == "cuda" or quick

    def sample(self, photos: Photos, clips: Clips | None, batch: int) -> MatteBatch:
        """Pairs of images; clips teach it nothing."""
        return matte_batch(photos, batch, MATTE_SIZE, PAIRS)

    def losses(self, batch: MatteBatch) -> dict[str, Tensor]:
        """Its losses on a batch, by name."""
        with torch.autocast(batch.frame.device.type, torch.bfloat16, enabled=self.half):
            logits = self.network(batch.frame, batch.template, batch.valid, batch.around)
        logits = logits.float()
        weight = batch.valid * (1 + (TEACHING.hidden - 1) * (1 - batch.seen))
        entropy = F.binary_cross_entropy_with_logits(logits, batch.seen, weight=weight)
        found, hidden = ((1 - x) * batch.valid for x in (logits.sigmoid(), batch.seen))
        both = (found * hidden).sum((1, 2, 3))
        either = (found.square() + hidden.square()).sum((1, 2, 3))
        smooth = 50.0  # px: keeps the loss of a pair with nothing in front small
        dice = 1 - ((2 * both + smooth) / (either + smooth)).mean()
        return {"entropy": entropy, "dice": TEACHING.dice * dice}


def matte_figures(network: MatteNetwork, photos: Photos, batches: Iterable[int], pairs: MattePairs) -> dict[str, float]:
    """Of all pixels that are known: the intersection over union of what is hidden, and shares that are right.

    "hidden kept" is the share of what is hidden that is found so, "surface seen" of the surface. NaN of nothing.
    """
    both = found = hidden = seen = right = 0.0
    for size in batches:
        batch = matte_batch(photos, size, MATTE_SIZE, pairs)
        matte = network(batch.frame, batch.template, batch.valid, batch.around).sigmoid()
        known = batch.valid > 0
        ours, truth = (matte < 0.5) & known, (batch.seen < 0.5) & known
        both += float((ours & truth).sum())
        found += float(ours.sum())
        hidden += float(truth.sum())
        seen += float((~truth & known).sum())
        right += float((~truth & ~ours & known).sum())

    def share(part: float, whole: float) -> float:
        return part / whole if whole else float("nan")

    return {
        "hidden IoU": share(both, found + hidden - both) if hidden else float("nan"),
        "hidden kept": share(both, hidden),
        "surface seen": share(right, seen),
    }
