"""The verdict: when it passes, when it fails, and when nothing is decided."""

import pytest
from paper_campaign import PaperCampaign

from app.report.checks import Check
from app.report.collect import collect
from app.report.conformity import Verdict, verdict
from app.report.evidence import Evidence
from app.report.stages import StageView, stage_view
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.settings.sections import AcceptanceConfig

WIDE = AcceptanceConfig(
    distance_mean_mm=1.0,
    distance_max_mm=1.0,
    rotation_mm=1.0,
    straightness_mm=1.0,
    repeatability_mm=1.0,
)


@pytest.fixture(scope="module")
def evidence(whole: PaperCampaign) -> Evidence:
    return collect(whole.campaign)


@pytest.fixture(scope="module")
def after(evidence: Evidence) -> StageView:
    assert evidence.after is not None
    return stage_view(evidence.after, TrackerUncertainty())


def judged(evidence: Evidence, after: StageView | None, limits: AcceptanceConfig) -> Verdict:
    return verdict(evidence.identification, after, limits, ())


def decision_on(found: Verdict, name: str) -> str | None:
    return next(r.decision for r in found.requirements if r.name == name)


def test_every_limit_surely_kept_passes(evidence: Evidence, after: StageView) -> None:
    assert judged(evidence, after, WIDE).decision == "pass"


def test_one_limit_surely_broken_fails_all(evidence: Evidence, after: StageView) -> None:
    found = judged(evidence, after, WIDE.model_copy(update={"repeatability_mm": 1e-6}))
    assert decision_on(found, "repeatability, radius of the sphere") == "fail"
    assert decision_on(found, "distances, mean error") == "pass"
    assert found.decision == "fail"


def test_a_limit_within_the_uncertainty_decides_nothing(
    evidence: Evidence, after: StageView
) -> None:
    assert after.cloud is not None
    limit = after.cloud.radius.value_mm
    found = judged(evidence, after, WIDE.model_copy(update={"repeatability_mm": limit}))
    assert decision_on(found, "repeatability, radius of the sphere") == "not decided"
    assert found.decision == "not decided"


def test_no_limit_asked_for_decides_nothing(evidence: Evidence, after: StageView) -> None:
    found = judged(evidence, after, AcceptanceConfig())
    assert found.decision == "not decided"
    assert {r.decision for r in found.requirements} == {None}


def test_a_limit_without_a_measurement_decides_nothing(evidence: Evidence) -> None:
    found = judged(evidence, None, WIDE)
    assert found.decision == "not decided"
    assert "not been validated after" in " ".join(found.reasons)


def test_without_an_identification_nothing_passes(evidence: Evidence, after: StageView) -> None:
    assert verdict(None, after, WIDE, ()).decision == "not decided"


def test_a_failed_identification_fails_all(evidence: Evidence, after: StageView) -> None:
    assert evidence.identification is not None
    failed = evidence.identification.model_copy(update={"verdict": "fail", "reasons": ("why",)})
    found = verdict(failed, after, WIDE, ())
    assert found.decision == "fail"
    assert "why" in " ".join(found.reasons)


def test_files_that_do_not_belong_together_take_a_pass_away(
    evidence: Evidence, after: StageView
) -> None:
    broken = Check("the plan is the plan", holds=False, detail="")
    unknown = Check("nothing to compare", holds=None, detail="")
    assert verdict(evidence.identification, after, WIDE, (unknown,)).decision == "pass"
    found = verdict(evidence.identification, after, WIDE, (broken,))
    assert found.decision == "not decided"
    assert "the plan is the plan" in " ".join(found.reasons)
