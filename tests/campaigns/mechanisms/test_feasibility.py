"""Which poses can be taken, and that each reason against one is found and told."""

from dataclasses import replace

import numpy as np
import pytest
from par4_cases import CENTRE, LIMITS, NOMINAL, ROBOTS, reachable_poses
from par4_space import TILTS, places_of
from scipy.optimize import brentq

from campaigns.mechanisms.arms import crank_frames
from campaigns.mechanisms.mechanism import Violation
from campaigns.mechanisms.par4 import PAR4

TURNED = np.array([[100.0, -150.0, -600.0, 0.5]])
"""Joints 13.8…60.9°, forearm 0 swings 31.8° out of its arm's plane."""
OUT_OF_REACH = np.array([[0.0, -50.0, -1300.0, 0.0]])


def told(limits, pose):
    return NOMINAL.feasibility(limits, pose).describe(0)


def violations(limits, pose):
    return Violation(int(NOMINAL.feasibility(limits, pose).violations[0]))


def turning(low_rad, high_rad):
    return (None, None, None, (low_rad, high_rad))


def frames_of(geometry):
    """Outward, along the motor's axis and down at 90°, (3, 4, 3)."""
    return crank_frames(geometry.p[places_of("azimuth_deg")], geometry.p[TILTS])


def test_a_pose_inside_every_limit_can_be_taken():
    assert violations(LIMITS, TURNED) is Violation.NONE
    assert told(LIMITS, TURNED) == []


def test_a_pose_out_of_reach_has_that_reason_and_no_measures():
    judged = NOMINAL.feasibility(LIMITS, OUT_OF_REACH)
    assert Violation(int(judged.violations[0])) is Violation.OUT_OF_REACH
    assert np.isnan([*judged.joints[0], *judged.swing_rad[0]]).all()
    assert np.isnan([judged.singular_value[0], judged.elbow[0]]).all()
    (line,) = told(LIMITS, OUT_OF_REACH)
    assert line.startswith("out of reach")


def test_a_joint_beyond_its_limit_is_named_with_value_and_limit():
    joints_deg = np.degrees(NOMINAL.inverse(TURNED).values_or_raise()[0])
    largest = int(np.argmax(joints_deg))
    limits = replace(LIMITS, joint=(-np.pi / 4, np.radians(joints_deg[largest] - 1.0)))
    assert violations(limits, TURNED) is Violation.JOINT_LIMIT
    (line,) = told(limits, TURNED)
    assert line.startswith(f"joint {largest} at {joints_deg[largest]:.3f}° outside [-45°, ")


def test_theta_beyond_its_limit_is_named_with_value_and_limit():
    limits = replace(LIMITS, task=turning(-0.1, np.radians(20.0)))
    assert violations(limits, TURNED) is Violation.TASK_LIMIT
    assert told(limits, TURNED) == ["theta 28.648° outside [-5.72958°, 20°]"]


def test_a_forearm_that_swings_too_far_is_named_with_value_and_limit():
    swing_deg = np.degrees(NOMINAL.feasibility(LIMITS, TURNED).swing_rad[0])
    worst = int(np.argmax(np.abs(swing_deg)))
    limits = replace(LIMITS, forearm_swing_rad=np.radians(np.sort(np.abs(swing_deg))[-2:].mean()))
    assert violations(limits, TURNED) is Violation.SWING_LIMIT
    (line,) = told(limits, TURNED)
    assert line.startswith(f"forearm {worst} swings {swing_deg[worst]:.2f}° out of its arm's plane")
    assert f"limit {np.degrees(limits.forearm_swing_rad):g}°" in line


@pytest.mark.parametrize("margin", ["singularity_margin", "elbow_margin"])
def test_too_small_a_margin_is_told_with_value_and_limit(margin):
    limits = replace(LIMITS, **{margin: 0.99})
    assert violations(limits, TURNED) is Violation.SINGULAR
    judged = NOMINAL.feasibility(LIMITS, TURNED)
    (line,) = told(limits, TURNED)
    assert f"margin {judged.singular_value[0]:.3f} (limit {limits.singularity_margin:g})" in line
    assert f"elbow {judged.elbow[0]:.3f} (limit {limits.elbow_margin:g})" in line


