"""Mechanisms stated by their closures: both ways, derivatives by differences, and what has none."""

import time
from dataclasses import replace

import numpy as np
import pytest
from own_mechanisms import OneClosureDelta, polar, robot_of, three_cranks, tricept
from par4_cases import central_differences
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from campaigns.kinematics.catalog import DELTA
from campaigns.kinematics.feasibility import Violation, search_extent
from campaigns.kinematics.implicit import closures
from campaigns.kinematics.model import Kinematics
from campaigns.robots.robot import find_robot
from pkmcal import sample_workspace

SHIPPED = ("hexapod", "hexaglide", "five-bar")
OWN = {"3-rrr": three_cranks, "tricept": tricept, "polar": polar}
AWAY = {"3-rrr": [40.0, 40.0, 0.0, 0.2], "tricept": [90.0] * 3, "polar": [60.0, 60.0, 0.0]}
"""Largest distance of the tests' poses from home."""
STEP = 1e-4
"""Of differences: 0.0001 rad or 0.01 mm."""

every_mechanism = pytest.mark.parametrize("name", [*SHIPPED, *OWN])


def robot_by_name(name):
    """A model with imperfect gears, drives and places, by a draw of its own."""
    robot = OWN[name]() if name in OWN else find_robot(name).robot.kinematics
    table, p, rng = robot.mechanism.parameters, robot.whole_p, np.random.default_rng(3)
    units = np.array([table[each].unit for each in table.of_robot])
    p[: len(units)] += np.where(units == "mm", 0.5, 2e-3) * rng.uniform(-1.0, 1.0, len(units))
    rates = [0.0 if each in table.rates else 7.0 for each in range(table.arms)]
    mechanism = robot.mechanism.with_ripples(rates[0] if table.rate.unit == "" else 20.0)
    return Kinematics(replace(mechanism, reflector_mm=(20.0, -30.0, -45.0)), p)


def poses_of(robot, name, count=12):
    if name in SHIPPED:
        return sample_workspace(find_robot(name).robot, count)
    home = np.array(robot.mechanism.home)
    return home + np.random.default_rng(1).uniform(-1.0, 1.0, (count, len(home))) * AWAY[name]


def directions(robot, count, seed=0):
    """Signs of the last motions of all joints."""
    shape = (count, len(robot.mechanism.joints))
    return np.random.default_rng(seed).choice([-1.0, 1.0], shape)


