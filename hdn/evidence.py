"""What the stages say about a frame, and whether it shows the target."""

from dataclasses import dataclass

TRUSTED_SCORE = 0.3  # of a similarity branch, below which its motion is not followed
SEEN = 0.15  # share of the target that the residual component sees, below which the pair counts as negative
# What makes a fix: the share of the visible target that agrees, or a patch of it that hangs together, as beside an
# occluder. Patches of 0.08 come about by chance in one frame of a hundred that does not show the target.
FIX, PATCH = 0.4, 0.1
CONSISTENT = 0.6
HINT = 0.04  # a patch that is followed, though it makes no fix
# Share of the border, and of the target as the residual component sees it, that make up for cells that do not agree:
# light on a target of little texture changes most of them.
BORDERED, SEEN_WITHIN = 0.65, 0.3
# Without which a target that was found is not shown surely enough to count as tracked.
SHOWN, PIECE = 0.35, 0.15
FIX_WITHOUT_HDN, PATCH_WITHOUT_HDN = 0.55, 0.2  # the same where HDN takes the pair for a negative one
# The share of cells that agree where nothing of the target is seen, and where all of it is: the mean of either over the
# drawn clips of `hdn-analyse states`, seed 1.
BY_CHANCE, AT_BEST = 0.1, 0.9


@dataclass(frozen=True)
class Evidence:
    """What the stages say about one frame; the negative-sample behaviour among it.

    Attributes:
        score, polar_score: classification scores of the two similarity branches, 0..1.
        residual: mean length of the residual's corner offsets, px of its crop; negatives pull it to zero.
        visible: share of the target that the residual component sees; negatives pull it to zero too.
        agreement: share of the target's visible cells that agree with the template after refinement, 0..1.
        cohesion: the largest adjoining patch of it, as a share of the whole target.
        border: share of the border that is where it should be, of a target that is placed by it; else 0.
    """

    score: float = 0.0
    polar_score: float = 0.0
    residual: float = 0.0
    visible: float = 0.0
    agreement: float = 0.0
    cohesion: float = 0.0
    border: float = 0.0

    @property
    def is_bordered(self) -> bool:
        """Whether the border speaks for the target, without its cells."""
        return self.border >= BORDERED and self.visible >= SEEN_WITHIN

    @property
    def support(self) -> float:
        """The share of the target, of its cells or of its border, that speaks for it, 0..1."""
        return max(self.agreement, self.border if self.is_bordered else 0.0)


def is_fix(evidence: Evidence) -> bool:
    """Whether the evidence says that the target was found.

    A negative pair shows as offsets pulled to zero and nothing seen; then the photometric agreement has to be the
    stronger. The score does not count: it falls with every occluder.
    """
    if evidence.visible < SEEN:
        return is_sure_fix(evidence)
    return evidence.support >= FIX or (evidence.cohesion >= PATCH and _is_consistent(evidence))


def is_sure_fix(evidence: Evidence) -> bool:
    """Whether the photometric agreement alone says so, as it has to where a frame was searched for a lost target."""
    return evidence.agreement >= FIX_WITHOUT_HDN or evidence.cohesion >= PATCH_WITHOUT_HDN


def is_shown(evidence: Evidence) -> bool:
    """Whether enough of a target that was found is seen to count as tracked."""
    return evidence.is_bordered or (evidence.agreement >= SHOWN and evidence.cohesion >= PIECE)


def calibrated(agreement: float) -> float:
    """The share of the target's area that is truly seen, 0..1, as far as the share of agreeing cells tells it."""
    return min(max((agreement - BY_CHANCE) / (AT_BEST - BY_CHANCE), 0.0), 1.0)


def is_hint(evidence: Evidence) -> bool:
    """Whether it is too little for a fix, but still better than to stay put: both HDN and a small patch see it."""
    return evidence.visible >= SEEN and evidence.cohesion >= HINT and _is_consistent(evidence)


def _is_consistent(evidence: Evidence) -> bool:
    """Whether most of what the residual component sees agrees with the template as well."""
    return evidence.agreement >= CONSISTENT * evidence.visible
