"""The verdict: when it passes, when it fails, and when nothing is decided."""

from dataclasses import replace

import pytest

from campaigns.evaluation.decision import NO_LIMIT
from campaigns.evaluation.validation import ValidationResult
from campaigns.evaluation.verdict import (
    CampaignVerdict,
    Check,
    IdentificationVerdict,
    campaign_verdict,
    gains,
    validation_verdict,
    worse_than_before,
)
from campaigns.evidence import Evaluation
from campaigns.settings.sections import AcceptanceConfig

WIDE = AcceptanceConfig(**dict.fromkeys(AcceptanceConfig.model_fields, 1.0))
PASSED = IdentificationVerdict("pass", ())


@pytest.fixture(scope="module")
def after(evaluation: Evaluation) -> ValidationResult:
    return evaluation.after


def judged(
    after: ValidationResult | None,
    limits: AcceptanceConfig,
    *checks: Check,
    identification: IdentificationVerdict | None = PASSED,
    before: ValidationResult | None = None,
    gained: str = "",
) -> CampaignVerdict:
    validated = validation_verdict(after, limits, worse_than_before(gains(before, after)))
    was_there = after is not None
    return campaign_verdict(identification, validated, checks, validated=was_there, gained=gained)


def far_off(found: ValidationResult, error_mm: float) -> ValidationResult:
    """The same with every distance off by so much."""
    test = found.distances
    return replace(found, distances=replace(test, commanded_mm=test.measured_mm + error_mm))


def decision_on(found: CampaignVerdict, name: str) -> str | None:
    return next(r.decision for r in found.requirements if r.name == name)


@pytest.mark.parametrize(
    ("share", "decision"), [(None, "pass"), (1e-3, "fail"), (1.0, "not decided")]
)
def test_all_limits_decide_together(after, share, decision) -> None:
    """One of them is a share of what was measured; the others are wide."""
    limits = WIDE
    if share is not None:
        limit = share * after.repeatability.radius.value_mm
        limits = WIDE.model_copy(update={"repeatability_mm": limit})
    found = judged(after, limits)
    assert decision_on(found, "repeatability, radius of the sphere") == decision
    assert decision_on(found, "distances, mean error") == "pass"
    assert found.decision == decision


def test_where_only_a_limit_is_missing_the_answer_is_that_none_is_specified(after) -> None:
    found = judged(after, AcceptanceConfig(), gained="Gained: much.")
    assert found.decision == NO_LIMIT
    assert {r.decision for r in found.requirements} == {None}
    assert found.headline.startswith("Gained: much. No acceptance limits are specified")
    assert judged(after, WIDE, gained="Gained: much.").decision == "pass"
    assert "Gained" not in judged(after, WIDE, gained="Gained: much.").headline


@pytest.mark.parametrize(
    ("identification", "checks", "answer"),
    [
        (None, (), "not decided"),
        (IdentificationVerdict("not decided", ("why",)), (), "not decided"),
        (IdentificationVerdict("fail", ("why",)), (), "fail"),
        (PASSED, (Check("the plan is the plan", holds=False, detail=""),), "not decided"),
        (PASSED, (Check("the limits", holds=False, detail="", decides=False),), NO_LIMIT),
    ],
)
def test_what_else_leaves_it_open_is_not_hidden_by_a_missing_limit(
    after, identification, checks, answer
) -> None:
    found = judged(after, AcceptanceConfig(), *checks, identification=identification)
    assert found.decision == answer


def test_an_accepted_finding_is_among_the_reasons_and_broken_files_take_a_pass_away(after) -> None:
    accepted = IdentificationVerdict("pass", (), ("all lengths are longer",))
    found = judged(after, WIDE, identification=accepted)
    assert found.decision == "pass"
    assert "Accepted all the same: all lengths are longer." in found.reasons
    broken = Check("the plan is the plan", holds=False, detail="")
    unknown = Check("nothing to compare", holds=None, detail="")
    assert judged(after, WIDE, unknown).decision == "pass"
    found = judged(after, WIDE, broken)
    assert found.decision == "not decided"
    assert "the plan is the plan" in " ".join(found.reasons)


def test_distances_that_became_worse_fail_beyond_their_uncertainty(after: ValidationResult) -> None:
    worse = far_off(after, 0.5)
    for limits in (WIDE, AcceptanceConfig()):
        found = judged(worse, limits, before=far_off(after, 0.4))
        assert found.decision == "fail"
        assert any("before loading" in reason for reason in found.reasons)
    assert judged(worse, WIDE, before=far_off(after, 0.6)).decision == "pass"
    worse = far_off(after, 0.5)
    mean = worse.comparable_figures()["distances, mean error"]
    expanded_mm = 2.0**0.5 * mean.expanded_uncertainty_mm
    for share, decision in ((0.99, "pass"), (1.01, "fail")):
        before = far_off(after, 0.5 - share * expanded_mm)
        assert judged(worse, WIDE, before=before).decision == decision


def test_a_campaigns_verdict_rests_on_its_own_identification(evaluation: Evaluation) -> None:
    evidence = evaluation.evidence
    assert "The identification passed" in evaluation.verdict.reasons[0]
    failed = replace(evidence.identification, verdict="fail", reasons=("why",))
    verdict = Evaluation(replace(evidence, identification=failed)).verdict
    assert verdict.decision == "fail"
    assert "why" in verdict.reasons[0]
    without = Evaluation(replace(evidence, identification=None)).verdict
    assert without.decision == "not decided"
    assert "Nothing has been identified" in without.reasons[0]
