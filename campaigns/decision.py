"""The decision rule of ISO 14253-1: a result must be clearer than its uncertainty."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

Decision = Literal["pass", "fail", "not decided"]

COVERAGE = 2.0
"""k: the expanded uncertainty is U = k u, which holds about 95 % of a normal distribution."""


@dataclass(frozen=True, slots=True)
class Conformity:
    """A measured error against the limit asked for; all three in the same unit."""

    error: float
    standard_uncertainty: float
    limit: float

    @property
    def expanded_uncertainty(self) -> float:
        """U = k u."""
        return COVERAGE * self.standard_uncertainty

    @property
    def decision(self) -> Decision:
        """What may be said of it."""
        return decide(self.error, self.standard_uncertainty, self.limit)


def decide(error: float, standard_uncertainty: float, limit: float) -> Decision:
    """Pass if |e| + U ≤ limit, fail if |e| − U > limit, else not decided.

    Raises `ValueError` for what is not finite, and for a negative uncertainty or limit.
    """
    if not all(map(math.isfinite, (error, standard_uncertainty, limit))):
        raise ValueError(f"nothing follows from {error}, {standard_uncertainty}, {limit}")
    if standard_uncertainty < 0.0 or limit < 0.0:
        raise ValueError(f"uncertainty {standard_uncertainty} and limit {limit} cannot be negative")
    expanded = COVERAGE * standard_uncertainty
    if abs(error) + expanded <= limit:
        return "pass"
    if abs(error) - expanded > limit:
        return "fail"
    return "not decided"


def decide_all(decisions: Iterable[Decision]) -> Decision:
    """One failure fails all; all pass only when each does, and there is at least one."""
    found = set(decisions)
    if "fail" in found:
        return "fail"
    return "pass" if found == {"pass"} else "not decided"
