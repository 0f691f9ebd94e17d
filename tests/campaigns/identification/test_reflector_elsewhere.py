"""Reflectors elsewhere on the plate than the robot file states, on the simulator's rods."""

import numpy as np
import pytest
from rod_campaigns import Errors, rod_campaign

from campaigns.api import sample_workspace
from campaigns.identification.findings import BEYOND_TOLERANCE
from campaigns.identification.identify import identify
from campaigns.identification.options import IdentificationOptions
from campaigns.robots.robot import find_robot, parse_robot

RODS = Errors(rods_mm=0.2)
ELSEWHERE_MM = [25.0, -20.0, -40.0]


def identified(campaign):
    options = IdentificationOptions(
        workspace=sample_workspace(campaign.robot, 30), tolerances=campaign.robot.tolerances
    )
    return identify(campaign.robot.kinematics, campaign.shots, options)


def stating(name, line):
    text = find_robot(name).document.text.replace("# reflector_mm: [x, y, z]", line)
    return parse_robot(text, "stated.yaml").robot


@pytest.mark.parametrize("name", ["par4-prototype", "linear-delta", "i4r"])
def test_positions_are_right_wherever_the_reflector_is(name):
    campaign = rod_campaign(name, RODS, seed=3, reflector_mm=ELSEWHERE_MM)
    result = identified(campaign)
    assert result.judgement.verdict == "pass", result.judgement.reasons
    real_mm = campaign.position_error_mm(result)
    assert real_mm < 1.5 * result.uncertainty.position_std_mm.rms
    assert real_mm < 0.03
    for axis, true_mm in zip("xyz", ELSEWHERE_MM, strict=True):
        fitted = result.value.parameters[f"reflector_{axis}_mm"]
        assert abs(fitted.delta - true_mm) < 3.0 * fitted.std
        assert fitted.std < 25.0


def test_stated_place_that_is_far_off_is_a_finding():
    robot = stating("par4-prototype", "reflector_mm: [0.0, 0.0, 0.0]")
    campaign = rod_campaign(robot, RODS, seed=3, reflector_mm=[60.0, 0.0, -60.0])
    result = identified(campaign)
    found = [f for f in result.judgement.findings if f.name == BEYOND_TOLERANCE]
    places = [f for f in found if str(f.numbers["parameter"]).startswith("reflector_")]
    assert len(places) == 1, found
    assert places[0].decision == "fail"
    assert places[0].says.startswith("the reflector's place in ")
    assert "usual are 3 mm" in places[0].says
    assert "correct reflector_mm in robot.yaml" in places[0].says


def test_stated_place_that_is_right_costs_no_uncertainty():
    silent, stated = (
        identified(rod_campaign(robot, RODS, seed=4, reflector_mm=ELSEWHERE_MM))
        for robot in ("par4-prototype", stating("par4-prototype", f"reflector_mm: {ELSEWHERE_MM}"))
    )
    assert stated.judgement.verdict == "pass", stated.judgement.reasons
    stds_mm = [result.value.parameters["reflector_z_mm"].std for result in (silent, stated)]
    assert stds_mm[1] < min(3.0, stds_mm[0])
    assert stated.uncertainty.position_std_mm.rms < 1.02 * silent.uncertainty.position_std_mm.rms
    assert np.isfinite(stds_mm).all()
