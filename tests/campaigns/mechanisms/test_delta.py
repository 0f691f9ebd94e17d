"""The rotary Delta against the reference model, closed forms and derivatives by differences."""

from dataclasses import replace

import numpy as np
import pytest
from delta_cases import (
    CASES,
    CENTRE,
    LIMITS,
    NOMINAL,
    PERTURBED,
    REFERENCE,
    ROBOTS,
    SPACE,
    answers,
    delta_in,
    delta_of,
    flat_in,
    joints_of,
    poses_of,
    reachable_joints,
    reachable_poses,
)
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from par4_cases import assert_exact_in_every_decade, central_differences

from campaigns.estimation.datum import datum_parameters
from campaigns.mechanisms.delta import DELTA
from campaigns.mechanisms.mechanism import Kinematics, NoSolution, Violation
from campaigns.robots.robot import find_robot

CLOSE_MM = 1e-10
CLOSE_DEG = 1e-10
OUT_OF_REACH = np.array([[0.0, 0.0, -1200.0]])
ASIDE = np.array([[-60.0, -300.0, -720.0]])
"""Joints -11.1…46.8°, forearm 0 swings 22.0° out of its arm's plane."""
TORN_APART_DEG = ([50, -80, -170], [40, -40, 180], [-150, -90, 30])
TURNED_OVER_DEG = ([130, -170, 80], [-120, 130, 10], [-30, -110, -150])
"""The only assemblies of these are above the elbows or on the other branch."""
LEVER_MM = 100.0
IS_ANGLE = SPACE.is_angle[: len(SPACE.geometry)]
BY_LENGTH = np.where(IS_ANGLE, 1.0, LEVER_MM)
"""A step of 0.01 is 0.01 rad or 1 mm."""
WELL_INSIDE = replace(LIMITS.drawn_in(joint=0.1, swing_rad=0.1), singularity_margin=0.3)
"""Leaves room for errors of ten millimetres or of a tenth of a radian."""
ALL_ROBOTS = pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
ALL_CASES = pytest.mark.parametrize("case", CASES.values(), ids=CASES)
any_seed = st.integers(0, 2**32 - 1)
angles_deg = st.floats(-180.0, 180.0)


def elbows_of(robot, joints):
    """A_i = P_i + l_i (cos q u_i - sin q z0), (N, 3, 3), of a robot without tilted axes."""
    arms = robot.p[: len(SPACE.names)].reshape(3, 7)
    angle, azimuth = joints + arms[:, 4], arms[:, 3]
    outward = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(3)], axis=-1)
    up = np.array([0.0, 0.0, 1.0])
    crank = np.cos(angle)[..., None] * outward - np.sin(angle)[..., None] * up
    return arms[:, :3] + arms[:, 5, None] * crank


def where_spheres_meet(elbows_mm, forearm_mm):
    """Both points (N, 2, 3) at given distances from three others (N, 3, 3); NaN where none is."""
    first, second, third = elbows_mm.swapaxes(0, 1)
    apart = np.linalg.norm(second - first, axis=1, keepdims=True)
    along = (second - first) / apart
    part = np.sum(along * (third - first), axis=1, keepdims=True)
    across = third - first - part * along
    height = np.linalg.norm(across, axis=1, keepdims=True)
    across = across / height
    square = forearm_mm**2
    x = (square[0] - square[1] + apart**2) / (2.0 * apart)
    y = (square[0] - square[2] + part**2 + height**2) / (2.0 * height) - part / height * x
    square_of_z = square[0] - x**2 - y**2
    z = np.sqrt(np.where(square_of_z >= 0.0, square_of_z, np.nan))
    between, normal = first + x * along + y * across, np.cross(along, across)
    return np.stack([between - z * normal, between + z * normal], axis=1)


def assemblies(robot, joints):
    """Both assemblies of joints, (N, 2, 3), and which of them is the wanted one, (N, 2).

    The wanted one hangs below the middle of its elbows and is on the same branch as at home.
    """
    elbows = elbows_of(robot, joints)
    both = where_spheres_meet(elbows, robot.p[[6, 13, 20]])
    forearms = both[:, :, None] - elbows[:, None]
    branch = np.sign(np.linalg.det(np.nan_to_num(forearms)))
    home = np.array([REFERENCE["home_mm_deg"]])
    at_home = elbows_of(NOMINAL, NOMINAL.inverse(home).values_or_raise())
    same = branch == np.sign(np.linalg.det(home[:, None] - at_home))
    below = both[..., 2] < elbows[..., 2].mean(axis=1)[:, None]
    return both, same & below


