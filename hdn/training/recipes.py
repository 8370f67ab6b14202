"""All that a training is made of besides its data: samples, losses and schedule, one recipe for each configuration."""

import math
from dataclasses import dataclass, replace
from typing import Literal

from ..networks.config import COMPACT, PAPER, Config
from ..synthesis import Hiding, Look

COMPRESSED_LOOK = Look(compressed=0.15)
SOME_HIDDEN = Hiding(quads=0.3, border=0.1)
MORE_HIDDEN = Hiding(quads=0.4, border=0.1)
ALL_NEGATIVES = 1_000_000  # more cells than any map has


@dataclass(frozen=True)
class Recipe:
    """Weights of losses are zero for what is left out. Names of losses in brackets are the paper's."""

    # Schedule
    steps: int = 5_000
    batch: int = 32
    decay: Literal["cosine", "exponential"] = "cosine"
    weight_decay: float = 1e-4  # of AdamW
    start_rate: float = 0.25  # factor on the learning rates of a training that begins with trained weights

    # Samples
    similarity_look: Look = COMPRESSED_LOOK
    residual_look: Look = COMPRESSED_LOOK
    negatives: float = 0.2  # share of pairs that show two different objects
    uses: int = 3  # of each pair of both branches, whose backbone maps are dearer than the rest of a step
    similarity_hiding: Hiding = SOME_HIDDEN
    residual_hiding: Hiding = MORE_HIDDEN
    plain: float = 0.0  # share of pairs that show a drawn screen of little texture
    reach: float = 16.0  # px that corners are off in the residual component's pairs
    clips: float = 0.25  # share of the residual component's batch that is cut from clips, where there are any
    gap: int = 5  # frames between the two of such a pair, at most
    centre_jitter: float = 3.0  # px that the log-polar crop's centre is off, as the translation's estimate is

    # Translation and log-polar branch
    hard_negatives: int = 100  # K of L_cls: of each map's negatives, the most probable count
    rotated_labels: bool = True
    peak: float = 1.0  # cross-entropy of where the peak is
    offset_radius: float | None = 2.0  # cells about the truth where offsets are taught; None: where labels exceed 0.7
    offset_beta: float = 0.2  # cells of error up to which the offset loss is quadratic

    # Residual component
    negative: float = 1.0  # lambda_2 [L_Lambda-]
    triplet_clips: float = 1.0  # lambda_3 [L_Lambda+*] on pairs from clips, of unknown motion
    triplet_images: float = 0.0  # lambda_3 on pairs from images
    corner: float = 0.25  # lambda_4 [L_Lambda+]
    matches: float = 1.0  # where each point is found, and whether it is seen: of the compact network alone

    def rate(self, step: int, steps: int) -> float:
        """Learning rate of a step, 0 to steps - 1.

        cosine: up to 2e-3 within 200 steps, then along a cosine to zero.
        exponential: as in the paper, of whose 30 epochs each is a thirtieth of the steps here: in the first one up from
        0.001 to 0.005, from 0.0012 in the second one down by 0.8 with each.
        """
        if self.decay == "cosine":
            return 2e-3 * min((step + 1) / 200, 0.5 + 0.5 * math.cos(math.pi * min(step / steps, 1)))
        epoch = 30 * min(step / steps, 1)
        return 0.001 + 0.004 * epoch if epoch < 1 else 0.0012 * 0.8 ** (math.floor(epoch) - 1)


RECIPES = {
    COMPACT.name: Recipe(
        similarity_look=replace(COMPRESSED_LOOK, blurred=0.3, reach=31),
        residual_look=replace(COMPRESSED_LOOK, blurred=0.35, reach=61),
        similarity_hiding=Hiding(quads=0.12, bars=0.1, slivers=0.03, hands=0.1, border=0.1, template=0.05),
        residual_hiding=Hiding(quads=0.15, bars=0.15, slivers=0.08, hands=0.12, border=0.12, template=0.08),
        plain=0.1,
    ),
    PAPER.name: Recipe(
        steps=30_000,
        batch=128,
        decay="exponential",
        weight_decay=0.0,
        uses=1,
        peak=0.0,
        offset_radius=None,
        offset_beta=1.0,
        triplet_images=1.0,
    ),
}


def recipe_of(config: Config) -> Recipe:
    """The recipe that trains a configuration."""
    return RECIPES[config.name]
