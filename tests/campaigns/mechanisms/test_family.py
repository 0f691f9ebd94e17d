"""Every mechanism of the family against the reference model and derivatives by differences."""

from dataclasses import replace

import numpy as np
import pytest
from family_cases import MEMBERS, flat_in
from par4_cases import central_differences

from campaigns.estimation.observability import observability
from campaigns.mechanisms.mechanism import Violation

CLOSE = 1e-9
"""mm and deg."""
LEVER_MM = 100.0
CONDITION = {"delta": 89, "h4": 120, "i4r": 105, "linear-delta": 363, "i4l": 742}
"""Of the reference model, for 200 shots of its own."""
FEWEST_SHOTS = {"delta": 7, "h4": 10, "i4r": 11, "linear-delta": 5, "i4l": 8}

all_members = pytest.mark.parametrize("member", MEMBERS, ids=lambda each: each.name)
both_cases = pytest.mark.parametrize("number", [0, 1], ids=["nominal", "perturbed"])
all_robots = pytest.mark.parametrize("kind", ["nominal", "perturbed", "tilted"])
with_rails = pytest.mark.parametrize(
    "member", [each for each in MEMBERS if "linear" in each.name or each.name == "i4l"], ids=str
)


def steps(member, size):
    """A step of each entry of a vector: 0.01 is 0.01 rad or 1 mm."""
    is_angle = member.space.is_angle[: len(member.space.geometry)]
    return size * np.where(is_angle, 1.0, LEVER_MM)


def singular_values(member, robot, poses, names):
    """Of what points tell of parameters and of a free frame, columns scaled."""
    joints = robot.inverse(poses).values_or_raise()
    jacobian = robot.jacobian(joints, poses)[:, :3, member.space.places(names)]
    points = poses[:, :3]
    turns = np.stack([np.cross(axis, points) for axis in np.eye(3)], axis=-1)
    shifts = np.tile(np.eye(3), (len(poses), 1, 1))
    rows = np.concatenate([jacobian, turns, shifts], axis=-1).reshape(3 * len(poses), -1)
    return observability(rows).singular_values


def rank(values):
    return np.count_nonzero(values > 1e-9 * values[0])


class TestReferenceVectors:
    @all_members
    @both_cases
    def test_inverse_gives_the_joints(self, member, number):
        case = member.reference["cases"][number]
        found = member.robot_in(case["geometry"]).inverse(member.poses_of(case)).values_or_raise()
        unit = member.file_units(member.mechanism.joints)
        assert np.abs(found / unit - case["joints"]).max() < CLOSE

    @all_members
    @both_cases
    @pytest.mark.parametrize("hinted", [False, True])
    def test_forward_gives_the_poses(self, member, number, hinted):
        """With and without a hint: where the nominal robot would stand."""
        case = member.reference["cases"][number]
        joints = member.joints_of(case)
        hint = member.nominal.forward(joints).values_or_raise() if hinted else None
        found = member.robot_in(case["geometry"]).forward(joints, hint).values_or_raise()
        unit = member.file_units(member.mechanism.task)
        assert np.abs(found / unit - case["poses_mm_deg"]).max() < CLOSE

    @all_members
    @both_cases
    def test_poses_are_inside_every_limit(self, member, number):
        case = member.reference["cases"][number]
        judged = member.robot_in(case["geometry"]).feasibility(member.limits, member.poses_of(case))
        assert judged.feasible.all()

    @all_members
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

    @all_members
    def test_what_is_free_by_default_is_the_reference_s(self, member):
        assert list(member.space.free_by_default) == member.answers("exact")["free"]


class TestForwardAndInverse:
    @all_members
    @all_robots
    def test_undo_each_other_all_over_the_workspace(self, member, kind):
        robot = member.robots[kind]
        poses = member.reachable_poses(robot, 2000, seed=11)
        joints = robot.inverse(poses).values_or_raise()
        unit = member.file_units(member.mechanism.task)
        for hint in (None, poses + np.random.default_rng(1).uniform(-0.1, 0.1, poses.shape)):
            found = robot.forward(joints, hint)
            assert found.found.all()
            assert np.abs((found.values - poses) / unit).max() < CLOSE
        again = robot.inverse(found.values).values_or_raise()
        apart = (again - joints) / member.file_units(member.mechanism.joints)
        assert np.abs(apart).max() < CLOSE

    @all_members
    def test_a_hint_on_another_assembly_leads_to_the_wanted_one(self, member):
        """The platform mirrored over its elbows closes the chain or nearly does, but stands."""
        poses = member.reachable_poses(member.nominal, 200, seed=12)
        joints = member.nominal.inverse(poses).values_or_raise()
        above = poses.copy()
        above[:, 2] *= -1.0
        found = member.nominal.forward(joints, above).values_or_raise()
        assert np.abs(found - poses).max() < 1e-6

    @all_members
    def test_joints_that_no_forearm_can_span_have_no_assembly(self, member):
        p = member.nominal.p.copy()
        p[member.space.places([f"arm{i}.forearm_mm" for i in range(member.space.arms)])] = 150.0
        joints = np.zeros((1, len(member.mechanism.joints)))
        assert not member.robot_of(p).forward(joints).found[0]


