"""Campaign verdict: identification, validation with its limits, and integrity, decided as one."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from campaigns.evaluation.decision import NO_LIMIT, Decision, Requirement, Verdict, decide_all
from campaigns.evaluation.validation import ValidationVerdict

RULE = (
    "Decision rule (ISO 14253-1): a limit is kept only if |e| + U ≤ limit, and broken only if "
    "|e| − U > limit; in between nothing is decided. U = 2 u is the expanded uncertainty of "
    "measurement (k = 2, about 95 %). All passes only if the identification passed, every limit "
    "that is asked for is kept, the files belong together, and no check found the robot changed."
)
NOT_DECIDED: Decision = "not decided"
HEADLINES: Mapping[Verdict, str] = {
    "pass": "Every limit that is asked for is kept, by more than the uncertainty of measurement.",
    "fail": "The calibration, or the robot after it, does not fulfil what is asked for.",
    "not decided": "It is not shown that the robot keeps, or breaks, the limits asked for.",
}
NOTHING_ASKED = "No limit is asked for, so there is none to be kept or broken."


@dataclass(frozen=True, slots=True)
class Check:
    """Statement about the files, and whether it holds; None: there is nothing to compare."""

    statement: str
    holds: bool | None
    detail: str
    decides: bool = True
    """Whether nothing can pass when it does not hold."""


def same_digest(statement: str, one: str | None, other: str | None) -> Check:
    """Check that two digests agree."""
    if not one or not other:
        return Check(statement, None, "nothing to compare")
    if one == other:
        return Check(statement, holds=True, detail=f"sha256 {one[:16]}…")
    return Check(statement, holds=False, detail=f"sha256 {one[:16]}… is not {other[:16]}…")


@dataclass(frozen=True, slots=True)
class IdentificationVerdict:
    """Decision on an identification, and its reasons."""

    decision: Decision
    reasons: tuple[str, ...]
    accepted: tuple[str, ...] = ()
    """Doubts that somebody accepted, in words."""


@dataclass(frozen=True, slots=True)
class CampaignVerdict:
    """Verdict as a whole, and the reasons, a sentence each."""

    decision: Verdict
    headline: str
    reasons: tuple[str, ...]
    requirements: tuple[Requirement, ...]

    @property
    def says(self) -> str:
        """The verdict and its reasons."""
        return f"{self.decision}: {' '.join(self.reasons)}"


def campaign_verdict(
    identification: IdentificationVerdict | None,
    after: ValidationVerdict,
    checks: Sequence[Check],
    *,
    validated: bool,
    notes: tuple[str, ...] = (),
    gained: str = "",
) -> CampaignVerdict:
    """Pass only if the identification passed, the limits are surely kept and the files agree.

    `validated`: whether the robot was measured after calibration. `notes`: sentences that a reader
    of the verdict needs. `gained`: what calibration gained, stated where no limit is asked for.
    """
    broken = [check for check in checks if check.holds is False]
    decisions: list[Decision] = [NOT_DECIDED for check in broken if check.decides]
    decisions.append(NOT_DECIDED if identification is None else identification.decision)
    asked = any(r.limit is not None for r in after.requirements)
    decision: Verdict = NO_LIMIT
    if after.decision != NO_LIMIT:
        decision = decide_all([*decisions, after.decision])
    elif asked or set(decisions) != {"pass"}:
        decision = decide_all([*decisions, NOT_DECIDED])
    reasons = (
        *_of_identification(identification),
        *_of_limits(after, validated=validated),
        *notes,
        *(f"Not confirmed: {check.statement} ({check.detail})." for check in broken),
    )
    headline = HEADLINES.get(decision, "")
    if not asked and decision != "fail":
        headline = f"{gained} {NOTHING_ASKED}".strip()
    return CampaignVerdict(decision, headline, reasons, after.requirements)


def _of_identification(found: IdentificationVerdict | None) -> Iterator[str]:
    if found is None:
        yield "Nothing has been identified yet."
    elif found.decision == "pass":
        yield f"The identification passed: {'; '.join(found.reasons)}."
    else:
        yield f"The identification: {found.decision} ({'; '.join(found.reasons)})."
    if found is not None:
        yield from (f"Accepted all the same: {doubt}." for doubt in found.accepted)


def _of_limits(after: ValidationVerdict, *, validated: bool) -> Iterator[str]:
    asked = [r for r in after.requirements if r.limit is not None]
    if not asked:
        yield "No limit is set under `acceptance` in campaign.yaml."
    elif not validated:
        yield "The robot has not been validated after calibration, so no limit is decided."
    else:
        for decision in ("fail", "not decided", "pass"):
            names = [r.name for r in asked if r.decision == decision]
            if names:
                yield f"{decision.capitalize()}: {'; '.join(names)}."
    yield from (f"Not shown: {reason}." for reason in after.beyond)
    yield from (f"Worse: {reason}." for reason in after.worse)
