"""Every mechanism: both ways against reference models, derivatives by differences, ranks."""

from dataclasses import replace

import numpy as np
import pytest
from family_cases import (
    ALL_MEMBERS,
    BY_NAME,
    all_members,
    closures_at,
    closures_by_pose,
    flat_in,
    of_members,
)
from hypothesis import given
from hypothesis import strategies as st
from par4_cases import NOMINAL, central_differences, reachable_joints
from scipy.optimize import root

from campaigns.kinematics import closed_chain
from campaigns.kinematics.feasibility import search_extent
from campaigns.kinematics.model import NoSolution
from campaigns.kinematics.parameters import Role

CLOSE = 1e-9
"""mm and deg."""
LEVER_MM = 100.0
STEP = 1e-4
"""Of differences: 0.0001 rad or 0.01 mm."""
DIRECTIONS = 6
WORKSHOP = 0.04
"""Share of the tilts of `Member.tilted` that makes them 2 mrad at most."""
CONDITION = {"par4": 120, "delta": 89, "h4": 120, "i4r": 105, "linear-delta": 363, "i4l": 742}
"""Of the reference models, for 200 shots of their own."""
HIDDEN = {"par4": 4, "delta": 4, "h4": 4, "i4r": 5, "linear-delta": 11, "i4l": 13}
"""Combinations of the geometry that no shot shows: motions of the base frame, and upright rails'
own."""
UPSIDE_DOWN = (([131.59, -317.79, -479.51, -0.4], [-86.12, 54.54, 265.75, -1.55]),)
"""Par4's reachable poses, and close to another assembly of the same joints."""
TORN_APART_DEG = {
    "par4": ([90, -90, 90, -90], [90, 90, 90, -45]),
    "delta": ([50, -80, -170], [-150, -90, 30]),
}
TURNED_OVER_DEG = {
    "par4": ([-2, -7, 21, -21], [30, -7, 15, 22]),
    "delta": ([130, -170, 80], [-120, 130, 10], [-30, -110, -150]),
}
"""Every assembly of these is turned over, above the elbows or in the other assembly mode."""

some_members = of_members("par4", "i4r", "linear-delta")
"""Each platform once, one on rails."""


def steps(member, size):
    """A step of each entry of a vector: 0.01 is 0.01 rad or 1 mm."""
    units = [member.space[name].unit for name in member.space.of_robot]
    return size * np.where(np.array(units) == "mm", LEVER_MM, 1.0)


def singular_values(robot, poses, names):
    """Singular values of points by parameters and by a free frame, columns scaled."""
    joints = robot.inverse(poses).values_or_raise()
    places = robot.mechanism.parameters.places(names)
    jacobian, points = robot.jacobian(joints, poses)[:, :3, places], poses[:, :3]
    turns = np.stack([np.cross(axis, points) for axis in np.eye(3)], axis=-1)
    shifts = np.tile(np.eye(3), (len(poses), 1, 1))
    rows = np.concatenate([jacobian, turns, shifts], axis=-1).reshape(3 * len(poses), -1)
    sizes = np.maximum(np.linalg.norm(rows, axis=0), 1e-3)  # an upright rail has no azimuth
    return np.linalg.svd(rows / sizes, compute_uv=False)


def rank(values):
    return np.count_nonzero(values > 1e-7 * values[0])