def test_every_reason_against_a_pose_is_told():
    limits = replace(LIMITS, joint=(0.0, 0.1), task=turning(0.0, 0.1), forearm_swing_rad=0.01)
    lines = told(replace(limits, singularity_margin=1.0), TURNED)
    for word in ("joint 0", "joint 1", "joint 2", "joint 3", "theta", "forearm", "singularity"):
        assert any(word in line for line in lines), word


def test_a_limit_itself_may_be_taken():
    joints = NOMINAL.inverse(TURNED).values_or_raise()[0]
    limits = replace(
        LIMITS, joint=(joints.min(), joints.max()), task=turning(-1.0, float(TURNED[0, 3]))
    )
    assert violations(limits, TURNED) is Violation.NONE


def test_swing_is_the_angle_between_a_forearm_and_its_arm_s_plane():
    swing = np.radians([0.0, 10.0, -35.0, 60.0])
    outward, axes, _ = frames_of(NOMINAL)
    in_plane = 0.6 * outward - 0.8 * np.array([0.0, 0.0, 1.0])
    forearms = 700.0 * (np.cos(swing)[:, None] * in_plane + np.sin(swing)[:, None] * axes)
    arms = PAR4.posture(NOMINAL.p, np.zeros((1, 4))).arms
    assert arms.swing_rad(forearms.T[..., None])[0] == pytest.approx(swing, abs=1e-14)


def test_the_margin_vanishes_where_the_assembly_could_turn_over():
    def determinant(theta):
        pose = np.array([[0.0, -50.0, -575.0, theta]])
        joints = NOMINAL.inverse(pose).values_or_raise()
        return np.linalg.det(PAR4.pose_jacobian(NOMINAL.p, joints, pose))[0]

    theta = brentq(determinant, 1.5, 1.7, xtol=1e-14)
    singular = np.array([[0.0, -50.0, -575.0, theta]])
    joints = NOMINAL.inverse(singular).values_or_raise()
    assert PAR4.smallest_singular_value(NOMINAL.p, joints, singular)[0] < 1e-9
    wide = replace(LIMITS, task=turning(-2.0, 2.0), forearm_swing_rad=1.5)
    assert Violation.SINGULAR in violations(wide, singular)


def test_an_elbow_stretched_straight_is_refused():
    """Straight down from the motors the legs are stretched just where the reach ends."""
    down = np.linspace(-900.0, -1100.0, 2001)
    poses = np.column_stack([np.zeros_like(down), np.full_like(down, -50.0), down, 0.0 * down])
    limits = replace(LIMITS, joint=(-np.pi, np.pi), singularity_margin=0.0)
    judged = NOMINAL.feasibility(limits, poses)
    deepest = int(np.flatnonzero(NOMINAL.inverse(poses).found)[-1])
    assert judged.elbow[deepest] < 0.05
    assert Violation(int(judged.violations[deepest])) is Violation.SINGULAR
    assert judged.feasible[0]


@pytest.mark.parametrize("robot", ROBOTS)
def test_what_is_feasible_keeps_every_limit(robot):
    geometry = ROBOTS[robot]
    poses = reachable_poses(geometry, 500, seed=4)
    joints = geometry.inverse(poses).values_or_raise()
    forearms = PAR4.posture(geometry.p, joints).forearms_mm(poses)
    lengths = geometry.p[places_of("forearm_mm")]
    along_axes = np.einsum("kin,ik->ni", forearms, frames_of(geometry)[1]) / lengths
    assert (joints >= LIMITS.joint[0]).all()
    assert (joints <= LIMITS.joint[1]).all()
    assert (np.abs(poses[:, 3]) <= np.pi / 4).all()
    assert np.abs(along_axes).max() <= np.sin(np.pi / 4)


def test_the_workspace_s_centre_is_far_from_every_limit():
    judged = NOMINAL.feasibility(LIMITS, CENTRE[None])
    assert judged.feasible[0]
    assert judged.singular_value[0] > 0.4
    assert judged.elbow[0] > 0.5