class TestBothWays:
    @every_mechanism
    def test_poses_come_back_from_their_joints(self, name):
        """From home, and from poses nearby; a redundant joint has many readings of one pose."""
        robot = robot_by_name(name)
        poses = poses_of(robot, name)
        signs = directions(robot, len(poses))
        joints = robot.inverse(poses, signs).values_or_raise()
        for near in (None, poses + 0.01):
            found = robot.forward(joints, near, signs).values_or_raise()
            assert np.abs(found - poses).max() < 1e-8
        assert len(robot.mechanism.joints) <= len(poses[0]) or name == "polar"

    def test_a_hexapod_s_legs_are_as_long_as_its_joints_are_apart(self):
        robot = replace(robot_by_name("hexapod"), p=find_robot("hexapod").robot.kinematics.p)
        poses, values = poses_of(robot, "hexapod"), robot.parameters
        base, ends = (
            np.array([[values[f"arm{k}.{on}{c}_mm"] for c in "xyz"] for k in range(6)])
            for on in ("", "plate_")
        )
        turned = Rotation.from_rotvec(poses[:, 3:]).as_matrix() @ ends.T
        legs = np.linalg.norm(poses[:, :3, None] + turned - base.T, axis=1)
        readings = robot.inverse(poses).values_or_raise()
        assert np.abs(readings + values["arm0.joint_offset_mm"] - legs).max() < 1e-9

    def test_a_hexaglide_s_carriages_are_on_their_rails_above_the_platform(self):
        robot = Kinematics(robot_by_name("hexaglide").mechanism, robot_by_name("hexaglide").p)
        robot = replace(robot, p=find_robot("hexaglide").robot.kinematics.p)
        poses, values = poses_of(robot, "hexaglide"), robot.parameters
        heights = robot.inverse(poses).values_or_raise()
        for leg in range(6):
            x, y, u, v = (values[f"arm{leg}.{key}_mm"] for key in ("x", "y", "plate_x", "plate_y"))
            ends = poses[:, :3] + Rotation.from_rotvec(poses[:, 3:]).apply([u, v, 0.0])
            aside2 = (ends[:, 0] - x) ** 2 + (ends[:, 1] - y) ** 2
            above = np.sqrt(values[f"arm{leg}.forearm_mm"] ** 2 - aside2)
            assert np.abs(heights[:, leg] - ends[:, 2] - above).max() < 1e-9

    def test_a_five_bar_stands_where_an_equation_solver_finds_it(self):
        robot = replace(robot_by_name("five-bar"), p=find_robot("five-bar").robot.kinematics.p)
        joints = np.radians([[10.0, -25.0], [30.0, 5.0]])
        found = robot.forward(joints).values_or_raise()
        for (left, right), pose in zip(np.pi / 2 + joints, found, strict=True):
            elbows = 200.0 * np.array([[np.cos(a), np.sin(a)] for a in (left, right)])
            elbows[:, 0] += [-100.0, 100.0]
            apart = least_squares(
                lambda point, at=elbows: np.linalg.norm(point - at, axis=1) - 250.0,
                [0.0, 400.0],
                xtol=1e-14,
            )
            assert pose == pytest.approx([*apart.x, 0.0], abs=1e-7)

    @every_mechanism
    def test_a_search_from_far_away_ends_at_the_assembly_or_says_that_it_failed(self, name):
        """Starts at random, five times as far as the workspace goes."""
        robot = robot_by_name(name)
        poses = poses_of(robot, name, 60)
        joints, wanted = robot.inverse(poses).values_or_raise(), robot.mechanism.home_poses(poses)
        home = np.zeros_like(poses)
        home[:, robot.mechanism._moving] = wanted
        found = robot.forward(joints, home + 5.0 * (poses[::-1] - home))
        again = robot.inverse(found.values[found.is_solved])
        assert found.is_solved.mean() > 0.9
        assert np.isnan(found.values[~found.is_solved]).all()
        elsewhere = np.abs(found.values - poses).max(axis=1) > 1e-6
        assert elsewhere.mean() < 0.5, "in the wanted assembly"
        if name != "polar":  # its first joints are those of one place
            closed = again.is_solved & ~elsewhere[found.is_solved]
            assert np.abs(again.values - joints[found.is_solved])[closed].max() < 1e-6

    def test_joints_without_an_assembly_and_poses_out_of_reach_are_nan(self):
        for name, torn in (("hexapod", [[0.0] * 5 + [5000.0]]), ("five-bar", [[1.5, -1.5]])):
            robot = find_robot(name).robot.kinematics
            assert not robot.forward(torn).is_solved.any()
            assert np.isnan(robot.forward(torn).values).all()
        five_bar = find_robot("five-bar").robot
        far = np.array([[0.0, 900.0, 0.0], [0.0, 250.0, 0.0]])
        found = five_bar.kinematics.inverse(far)
        assert found.is_solved.tolist() == [False, True]
        assert np.isnan(found.values[0]).all()
        judged = five_bar.kinematics.feasibility(five_bar.limits, far)
        assert judged.describe(0) == ["out of reach: no joints lead to this pose"]

    def test_poses_of_another_assembly_are_not_taken(self):
        """The same legs hold a platform above the base."""
        robot = find_robot("hexapod").robot
        wide = replace(robot.limits, task=((-900.0, 900.0),) * 3 + robot.limits.task[3:])
        mirrored = np.array([[0.0, 0.0, 500.0, 0.0, 0.0, 0.0]])
        judged = robot.kinematics.feasibility(wide, mirrored)
        assert Violation(int(judged.violations[0])) is Violation.OTHER_ASSEMBLY
        assert judged.describe(0)[0].startswith("another assembly")
        standing = replace(
            robot.kinematics, mechanism=robot.mechanism.with_home(mirrored[0])
        ).feasibility(wide, mirrored)
        assert standing.feasible.all()

    def test_a_pose_that_differs_by_a_turn_alone_is_another_assembly(self):
        robot = find_robot("hexapod").robot.kinematics
        poses = poses_of(robot, "hexapod", 3)
        joints = robot.inverse(poses).values_or_raise()
        around = poses.copy()
        full = Rotation.from_rotvec(poses[:, 3:]).as_rotvec()
        around[:, 3:] = full * (1.0 - 2.0 * np.pi / np.linalg.norm(full, axis=1, keepdims=True))
        aside = poses + [0.0, 0.0, 0.0, 0.0, 0.0, 0.01]  # noqa: RUF005 - arrays add
        for given, is_home in ((poses, True), (around, True), (aside, False)):
            found = robot.mechanism.is_mode_of_home(robot.p, joints, given)
            assert (found == is_home).all()

    def test_the_box_of_poses_reaches_the_limits_from_a_centre_aside(self):
        robot = find_robot("hexapod").robot
        centre = robot.workspace_centre + np.array([60.0, 0.0, -30.0, 0.0, 0.0, 0.0])
        half = search_extent(robot.mechanism, robot.kinematics.p, robot.limits, centre)
        low, high = np.array(robot.limits.task).T
        assert (centre[:3] - half[:3] <= low[:3]).all()
        assert (centre[:3] + half[:3] >= high[:3]).all()