def violations(limits, pose):
    return Violation(int(NOMINAL.feasibility(limits, pose).violations[0]))


def told(limits, pose):
    return NOMINAL.feasibility(limits, pose).describe(0)


class TestParameters:
    def test_are_seven_for_each_of_three_arms_and_none_for_the_platform(self):
        assert len(SPACE.names) == 21
        assert set(SPACE.names) == set(flat_in(REFERENCE["robot"]["geometry"]))
        assert [axis.column for axis in DELTA.joints] == ["q0_deg", "q1_deg", "q2_deg"]
        assert [axis.column for axis in DELTA.task] == ["x_mm", "y_mm", "z_mm"]

    def test_that_are_free_by_default_are_the_reference_s(self):
        assert list(SPACE.free_by_default) == answers("exact")["free"]

    def test_and_limits_of_the_shipped_robot_are_the_reference_s(self):
        robot = find_robot("delta").robot
        assert robot.mechanism.name == DELTA.name
        assert dict(robot.parameters) == flat_in(REFERENCE["robot"]["geometry"])
        assert robot.limits == LIMITS
        assert np.degrees(robot.limits.joint).tolist() == pytest.approx(
            REFERENCE["robot"]["limits"]["joint_deg"]
        )
        assert robot.workspace_centre.tolist() == REFERENCE["home_mm_deg"]

    def test_that_are_free_can_be_told_by_points_and_a_frame_and_two_azimuths_too(self):
        """Of 21 the frame takes four: a place, and the turn about the vertical."""
        poses = reachable_poses(NOMINAL, 200, seed=3)
        free = SPACE.places(SPACE.free_by_default)
        by_all = scaled_singular_values(poses, np.arange(len(SPACE.names)))
        by_free = scaled_singular_values(poses, free)
        assert np.count_nonzero(by_all > 1e-9 * by_all[0]) == 17 + 6
        assert by_free[0] / by_free[-1] < 120.0

    def test_that_are_free_need_seven_shots_and_seven_are_enough(self):
        assert DELTA.minimum_shots(SPACE.free_by_default) == 7
        poses = reachable_poses(NOMINAL, 7, seed=4)
        known = scaled_singular_values(poses, SPACE.places(SPACE.free_by_default))
        assert len(known) == 21
        assert known[-1] > 1e-6 * known[0]

    def test_of_the_same_robot_in_another_frame_move_it_alike(self):
        """Base turned about its vertical and shifted: the same distances, the nominal's frame."""
        cos, sin = np.cos(0.3), np.sin(0.3)
        turned_from_base = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        elsewhere = PERTURBED.p.copy()
        arms = elsewhere[:21].reshape(3, 7)
        arms[:, :3] = arms[:, :3] @ turned_from_base.T + [5.0, -3.0, 2.0]
        arms[:, 3] += 0.3
        seen = datum_parameters(NOMINAL, Kinematics(DELTA, elsewhere)).p
        assert seen == pytest.approx(PERTURBED.p, abs=1e-10)
        joints = reachable_joints(PERTURBED, 20, seed=5)
        moved = delta_of(elsewhere).forward(joints).values_or_raise()
        expected = PERTURBED.forward(joints).values_or_raise() @ turned_from_base.T
        assert np.abs(moved - expected - [5.0, -3.0, 2.0]).max() < CLOSE_MM


def scaled_singular_values(poses, places):
    """Of what points tell of parameters and of a free frame, columns scaled."""
    jacobian = NOMINAL.jacobian(NOMINAL.inverse(poses).values_or_raise(), poses)[:, :, places]
    turns = np.stack([np.cross(axis, poses) for axis in np.eye(3)], axis=-1)
    shifts = np.tile(np.eye(3), (len(poses), 1, 1))
    rows = np.concatenate([jacobian, turns, shifts], axis=-1).reshape(3 * len(poses), -1)
    return np.linalg.svd(rows / np.linalg.norm(rows, axis=0), compute_uv=False)


