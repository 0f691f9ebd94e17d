"""Which poses can be taken, and that each reason against one is found and told."""

from dataclasses import replace

import numpy as np
import pytest
from par4_cases import CENTRE, LIMITS, NOMINAL, ROBOTS, reachable_poses
from scipy.optimize import brentq

from campaigns.mechanisms.feasibility import (
    Violation,
    describe_violations,
    feasibility,
    smallest_singular_value,
    swing_rad,
)
from campaigns.mechanisms.par4 import arm_frames, forearms_mm, inverse, pose_jacobian

TURNED = np.array([[100.0, -150.0, -600.0, 0.5]])
"""Joints 13.8…60.9°, forearm 0 swings 31.8° out of its arm's plane."""
OUT_OF_REACH = np.array([[0.0, -50.0, -1300.0, 0.0]])


def told(limits, pose):
    return describe_violations(limits, feasibility(NOMINAL, limits, pose), 0, float(pose[0, 3]))


def reasons(limits, pose):
    return Violation(int(feasibility(NOMINAL, limits, pose).reasons[0]))


def test_a_pose_inside_every_limit_can_be_taken():
    assert reasons(LIMITS, TURNED) is Violation.NONE
    assert told(LIMITS, TURNED) == []


def test_a_pose_out_of_reach_has_that_reason_and_no_measures():
    judged = feasibility(NOMINAL, LIMITS, OUT_OF_REACH)
    assert Violation(int(judged.reasons[0])) is Violation.OUT_OF_REACH
    assert np.isnan([*judged.joints_rad[0], *judged.swing_rad[0]]).all()
    assert np.isnan([judged.singular_value[0], judged.elbow_sine[0]]).all()
    (line,) = told(LIMITS, OUT_OF_REACH)
    assert line.startswith("out of reach")


def test_a_joint_beyond_its_limit_is_named_with_value_and_limit():
    joints_deg = np.degrees(inverse(NOMINAL, TURNED).require()[0])
    largest = int(np.argmax(joints_deg))
    limits = replace(LIMITS, joint_rad=(-np.pi / 4, np.radians(joints_deg[largest] - 1.0)))
    assert reasons(limits, TURNED) is Violation.JOINT_LIMIT
    (line,) = told(limits, TURNED)
    assert line.startswith(f"joint {largest} at {joints_deg[largest]:.3f}° outside [-45°, ")


def test_theta_beyond_its_limit_is_named_with_value_and_limit():
    limits = replace(LIMITS, theta_rad=(-0.1, np.radians(20.0)))
    assert reasons(limits, TURNED) is Violation.THETA_LIMIT
    assert told(limits, TURNED) == ["theta 28.648° outside [-5.72958°, 20°]"]


def test_a_forearm_that_swings_too_far_is_named_with_value_and_limit():
    swing_deg = np.degrees(feasibility(NOMINAL, LIMITS, TURNED).swing_rad[0])
    worst = int(np.argmax(np.abs(swing_deg)))
    limits = replace(LIMITS, forearm_swing_rad=np.radians(np.sort(np.abs(swing_deg))[-2:].mean()))
    assert reasons(limits, TURNED) is Violation.SWING_LIMIT
    (line,) = told(limits, TURNED)
    assert line.startswith(f"forearm {worst} swings {swing_deg[worst]:.2f}° out of its arm's plane")
    assert f"limit {np.degrees(limits.forearm_swing_rad):g}°" in line


@pytest.mark.parametrize("margin", ["singularity_margin", "elbow_margin"])
def test_too_small_a_margin_is_told_with_value_and_limit(margin):
    limits = replace(LIMITS, **{margin: 0.99})
    assert reasons(limits, TURNED) is Violation.SINGULAR
    judged = feasibility(NOMINAL, LIMITS, TURNED)
    (line,) = told(limits, TURNED)
    assert f"margin {judged.singular_value[0]:.3f} (limit {limits.singularity_margin:g})" in line
    assert f"elbow {judged.elbow_sine[0]:.3f} (limit {limits.elbow_margin:g})" in line


