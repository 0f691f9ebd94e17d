"""Plans for the robot as it was identified, which runs take by the nominal one."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded_identifications import body

from app.new_campaign import create_simulated
from campaigns.campaign import Campaign, open_campaign
from campaigns.errors import ShotsMissing, VerdictBad
from campaigns.estimation.estimators import Model
from campaigns.journal.records import Finding
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.options import PlanOptions
from campaigns.planning.plans import Placement, joints_of, poses_of
from campaigns.workflow.planning import plan

OFF = {"mm": 5.0, "deg": 3.0}
AFTER = PlanOptions(shots=40, model=Model.STANDARD, after_identify=True)
OPTIMAL = replace(AFTER, placement=Placement.OPTIMAL, candidates=200)
Identified = Callable[..., tuple[Campaign, Kinematics]]


@pytest.fixture
def identified(tmp_path: Path) -> Identified:
    """Campaign in which a robot far off was identified, and its kinematics."""

    def make(robot: str = "par4-prototype", **more: object) -> tuple[Campaign, Kinematics]:
        create_simulated(tmp_path / "cell", robot, "paper-simulation")
        campaign = open_campaign(tmp_path / "cell")
        old, rng = campaign.robot.parameters, np.random.default_rng(3)
        free = old.space.free_by_default
        new = {**old} | {
            name: old[name] + OFF[old.space[name].unit] * rng.uniform(-1.0, 1.0) for name in free
        }
        parameters = {
            name: {"nominal": old[name], "value": new[name], "std": 0.01, "free": name in free}
            for name in new
        }
        found = body(parameters, robot_digest=campaign.robot.digest(), **more)
        with campaign.journal() as journal:
            journal.append(Finding("identification", found))
        return campaign, Kinematics.of(campaign.robot.mechanism, new)

    return make


@pytest.mark.parametrize("options", [AFTER, pytest.param(OPTIMAL, marks=pytest.mark.long)])
@pytest.mark.parametrize("robot", ["par4-prototype", "linear-delta"])
def test_both_models_can_take_every_joint_and_see_it(
    identified: Identified, robot: str, options: PlanOptions
) -> None:
    campaign, known = identified(robot)
    plan(campaign, options)
    shots = campaign.checked_plan().shots
    joints, poses = joints_of(shots), poses_of(shots)
    assert campaign.robot.kinematics.inverse(poses).values == pytest.approx(joints, abs=1e-6)
    real = known.forward(joints, near=poses).values_or_raise()
    assert np.abs(real - poses).max() > 1.0
    assert replace(campaign.region, kinematics=known).can_measure(real).all()
    assert known.inverse(real).values == pytest.approx(joints, abs=1e-6)


def test_what_is_predicted_is_of_the_identified_robot_with_its_own_scatter(
    identified: Identified,
) -> None:
    scatter = {"point_mm": 0.2, "point_mm_std": 0.01, "joint": 0.0, "joint_std": 0.0, "says": ""}
    campaign, _ = identified(robot_scatter=scatter)
    found = plan(campaign, AFTER)
    ideal = plan(campaign, replace(AFTER, scatter_mm=1e-6))
    ratio = found.forecast.predicted.largest("mm") / ideal.forecast.predicted.largest("mm")
    tracker_mm = campaign.instrument.across_mm
    assert ratio == pytest.approx(np.hypot(0.2, tracker_mm) / tracker_mm, rel=0.2)
    assert (campaign.folder / "plan-older-1.csv").exists()


def test_without_an_identification_that_passed_nothing_is_planned(identified: Identified) -> None:
    campaign, _ = identified(verdict="fail")
    with pytest.raises(VerdictBad):
        plan(campaign, AFTER)
    campaign.journal_path.unlink()
    with pytest.raises(ShotsMissing):
        plan(campaign, AFTER)
    assert not campaign.plan_path.exists()
