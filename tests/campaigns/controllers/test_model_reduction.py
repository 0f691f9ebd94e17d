"""Projection: plain parameters that come nearest, and what they leave."""

import numpy as np
import pytest
from family_cases import BY_NAME, some_members

from campaigns.controllers.model_reduction import ResidualError, Workspace, project_plain
from campaigns.errors import IdentificationRefused
from campaigns.fit.rigid_transforms import fit_transform
from campaigns.kinematics.mechanism import Kinematics
from campaigns.kinematics.parameters import Role


def left_by(kinematics, workspace):
    """What other parameters leave of position over a workspace, the frame best fitted."""
    points = kinematics.forward(workspace.joints, workspace.poses).values_or_raise()[:, :3]
    wanted = workspace.poses[:, :3]
    return ResidualError.of(fit_transform(points, wanted).apply(points) - wanted)


def workspace_of(member, robot, count=300):
    return Workspace.of(robot, member.poses(count))


def slightly_tilted(member):
    """Skews and tilts as workshops leave them."""
    p, columns = member.perturbed.p.copy(), member.space.columns
    first = {"rail_tilt": 1, "axis_tilt": 2, "parallelogram_skew": 0}  # others turn the base frame
    places = np.concatenate([columns[stem][arm:] for stem, arm in first.items() if stem in columns])
    p[places] += np.random.default_rng(2).normal(0.0, 5e-4, len(places))
    return Kinematics(member.mechanism, p)


@some_members
def test_plain_parameters_leave_nothing_of_a_robot_without_tilts(member):
    workspace = workspace_of(member, member.perturbed)
    assert project_plain(member.perturbed, workspace).error.max_mm < 1e-9
    assert left_by(member.nominal, workspace).mean_mm > 0.3


@some_members
def test_plain_parameters_leave_less_than_the_full_ones_without_their_extensions(member):
    robot = slightly_tilted(member)
    workspace = workspace_of(member, robot)
    own, extensions = robot.p.copy(), member.space.places(member.space.select(Role.EXTENSION))
    own[extensions] = 0.0
    cut = left_by(Kinematics(member.mechanism, own), workspace)
    found = project_plain(robot, workspace)
    assert 1e-3 < found.error.rms_mm < 0.8 * cut.rms_mm
    assert not found.kinematics.p[extensions].any()


@some_members
def test_no_other_values_leave_less(member):
    """Every small change of a value, the frame fitted anew, makes the error larger."""
    robot = slightly_tilted(member)
    workspace = workspace_of(member, robot, 150)
    found = project_plain(robot, workspace)
    for place in member.space.places(member.free):
        for step in (-1e-4, 1e-4):
            p = found.kinematics.p.copy()
            p[place] += step
            other = left_by(Kinematics(member.mechanism, p), workspace)
            assert other.rms_mm > found.error.rms_mm


def test_a_controller_that_cannot_take_the_joints_is_refused():
    member = BY_NAME["delta"]
    workspace = workspace_of(member, member.nominal, 50)
    p = member.nominal.p.copy()
    p[member.space.places([f"arm{arm}.forearm_mm" for arm in range(3)])] *= 0.3
    with pytest.raises(IdentificationRefused, match="cannot be assembled all over the workspace"):
        project_plain(Kinematics(member.mechanism, p), workspace)
