"""The verdict: every limit asked for, decided with the uncertainty of measurement."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from app.report.checks import Check
from app.report.findings import IdentificationFinding
from app.report.stages import StageView
from campaigns.evaluation.decision import Decision, Requirement, decide_all
from campaigns.evaluation.validation import Result
from campaigns.settings.sections import AcceptanceConfig

RULE = (
    "Decision rule (ISO 14253-1): a limit is kept only if |e| + U ≤ limit, and broken only if "
    "|e| − U > limit; in between nothing is decided. U = 2 u is the expanded uncertainty of "
    "measurement (k = 2, about 95 %). All passes only if the identification passed, every limit "
    "that is asked for is kept, and the files belong together."
)
NOT_DECIDED: Decision = "not decided"
HEADLINES: Mapping[Decision, str] = {
    "pass": "Every limit that is asked for is kept, by more than the uncertainty of measurement.",
    "fail": "The calibration, or the robot after it, does not fulfil what is asked for.",
    "not decided": "It is not shown that the robot keeps, or breaks, the limits asked for.",
}
NOTHING_ASKED = "No limit is asked for, so there is none to be kept or broken."


@dataclass(frozen=True, slots=True)
class Verdict:
    """The decision as a whole, in a sentence each why."""

    decision: Decision
    headline: str
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
    decisions += [NOT_DECIDED for check in broken if check.decides]
    decisions.append(NOT_DECIDED if finding is None else finding.verdict)
    reasons = (
        *_of_identification(finding),
        *_of_limits(requirements, after),
        *(f"Does not hold: {check.statement} ({check.detail})." for check in broken),
    )
    decision = decide_all(decisions)
    asked = any(r.limit is not None for r in requirements)
    headline = HEADLINES[decision] if asked or decision == "fail" else NOTHING_ASKED
    return Verdict(decision, headline, reasons, requirements)


def _requirements(after: StageView | None, limits: AcceptanceConfig) -> Iterator[Requirement]:
    """Of the validation after calibration, in mm, with the instrument's uncertainty."""
    mean, largest = _distance_results(after)
    yield _requirement("distances, mean error", mean, limits.distance_mean_mm)
    yield _requirement("distances, largest error", largest, limits.distance_max_mm)
    turn = after.turn.moved if after and after.turn else None
    yield _requirement("motion of the point while the plate turns", turn, limits.rotation_mm)
    lines = after.lines if after else ()
    for axis in ("x", "y", "z"):
        line = next((line.straightness for line in lines if line.axis == axis), None)
        yield _requirement(f"straightness along {axis}", line, limits.straightness_mm)
    radius = after.cloud.radius if after and after.cloud else None
    yield _requirement("repeatability, radius of the sphere", radius, limits.repeatability_mm)


def _requirement(name: str, result: Result | None, limit_mm: float | None) -> Requirement:
    if result is None:
        return Requirement(name, None, limit_mm)
    return Requirement(name, result.value_mm, limit_mm, result.instrument_mm)


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
    asked = [r for r in requirements if r.limit is not None]
    if not asked:
        yield "No limit is set under `acceptance` in campaign.yaml."
    elif after is None:
        yield "The robot has not been validated after calibration, so no limit is decided."
    else:
        for decision in ("fail", "not decided", "pass"):
            names = [r.name for r in asked if r.decision == decision]
            if names:
                yield f"{decision.capitalize()}: {'; '.join(names)}."
