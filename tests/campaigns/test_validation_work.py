"""Work of a validation: what is commanded."""

from dataclasses import replace

import pytest
from paper_campaign import NOMINAL, new_campaign

from campaigns.campaign import open_campaign
from campaigns.errors import OptionsInvalid
from campaigns.options import ValidationOptions
from campaigns.workflow.validation import validation_work

OPTIONS = ValidationOptions(stage="before")
ACTIVE = dict(NOMINAL.robot.parameters)


@pytest.fixture
def paper(tmp_path):
    paper = new_campaign(tmp_path / "c")
    paper.run(pairs=1, unseen=1)
    return paper


def test_a_reflector_on_half_2_is_commanded_by_poses_of_the_controllers_own_point(paper):
    plain, _ = validation_work(paper.campaign, ACTIVE, OPTIONS)
    assert not any(step.corrected for step in plain.steps)
    with (paper.folder / "robot.yaml").open("a", encoding="utf-8") as file:
        file.write("reflector_half: 2\n")
    work, _ = validation_work(open_campaign(paper.folder), ACTIVE, OPTIONS)
    turned = [step for step in work.steps if step.planned.pose.theta_rad]
    assert turned
    assert all(step.corrected and step.corrected != step.planned.pose for step in turned)


def test_unknown_shot_to_skip_is_refused_and_others_are_kept_out(paper):
    work, _ = validation_work(paper.campaign, ACTIVE, replace(OPTIONS, skip=(1,)))
    assert work.skip == {1}
    with pytest.raises(OptionsInvalid, match="--skip 999: this validation has no such shot"):
        validation_work(paper.campaign, ACTIVE, replace(OPTIONS, skip=(999,)))