class TestDerivatives:
    @every_mechanism
    def test_the_jacobian_is_that_of_differences(self, name):
        robot = robot_by_name(name)
        poses = poses_of(robot, name, 5)
        signs = directions(robot, len(poses))
        joints = robot.inverse(poses, signs).values_or_raise()
        table = robot.mechanism.parameters
        units = np.array([table[each].unit for each in table.of_robot])
        steps = np.where(units == "mm", 100.0 * STEP, 0.1 * STEP)
        size = len(units)

        def poses_by(p):
            at = replace(robot, p=np.concatenate([p, robot.p[size:]]))
            return at.forward(joints, poses, signs).values_or_raise()

        expected = central_differences(poses_by, robot.p[:size].copy(), steps)
        found = robot.jacobian(joints, poses, signs)
        scale = np.maximum(np.abs(expected).max(axis=(0, 1)), 1e-3)
        assert np.abs((found[..., :size] - expected) / scale).max() < 3e-6
        by_joints = central_differences(
            lambda q: robot.forward(joints + q, poses, signs).values_or_raise(),
            np.zeros(joints.shape[1]),
            np.where([a.is_revolute for a in robot.mechanism.joints], STEP, 100.0 * STEP),
        )
        found = robot.joint_jacobian(joints, poses, signs)
        assert np.abs(found - by_joints).max() < 1e-5 * np.abs(by_joints).max()

    @every_mechanism
    def test_a_reflector_off_the_controlled_point_moves_with_the_platform(self, name):
        robot = robot_by_name(name)
        poses = poses_of(robot, name, 5)
        mechanism, lever = robot.mechanism, np.array(robot.mechanism.reflector_mm)
        turns = np.zeros((len(poses), 3))
        turns[:, 6 - poses.shape[1] :] = poses[:, 3:]
        expected = poses[:, :3] + Rotation.from_rotvec(turns).apply(lever)
        assert np.abs(robot.points(poses) - expected).max() < 1e-10
        rows = np.tile(np.eye(poses.shape[1]), (len(poses), 1, 1))
        by_pose = central_differences(
            lambda by: mechanism.points(poses + by),
            np.zeros(poses.shape[1]),
            np.full(poses.shape[1], STEP),
        )
        assert np.abs(mechanism.point_rows(poses, rows) - by_pose).max() < 1e-6

    @pytest.mark.parametrize("name", ["hexapod", "hexaglide"])
    def test_a_turn_is_the_body_s_and_not_the_change_of_its_vector(self, name):
        robot = robot_by_name(name)
        poses = poses_of(robot, name, 5)
        rows = np.tile(np.eye(6), (5, 1, 1))
        at = Rotation.from_rotvec(poses[:, 3:])
        for column in range(3, 6):
            aside = poses + STEP * np.eye(6)[column]
            turn = (Rotation.from_rotvec(aside[:, 3:]) * at.inv()).as_rotvec() / STEP
            assert np.abs(robot.mechanism.turn_rows(poses, rows)[..., column] - turn).max() < 1e-4

    def test_a_singular_pose_has_no_margin(self):
        """The five-bar's forearms in one line."""
        robot = find_robot("five-bar").robot
        joints = np.array([[np.arccos(150.0 / 200.0) - np.pi / 2] * 2]) * [-1.0, 1.0]
        height = 200.0 * np.cos(joints[0, 0])
        pose = np.array([[0.0, height, 0.0]])
        margins = robot.mechanism.margins(robot.kinematics.p, joints, pose)
        assert margins.singular_value[0] < 1e-9

    @pytest.mark.parametrize("name", ["hexapod", "five-bar"])
    def test_a_robot_twice_the_size_has_the_same_margins(self, name):
        robot = find_robot(name).robot
        values = {
            key: value * (2.0 if robot.mechanism.parameters[key].unit == "mm" else 1.0)
            for key, value in robot.parameters.items()
        }
        large = Kinematics.of(robot.mechanism, values)
        poses = poses_of(robot, name)
        larger = poses * np.where([a.is_revolute for a in robot.mechanism.task], 1.0, 2.0)
        at = [
            each.mechanism.margins(each.p, each.inverse(where).values_or_raise(), where)
            for each, where in ((robot.kinematics, poses), (large, larger))
        ]
        assert at[1].singular_value == pytest.approx(at[0].singular_value, abs=1e-9)


