"""The decision rule of ISO 14253-1: a result must be clearer than its uncertainty."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

Decision = Literal["pass", "fail", "not decided"]
NO_LIMIT: Literal["no limits specified"] = "no limits specified"
Verdict = Literal["pass", "fail", "not decided", "no limits specified"]
"""Decision on a stage or a campaign; the last where nothing but a limit is lacking."""

COVERAGE = 2.0
"""k: the expanded uncertainty is U = k u, which holds about 95 % of a normal distribution."""


@dataclass(frozen=True, slots=True)
class Requirement:
    """Requirement: a measured error and the limit specified for it, in one unit.

    None: not measured, or not specified. Without an uncertainty the error is judged as it stands.
    """

    name: str
    error: float | None
    limit: float | None
    standard_uncertainty: float = 0.0

    @property
    def expanded_uncertainty(self) -> float | None:
        """U = k u; None for what was not measured."""
        return None if self.error is None else COVERAGE * self.standard_uncertainty

    @property
    def margin(self) -> float | None:
        """Margin: what is left of the limit, below zero beyond it; None without error or limit."""
        if self.error is None or self.limit is None:
            return None
        return self.limit - abs(self.error)

    @property
    def decision(self) -> Decision | None:
        """None when no limit is asked for."""
        if self.limit is None:
            return None
        if self.error is None:
            return "not decided"
        return decide(self.error, self.standard_uncertainty, self.limit)

    def in_words(self, unit: str = "mm") -> str:
        """Name, value with U, limit and decision, for people."""
        limit = "" if self.limit is None else f", limit {self.limit:g} {unit}"
        if self.error is None:
            return f"{self.name} not measured{limit}"
        value = f"{self.error:.3f} ± {self.expanded_uncertainty:.3f} {unit}"
        return f"{self.name} {value}{limit}: {self.decision}"


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
    """Decide all: one failure fails all; all pass only if each does, and there is one."""
    kinds = set(decisions)
    if "fail" in kinds:
        return "fail"
    return "pass" if kinds == {"pass"} else "not decided"
