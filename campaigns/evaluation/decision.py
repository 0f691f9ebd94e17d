"""The decision rule of JCGM 106:2012: nothing is decided that the uncertainty does not allow.

A measured error e has an expanded uncertainty U = k u, so the true error lies somewhere between
|e| − U and |e| + U, with about 95 % probability. Against a limit there are three answers:

    |e| + U ≤ limit    pass: the whole interval is within the limit (guarded acceptance, w = U)
    |e| − U > limit    fail: the whole interval is beyond it (guarded rejection, w = U)
    otherwise          not decided: a better instrument or more measurements could decide

Who claims conformity or failure has to prove it, so U counts against both claims. Several decisions
together pass only if each of them does; a single failure fails all. Two measured figures are
compared by the same rule: their difference counts only beyond its own U.

k is 2 for a single figure whose u is known. It is larger, by Student's t, where u was estimated
from few repeats (GUM G.4), and where the figure is the largest of several: the interval must then
hold for whichever of them is truly the largest. Every comparison of measured figures with a limit
or with each other is made by this module.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

import scipy

Decision = Literal["pass", "fail", "not decided"]
NO_LIMIT: Literal["no limits specified"] = "no limits specified"
Verdict = Literal["pass", "fail", "not decided", "no limits specified"]
"""Decision on a stage or a campaign; the last where nothing but a limit is lacking."""

FigureChange = Literal["smaller", "larger", "no change shown"]
"""Difference of two measured figures, second against first."""

COVERAGE = 2.0
"""k of one figure whose u is known: U = k u holds about 95 % of a normal distribution (GUM)."""


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
    dof: float = math.inf
    """Degrees of freedom of the standard uncertainty."""
    count: int = 1
    """Number of errors of which this is the largest."""

    @property
    def expanded_uncertainty(self) -> float | None:
        """U = k u; None for an error that was not measured."""
        if self.error is None:
            return None
        return coverage_factor(self.dof, self.count) * self.standard_uncertainty

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
        return decide(self.error, self.standard_uncertainty, self.limit, self.dof, self.count)

    def in_words(self, unit: str = "mm") -> str:
        """Return name, value with U, limit and decision, for people."""
        limit = "" if self.limit is None else f", limit {self.limit:g} {unit}"
        if self.error is None:
            return f"{self.name} not measured{limit}"
        value = f"{self.error:.3f} ± {self.expanded_uncertainty:.3f} {unit}"
        return f"{self.name} {value}{limit}: {self.decision}"


def coverage_factor(dof: float = math.inf, count: int = 1) -> float:
    """Return k of U = k u, by the degrees of freedom of u, for the largest of `count` errors.

    It is 2 for one error and infinitely many degrees of freedom. Raise `ValueError` if either is
    below 1.
    """
    # The probability outside of ± 2 σ, shared among the errors (Bonferroni). The largest of the
    # measured errors differs from the largest of the true ones by no more than the largest single
    # deviation, so an interval that holds for all at once holds for the largest, however the
    # deviations are correlated.
    if not dof >= 1.0 or count < 1:
        raise ValueError(f"no coverage factor by {dof} degrees of freedom for {count} errors")
    if math.isinf(dof) and count == 1:
        return COVERAGE
    tail = float(scipy.special.ndtr(-COVERAGE)) / count
    quantile = scipy.special.ndtri(tail) if math.isinf(dof) else scipy.special.stdtrit(dof, tail)
    return -float(quantile)


def effective_dof(variance: float, estimated_variance: float, dof: float) -> float:
    """Return the degrees of freedom of a variance of which a part was estimated with `dof`.

    The other part counts as known (Welch and Satterthwaite, GUM G.4.1).
    """
    if estimated_variance == 0.0:
        return math.inf
    return dof * max(variance / estimated_variance, 1.0) ** 2  # rounding may take it below 1


def decide(
    error: float, standard_uncertainty: float, limit: float, dof: float = math.inf, count: int = 1
) -> Decision:
    """Pass if |e| + U ≤ limit, fail if |e| − U > limit, else leave it undecided.

    `dof` are the degrees of freedom of the uncertainty, `count` is the number of errors of which
    this is the largest. Raise `ValueError` for a value that is not finite, and for a negative
    uncertainty or limit.
    """
    # NaN compares false with everything and would end as "not decided": refuse it instead.
    if not all(map(math.isfinite, (error, standard_uncertainty, limit))):
        raise ValueError(f"nothing follows from {error}, {standard_uncertainty}, {limit}")
    if standard_uncertainty < 0.0 or limit < 0.0:
        raise ValueError(f"uncertainty {standard_uncertainty} and limit {limit} cannot be negative")
    expanded = coverage_factor(dof, count) * standard_uncertainty
    if abs(error) + expanded <= limit:
        return "pass"
    if abs(error) - expanded > limit:
        return "fail"
    return "not decided"


def decide_change(
    difference: float, standard_uncertainty: float, dof: float = math.inf, count: int = 1
) -> FigureChange:
    """Decide whether a figure became larger or smaller: only a difference beyond its U counts.

    Parameters and errors are those of `decide`; `difference` is second minus first.
    """
    if decide(difference, standard_uncertainty, 0.0, dof, count) != "fail":
        return "no change shown"
    return "larger" if difference > 0.0 else "smaller"


def chance_of_larger(chi2: float, count: int, dof: float = math.inf) -> float:
    """Return the probability that chance alone makes χ² of `count` errors larger.

    `dof` are the degrees of freedom of the variance by which the errors were divided: with a
    variance estimated from few shots χ²/count follows Fisher's F.
    """
    if math.isinf(dof):
        return float(scipy.special.chdtrc(count, chi2))
    return float(scipy.special.fdtrc(count, dof, chi2 / count))


def allows_decision(
    std_mm: float, limits_mm: Mapping[str, float], before_mm: float | None
) -> str | None:
    """Return why positions of this 1 σ allow no decision, in words; None if they allow it.

    Their U must be within each limit of errors (mm, by name); without limits, below the error
    before calibration. Without either there is nothing to decide by.
    """
    # Beyond, no error could pass, not even 0 ("not decided" for an error of 0), and no gain could
    # be shown.
    if not math.isfinite(std_mm):
        return "σ of positions is unknown"
    expanded_mm = coverage_factor() * std_mm
    too_large = f"U of distances is {expanded_mm:.3g} mm (k = 2)"
    for name, limit_mm in sorted(limits_mm.items(), key=lambda item: item[1]):
        if decide(0.0, std_mm, limit_mm) != "pass":
            return f"{too_large}, more than the limit of the {name} error, {limit_mm:g} mm"
    if limits_mm or before_mm is None or decide_change(-abs(before_mm), std_mm) == "smaller":
        return None
    return f"{too_large}, not less than the error before, {abs(before_mm):.3g} mm"


def decide_all(decisions: Iterable[Decision]) -> Decision:
    """Decide several together: one failure fails all; all pass only if each does.

    No decisions at all are not decided: nothing was shown.
    """
    kinds = set(decisions)
    if "fail" in kinds:
        return "fail"
    return "pass" if kinds == {"pass"} else "not decided"
