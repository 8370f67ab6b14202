"""Training samples, synthesised in batches on the training device.

A sample shows a planar target twice: as the template and, moved by a known homography, as the search crop, with light,
blur, noise, occluders and frame borders of its own. Everything is a tensor; nothing loops over samples.
"""

from .batches import ResidualBatch, SimilarityBatch, residual_batch, similarity_batch, unlabelled_batch
from .covers import NOTHING, Hiding
from .lit_clips import LightBatch, LitClips, light_batch
from .looks import Look
from .mattes import MatteBatch, MattePairs, matte_batch
from .photos import SIDE, Photos, read_photo, squared
from .views import Motion, decomposition

__all__ = [
    "NOTHING",
    "SIDE",
    "Hiding",
    "LightBatch",
    "LitClips",
    "Look",
    "MatteBatch",
    "MattePairs",
    "Motion",
    "Photos",
    "ResidualBatch",
    "SimilarityBatch",
    "decomposition",
    "light_batch",
    "matte_batch",
    "read_photo",
    "residual_batch",
    "similarity_batch",
    "squared",
    "unlabelled_batch",
]
