"""Whether the files belong together: every broken link is found, and only that one."""

from dataclasses import replace

import pytest
from paper_campaign import NOMINAL, PaperCampaign, new_campaign

from campaigns.evaluation.campaign_verdict import Check
from campaigns.evidence import Evaluation, Evidence, gather
from campaigns.journal.records import SeriesStarted


@pytest.fixture(scope="module")
def evidence(whole: PaperCampaign) -> Evidence:
    return gather(whole.campaign)


def checks(evidence: Evidence) -> tuple[Check, ...]:
    return Evaluation(evidence).checks


def broken(evidence: Evidence) -> list[str]:
    return [check.statement for check in checks(evidence) if check.holds is False]


def restarted(evidence: Evidence, **changes: object) -> Evidence:
    """With another beginning of the series after calibration."""
    (measured,) = evidence.after
    series = measured.series
    started: SeriesStarted = replace(series.started, **changes)
    return replace(evidence, after=(replace(measured, series=replace(series, started=started)),))


def test_a_whole_campaign_holds_together(evidence: Evidence) -> None:
    found = {check.statement: check.holds for check in checks(evidence)}
    assert len(found) == 8
    assert list(found.values()) == [True] * 7 + [None]  # the paper journal holds no settings


def test_files_of_another_campaign_are_found(evidence: Evidence) -> None:
    (found,) = broken(replace(evidence, plan=evidence.plan[:-1]))
    assert found.startswith("plan.csv")
    other = replace(evidence.identification, robot_digest="0" * 64)
    (found,) = broken(replace(evidence, identification=other))
    assert found.startswith("the nominal robot")
    other = replace(evidence.identification, journal_digest="0" * 64)
    (found,) = broken(replace(evidence, identification=other))
    assert found.startswith("the journal")
    (found,) = broken(replace(evidence, parameter_file=NOMINAL.robot))
    assert found.startswith("the parameter file")
    rolled_back = replace(evidence.loaded, digest=NOMINAL.robot.digest())
    (found,) = broken(replace(evidence, loaded=rolled_back))
    assert found.startswith("what was loaded last")
    (found,) = broken(restarted(evidence, robot_file_digest=NOMINAL.robot.digest()))
    assert found.startswith("the controller held the identified set")


def test_a_before_with_other_parameters_is_told_and_decides_nothing(evidence: Evidence) -> None:
    (measured,) = evidence.before
    started = replace(measured.series.started, robot_file_digest="0" * 64)
    series = replace(measured.series, started=started)
    (found,) = [
        check
        for check in checks(replace(evidence, before=(replace(measured, series=series),)))
        if check.holds is False
    ]
    assert "neither nominal nor identified" in found.detail
    assert not found.decides


def test_limits_changed_after_the_validation_are_found_and_decide_nothing(
    evidence: Evidence,
) -> None:
    now = evidence.campaign.config.acceptance.model_dump(mode="json")
    assert broken(restarted(evidence, configuration={"acceptance": now})) == []
    then = restarted(evidence, configuration={"acceptance": now | {"rotation_mm": 0.1}})
    (found,) = [check for check in checks(then) if check.holds is False]
    assert found.statement.startswith("the limits")
    assert not found.decides


def test_an_empty_campaign_has_nothing_to_compare(tmp_path) -> None:
    empty = gather(new_campaign(tmp_path / "empty").campaign)
    assert {check.holds for check in checks(empty)} == {None}
