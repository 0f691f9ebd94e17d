"""Gains: what a validation after calibration shows against one before, beyond its uncertainty."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from campaigns.evaluation.decision import COVERAGE
from campaigns.evaluation.summary import BeforeAfter
from campaigns.evaluation.validation import MeasuredLength, ValidationResult

NO_CHANGE = "no change shown"
JUDGED = "distances, mean error"
"""The figure that must not become worse."""


@dataclass(frozen=True, slots=True)
class Gain:
    """Figure before and after; None: not measured in that stage.

    The uncertainties hold the robot's own scatter, so far as it is known: the two stages are of
    different visits.
    """

    name: str
    before: MeasuredLength | None
    after: MeasuredLength | None

    @property
    def expanded_uncertainty_mm(self) -> float | None:
        """U of the difference, k = 2; None without both."""
        if self.before is None or self.after is None:
            return None
        both = self.before.standard_uncertainty_mm, self.after.standard_uncertainty_mm
        return COVERAGE * float(np.hypot(*both))

    @property
    def shown(self) -> bool | None:
        """Significance: the difference is larger than its U; None without both."""
        expanded_mm = self.expanded_uncertainty_mm
        if self.before is None or self.after is None or expanded_mm is None:
            return None
        return abs(self.after.value_mm - self.before.value_mm) > expanded_mm

    def in_words(self) -> str:
        """Name, both values, and whether they differ."""
        values = (each.value_mm for each in (self.before, self.after) if each is not None)
        told = f"{self.name} {' → '.join(f'{value:.3f}' for value in values)} mm"
        return f"{told} ({NO_CHANGE})" if self.shown is False else told


def gains(before: ValidationResult | None, after: ValidationResult | None) -> tuple[Gain, ...]:
    """Every figure that was measured in at least one stage."""
    old, new = (stage.comparable_figures() if stage else {} for stage in (before, after))
    every = (Gain(name, old.get(name), new.get(name)) for name in {**new, **old})
    return tuple(each for each in every if each.before or each.after)


def worse_than_before(found: Iterable[Gain]) -> Iterator[str]:
    """Words on the distances, if their mean error became larger beyond its uncertainty."""
    for each in found:
        if each.name != JUDGED or not each.shown or each.before is None or each.after is None:
            continue
        before_mm, after_mm = each.before.value_mm, each.after.value_mm
        if after_mm > before_mm:
            yield f"{JUDGED} {after_mm:.3f} mm, before loading it was {before_mm:.3f} mm"


def gained_in_words(found: tuple[Gain, ...], unseen: BeforeAfter | None) -> str:
    """Gain of calibration: in distances as commanded, or else of hold-out pairs by the model.

    Empty where neither was compared.
    """
    told = [each.in_words() for each in found if each.shown is not None]
    if told:
        return f"Measured before and after: {'; '.join(told[:2])}."
    if unseen is None:
        return ""
    before, after = unseen.before, unseen.after
    return (
        "By the model, not yet by the commanded robot: distances of hold-out pairs, mean error "
        f"{before.mean_abs:.3f} → {after.mean_abs:.3f} mm, largest "
        f"{before.max_abs:.3f} → {after.max_abs:.3f} mm."
    )
