"""When enough is known, what need not be measured any more, and what a goal asks of a plan."""

from dataclasses import replace

import numpy as np
import pytest
from fake_cell import CENTRE, NOMINAL, ROBOT
from goal_plans import REQUEST, TRACKER_MM, VIEW
from small_plans import LIMITS, OPTIONS

from campaigns.errors import OptionsInvalid, PlanInvalid
from campaigns.measuring import stopping_rule
from campaigns.measuring.run_state import PositionUncertainty
from campaigns.measuring.uncertainty_monitor import UncertaintyMonitor
from campaigns.planning.paths import RobotModel
from campaigns.planning.plans import make_plan

KNOWN = PositionUncertainty(84, "arm2.forearm_mm", 0.21, 0.0198, 0.003)
SHOTS = 80
PLAN = make_plan(
    ROBOT, VIEW, replace(REQUEST, identification_shots=SHOTS), np.random.default_rng(1)
)


def monitor(shots=PLAN) -> UncertaintyMonitor:
    return UncertaintyMonitor(shots, RobotModel(NOMINAL, LIMITS, CENTRE), OPTIONS)


def test_a_goal_within_reach_says_how_many_shots_will_do() -> None:
    whole = monitor().predicted(TRACKER_MM)
    goal_mm = 2.0 * whole.position_std_mm
    told, shots = stopping_rule.predicted_stop(goal_mm, monitor(), TRACKER_MM)
    assert told == whole
    enough, fewer = (monitor().predicted(TRACKER_MM, n) for n in (shots, shots - 2))
    assert enough.position_std_mm <= goal_mm < fewer.position_std_mm


def test_a_goal_out_of_reach_is_refused_with_what_the_plan_will_give() -> None:
    whole = monitor().predicted(TRACKER_MM)
    with pytest.raises(PlanInvalid) as caught:
        stopping_rule.predicted_stop(0.001, monitor(), TRACKER_MM)
    assert caught.value.problem == (
        f"goal 0.001 mm: the whole plan will give {whole.position_std_mm:.3g} mm"
    )
    assert "pkmcal plan --until 0.001" in caught.value.remedy


@pytest.mark.parametrize("text", ["0.02", " 2e-2mm ", "σ=0.02", " Std = 0.02 mm"])
def test_a_goal_is_a_standard_deviation_in_mm(text: str) -> None:
    assert stopping_rule.read_goal(text) == 0.02


@pytest.mark.parametrize("text", ["", "tau=0.02", "0", "nan", "11", "0,02", "0.02 m"])
def test_what_is_no_goal_is_refused_with_the_limit_and_an_example(text: str) -> None:
    with pytest.raises(OptionsInvalid, match="must be above 0 and at most 10 mm") as caught:
        stopping_rule.read_goal(text)
    assert "0.02" in caught.value.remedy