class TestOneClosureDelta:
    """A Delta stated by its misfit is the catalogue's, which is built of limbs and a platform."""

    @pytest.fixture
    def pair(self):
        shipped = find_robot("delta").robot
        values = dict(shipped.parameters) | {
            f"arm{arm}.{key}": value * (arm + 1)
            for arm in range(3)
            for key, value in (
                ("encoder_gain_ppm", 300.0), ("eccentricity_sin_deg", 0.01),
                ("eccentricity_cos_deg", -0.02), ("ripple_sin_deg", 0.01),
                ("ripple_cos_deg", 0.004), ("backlash_deg", 0.02),
            )
        } | {"ripples_per_turn": 50.0}  # fmt: skip
        own = OneClosureDelta("own").with_home(shipped.workspace_centre)
        return Kinematics.of(DELTA, values), Kinematics.of(own, values)

    def test_poses_joints_and_jacobian_are_equal(self, pair):
        chain, own = pair
        poses = sample_workspace(find_robot("delta").robot, 60)
        signs = directions(chain, len(poses))
        joints = chain.inverse(poses, signs).values_or_raise()
        assert np.abs(own.inverse(poses, signs).values_or_raise() - joints).max() < 1e-12
        reached = [each.forward(joints, poses, signs).values_or_raise() for each in pair]
        assert np.abs(reached[1] - reached[0]).max() < 2e-12
        names = own.mechanism.parameters.of_robot
        rows = [
            each.jacobian(joints, poses, signs)[..., each.mechanism.parameters.places(names)]
            for each in pair
        ]
        assert np.abs(rows[1] - rows[0]).max() < 3e-12 * np.abs(rows[0]).max()

    def test_it_takes_about_as_long(self, pair):
        poses = sample_workspace(find_robot("delta").robot, 60)
        joints = pair[0].inverse(poses).values_or_raise()

        def seconds(robot):
            took = []
            for _ in range(20):
                begun = time.perf_counter()
                robot.forward(joints, poses + 1.0)
                robot.jacobian(joints, poses)
                took.append(time.perf_counter() - begun)
            return min(took)

        assert seconds(pair[1]) < 3.0 * seconds(pair[0])


