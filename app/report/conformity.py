"""The verdict: every limit asked for, decided with the uncertainty of measurement."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from app.report.checks import Check
from app.report.findings import IdentificationFinding
from app.report.stages import StageView
from campaigns.config_sections import AcceptanceConfig
from campaigns.decision import COVERAGE, Conformity, Decision, decide_all
from campaigns.validation_traces import Result

NOT_DECIDED: Decision = "not decided"


@dataclass(frozen=True, slots=True)
class Requirement:
    """One figure of the validation after calibration. `result` None: not measured."""

    name: str
    result: Result | None
    limit_mm: float | None

    @property
    def expanded_mm(self) -> float | None:
        """U, k = 2."""
        return None if self.result is None else COVERAGE * self.result.instrument_mm

    @property
    def decision(self) -> Decision | None:
        """None when no limit is asked for."""
        if self.limit_mm is None:
            return None
        if self.result is None:
            return "not decided"
        return Conformity(self.result.value_mm, self.result.instrument_mm, self.limit_mm).decision


@dataclass(frozen=True, slots=True)
class Verdict:
    """The decision as a whole, in a sentence each why."""

    decision: Decision
    reasons: tuple[str, ...]
    requirements: tuple[Requirement, ...]


def verdict(
    finding: IdentificationFinding | None,
    after: StageView | None,
    limits: AcceptanceConfig,
    checks: Sequence[Check],
) -> Verdict:
    """Pass only if the identification passed, the limits are surely kept and the files agree."""
    requirements = tuple(_requirements(after, limits))
    decisions = [r.decision for r in requirements if r.decision is not None] or [NOT_DECIDED]
    broken = [check for check in checks if check.holds is False]
    decisions += [NOT_DECIDED] * len(broken)
    decisions.append(NOT_DECIDED if finding is None else finding.verdict)
    reasons = (
        *_of_identification(finding),
        *_of_limits(requirements, after),
        *(f"The files don't belong together; broken: {check.statement}." for check in broken),
    )
    return Verdict(decide_all(decisions), reasons, requirements)


def _requirements(after: StageView | None, limits: AcceptanceConfig) -> Iterator[Requirement]:
    mean, largest = _distance_results(after)
    yield Requirement("distances, mean error", mean, limits.distance_mean_mm)
    yield Requirement("distances, largest error", largest, limits.distance_max_mm)
    turn = after.turn.moved if after and after.turn else None
    yield Requirement("motion of the point while the plate turns", turn, limits.rotation_mm)
    lines = after.lines if after else ()
    for axis in ("x", "y", "z"):
        line = next((line.straightness for line in lines if line.axis == axis), None)
        yield Requirement(f"straightness along {axis}", line, limits.straightness_mm)
    radius = after.cloud.radius if after and after.cloud else None
    yield Requirement("repeatability, radius of the sphere", radius, limits.repeatability_mm)


def _distance_results(after: StageView | None) -> tuple[Result | None, Result | None]:
    """Mean and largest error; the mean's uncertainty is not reduced by averaging.

    An instrument's errors at points near each other are alike.
    """
    if after is None or after.distances is None:
        return None, None
    errors, instrument = np.abs(after.distances.errors_mm), after.distances.instrument_mm
    worst = int(np.argmax(errors))
    return (
        Result(float(errors.mean()), float(instrument.mean())),
        Result(float(errors[worst]), float(instrument[worst])),
    )


def _of_identification(finding: IdentificationFinding | None) -> Iterator[str]:
    if finding is None:
        yield "Nothing has been identified yet."
    elif finding.verdict == "pass":
        yield "The identification passed: pairs of shots that were not fitted improved too."
    else:
        yield f"The identification: {finding.verdict} ({'; '.join(finding.reasons)})."


def _of_limits(requirements: tuple[Requirement, ...], after: StageView | None) -> Iterator[str]:
    asked = [r for r in requirements if r.limit_mm is not None]
    if not asked:
        yield "No acceptance limit is set in campaign.yaml, so conformity is not decided."
    elif after is None:
        yield "The robot has not been validated after calibration, so no limit is decided."
    else:
        for decision in ("fail", "not decided", "pass"):
            names = [r.name for r in asked if r.decision == decision]
            if names:
                yield f"{decision.capitalize()}: {', '.join(names)}."
