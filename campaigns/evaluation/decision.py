"""The decision rule of ISO 14253-1: nothing is decided that the uncertainty does not allow.

A measured error e has an expanded uncertainty U = 2 u, so the true error lies somewhere between
|e| − U and |e| + U, with about 95 % probability. Against a limit there are three answers:

    |e| + U ≤ limit    pass: the whole interval is within the limit
    |e| − U > limit    fail: the whole interval is beyond it
    otherwise          not decided: a better instrument or more measurements could decide

Who claims conformity or failure has to prove it, so U counts against both claims. Several decisions
together pass only if each of them does; a single failure fails all.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

Decision = Literal["pass", "fail", "not decided"]
NO_LIMIT: Literal["no limits specified"] = "no limits specified"
Verdict = Literal["pass", "fail", "not decided", "no limits specified"]
"""Decision on a stage or a campaign; the last where nothing but a limit is lacking."""

COVERAGE = 2.0
"""k: the expanded uncertainty is U = k u, which holds about 95 % of a normal distribution (GUM)."""


@dataclass(frozen=True, slots=True)
class Requirement:
    """Requirement: a measured error and the limit specified for it, in one unit.

    An error of None was not measured, a limit of None not specified. With an uncertainty of zero
    the error is judged as it stands.
    """

    name: str
    error: float | None
    limit: float | None
    standard_uncertainty: float = 0.0

    @property
    def expanded_uncertainty(self) -> float | None:
        """U = k u; None for an error that was not measured."""
        return None if self.error is None else COVERAGE * self.standard_uncertainty

    @property
    def margin(self) -> float | None:
        """Limit minus absolute error, negative beyond the limit; None without error or limit."""
        if self.error is None or self.limit is None:
            return None
        return self.limit - abs(self.error)

    @property
    def decision(self) -> Decision | None:
        """Decision by the rule; None without a limit."""
        if self.limit is None:
            return None
        # A limit asks for a measurement: without one nothing can pass.
        if self.error is None:
            return "not decided"
        return decide(self.error, self.standard_uncertainty, self.limit)

    def in_words(self, unit: str = "mm") -> str:
        """Return name, value with U, limit and decision, for people."""
        limit = "" if self.limit is None else f", limit {self.limit:g} {unit}"
        if self.error is None:
            return f"{self.name} not measured{limit}"
        value = f"{self.error:.3f} ± {self.expanded_uncertainty:.3f} {unit}"
        return f"{self.name} {value}{limit}: {self.decision}"


def decide(error: float, standard_uncertainty: float, limit: float) -> Decision:
    """Pass if |e| + U ≤ limit, fail if |e| − U > limit, else leave it undecided.

    Raise `ValueError` for a value that is not finite, and for a negative uncertainty or limit.
    """
    # NaN compares false with everything and would end as "not decided": refuse it instead.
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
    """Decide several together: one failure fails all; all pass only if each does.

    No decisions at all are not decided: nothing was shown.
    """
    kinds = set(decisions)
    if "fail" in kinds:
        return "fail"
    return "pass" if kinds == {"pass"} else "not decided"