class TestReferenceVectors:
    @ALL_CASES
    def test_inverse_gives_the_joints(self, case):
        joints = delta_in(case["geometry"]).inverse(poses_of(case)).values_or_raise()
        assert np.degrees(np.abs(joints - joints_of(case)).max()) < CLOSE_DEG

    @ALL_CASES
    def test_forward_gives_the_poses_without_a_hint(self, case):
        poses = delta_in(case["geometry"]).forward(joints_of(case)).values_or_raise()
        assert np.abs(poses - poses_of(case)).max() < CLOSE_MM

    @ALL_CASES
    def test_forward_gives_the_poses_from_the_commanded_ones(self, case):
        """The controller commands by the nominal geometry; the robot stands some mm beside that."""
        commanded = NOMINAL.forward(joints_of(case)).values_or_raise()
        poses = delta_in(case["geometry"]).forward(joints_of(case), commanded).values_or_raise()
        assert np.abs(poses - poses_of(case)).max() < CLOSE_MM

    @ALL_CASES
    def test_poses_close_the_mechanism(self, case):
        robot = delta_in(case["geometry"])
        too_long_mm2 = DELTA.closure_mm2(robot.p, joints_of(case), poses_of(case))
        assert np.abs(too_long_mm2 / (2.0 * robot.p[[6, 13, 20]])).max() < CLOSE_MM

    @ALL_CASES
    def test_poses_are_inside_every_limit(self, case):
        judged = delta_in(case["geometry"]).feasibility(LIMITS, poses_of(case))
        assert judged.feasible.all()
        assert np.abs(np.degrees(judged.joints) - case["joints"]).max() < CLOSE_DEG


class TestForwardAndInverse:
    @ALL_ROBOTS
    def test_undo_each_other_all_over_the_workspace(self, robot):
        poses = reachable_poses(robot, 4000, seed=11)
        joints = robot.inverse(poses).values_or_raise()
        found = robot.forward(joints)
        assert found.found.all()
        assert np.abs(found.values - poses).max() < CLOSE_MM
        again = robot.inverse(found.values).values_or_raise()
        assert np.degrees(np.abs(again - joints).max()) < CLOSE_DEG

    @ALL_ROBOTS
    def test_undo_each_other_from_a_hint_some_millimetres_off(self, robot):
        poses = reachable_poses(robot, 1000, seed=12)
        joints = robot.inverse(poses).values_or_raise()
        hint = poses + np.random.default_rng(0).uniform(-20.0, 20.0, poses.shape)
        assert np.abs(robot.forward(joints, hint).values_or_raise() - poses).max() < CLOSE_MM

    @pytest.mark.parametrize("robot", [NOMINAL, PERTURBED], ids=["nominal", "perturbed"])
    def test_newton_agrees_with_three_spheres_for_any_joints_within_limits(self, robot):
        joints = np.random.default_rng(7).uniform(*LIMITS.joint, (5000, 3))
        both, wanted = assemblies(robot, joints)
        assert (wanted.sum(axis=1) == 1).all()
        found = robot.forward(joints).values_or_raise()
        assert np.abs(found - both[wanted]).max() < CLOSE_MM

    @settings(deadline=None, max_examples=40)
    @given(
        st.lists(angles_deg, min_size=3, max_size=3),
        st.none() | st.lists(st.floats(-2000.0, 2000.0), min_size=3, max_size=3),
    )
    def test_any_joints_and_any_hint_give_the_wanted_assembly_or_none(self, degrees, hint):
        joints = np.radians([degrees])
        solution = NOMINAL.forward(joints, None if hint is None else np.array([hint]))
        if not solution.found[0]:
            assert np.isnan(solution.values).all()
            return
        both, wanted = assemblies(NOMINAL, joints)
        assert wanted.any()
        # the spheres' own closed form loses half of the digits where they only just meet
        assume(np.linalg.norm(both[0, 0] - both[0, 1]) > 10.0)
        assert np.abs(solution.values - both[wanted]).max() < 1e-6

    def test_a_hint_on_the_other_assembly_still_leads_to_the_wanted_one(self):
        joints = reachable_joints(NOMINAL, 300, seed=5)
        both, wanted = assemblies(NOMINAL, joints)
        others = both[~wanted]
        assert np.abs(DELTA.closure_mm2(NOMINAL.p, joints, others)).max() < 1e-6
        found = NOMINAL.forward(joints, others).values_or_raise()
        assert np.abs(found - both[wanted]).max() < CLOSE_MM
        assert (found[:, 2] < others[:, 2]).all()

    def test_elbows_stay_outward(self):
        """Of the two crank angles that reach a pose the one that moves the elbow out is taken."""
        joints = reachable_joints(NOMINAL, 300, seed=6)
        poses = NOMINAL.forward(joints).values_or_raise()
        arms = NOMINAL.p[:21].reshape(3, 7)
        outward = np.stack([np.cos(arms[:, 3]), np.sin(arms[:, 3]), np.zeros(3)], axis=-1)
        to_pose, elbow = poses[:, None] - arms[:, :3], elbows_of(NOMINAL, joints) - arms[:, :3]
        outside_of_the_line = np.sum(elbow * outward, axis=-1) * -to_pose[..., 2] + elbow[
            ..., 2
        ] * np.sum(to_pose * outward, axis=-1)
        assert (outside_of_the_line > 0.0).all()

    @pytest.mark.parametrize("degrees", TORN_APART_DEG + TURNED_OVER_DEG)
    def test_joints_without_the_wanted_assembly_say_so(self, degrees):
        solution = NOMINAL.forward(np.radians([degrees]))
        assert not solution.found[0]
        with pytest.raises(NoSolution, match="row 0 of 1"):
            solution.values_or_raise()

    def test_a_robot_whose_forearms_are_too_short_for_level_arms_works_with_lowered_ones(self):
        """At joints of 0 it cannot be assembled: its elbows are 455 mm out, its forearms 420."""
        p = NOMINAL.p.copy()
        p[[6, 13, 20]] = 420.0
        robot = delta_of(p)
        poses = np.array([[0.0, 0.0, -420.0], [30.0, -40.0, -450.0]])
        joints = robot.inverse(poses).values_or_raise()
        assert robot.feasibility(LIMITS, poses).feasible.all()
        assert np.abs(robot.forward(joints).values_or_raise() - poses).max() < CLOSE_MM
        assert not robot.forward(np.zeros((1, 3))).found[0]

    def test_one_unreachable_pose_leaves_the_others_alone(self):
        case = CASES["nominal"]
        poses = poses_of(case)[:3]
        poses[1] = OUT_OF_REACH
        solution = NOMINAL.inverse(poses)
        assert solution.found.tolist() == [True, False, True]
        assert np.isnan(solution.values[1]).all()
        assert np.abs(solution.values[[0, 2]] - joints_of(case)[[0, 2]]).max() < 1e-11
        with pytest.raises(NoSolution, match="row 1 of 3"):
            solution.values_or_raise()

    @pytest.mark.parametrize("bad", [np.nan, 1e308])
    def test_a_meaningless_joint_or_hint_never_gets_through(self, bad):
        joints = reachable_joints(NOMINAL, 3, seed=1)
        hint = np.full((3, 3), bad)
        assert NOMINAL.forward(joints, hint).found.all()
        joints[1, 2] = np.nan
        assert NOMINAL.forward(joints, hint).found.tolist() == [True, False, True]

    def test_no_rows_give_no_rows(self):
        assert NOMINAL.forward(np.empty((0, 3))).values_or_raise().shape == (0, 3)


