"""Whether the files belong together: every broken link is found, and only that one."""

from dataclasses import replace
from pathlib import Path

import pytest
from changed_results import with_fields
from paper_campaign import NOMINAL, PaperCampaign, new_campaign

from campaigns.assessment import Evaluation
from campaigns.evaluation.verdict import Check
from campaigns.evidence import Evidence, gather
from campaigns.identification.findings import HOLD_OUT, Finding
from campaigns.next_step import next_step, state_of
from campaigns.planning.plan_file import write_plan
from campaigns.settings.sections import AcceptanceConfig, KnownLengthConfig
from campaigns.settings.space import SpaceConfig


@pytest.fixture(scope="module")
def evidence(whole: PaperCampaign) -> Evidence:
    return gather(whole.campaign)


def broken_checks(evidence) -> list[Check]:
    return [check for check in Evaluation(evidence).checks if check.holds is False]


def broken(evidence: Evidence) -> list[str]:
    return [check.statement for check in broken_checks(evidence)]


def restarted(evidence: Evidence, stage: str, **changes: object) -> Evidence:
    """With another beginning of the series before or after calibration."""
    (measured,) = getattr(evidence, stage)
    started = replace(measured.series.started, **changes)
    series = replace(measured.series, started=started)
    return replace(evidence, **{stage: (replace(measured, series=series),)})


def test_a_whole_campaign_holds_together_and_an_empty_one_compares_nothing(evidence, tmp_path):
    holds = [check.holds for check in Evaluation(evidence).checks]
    assert holds == [True] * 8
    empty = gather(new_campaign(tmp_path / "empty").campaign)
    assert {check.holds for check in Evaluation(empty).checks} == {None}


def test_each_file_of_another_campaign_is_found_and_only_that(evidence, tmp_path: Path) -> None:
    campaign = replace(evidence.campaign, folder=tmp_path)
    shorter = evidence.plan[:-1]
    write_plan(campaign.plan_path, shorter, campaign.robot.mechanism)
    identification, nominal = evidence.identification, NOMINAL.robot.digest()
    other_robot = with_fields(identification, robot_digest="0" * 64)
    other_journal = with_fields(identification, journal_digest="0" * 64)
    rolled_back = replace(evidence.loaded, digest=nominal)
    for statement, exchanged in {
        "plan.csv": replace(evidence, campaign=campaign, plan=shorter),
        "the nominal robot": replace(evidence, identification=other_robot),
        "the journal": replace(evidence, identification=other_journal),
        "the parameter file": replace(evidence, parameter_file=NOMINAL.robot),
        "what was loaded last": replace(evidence, loaded=rolled_back),
        "the controller held the identified set": restarted(
            evidence, "after", robot_file_digest=nominal
        ),
    }.items():
        (found,) = broken(exchanged)
        assert found.startswith(statement)


def test_a_before_with_other_parameters_is_told_and_decides_nothing(evidence):
    (found,) = broken_checks(restarted(evidence, "before", robot_file_digest="0" * 64))
    assert "neither nominal nor identified" in found.detail
    assert not found.decides


def test_limits_set_after_the_validation_are_judged_and_said_with_their_time(evidence):
    limits = AcceptanceConfig(distance_mean_mm=5.0)
    now = reconfigured(evidence, acceptance=limits)
    same, other = (each.model_dump(mode="json") for each in (limits, AcceptanceConfig()))
    of_a_version_without = {key: limit for key, limit in same.items() if limit is not None}
    for then, is_said in ((same, False), (other, True), (of_a_version_without, False)):
        started = restarted(now, "after", configuration={"acceptance": then})
        verdict = Evaluation(started).verdict
        assert verdict.decision == "pass"
        assert any("Limits set after" in reason for reason in verdict.reasons) == is_said
        assert broken(started) == []


def reconfigured(evidence: Evidence, **changes: object) -> Evidence:
    """With a campaign.yaml that says otherwise now."""
    campaign = evidence.campaign
    config = campaign.config.model_copy(update=changes)
    return replace(evidence, campaign=replace(campaign, config=config))


def judged_now(evidence: Evidence, **changes: object) -> Evidence:
    """Of an identification by today's settings, with changes."""
    settings = evidence.campaign.identification_settings
    found = with_fields(evidence.identification, settings=settings, **changes)
    return replace(evidence, identification=found)


def test_a_space_or_a_known_length_of_another_day_leaves_the_verdict_open(evidence):
    judged = judged_now(evidence)
    assert broken(judged) == []
    bar = KnownLengthConfig(name="bar", length_mm=1000.0, std_mm=0.005)
    for changes in ({"space": SpaceConfig(z_lowest_mm=-700.0)}, {"known_lengths": (bar,)}):
        changed = reconfigured(judged, **changes)
        (found,) = broken_checks(changed)
        assert found.detail == f"{next(iter(changes))} changed since"
        assert Evaluation(changed).verdict.decision == "not decided"
        assert next_step(state_of(Evaluation(changed))).text.startswith("pkmcal identify")
        without_settings = replace(changed, identification=evidence.identification)
        assert broken(without_settings) == []


def test_a_pass_by_limits_that_are_gone_is_none(evidence):
    let_pass = Finding(HOLD_OUT, "far off; the acceptance limits are met all the same")
    judged = judged_now(evidence, findings=(let_pass,))
    kept = AcceptanceConfig(distance_mean_mm=5.0, distance_max_mm=9.0)
    assert broken(reconfigured(judged, acceptance=kept)) == []
    for limits in (AcceptanceConfig(), AcceptanceConfig(distance_max_mm=1e-6)):
        changed = reconfigured(judged, acceptance=limits)
        (found,) = broken_checks(changed)
        assert found.detail == "acceptance changed since"
        assert Evaluation(changed).verdict.decision != "pass"