class TestReferenceModel:
    @all_members
    def test_poses_and_joints_are_its_own_both_ways(self, member):
        """Forward with and without a hint: where the nominal robot would stand."""
        for case in member.reference["cases"]:
            robot = member.robot_in(case["geometry"])
            poses, joints = member.poses_of(case), member.joints_of(case)
            found = robot.inverse(poses).values_or_raise()
            apart = (found - joints) / member.file_units(member.mechanism.joints)
            assert np.abs(apart).max() < CLOSE
            for hint in (None, member.nominal.forward(joints).values_or_raise()):
                found = robot.forward(joints, hint).values_or_raise()
                apart = (found - poses) / member.file_units(member.mechanism.task)
                assert np.abs(apart).max() < CLOSE
            assert member.name == "par4" or robot.feasibility(member.limits, poses).feasible.all()
            assert np.abs(closures_at(robot, joints, poses)).max() < 1e-9

    @pytest.mark.parametrize("member", ALL_MEMBERS[1:], ids=lambda each: each.name)
    def test_the_shipped_robot_is_the_reference_s(self, member):
        robot, reference = member.shipped, member.reference
        expected = flat_in(reference["robot"]["geometry"])
        assert robot.mechanism.name == member.name
        assert dict(robot.parameters) == pytest.approx(expected, abs=1e-12)
        assert robot.workspace_centre.tolist() == reference["home_mm_deg"]
        limits, joint = reference["robot"]["limits"], member.mechanism.joints[0]
        in_file = [joint.to_file(end) for end in robot.limits.joint]
        assert in_file == pytest.approx(limits[f"joint_{reference['joint_unit']}"])
        assert np.degrees(robot.limits.forearm_swing_rad) == limits["forearm_swing_deg"]
        assert list(member.free) == member.answers("exact")["free"]