class TestJacobians:
    @ALL_ROBOTS
    @pytest.mark.parametrize("row", range(3))
    def test_of_the_closures_by_the_pose(self, robot, row):
        """By complex step: exact but for rounding."""
        poses = reachable_poses(robot, 3, seed=21)[[row]]
        joints = robot.inverse(poses).values_or_raise()
        (exact,) = DELTA.pose_jacobian(robot.p, joints, poses)
        for place, unit in enumerate(np.eye(3)):
            aside = DELTA.closure_mm2(robot.p, joints, poses + 1e-20j * unit)
            assert exact[:, place] == pytest.approx(aside[0].imag / 1e-20, rel=1e-12, abs=1e-9)

    @ALL_ROBOTS
    @pytest.mark.parametrize("row", range(3))
    def test_of_the_closures_by_each_arm_s_own_parameters_alone(self, robot, row):
        poses = reachable_poses(robot, 3, seed=22)[[row]]
        joints = robot.inverse(poses).values_or_raise()
        (own,) = DELTA.closure_parameter_jacobian(robot.p, joints, poses)
        expected = np.zeros((3, len(SPACE.geometry)))
        for arm in range(3):
            expected[arm, 7 * arm : 7 * arm + 7] = own[arm, :7]
            expected[arm, 21 + arm] = own[arm, 7]
        measured = central_differences(
            lambda p: DELTA.closure_mm2(p, joints, poses)[0], robot.p, 1e-4 * BY_LENGTH
        )
        apart = np.abs(expected - measured) * BY_LENGTH
        assert apart.max() < 1e-7 * np.abs(expected * BY_LENGTH).max()

    def test_of_the_pose_by_every_parameter_in_every_decade(self):
        robot = ROBOTS["perturbed + axis tilts"]
        poses = reachable_poses(robot, 12, seed=23, limits=WELL_INSIDE)
        joints = robot.inverse(poses).values_or_raise()
        exact = robot.jacobian(joints, poses) * BY_LENGTH

        def moved(vector):
            return delta_of(vector).forward(joints, poses).values_or_raise()

        assert_exact_in_every_decade(exact, moved, robot.p, BY_LENGTH, BY_LENGTH)

    @settings(deadline=None, max_examples=10)
    @given(any_seed)
    def test_of_the_pose_for_any_robot_near_the_nominal_at_any_pose(self, seed):
        rng = np.random.default_rng(seed)
        errors = rng.uniform(-1.0, 1.0, len(SPACE.geometry)) * np.where(IS_ANGLE, 0.02, 5.0)
        robot = delta_of(NOMINAL.p + errors)
        poses = reachable_poses(robot, 4, seed, limits=WELL_INSIDE)
        joints = robot.inverse(poses).values_or_raise()

        def moved(vector):
            return delta_of(vector).forward(joints, poses).values_or_raise()

        measured = central_differences(moved, robot.p, 1e-4 * BY_LENGTH) * BY_LENGTH
        exact = robot.jacobian(joints, poses) * BY_LENGTH
        assert np.abs(measured - exact).max() < 1e-6 * np.abs(exact).max()

    def test_of_the_joint_offset_is_that_of_the_joint(self):
        poses = reachable_poses(NOMINAL, 20, seed=24)
        joints = NOMINAL.inverse(poses).values_or_raise()
        by_offset = NOMINAL.jacobian(joints, poses)[:, :, SPACE.offsets]
        forearms = poses[:, None] - elbows_of(NOMINAL, joints)
        step = 1e-4
        for joint, unit in enumerate(np.eye(3)):
            ahead, behind = (
                NOMINAL.forward(joints + sign * step * unit).values_or_raise() for sign in (1, -1)
            )
            by_joint = (ahead - behind) / (2.0 * step)
            assert np.abs(by_offset[:, :, joint] - by_joint).max() < 1e-4
            others = [arm for arm in range(3) if arm != joint]
            across = np.einsum("nak,nk->na", forearms[:, others], by_offset[:, :, joint])
            assert np.abs(across).max() < 1e-6, "the point moves about the other elbows"