class TestJacobians:
    @all_members
    @all_robots
    def test_of_the_pose_by_every_parameter(self, member, kind):
        robot = member.robots[kind]
        poses = member.reachable_poses(robot, 6, seed=23, limits=member.well_inside)
        joints = robot.inverse(poses).values_or_raise()
        by_length = steps(member, 1.0)

        def moved(vector):
            return member.robot_of(vector).forward(joints, poses).values_or_raise()

        measured = central_differences(moved, robot.p, steps(member, 1e-4)) * by_length
        exact = robot.jacobian(joints, poses) * by_length
        assert np.abs(measured - exact).max() < 1e-6 * np.abs(exact).max()

    @all_members
    @all_robots
    def test_of_the_closures_by_the_pose(self, member, kind):
        """By complex step: exact but for rounding."""
        robot, chain = member.robots[kind], member.mechanism
        poses = member.reachable_poses(robot, 5, seed=21)
        joints = robot.inverse(poses).values_or_raise()
        exact = chain.pose_jacobian(robot.p, joints, poses)
        for place, unit in enumerate(np.eye(poses.shape[1])):
            aside = chain.closure_mm2(robot.p, joints, poses + 1e-20j * unit)
            assert exact[:, :, place] == pytest.approx(aside.imag / 1e-20, rel=1e-12, abs=1e-9)


class TestWhatShotsTell:
    @all_members
    def test_all_that_is_free_by_default(self, member):
        poses = member.reachable_poses(member.nominal, 200, seed=3)
        values = singular_values(member, member.nominal, poses, member.space.free_by_default)
        assert rank(values) == len(member.space.free_by_default) + 6
        assert values[0] / values[-1] < 1.6 * CONDITION[member.name]

    @all_members
    def test_everything_in_files_but_what_fixes_the_frames(self, member):
        poses = member.reachable_poses(member.nominal, 200, seed=4)
        told = [name for name in member.space.names if name not in member.space.datum]
        for names in (told, member.space.names):
            assert rank(singular_values(member, member.nominal, poses, names)) == len(told) + 6

    @all_members
    def test_as_many_shots_as_it_says_are_enough_and_fewer_are_not(self, member):
        free, least = member.space.free_by_default, FEWEST_SHOTS[member.name]
        assert member.mechanism.minimum_shots(free) == least
        robot = member.perturbed
        for shots, is_enough in ((least, True), (least - 1, False)):
            poses = member.reachable_poses(robot, shots, seed=5)
            assert (rank(singular_values(member, robot, poses, free)) == len(free) + 6) == is_enough

    @with_rails
    def test_the_direction_of_every_rail_but_the_first(self, member):
        poses = member.reachable_poses(member.nominal, 200, seed=6)
        free = [name for name in member.space.free_if_extended if "backlash" not in name]
        fields = ("elevation_deg", "rail_tilt_deg")
        assert {f"arm{i}.{each}" for i in range(1, member.space.arms) for each in fields} <= {*free}
        assert rank(singular_values(member, member.nominal, poses, free)) == len(free) + 6


class TestFeasibility:
    @with_rails
    def test_says_where_a_carriage_cannot_be(self, member):
        beyond = np.zeros((1, len(member.mechanism.task)))
        beyond[0, :3] = [0.0, 0.0, -1200.0]
        judged = member.nominal.feasibility(member.limits, beyond)
        (first, *_) = judged.describe(0)
        assert first.startswith("joint 0 at -")
        assert "mm outside [-450 mm, 450 mm]" in first
        aside = beyond + 0.0
        aside[0, 0] = 900.0
        (line,) = member.nominal.feasibility(member.limits, aside).describe(0)
        assert line == "out of reach: a forearm cannot span from its carriage's rail to the plate"

    @with_rails
    def test_says_how_far_a_forearm_swings_away_from_its_rail(self, member):
        pose = member.shipped.workspace_centre[None]
        judged = member.nominal.feasibility(member.limits, pose)
        forearm = member.nominal.p[6]
        radius = float(np.hypot(*member.nominal.p[:2]))
        assert judged.swing_rad[0, 0] == pytest.approx(np.arcsin(radius / forearm))
        narrow = replace(member.limits, forearm_swing_rad=0.9 * judged.swing_rad[0, 0])
        judged = member.nominal.feasibility(narrow, pose)
        assert Violation(int(judged.violations[0])) is Violation.SWING_LIMIT
        assert "away from its rail, limit" in judged.describe(0)[0]
        near = replace(member.limits, elbow_margin=0.999)
        (line,) = member.nominal.feasibility(near, pose).describe(0)
        assert "carriage 0." in line

    def test_a_platform_above_its_elbows_is_another_assembly(self):
        """Cranks can stand so that forearms reach up to it, but forward never gives that pose."""
        (member,) = (each for each in MEMBERS if each.name == "i4r")
        above = np.array([[-13.0, 23.3, 248.0, -0.5269]])
        judged = member.nominal.feasibility(member.limits, above)
        assert judged.describe(0) == ["another assembly: the platform would be above its elbows"]
        hung = member.nominal.forward(judged.joints, above)
        assert not hung.found[0] or hung.values[0, 2] < -100.0

    @all_members
    def test_the_searched_box_holds_the_workspace(self, member):
        rng, centre = np.random.default_rng(33), member.shipped.workspace_centre
        extent = member.mechanism.search_extent(member.nominal.p, member.limits, centre)
        wide = centre + rng.uniform(-2.0, 2.0, (200_000, len(extent))) * extent
        feasible = wide[member.nominal.feasibility(member.limits, wide).feasible]
        assert len(feasible) > 20
        assert (np.abs(feasible - centre) <= extent).all()