class TestForwardAndInverse:
    @all_members
    @pytest.mark.parametrize("kind", ["perturbed", "tilted"])
    def test_undo_each_other_all_over_the_workspace(self, member, kind):
        robot = member.robots[kind]
        poses = member.reachable_poses(robot, 200 if kind == "perturbed" else 40, seed=11)
        joints = robot.inverse(poses).values_or_raise()
        unit = member.file_units(member.mechanism.task)
        aside = np.random.default_rng(1).uniform(-1.0, 1.0, poses.shape)
        for hint in (None, poses + 0.1 * aside, poses + aside * [20, 20, 20, 0.1][: len(unit)]):
            found = robot.forward(joints, hint)
            assert found.is_solved.all()
            assert np.abs((found.values - poses) / unit).max() < CLOSE
        again = robot.inverse(found.values).values_or_raise()
        apart = (again - joints) / member.file_units(member.mechanism.joints)
        assert np.abs(apart).max() < CLOSE

    @pytest.mark.parametrize("sag_mm", [20.0, 120.0, 150.0])
    def test_joints_are_given_only_where_their_rounds_settle(self, sag_mm):
        """A plate that rises by half of its height or more: rounds converge slowly, or never."""
        member = BY_NAME["linear-delta"]
        p = member.nominal.p.copy()
        p[member.space.places(["sag_z_mm"])] = sag_mm
        robot = member.robot_of(p)
        poses = member.reachable_poses(member.nominal, 50, seed=11)
        solution = robot.inverse(poses)
        reached = robot.forward(solution.values[solution.is_solved]).values_or_raise()
        assert np.abs(reached - poses[solution.is_solved]).max(initial=0.0) < 1e-6
        assert solution.is_solved.all() == (sag_mm < 100.0)

    @all_members
    def test_a_hint_on_another_assembly_leads_to_the_wanted_one(self, member):
        """The platform mirrored over its elbows closes the chain or nearly does, but stands."""
        poses = member.reachable_poses(member.nominal, 200, seed=12)
        joints = member.nominal.inverse(poses).values_or_raise()
        above = poses * np.where(np.arange(poses.shape[1]) == 2, -1.0, 1.0)
        found = member.nominal.forward(joints, above).values_or_raise()
        assert np.abs(found - poses).max() < 1e-6

    def test_par4_s_other_real_assembly_is_never_taken(self):
        joints = reachable_joints(NOMINAL, 40, seed=5)
        wanted = NOMINAL.forward(joints).values_or_raise()
        others = np.full_like(wanted, np.nan)
        for row, pose in enumerate(wanted):
            start = np.add(pose, [0.0, 0.0, 50.0, np.copysign(1.9, pose[3])])
            one = joints[[row]]
            answer = root(lambda x, one=one: closures_at(NOMINAL, one, x[None])[0], start)
            if answer.success and np.abs(answer.x - pose).max() > 1.0:
                others[row] = answer.x
        known = np.isfinite(others[:, 0])
        assert known.sum() >= 12
        assert (np.abs(others[known, 3]) > np.pi / 2).all()
        assert (others[known, 2] > wanted[known, 2]).all()
        found = NOMINAL.forward(joints[known], others[known]).values_or_raise()
        assert np.abs(found - wanted[known]).max() < 1e-8

    @pytest.mark.parametrize(("pose", "above_the_elbows"), UPSIDE_DOWN)
    def test_a_hint_above_the_elbows_still_leads_to_the_wanted_one(self, pose, above_the_elbows):
        """There forearms point upwards; assembly mode and |θ| alone would let it pass."""
        joints, above = NOMINAL.inverse(np.array([pose])).values, np.array([above_the_elbows])
        signs = [
            np.sign(np.linalg.det(closures_by_pose(NOMINAL, joints, each)))
            for each in (above, np.array([pose]))
        ]
        assert signs[0] == signs[1]
        found = NOMINAL.forward(joints, above).values_or_raise()
        assert np.abs(found - pose).max() < 1e-8

    @pytest.mark.parametrize(
        ("name", "degrees"),
        [(name, each) for name in TORN_APART_DEG for each in TORN_APART_DEG[name]]
        + [(name, each) for name in TURNED_OVER_DEG for each in TURNED_OVER_DEG[name]],
    )
    def test_joints_without_the_wanted_assembly_say_so(self, name, degrees):
        solution = BY_NAME[name].nominal.forward(np.radians([degrees]))
        assert not solution.is_solved[0]
        with pytest.raises(NoSolution, match="row 0 of 1"):
            solution.values_or_raise()

    @pytest.mark.slow
    @given(st.sampled_from(ALL_MEMBERS), st.integers(0, 2**32 - 1), st.booleans())
    def test_any_joints_and_any_hint_give_a_closed_mechanism_or_none(self, member, seed, hinted):
        rng, robot = np.random.default_rng(seed), member.nominal
        scale = np.pi * np.array([axis.scale for axis in member.mechanism.joints])
        joints = scale * rng.uniform(-1.0, 1.0, (1, len(scale)))
        hint = rng.uniform(-2000.0, 2000.0, (1, len(member.mechanism.task))) if hinted else None
        solution = robot.forward(joints, hint)
        if not solution.is_solved[0]:
            assert np.isnan(solution.values).all()
            return
        pose = solution.values
        assert np.abs(closures_at(robot, joints, pose)).max() < 1e-6
        fields = member.mechanism.geometry(robot.p).arms
        assert pose[0, 2] < member.mechanism.limb.upper_ends(fields, joints)[2].mean()
        assert member.name not in {"par4", "h4"} or abs(pose[0, 3]) < np.pi / 2

    @some_members
    @pytest.mark.parametrize("bad", [np.nan, 1e308])
    def test_a_meaningless_joint_or_hint_never_gets_through(self, member, bad):
        poses = member.reachable_poses(member.nominal, 3, seed=1)
        joints = member.nominal.inverse(poses).values_or_raise()
        hint = np.full(poses.shape, bad)
        assert member.nominal.forward(joints, hint).is_solved.all()
        joints[1, 2] = np.nan
        assert member.nominal.forward(joints, hint).is_solved.tolist() == [True, False, True]

    @some_members
    def test_one_unreachable_pose_leaves_the_others_alone(self, member):
        poses = member.reachable_poses(member.nominal, 3, seed=2)
        expected = member.nominal.inverse(poses).values_or_raise()
        poses[1, 0] = 5000.0
        solution = member.nominal.inverse(poses)
        assert solution.is_solved.tolist() == [True, False, True]
        assert np.isnan(solution.values[1]).all()
        assert (solution.values[[0, 2]] == expected[[0, 2]]).all()
        with pytest.raises(NoSolution, match="row 1 of 3"):
            solution.values_or_raise()

    def test_a_row_s_answer_does_not_depend_on_the_rows_beside_it(self, monkeypatch):
        monkeypatch.setattr(closed_chain, "CHUNK", 8)
        joints = reachable_joints(NOMINAL, 11, seed=3)
        together = NOMINAL.forward(joints).values_or_raise()
        for row in (0, 3, 7, 8, 10):
            alone = NOMINAL.forward(joints[[row]]).values_or_raise()
            assert np.abs(alone - together[row]).max() < 1e-10