class TestFeasibility:
    def test_a_pose_inside_every_limit_can_be_taken(self):
        assert violations(LIMITS, ASIDE) is Violation.NONE
        assert told(LIMITS, ASIDE) == []
        assert NOMINAL.feasibility(LIMITS, CENTRE[None]).singular_value[0] > 0.4

    def test_a_pose_out_of_reach_has_that_reason_and_no_measures(self):
        judged = NOMINAL.feasibility(LIMITS, OUT_OF_REACH)
        assert Violation(int(judged.violations[0])) is Violation.OUT_OF_REACH
        assert np.isnan([*judged.joints[0], *judged.swing_rad[0]]).all()
        assert np.isnan([judged.singular_value[0], judged.elbow[0]]).all()
        (line,) = told(LIMITS, OUT_OF_REACH)
        assert line.startswith("out of reach")

    def test_a_joint_beyond_its_limit_is_named_with_value_and_limit(self):
        joints_deg = np.degrees(NOMINAL.inverse(ASIDE).values_or_raise()[0])
        largest = int(np.argmax(joints_deg))
        limits = replace(LIMITS, joint=(LIMITS.joint[0], np.radians(joints_deg[largest] - 1.0)))
        assert violations(limits, ASIDE) is Violation.JOINT_LIMIT
        (line,) = told(limits, ASIDE)
        assert line.startswith(f"joint {largest} at {joints_deg[largest]:.3f}° outside [-40°, ")

    def test_a_forearm_that_swings_too_far_is_named_with_value_and_limit(self):
        swing_deg = np.degrees(NOMINAL.feasibility(LIMITS, ASIDE).swing_rad[0])
        worst = int(np.argmax(np.abs(swing_deg)))
        limit_rad = np.radians(np.sort(np.abs(swing_deg))[-2:].mean())
        limits = replace(LIMITS, forearm_swing_rad=limit_rad)
        assert violations(limits, ASIDE) is Violation.SWING_LIMIT
        (line,) = told(limits, ASIDE)
        assert line.startswith(f"forearm {worst} swings {swing_deg[worst]:.2f}° out of its arm's")
        assert line.endswith(f"limit {np.degrees(limit_rad):g}°")

    def test_a_coordinate_beyond_its_limit_is_named_with_value_and_limit(self):
        limits = replace(LIMITS, task=(None, None, (-700.0, -500.0)))
        assert violations(limits, ASIDE) is Violation.TASK_LIMIT
        assert told(limits, ASIDE) == ["z -720.000 mm outside [-700 mm, -500 mm]"]

    @pytest.mark.parametrize("margin", ["singularity_margin", "elbow_margin"])
    def test_too_small_a_margin_is_told_with_value_and_limit(self, margin):
        limits = replace(LIMITS, **{margin: 0.999})
        assert violations(limits, ASIDE) is Violation.SINGULAR
        judged = NOMINAL.feasibility(LIMITS, ASIDE)
        (line,) = told(limits, ASIDE)
        assert (
            f"margin {judged.singular_value[0]:.3f} (limit {limits.singularity_margin:g})" in line
        )
        assert f"elbow {judged.elbow[0]:.3f} (limit {limits.elbow_margin:g})" in line

    def test_margins_are_those_of_the_geometry(self):
        """Swing, singular value and elbow by hand, from elbows, forearms and crank directions."""
        poses = reachable_poses(PERTURBED, 300, seed=31)
        judged = PERTURBED.feasibility(LIMITS, poses)
        elbows = elbows_of(PERTURBED, judged.joints)
        forearms = poses[:, None] - elbows
        directions = forearms / np.linalg.norm(forearms, axis=-1, keepdims=True)
        arms = PERTURBED.p[:21].reshape(3, 7)
        axes = np.stack([-np.sin(arms[:, 3]), np.cos(arms[:, 3]), np.zeros(3)], axis=-1)
        cranks = (elbows - arms[:, :3]) / arms[:, 5, None]
        swing = np.arcsin(np.sum(directions * axes, axis=-1))
        lever = np.abs(np.sum(directions * np.cross(axes, cranks), axis=-1)).min(axis=1)
        singular = np.linalg.svd(directions, compute_uv=False)[:, -1]
        assert np.abs(judged.swing_rad - swing).max() < 1e-12
        assert np.abs(judged.elbow - lever).max() < 1e-12
        assert np.abs(judged.singular_value - singular).max() < 1e-12

    @pytest.mark.parametrize("height_mm", [500.0, 100.0, 20.0, 1.0])
    def test_the_margin_vanishes_as_the_platform_rises_between_its_elbows(self, height_mm):
        """On the axis of a symmetric robot it is √3 cos φ or √1.5 sin φ, φ from the vertical."""
        level = np.zeros((1, 3))
        outward_mm = float(elbows_of(NOMINAL, level)[0, 0, 0])
        p = NOMINAL.p.copy()
        p[[6, 13, 20]] = np.hypot(outward_mm, height_mm)
        robot, pose = delta_of(p), np.array([[0.0, 0.0, -height_mm]])
        assert np.abs(robot.inverse(pose).values_or_raise()).max() < 1e-12
        phi = np.arctan2(outward_mm, height_mm)
        expected = min(np.sqrt(3.0) * np.cos(phi), np.sqrt(1.5) * np.sin(phi))
        judged = robot.feasibility(LIMITS, pose)
        assert judged.singular_value[0] == pytest.approx(expected, rel=1e-9)
        near = Violation.SINGULAR in Violation(int(judged.violations[0]))
        assert near == (expected < LIMITS.singularity_margin)

    @ALL_ROBOTS
    def test_what_is_feasible_keeps_every_limit(self, robot):
        poses = reachable_poses(robot, 500, seed=32)
        judged = robot.feasibility(LIMITS, poses)
        assert judged.feasible.all()
        assert (judged.joints >= LIMITS.joint[0]).all()
        assert (judged.joints <= LIMITS.joint[1]).all()
        assert np.abs(judged.swing_rad).max() <= LIMITS.forearm_swing_rad

    def test_the_searched_box_holds_the_workspace(self):
        extent = DELTA.search_extent(NOMINAL.p, LIMITS, CENTRE)
        assert extent.shape == (3,)
        rng = np.random.default_rng(33)
        wide = CENTRE + rng.uniform(-2.0, 2.0, (20_000, 3)) * extent
        feasible = wide[NOMINAL.feasibility(LIMITS, wide).feasible]
        assert len(feasible) > 100
        assert (np.abs(feasible - CENTRE) <= extent).all()