class TestTables:
    def test_joints_of_two_kinds_have_offsets_and_gears_in_their_own_units(self):
        table = polar().mechanism.parameters
        assert table.names == (
            "arm0.joint_offset_deg", "arm1.joint_offset_mm", "arm2.joint_offset_deg", "hand_mm",
        )  # fmt: skip
        assert {"arm0.backlash_deg", "arm1.backlash_mm"} <= {*table.of_robot}
        assert "arm1.backlash_deg" not in table.of_robot
        rippling = {table[name].arm for name in table.select(group="ripple")}
        assert rippling == {0, 2}, "one rate cannot be a length and a number of periods"

    def test_a_fixed_axis_is_in_poses_and_never_moves(self):
        robot = find_robot("five-bar").robot.kinematics
        assert [axis.name for axis in robot.mechanism.task] == ["x", "y", "z"]
        poses = poses_of(robot, "five-bar", 3)
        joints = robot.inverse(poses).values_or_raise()
        assert (robot.forward(joints).values_or_raise()[:, 2] == 0.0).all()
        assert (robot.jacobian(joints, poses)[:, 2] == 0.0).all()

    def test_ripple_rates_of_another_number_of_joints_are_refused(self):
        with pytest.raises(ValueError, match="2 ripple rates for 6 joints"):
            find_robot("hexapod").robot.mechanism.with_ripples([1.0, 2.0])

    def test_a_part_that_the_platform_has_not_is_refused(self):
        with pytest.raises(ValueError, match="no part 1"):
            find_robot("hexapod").robot.mechanism.seen_from(1)

    def test_closures_of_different_steps_are_joined(self):
        joined = closures(np.ones((3, 4, 2)), np.zeros((4, 1)))
        assert joined.shape == (3, 4, 3)
        assert joined[..., 2].max() == 0.0

    def test_parts_and_frame_grow_by_their_own_lengths(self):
        """A hexaglide's legs are lengths; its rails' scales grow by where their carriages stand."""
        robot = find_robot("hexaglide").robot.kinematics
        poses = poses_of(robot, "hexaglide", 3)
        joints = robot.inverse(poses).values_or_raise()
        table = robot.mechanism.parameters
        by_p = robot.point_jacobian(joints, poses)
        grown = robot.mechanism.growth_columns(robot.p, by_p, joints)
        longer = robot.whole_p
        longer[table.columns["forearm"]] *= 1.0 + 1e-6
        apart = replace(robot, p=longer).forward(joints, poses).values_or_raise() - poses
        assert np.abs(grown[..., 1] * 1e-6 - apart[:, :3]).max() < 1e-8
        self.compare_travel(robot, joints, poses, grown[..., 0])

    def test_a_leg_of_variable_length_grows_by_all_of_it(self):
        robot = find_robot("hexapod").robot.kinematics
        poses = poses_of(robot, "hexapod", 3)
        joints = robot.inverse(poses).values_or_raise()
        by_p = robot.point_jacobian(joints, poses)
        grown = robot.mechanism.growth_columns(robot.p, by_p, joints)
        self.compare_travel(robot, joints, poses, grown[..., 0])
        assert (grown[..., 1] == 0.0).all()

    @staticmethod
    def compare_travel(robot, joints, poses, grown):
        offsets = robot.p[robot.mechanism.parameters.columns["joint_offset"]]
        farther = joints + 1e-6 * (joints + offsets)
        apart = robot.forward(farther, poses).values_or_raise() - poses
        assert np.abs(grown * 1e-6 - apart[:, :3]).max() < 1e-8


def test_turns_of_mechanisms_of_one_turn_are_about_z():
    robot = three_cranks()
    rows = robot.mechanism.turn_rows(np.zeros((1, 4)), np.eye(4)[None])
    assert rows[0, 2].tolist() == [0.0, 0.0, 0.0, 1.0]
    assert not rows[0, :2].any()


def test_a_home_is_where_the_search_begins():
    arms = {"x_mm": [0.0] * 3, "y_mm": [0.0] * 3}
    with pytest.raises(KeyError):
        robot_of(OneClosureDelta("own"), arms, [0.0, 0.0, -700.0])
    assert OneClosureDelta("own").home_poses(np.zeros((2, 3))).tolist() == [[0.0] * 3] * 2
