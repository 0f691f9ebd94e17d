"""Work of a check: shots that the identified robot reaches, judged with their temperatures."""

import numpy as np
import pytest
from command_line import change
from paper_campaign import new_campaign

from campaigns.campaign import open_campaign
from campaigns.errors import PlanInvalid
from campaigns.identification.options import IdentificationOptions
from campaigns.options import CheckOptions
from campaigns.planning.paths import check_paths
from campaigns.workflow.checking import check_work, record_check, update_by_check
from campaigns.workflow.identification import identify

pytestmark = pytest.mark.slow
READINGS = {"2026-03-02T08:00:00Z": 20.0, "2026-03-02T08:10:00Z": 24.0}


def identified(folder, options=None, **settings):
    """A campaign whose 74 shots are measured within three minutes, and identified."""
    paper = new_campaign(folder, **settings)
    paper.run(pairs=30, unseen=6)
    assert identify(paper.campaign, options).judgement.verdict == "pass"
    return paper


def stops_of(work):
    return [(f"shot {step.planned.shot}", np.array(step.planned.joints)) for step in work.steps]


def checked(paper):
    """Measure and judge a check, by the campaign's files as they are now."""
    paper.campaign = open_campaign(paper.folder)
    work = check_work(paper.campaign, CheckOptions())
    series = paper.measure("check", tuple(step.planned for step in work.steps))
    with paper.campaign.journal() as journal:
        return record_check(paper.campaign, journal, series)


def test_a_check_passes_by_safe_ways_where_the_robot_cannot_take_some_of_the_shots(tmp_path):
    paper = identified(tmp_path / "c")
    change(paper.folder / "robot.yaml", {"limits.theta_deg": [-8.0, 8.0]})
    campaign = open_campaign(paper.folder)
    work = check_work(campaign, CheckOptions())
    assert [step.planned.shot for step in work.steps] == list(range(8))
    assert check_paths(stops_of(work), work.robot).faults == ()
    assert check_work(campaign, CheckOptions()).steps == work.steps
    assert len(check_work(campaign, CheckOptions(shots=6)).steps) == 6


def test_a_robot_that_reaches_no_shot_is_refused(tmp_path):
    paper = identified(tmp_path / "c")
    change(paper.folder / "campaign.yaml", {"validation.centre_mm": [0.0, 0.0, -2000.0]})
    with pytest.raises(PlanInvalid, match="reaches no identification shot"):
        check_work(open_campaign(paper.folder), CheckOptions())


def test_with_temperatures_of_parts_a_check_is_judged_and_updates(tmp_path):
    paper = identified(tmp_path / "c", part_temperatures=READINGS)
    judged = checked(paper)
    assert judged.decision == "pass", judged.says
    updated = update_by_check(paper.campaign)
    assert updated.judgement.verdict == "pass", updated.judgement.reasons
    assert updated.value.reference_degC == 20.0


def test_without_temperatures_at_the_check_growth_is_left_out(tmp_path):
    paper = identified(tmp_path / "c", part_temperatures=READINGS)
    change(paper.folder / "campaign.yaml", {"part_temperatures": {}})
    judged = checked(paper)
    assert judged.decision == "pass", judged.says
    assert update_by_check(paper.campaign).judgement.verdict == "pass"


def test_a_set_identified_with_held_parameters_is_checked_and_updated(tmp_path):
    paper = identified(tmp_path / "c", IdentificationOptions(fix=("rods", "arm3.arm_mm")))
    judged = checked(paper)
    assert judged.decision == "pass", judged.says
    updated = update_by_check(paper.campaign)
    assert updated.judgement.verdict == "pass", updated.judgement.reasons
    assert not updated.value.parameters["arm3.arm_mm"].free
