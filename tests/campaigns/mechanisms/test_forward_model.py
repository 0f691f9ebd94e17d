"""The forward model: the wanted assembly or none, never another and never a NaN."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from par4_cases import NOMINAL, ROBOTS, reachable_joints, reachable_poses
from scipy.optimize import root

from campaigns.mechanisms.forward import CHUNK, forward
from campaigns.mechanisms.par4 import NoSolution, closure_mm2, inverse, pose_jacobian

CLOSE = 1e-8
UPSIDE_DOWN = (
    ([131.59, -317.79, -479.51, -0.4], [-86.12, 54.54, 265.75, -1.55]),
    ([-134.45, -195.12, -398.44, 0.42], [142.34, 73.5, 290.29, 1.55]),
    ([316.59, -117.96, -413.13, -0.59], [-182.9, 12.84, 288.99, -1.5]),
)
"""Reachable poses, and close to another assembly of the same joints."""
TORN_APART_DEG = ([90, -90, 90, -90], [0, 0, 180, 180], [90, 90, 90, -45], [90, -45, 90, -45])
TURNED_OVER_DEG = ([-2, -7, 21, -21], [30, -7, 15, 22])
"""Every assembly of these has |θ| > 90°."""


def other_assemblies(joints):
    """The other real assembly of each row that Newton finds from a turned and lifted plate."""
    found = np.full((len(joints), 4), np.nan)
    for row, wanted in enumerate(forward(NOMINAL, joints).require()):
        start = np.add(wanted, [0.0, 0.0, 50.0, np.copysign(1.9, wanted[3])])
        answer = root(lambda pose, q: closure_mm2(NOMINAL, q, pose[None])[0], start, joints[[row]])
        if answer.success and np.abs(answer.x - wanted).max() > 1.0:
            found[row] = answer.x
    return found


@pytest.fixture(scope="module")
def joints_with_another_assembly():
    joints = reachable_joints(NOMINAL, 60, seed=5)
    others = other_assemblies(joints)
    known = np.isfinite(others[:, 0])
    return joints[known], others[known]


@pytest.mark.parametrize("robot", ROBOTS)
def test_thousands_of_reachable_poses_come_back_and_none_is_lost(robot):
    geometry = ROBOTS[robot]
    poses = reachable_poses(geometry, 4000, seed=11)
    joints = inverse(geometry, poses).require()
    found = forward(geometry, joints)
    assert found.found.all()
    assert np.abs(found.values - poses).max() < CLOSE
    assert np.abs(inverse(geometry, found.values).require() - joints).max() < CLOSE


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_hint_some_millimetres_off_changes_nothing(robot):
    geometry = ROBOTS[robot]
    poses = reachable_poses(geometry, 2000, seed=12)
    joints = inverse(geometry, poses).require()
    hint = poses + np.random.default_rng(0).uniform(-1, 1, poses.shape) * [20, 20, 20, 0.1]
    assert np.abs(forward(geometry, joints, hint).require() - poses).max() < CLOSE


def test_the_other_assembly_is_real_higher_and_turned_over(joints_with_another_assembly):
    joints, others = joints_with_another_assembly
    wanted = forward(NOMINAL, joints).require()
    assert len(joints) >= 20
    assert np.abs(closure_mm2(NOMINAL, joints, others)).max() < 1e-3
    assert (np.abs(others[:, 3]) > np.pi / 2).all()
    assert (others[:, 2] > wanted[:, 2]).all()


def test_a_hint_on_the_other_assembly_still_leads_to_the_wanted_one(joints_with_another_assembly):
    joints, others = joints_with_another_assembly
    found = forward(NOMINAL, joints, others)
    assert found.found.all()
    assert np.abs(found.values - forward(NOMINAL, joints).require()).max() < CLOSE


@pytest.mark.parametrize(("pose", "above_the_elbows"), UPSIDE_DOWN)
def test_a_hint_on_an_assembly_above_the_elbows_still_leads_to_the_wanted_one(
    pose, above_the_elbows
):
    """There the forearms point upwards; branch and |θ| alone would let it pass."""
    joints = inverse(NOMINAL, np.array([pose])).require()
    branch = np.linalg.det(pose_jacobian(NOMINAL, joints, np.array([above_the_elbows])))
    assert branch > 0.0
    assert abs(above_the_elbows[3]) < np.pi / 2
    found = forward(NOMINAL, joints, np.array([above_the_elbows])).require()
    assert np.abs(found - pose).max() < CLOSE


@pytest.mark.parametrize("degrees", TORN_APART_DEG + TURNED_OVER_DEG)
def test_joints_without_the_wanted_assembly_say_so(degrees):
    solution = forward(NOMINAL, np.radians([degrees]))
    assert not solution.found[0]
    with pytest.raises(NoSolution):
        solution.require()


@pytest.mark.slow
@settings(deadline=None)
@given(
    st.lists(st.floats(-180.0, 180.0), min_size=4, max_size=4),
    st.one_of(st.none(), st.lists(st.floats(-2000.0, 2000.0), min_size=4, max_size=4)),
)
def test_any_joints_and_any_hint_give_a_closed_mechanism_or_none(degrees, hint):
    joints = np.radians([degrees])
    solution = forward(NOMINAL, joints, None if hint is None else np.array([hint]))
    if solution.found[0]:
        pose = solution.require()
        assert np.abs(closure_mm2(NOMINAL, joints, pose)).max() < 1e-3
        assert abs(pose[0, 3]) < np.pi / 2
    else:
        assert np.isnan(solution.values).all()


@pytest.mark.parametrize("bad", [np.nan, 1e308])
def test_a_meaningless_joint_or_hint_never_gets_through(bad):
    joints = reachable_joints(NOMINAL, 3, seed=1)
    hint = np.full((3, 4), bad)
    assert forward(NOMINAL, joints, hint).found.all()
    joints[1, 2] = np.nan
    solution = forward(NOMINAL, joints, hint)
    assert solution.found.tolist() == [True, False, True]


def test_a_row_s_answer_does_not_depend_on_the_rows_beside_it():
    joints = reachable_joints(NOMINAL, CHUNK + 3, seed=3)
    together = forward(NOMINAL, joints).require()
    for row in (0, 17, CHUNK - 1, CHUNK, CHUNK + 2):
        alone = forward(NOMINAL, joints[[row]]).require()
        assert np.abs(alone - together[row]).max() < 1e-10


def test_no_rows_give_no_rows():
    assert forward(NOMINAL, np.empty((0, 4))).require().shape == (0, 4)
