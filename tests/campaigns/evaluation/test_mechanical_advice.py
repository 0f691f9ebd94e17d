"""The mechanic's list, for changes that are known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from campaigns.arrays import Array
from campaigns.design.pose_sampling import sample_workspace
from campaigns.estimation.information import Uncertainty
from campaigns.evaluation.diagnostics import Doubt, nests_told
from campaigns.evaluation.mechanical_advice import (
    HIDES,
    LEANS,
    UNTESTED,
    Dimensions,
    mechanical_advice,
)
from campaigns.identification.result import RippleRate
from campaigns.robots.robot import find_robot
from campaigns.robots.schema import Mechanics
from campaigns.workflow.advising import dimensions_of

ROBOT = replace(
    find_robot("par4-prototype").robot,
    mechanics=Mechanics(rod_distance_mm=80.0, rod_thread_pitch_mm=1.0, bolt_distance_mm=100.0),
)
POSES = sample_workspace(ROBOT.kinematics, ROBOT.limits, ROBOT.workspace_centre)[::10]
STD = 0.005


def dimensions(changes: dict[str, float], hidden: float = 0.01) -> Dimensions:
    space = ROBOT.parameters.space
    names = tuple(dict.fromkeys([*space.free_in_full, *changes]))
    units: Array = np.ones(len(names))
    known = Uncertainty.of(names, units, STD**2 * np.eye(len(names)))
    return Dimensions(
        ROBOT,
        dict.fromkeys(names, 0.0) | changes,
        known,
        2.0,
        {"general": dict.fromkeys(names, hidden)},
    )


@pytest.mark.parametrize(
    ("changes", "says", "act"),
    [
        (
            {"arm1.forearm_mm": 0.1, "arm1.parallelogram_skew_deg": np.degrees(0.2 / 80)},
            "forearm 1: left rod 0.20 mm ± 0.01 mm too long",
            "shorten it by 0.20 turns of its thread (1 mm)",
        ),
        (
            {"arm1.forearm_mm": -0.1, "arm1.parallelogram_skew_deg": np.degrees(0.2 / 80)},
            "forearm 1: right rod 0.20 mm ± 0.01 mm too short",
            "lengthen it by 0.20 turns of its thread (1 mm)",
        ),
        (
            {"arm2.joint_offset_deg": -0.5},
            "arm 2's home is 0.500° ± 0.010° high",
            "reset it: readings 0.500° lower",
        ),
        (
            {"arm3.axis_tilt_deg": np.degrees(1e-3)},
            "motor 3's axis leans 1.00 mrad ± 0.17 mrad, its left end up",
            "shim it: left end 0.10 mm over 100 mm lower",
        ),
        (
            {"arm2.backlash_deg": 1.5 / 60},
            "gear 2 has 1.50′ ± 0.60′ of play",
            "replace it, or take up its play",
        ),
        (
            {"arm2.eccentricity_sin_deg": 0.06, "arm2.eccentricity_cos_deg": -0.08},
            "encoder 2 sits eccentric by 360″ ± 36″",
            "re-centre it, then reset its home",
        ),
    ],
)
def test_a_part_that_is_off_is_named_with_what_to_do(changes, says, act):
    hidden = 0.01 if "arm1.forearm_mm" in changes or "arm2.joint_offset_deg" in changes else 0.0
    found = mechanical_advice(dimensions(changes, hidden), POSES)
    assert found.instructions, found.left
    first = found.instructions[0]
    assert (first.says.split(" (seen")[0], first.act) == (says, act)
    assert first.gain_mm > 0.0
    assert first.mean_mm < found.mean_mm
    assert len(found.instructions) == 1
    assert first.change == pytest.approx(changes)


def test_what_may_hide_or_lean_is_left_alone():
    hidden = mechanical_advice(dimensions({"arm1.forearm_mm": 0.2}, hidden=0.3), POSES)
    leaning = mechanical_advice(dimensions({"arm2.joint_offset_deg": 0.045}), POSES)
    assert not hidden.instructions
    assert any("forearm 1" in each for each in hidden.left[HIDES])
    assert not leaning.instructions
    assert leaning.left[LEANS] == ("arm2.joint_offset +0.045°",)


def test_a_model_in_doubt_gives_no_dimensions():
    found = dimensions({})
    assert found.refusal("pass", ()) == ""
    assert "lacks" in found.refusal("pass", (Doubt("lack-of-fit", "it lacks something"),))
    assert "fail" in found.refusal("fail", ())
    assert found.refusal("pass", (nests_told("stand", 0.3, 0.01, (3, 4)),)) == ""
    assert "robot" in found.refusal("pass", (nests_told("robot", 0.3, 0.01, (3, 4)),))
    assert replace(found, hidden={}).refusal("pass", ()) == UNTESTED


def test_repairs_are_worked_out_with_ripples_as_often_as_they_were_found_to_come():
    rate = RippleRate("ripples_per_turn", 31.2, 0.01, 1e-9)
    found = SimpleNamespace(
        covariance=None, parameters={}, coverage_factor_95=2.0, hidden={}, ripples=rate
    )
    assert ROBOT.mechanism.rate == 0.0
    assert dimensions_of(ROBOT, found).robot.kinematics.mechanism.rate == 31.2
