"""The forward model: the wanted assembly or none, never another and never a NaN."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from par4_cases import NOMINAL, ROBOTS, reachable_joints, reachable_poses
from scipy.optimize import root

from campaigns.mechanisms.closed_chain import CHUNK
from campaigns.mechanisms.mechanism import NoSolution
from campaigns.mechanisms.par4 import PAR4

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


def misfits(pose, joints):
    return PAR4.closure_mm2(NOMINAL.p, joints, pose[None])[0]


def other_assemblies(joints):
    """The other real assembly of each row that Newton finds from a turned and lifted plate."""
    found = np.full((len(joints), 4), np.nan)
    for row, wanted in enumerate(NOMINAL.forward(joints).values_or_raise()):
        start = np.add(wanted, [0.0, 0.0, 50.0, np.copysign(1.9, wanted[3])])
        answer = root(misfits, start, joints[[row]])
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
    joints = geometry.inverse(poses).values_or_raise()
    found = geometry.forward(joints)
    assert found.found.all()
    assert np.abs(found.values - poses).max() < CLOSE
    assert np.abs(geometry.inverse(found.values).values_or_raise() - joints).max() < CLOSE


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_hint_some_millimetres_off_changes_nothing(robot):
    geometry = ROBOTS[robot]
    poses = reachable_poses(geometry, 2000, seed=12)
    joints = geometry.inverse(poses).values_or_raise()
    hint = poses + np.random.default_rng(0).uniform(-1, 1, poses.shape) * [20, 20, 20, 0.1]
    assert np.abs(geometry.forward(joints, hint).values_or_raise() - poses).max() < CLOSE


def test_the_other_assembly_is_real_higher_and_turned_over(joints_with_another_assembly):
    joints, others = joints_with_another_assembly
    wanted = NOMINAL.forward(joints).values_or_raise()
    assert len(joints) >= 20
    assert np.abs(PAR4.closure_mm2(NOMINAL.p, joints, others)).max() < 1e-3
    assert (np.abs(others[:, 3]) > np.pi / 2).all()
    assert (others[:, 2] > wanted[:, 2]).all()


def test_a_hint_on_the_other_assembly_still_leads_to_the_wanted_one(joints_with_another_assembly):
    joints, others = joints_with_another_assembly
    found = NOMINAL.forward(joints, others)
    assert found.found.all()
    assert np.abs(found.values - NOMINAL.forward(joints).values_or_raise()).max() < CLOSE


@pytest.mark.parametrize(("pose", "above_the_elbows"), UPSIDE_DOWN)
def test_a_hint_on_an_assembly_above_the_elbows_still_leads_to_the_wanted_one(
    pose, above_the_elbows
):
    """There the forearms point upwards; branch and |θ| alone would let it pass."""
    joints = NOMINAL.inverse(np.array([pose])).values_or_raise()
    branch = np.linalg.det(PAR4.pose_jacobian(NOMINAL.p, joints, np.array([above_the_elbows])))
    assert branch > 0.0
    assert abs(above_the_elbows[3]) < np.pi / 2
    found = NOMINAL.forward(joints, np.array([above_the_elbows])).values_or_raise()
    assert np.abs(found - pose).max() < CLOSE


@pytest.mark.parametrize("degrees", TORN_APART_DEG + TURNED_OVER_DEG)
def test_joints_without_the_wanted_assembly_say_so(degrees):
    solution = NOMINAL.forward(np.radians([degrees]))
    assert not solution.found[0]
    with pytest.raises(NoSolution):
        solution.values_or_raise()


@pytest.mark.slow
@given(
    st.lists(st.floats(-180.0, 180.0), min_size=4, max_size=4),
    st.one_of(st.none(), st.lists(st.floats(-2000.0, 2000.0), min_size=4, max_size=4)),
)
def test_any_joints_and_any_hint_give_a_closed_mechanism_or_none(degrees, hint):
    joints = np.radians([degrees])
    solution = NOMINAL.forward(joints, None if hint is None else np.array([hint]))
    if solution.found[0]:
        pose = solution.values_or_raise()
        assert np.abs(PAR4.closure_mm2(NOMINAL.p, joints, pose)).max() < 1e-3
        assert abs(pose[0, 3]) < np.pi / 2
    else:
        assert np.isnan(solution.values).all()


@pytest.mark.parametrize("bad", [np.nan, 1e308])
def test_a_meaningless_joint_or_hint_never_gets_through(bad):
    joints = reachable_joints(NOMINAL, 3, seed=1)
    hint = np.full((3, 4), bad)
    assert NOMINAL.forward(joints, hint).found.all()
    joints[1, 2] = np.nan
    solution = NOMINAL.forward(joints, hint)
    assert solution.found.tolist() == [True, False, True]


def test_a_row_s_answer_does_not_depend_on_the_rows_beside_it():
    joints = reachable_joints(NOMINAL, CHUNK + 3, seed=3)
    together = NOMINAL.forward(joints).values_or_raise()
    for row in (0, 17, CHUNK - 1, CHUNK, CHUNK + 2):
        alone = NOMINAL.forward(joints[[row]]).values_or_raise()
        assert np.abs(alone - together[row]).max() < 1e-10


def test_no_rows_give_no_rows():
    assert NOMINAL.forward(np.empty((0, 4))).values_or_raise().shape == (0, 4)
