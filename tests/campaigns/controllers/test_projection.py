"""Projection: plain parameters that come nearest, and what they leave."""

import numpy as np
import pytest
from family_cases import BY_NAME, some_members

from campaigns.controllers.projection import position_errors, project_plain
from campaigns.errors import IdentificationRefused
from campaigns.kinematics.model import Kinematics
from campaigns.kinematics.parameters import Role
from campaigns.robots.robot import find_robot


def slightly_tilted(member):
    """Skews and tilts as workshops leave them."""
    p, columns = member.perturbed.p.copy(), member.space.columns
    first = {"rail_tilt": 1, "axis_tilt": 2, "parallelogram_skew": 0}  # others turn the base frame
    places = np.concatenate([columns[stem][arm:] for stem, arm in first.items() if stem in columns])
    p[places] += np.random.default_rng(2).normal(0.0, 5e-4, len(places))
    return Kinematics(member.mechanism, p)


def rms(controller, robot, poses):
    return np.sqrt(np.mean(position_errors(controller, robot, poses) ** 2))


def test_a_mechanism_without_forearms_has_no_plain_form():
    robot = find_robot("hexapod").robot
    with pytest.raises(IdentificationRefused, match="plain controller of a hexapod") as raised:
        project_plain(robot.kinematics, robot.workspace_centre[None])
    assert "pkmcal correct" in raised.value.remedy


@some_members
def test_no_other_values_leave_less(member):
    """Neither the full ones without their extensions, nor any small change of a value."""
    robot, poses = slightly_tilted(member), member.poses(60)
    extensions = member.space.places(member.space.select(Role.EXTENSION))
    own = robot.p.copy()
    own[extensions] = 0.0
    plain = project_plain(robot, poses)
    least = rms(plain, robot, poses)
    assert not plain.p[extensions].any()
    assert 1e-3 < least < 0.8 * rms(Kinematics(member.mechanism, own), robot, poses)
    for place in member.space.places(member.free):
        for step in (-1e-3, 1e-3):
            p = plain.p.copy()
            p[place] += step
            assert rms(Kinematics(member.mechanism, p), robot, poses) > least


def test_a_robot_that_cannot_take_the_workspace_is_refused():
    member = BY_NAME["delta"]
    p = member.nominal.p.copy()
    p[member.space.places([f"arm{arm}.forearm_mm" for arm in range(3)])] *= 0.3
    with pytest.raises(IdentificationRefused, match="can take 0 of 50 poses"):
        project_plain(Kinematics(member.mechanism, p), member.poses(50))
