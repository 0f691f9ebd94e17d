"""The verdict: when it passes, when it fails, and when nothing is decided."""

import ast
import inspect
import re
from dataclasses import replace

import pytest
from changed_results import with_fields

from campaigns import chain
from campaigns.assessment import Evaluation
from campaigns.evaluation import stated_sources
from campaigns.evaluation.decision import NO_LIMIT
from campaigns.evaluation.verdict import (
    Check,
    IdentificationVerdict,
    campaign_verdict,
    gains,
    validation_verdict,
    worse_than_before,
)
from campaigns.settings.sections import AcceptanceConfig

WIDE = AcceptanceConfig(**dict.fromkeys(AcceptanceConfig.model_fields, 1.0))
PASSED = IdentificationVerdict("pass", ())
BROKEN = Check("the plan is the plan", holds=False, detail="")


@pytest.fixture(scope="module")
def after(evaluation):
    return evaluation.after


def judged(after, limits, *checks, identification=PASSED, before=None, gained=""):
    validated = validation_verdict(after, limits, worse_than_before(gains(before, after)))
    return campaign_verdict(identification, validated, checks, validated=True, gained=gained)


def far_off(result, error_mm):
    """The validation with every distance off by so much."""
    test = result.distances
    return replace(result, distances=replace(test, commanded_mm=test.measured_mm + error_mm))


def decision_on(verdict, name):
    return next(r.decision for r in verdict.requirements if r.name == name)


@pytest.mark.parametrize(
    ("share", "decision"), [(None, "pass"), (1e-3, "fail"), (1.0, "not decided")]
)
def test_all_limits_decide_together(after, share, decision):
    """One limit is a share of what was measured; the others are wide."""
    limits = WIDE
    if share is not None:
        limit = share * after.repeatability.radius.value_mm
        limits = WIDE.model_copy(update={"repeatability_mm": limit})
    verdict = judged(after, limits)
    assert decision_on(verdict, "repeatability, radius of the sphere") == decision
    assert decision_on(verdict, "distances, mean error") == "pass"
    assert verdict.decision == decision


def test_where_only_a_limit_is_missing_the_answer_is_that_none_is_specified(after):
    verdict = judged(after, AcceptanceConfig(), gained="Gained: much.")
    assert verdict.decision == NO_LIMIT
    assert {r.decision for r in verdict.requirements} == {None}
    assert verdict.headline.startswith("Gained: much. No acceptance limits are specified")
    assert "Gained" not in judged(after, WIDE, gained="Gained: much.").headline


@pytest.mark.parametrize(
    ("identification", "checks", "answer"),
    [
        (None, (), "not decided"),
        (IdentificationVerdict("not decided", ("why",)), (), "not decided"),
        (IdentificationVerdict("fail", ("why",)), (), "fail"),
        (PASSED, (BROKEN,), "not decided"),
        (PASSED, (replace(BROKEN, decides=False),), NO_LIMIT),
    ],
)
def test_what_else_leaves_it_open_is_not_hidden_by_a_missing_limit(
    after, identification, checks, answer
):
    verdict = judged(after, AcceptanceConfig(), *checks, identification=identification)
    assert verdict.decision == answer


def test_an_accepted_finding_is_among_the_reasons_and_broken_files_take_a_pass_away(after):
    accepted = IdentificationVerdict("pass", (), ("all lengths are longer",))
    verdict = judged(after, WIDE, identification=accepted)
    assert verdict.decision == "pass"
    assert "Accepted all the same: all lengths are longer." in verdict.reasons
    assert judged(after, WIDE, replace(BROKEN, holds=None)).decision == "pass"
    verdict = judged(after, WIDE, BROKEN)
    assert verdict.decision == "not decided"
    assert verdict.reasons[-1].startswith("The plan is not the plan")


def test_distances_that_became_worse_fail_beyond_their_uncertainty(after):
    worse = far_off(after, 0.5)
    verdict = judged(worse, AcceptanceConfig(), before=far_off(after, 0.4))
    assert verdict.decision == "fail"
    assert any("before loading" in reason for reason in verdict.reasons)
    assert judged(worse, WIDE, before=far_off(after, 0.6)).decision == "pass"
    mean = worse.comparable_figures()["distances, mean error"]
    expanded_mm = 2.0**0.5 * mean.expanded_uncertainty_mm
    for share, decision in ((0.99, "pass"), (1.01, "fail")):
        before = far_off(after, 0.5 - share * expanded_mm)
        assert judged(worse, WIDE, before=before).decision == decision


def test_a_campaigns_verdict_rests_on_its_own_identification(evaluation):
    evidence = evaluation.evidence
    assert "The identification passed" in evaluation.verdict.reasons[0]
    failed = with_fields(evidence.identification, verdict="fail", reasons=("why",))
    for identification, decision in ((failed, "fail"), (None, "not decided")):
        verdict = Evaluation(replace(evidence, identification=identification)).verdict
        assert verdict.decision == decision


def statements():
    """Texts that checks are made of; what is filled in stands as …."""
    source = inspect.getsource(chain) + inspect.getsource(stated_sources)
    for node in ast.walk(ast.parse(source)):
        text = None
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "statement":
            text = node.value
        elif isinstance(node, ast.Call) and ast.unparse(node.func) in {"Check", "same_digest"}:
            text = node.args[0]
        if isinstance(text, ast.JoinedStr):
            parts = (getattr(part, "value", None) for part in text.values)
            yield "".join(part if isinstance(part, str) else "…" for part in parts)
        elif isinstance(text, ast.Constant):
            yield text.value


def test_each_statement_about_the_files_has_its_opposite():
    denied = {text: Check(text, holds=False, detail="").denied for text in statements()}
    assert len(denied) > 10
    assert all(re.search(r" (?:not|no) ", f" {opposite} ") for opposite in denied.values())
    says = "campaign.yaml says what it said when the identification was judged by it"
    assert denied[says] == says.replace("says", "does not say")
    held = "the controller held the nominal parameters when the robot was validated before"
    assert denied[held] == held.replace("held", "did not hold")
