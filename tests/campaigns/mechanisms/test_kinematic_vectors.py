"""The reference model's poses and joints, both ways."""

import numpy as np
import pytest
from par4_cases import CASES, KINEMATICS, NOMINAL, geometry_in
from par4_space import places_of

from campaigns.mechanisms.mechanism import NoSolution
from campaigns.mechanisms.par4 import PAR4

CLOSE_MM = 1e-9
CLOSE_DEG = 1e-9


def poses_of(case):
    rows = [[p["x_mm"], p["y_mm"], p["z_mm"], np.radians(p["theta_deg"])] for p in case["poses"]]
    return np.array(rows)


def joints_of(case):
    return np.radians([pose["joints_deg"] for pose in case["poses"]])


def assert_same_poses(found, expected):
    apart = np.abs(found - expected)
    assert apart[:, :3].max() < CLOSE_MM
    assert np.degrees(apart[:, 3].max()) < CLOSE_DEG


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_inverse_gives_the_reference_joints(case):
    joints = geometry_in(case["geometry"]).inverse(poses_of(case)).values_or_raise()
    assert np.degrees(np.abs(joints - joints_of(case)).max()) < CLOSE_DEG


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_forward_gives_the_reference_poses_without_a_hint(case):
    poses = geometry_in(case["geometry"]).forward(joints_of(case)).values_or_raise()
    assert_same_poses(poses, poses_of(case))


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_forward_gives_the_reference_poses_from_the_commanded_ones(case):
    """The controller commands by the nominal geometry; the robot stands some mm beside that."""
    commanded = NOMINAL.forward(joints_of(case)).values_or_raise()
    poses = geometry_in(case["geometry"]).forward(joints_of(case), commanded).values_or_raise()
    assert_same_poses(poses, poses_of(case))


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_reference_poses_close_the_mechanism(case):
    geometry = geometry_in(case["geometry"])
    too_long_mm2 = PAR4.closure_mm2(geometry.p, joints_of(case), poses_of(case))
    assert np.abs(too_long_mm2 / geometry.p[places_of("forearm_mm")]).max() < CLOSE_MM


@pytest.mark.parametrize("pose", KINEMATICS["unreachable_poses_mm_rad"])
def test_unreachable_poses_say_so(pose):
    solution = NOMINAL.inverse(np.array([pose], dtype=float))
    assert not solution.found[0]
    with pytest.raises(NoSolution, match="row 0 of 1"):
        solution.values_or_raise()


def test_one_unreachable_pose_leaves_the_others_alone():
    case = CASES["nominal"]
    poses = poses_of(case)[:3]
    poses[1] = KINEMATICS["unreachable_poses_mm_rad"][0]
    solution = NOMINAL.inverse(poses)
    assert solution.found.tolist() == [True, False, True]
    assert np.isnan(solution.values[1]).all()
    assert np.abs(solution.values[[0, 2]] - joints_of(case)[[0, 2]]).max() < 1e-11
    with pytest.raises(NoSolution, match="row 1 of 3"):
        solution.values_or_raise()


def test_arms_that_could_reach_give_no_joints_where_others_cannot():
    pose = np.array([[680.0, -50.0, -500.0, 0.0]])
    solution = NOMINAL.inverse(pose)
    assert not solution.found[0]
    assert np.isnan(solution.values).all()
