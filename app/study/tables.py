"""The study as tables and lines for people."""

from collections import Counter
from collections.abc import Sequence

from app.study.comparison import Compared
from campaigns.studies.summary import ParameterSummary, StudySummary

NAMED = 3
"""Parameters whose σ is wrong, and failures, that are named in a line."""
EXPLAINED = (
    "ratio: σ found over σ stated; 95 %: share of intervals that hold the truth; "
    "bound: variance found over the least that the shots allow (Cramér-Rao)"
)

Row = tuple[str, ...]

PARAMETERS = ("", "bias", "σ found", "stated", "ratio", "95 %", "bound")
HONESTY = ("", "worst mm", "worst deg", "ratio", "95 %", "bound")
UNSEEN = ("", "mean: half", "95 %", "largest: half", "95 %", "relative")


def labels(compared: Sequence[Compared]) -> list[str]:
    """What tells each combination from the others; all of it when there is one."""
    return labels_of([one.combination.words for one in compared])


def labels_of(words: Sequence[tuple[str, ...]]) -> list[str]:
    """Labels of what is told by several words each, without those that all have in common."""
    differing = [place for place, each in enumerate(zip(*words, strict=True)) if len(set(each)) > 1]
    return [" · ".join(each[place] for place in differing or range(len(each))) for each in words]


def parameter_rows(summary: StudySummary) -> list[Row]:
    """One line a parameter, in mm and deg."""
    return [
        (
            p.name,
            f"{p.bias:+.5f}",
            f"{p.std:.5f}",
            f"{p.stated_std:.5f}",
            f"{p.ratio:.3f}",
            f"{100.0 * p.covered:.1f}",
            f"{p.variance_over_bound:.3f}",
        )
        for p in summary.parameters
    ]


def honesty_rows(compared: Sequence[Compared]) -> list[Row]:
    """One line a combination: the worst of its parameters, or from the least to the most."""
    return [
        (
            label,
            _number(one.worst_length_mm, 4),
            _number(one.worst_angle_deg, 5),
            "–".join(f"{ratio:.3f}" for ratio in one.ratios),
            "–".join(f"{100.0 * share:.1f}" for share in one.covered),
            f"{one.variance_over_bound:.3f}",
        )
        for label, one in zip(labels(compared), compared, strict=True)
    ]


def unseen_rows(compared: Sequence[Compared]) -> list[Row]:
    """One line a combination with unseen pairs: in half of its campaigns, and in 95 %, mm."""
    return [
        (
            label,
            *(f"{value:.4f}" for value in (*one.summary.unseen_mean_mm, *largest_mm)),
            _number(one.unseen_relative, 2),
        )
        for label, one in zip(labels(compared), compared, strict=True)
        if one.summary.unseen_mean_mm and (largest_mm := one.summary.unseen_max_mm)
    ]


def honesty(summary: StudySummary) -> str:
    """What the study says of the stated σ, in a line."""
    if summary.too_sure:
        worst = sorted(summary.too_sure, key=lambda p: p.ratio, reverse=True)
        return f"stated σ are too small: {_named(worst)}"
    if summary.too_unsure:
        worst = sorted(summary.too_unsure, key=lambda p: p.ratio)
        return f"stated σ are larger than need be: {_named(worst)}"
    low, high = summary.chance.ratio
    return (
        f"stated σ are true, as far as {summary.campaigns} campaigns tell "
        f"(ratios from {low:.3f} to {high:.3f} may be chance)"
    )


def failures(one: Compared) -> str:
    """How many campaigns ended without an answer, and why."""
    reasons = Counter(outcome.failure for outcome in one.studied.outcomes if outcome.failure)
    worded = "; ".join(f"{count} × {reason}" for reason, count in reasons.most_common(NAMED))
    return f"{one.summary.failed} campaigns without an answer: {worded}"


def losses(one: Compared) -> str:
    """How many campaigns no worker came back with, why, and what next."""
    reasons = "; ".join(one.studied.reasons[:NAMED])
    return f"{one.studied.lost} campaigns lost: {reasons} → the same command tries them again"


def _named(parameters: Sequence[ParameterSummary]) -> str:
    named = [f"{p.name} found {p.ratio:.2f} × stated" for p in parameters[:NAMED]]
    more = len(parameters) - len(named)
    return ", ".join([*named, *([f"and {more} more"] if more else [])])


def _number(value: float | None, decimals: int) -> str:
    return "-" if value is None else f"{value:.{decimals}f}"