def jacobian_error(member, robot):
    """Largest difference of the Jacobian from central differences, over its own largest element.

    All parameters are changed at once, each by a share of its own in each of a few directions.
    """
    poses = member.reachable_poses(robot, 1, seed=23, limits=member.well_inside)
    joints = robot.inverse(poses).values_or_raise()
    shares = np.random.default_rng(24).standard_normal((len(robot.p), DIRECTIONS))
    shares[member.space.places(member.space.select(group="compliance"))] = 0.0  # never exact
    ways = steps(member, 1.0)[:, None] * shares / np.linalg.norm(shares, axis=0)
    unit = np.where(np.arange(poses.shape[1]) < 3, 1.0, LEVER_MM)[:, None]

    def moved(along):
        there = member.robot_of(robot.p + ways @ along)
        return there.forward(joints, poses).values_or_raise()

    exact = robot.jacobian(joints, poses) @ ways * unit
    nowhere = np.zeros(DIRECTIONS)
    differences = central_differences(moved, nowhere, nowhere + STEP) * unit
    return np.abs(differences - exact).max() / np.abs(exact).max()


class TestJacobian:
    @all_members
    def test_of_imperfect_parts_leaves_out_the_curvature_of_rods_that_do_not_close(self, member):
        """Rods of four arms are strained a little; those of three close exactly."""
        perfect, tilted = member.perturbed.p, member.tilted.p
        robot = member.robot_of(perfect + WORKSHOP * (tilted - perfect))
        assert jacobian_error(member, robot) < (1e-7 if member.space.arms == 3 else 1e-3)


class TestWhatShotsDetermine:
    @all_members
    def test_what_the_papers_method_fits_and_all_but_motions_of_the_base_frame(self, member):
        poses = member.reachable_poses(member.nominal, 200, seed=3)
        values = singular_values(member.nominal, poses, member.free)
        assert rank(values) == len(member.free) + 6
        assert values[0] / values[-1] < 1.6 * CONDITION[member.name]
        poses = member.reachable_poses(member.nominal, 200, seed=4)
        names = member.space.select(Role.GEOMETRY)
        found = rank(singular_values(member.nominal, poses, names))
        assert found == len(names) + 6 - HIDDEN[member.name]


@all_members
def test_the_searched_box_holds_the_workspace(member):
    rng, centre = np.random.default_rng(33), member.shipped.workspace_centre
    extent = search_extent(member.mechanism, member.nominal.p, member.limits, centre)
    wide = centre + rng.uniform(-2.0, 2.0, (20_000, len(extent))) * extent
    feasible = wide[member.nominal.feasibility(member.limits, wide).feasible]
    assert len(feasible) > 10
    assert (np.abs(feasible - centre) <= extent).all()


@pytest.mark.parametrize("elevation_deg", [90.0, 60.0, 30.0, 0.0])
@of_members("linear-delta")
def test_rails_that_count_the_other_way_are_the_same_robot(member, elevation_deg):
    """Rails from upright over inclined to level, which count up and outward, or down and inward."""
    columns, draw = member.space.columns, np.random.default_rng(5)
    p = member.nominal.p.copy()
    p[columns["azimuth"]] = np.arctan2(p[columns["y"]], p[columns["x"]])
    p[columns["elevation"]], p[columns["forearm"]] = np.radians(elevation_deg), 520.0
    turned = p.copy()
    turned[columns["azimuth"]] += np.pi
    turned[columns["elevation"]] *= -1.0
    robot, other = member.robot_of(p), member.robot_of(turned)
    poses = np.array([0.0, 0.0, -420.0]) + draw.uniform(-60.0, 60.0, (200, 3))
    joints = robot.inverse(poses).values_or_raise()
    assert np.abs(other.inverse(poses).values_or_raise() + joints).max() < 1e-9
    assert np.abs(other.forward(-joints).values_or_raise() - poses).max() < 1e-9
    limits = replace(member.limits, joint=(-600.0, 600.0))
    both = [each.feasibility(limits, poses) for each in (robot, other)]
    assert both[0].feasible.mean() > 0.9
    assert np.abs(both[0].margins.swing_rad - both[1].margins.swing_rad).max() < 1e-9
    assert (both[0].violations == both[1].violations).all()
