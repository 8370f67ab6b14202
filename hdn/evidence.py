"""What the tracker's stages say about a frame, and whether it shows the target."""

from dataclasses import dataclass


@dataclass(frozen=True)
class EvidenceThresholds:
    """What the evidence has to reach; all of them are shares, 0..1, but for the score.

    *Visible* is what the residual network sees of the target, *agreeing* what correlates with the template.
    """

    trusted_score: float = 0.3  # of a similarity branch, below which its motion is not followed
    min_visible: float = 0.15  # below which the residual network takes template and frame for a negative pair

    # What makes a fix: the share of the visible target that agrees, or a patch of it that hangs together, as beside an
    # occluder. Patches of 0.08 come about by chance in one frame of a hundred that does not show the target.
    fix_support: float = 0.4
    fix_patch: float = 0.1
    # The same where the residual network takes the pair for a negative one.
    negative_fix_agreement: float = 0.55
    negative_fix_patch: float = 0.2
    min_agreeing_of_visible: float = 0.6  # agreement, as a share of what is visible, beside which a patch counts
    hint_patch: float = 0.04  # is followed for some frames, though it makes no fix

    # They make up for cells that do not agree: light on a target of little texture changes most of them.
    border: float = 0.65  # of the border that is where it should be
    border_visible: float = 0.3  # of the target inside it

    # Without which a target that was found is not shown surely enough to count as tracked.
    shown_agreement: float = 0.35
    shown_patch: float = 0.15

    # The share of cells that agree where nothing of the target is seen, and where all of it is: the mean of either over
    # the drawn clips of `hdn-analyse states`, seed 1.
    agreement_by_chance: float = 0.1
    agreement_at_best: float = 0.9


THRESHOLDS = EvidenceThresholds()


@dataclass(frozen=True)
class Evidence:
    """What the stages say about one frame; the negative-sample behaviour among it.

    Attributes:
        score, polar_score: classification scores of the two similarity branches, 0..1.
        residual: mean length of the residual's corner offsets, px of its crop; negatives pull it to zero.
        visible: share of the target that the residual network sees; negatives pull it to zero too.
        agreement: share of the target's visible cells that agree with the template after refinement, 0..1.
        cohesion: the largest patch of adjoining cells that agree, as a share of the whole target.
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
        """Whether the border alone shows that the target is there."""
        return self.border >= THRESHOLDS.border and self.visible >= THRESHOLDS.border_visible

    @property
    def support(self) -> float:
        """The share of the target's cells, or of its border, that shows that the target is there, 0..1."""
        return max(self.agreement, self.border if self.is_bordered else 0.0)


def is_fix(evidence: Evidence) -> bool:
    """Whether the target was found.

    A negative pair shows as offsets pulled to zero and nothing visible; then the photometric agreement has to be the
    stronger. The score does not count: it falls with every occluder.
    """
    if evidence.visible < THRESHOLDS.min_visible:
        return is_sure_fix(evidence)
    is_patch = evidence.cohesion >= THRESHOLDS.fix_patch and _agrees_where_visible(evidence)
    return evidence.support >= THRESHOLDS.fix_support or is_patch


def is_sure_fix(evidence: Evidence) -> bool:
    """Whether the target was found by photometric agreement alone, as asked for where a whole frame was searched."""
    return evidence.agreement >= THRESHOLDS.negative_fix_agreement or evidence.cohesion >= THRESHOLDS.negative_fix_patch


def is_hint(evidence: Evidence) -> bool:
    """Whether a pose that is no fix is still better than staying put: the network and a small patch see the target."""
    is_visible = evidence.visible >= THRESHOLDS.min_visible
    return is_visible and evidence.cohesion >= THRESHOLDS.hint_patch and _agrees_where_visible(evidence)


def is_shown(evidence: Evidence) -> bool:
    """Whether enough of a target that was found is seen to count as tracked."""
    agrees = evidence.agreement >= THRESHOLDS.shown_agreement and evidence.cohesion >= THRESHOLDS.shown_patch
    return evidence.is_bordered or agrees


def visible_share(agreement: float) -> float:
    """The share of the target's area that is truly seen, 0..1, as far as the share of agreeing cells tells it."""
    lowest, highest = THRESHOLDS.agreement_by_chance, THRESHOLDS.agreement_at_best
    return min(max((agreement - lowest) / (highest - lowest), 0.0), 1.0)


def _agrees_where_visible(evidence: Evidence) -> bool:
    """Whether most of what the residual network sees agrees with the template as well."""
    return evidence.agreement >= THRESHOLDS.min_agreeing_of_visible * evidence.visible