def test_every_reason_against_a_pose_is_told():
    limits = replace(LIMITS, joint_rad=(0.0, 0.1), theta_rad=(0.0, 0.1), forearm_swing_rad=0.01)
    lines = told(replace(limits, singularity_margin=1.0), TURNED)
    for word in ("joint 0", "joint 1", "joint 2", "joint 3", "theta", "forearm", "singularity"):
        assert any(word in line for line in lines), word


def test_a_limit_itself_may_be_taken():
    joints = inverse(NOMINAL, TURNED).require()[0]
    limits = replace(
        LIMITS, joint_rad=(joints.min(), joints.max()), theta_rad=(-1.0, float(TURNED[0, 3]))
    )
    assert reasons(limits, TURNED) is Violation.NONE


def test_swing_is_the_angle_between_a_forearm_and_its_arm_s_plane():
    swing = np.radians([0.0, 10.0, -35.0, 60.0])
    outward, axes, _ = arm_frames(NOMINAL)
    in_plane = 0.6 * outward - 0.8 * np.array([0.0, 0.0, 1.0])
    forearms = 700.0 * (np.cos(swing)[:, None] * in_plane + np.sin(swing)[:, None] * axes)
    assert swing_rad(NOMINAL, forearms[None])[0] == pytest.approx(swing, abs=1e-14)


def test_the_margin_vanishes_where_the_assembly_could_turn_over():
    def determinant(theta):
        pose = np.array([[0.0, -50.0, -575.0, theta]])
        return np.linalg.det(pose_jacobian(NOMINAL, inverse(NOMINAL, pose).require(), pose))[0]

    theta = brentq(determinant, 1.5, 1.7, xtol=1e-14)
    singular = np.array([[0.0, -50.0, -575.0, theta]])
    joints = inverse(NOMINAL, singular).require()
    assert smallest_singular_value(NOMINAL, joints, singular)[0] < 1e-9
    wide = replace(LIMITS, theta_rad=(-2.0, 2.0), forearm_swing_rad=1.5)
    assert Violation.SINGULAR in reasons(wide, singular)


def test_an_elbow_stretched_straight_is_refused():
    """Straight down from the motors the legs are stretched just where the reach ends."""
    down = np.linspace(-900.0, -1100.0, 2001)
    poses = np.column_stack([np.zeros_like(down), np.full_like(down, -50.0), down, 0.0 * down])
    limits = replace(LIMITS, joint_rad=(-np.pi, np.pi), singularity_margin=0.0)
    judged = feasibility(NOMINAL, limits, poses)
    deepest = int(np.flatnonzero(inverse(NOMINAL, poses).found)[-1])
    assert judged.elbow_sine[deepest] < 0.05
    assert Violation(int(judged.reasons[deepest])) is Violation.SINGULAR
    assert judged.feasible[0]


@pytest.mark.parametrize("robot", ROBOTS)
def test_what_is_feasible_keeps_every_limit(robot):
    geometry = ROBOTS[robot]
    poses = reachable_poses(geometry, 500, seed=4)
    joints = inverse(geometry, poses).require()
    forearms = forearms_mm(geometry, joints, poses)
    along_axes = np.einsum("nik,ik->ni", forearms, arm_frames(geometry)[1]) / geometry.forearm_mm
    assert (joints >= LIMITS.joint_rad[0]).all()
    assert (joints <= LIMITS.joint_rad[1]).all()
    assert (np.abs(poses[:, 3]) <= np.pi / 4).all()
    assert np.abs(along_axes).max() <= np.sin(np.pi / 4)


def test_the_workspace_s_centre_is_far_from_every_limit():
    judged = feasibility(NOMINAL, LIMITS, CENTRE[None])
    assert judged.feasible[0]
    assert judged.singular_value[0] > 0.4
    assert judged.elbow_sine[0] > 0.5
