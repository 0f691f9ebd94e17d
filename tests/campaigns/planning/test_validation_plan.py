"""The tests of section IV.E as steps: what is asked, trimmed, left out, and said about it."""

from dataclasses import replace

import numpy as np
import pytest
from any_axes import robot_file
from fake_cell import CENTRE, NOMINAL
from family_cases import MEMBERS
from par4_space import par4
from small_plans import LIMITS, planned

from campaigns.controllers.corrected_targets import TargetCorrection
from campaigns.design.pose_sampling import FeasibleRegion
from campaigns.errors import PlanInvalid
from campaigns.kinematics.model import KinematicSolution
from campaigns.planning.paths import RobotModel
from campaigns.planning.plans import View, region_of
from campaigns.planning.steps import Step
from campaigns.planning.validation_plan import APPROACHES_MM, Planned, Reachable, validation_steps
from campaigns.robots.robot import pose_of, pose_row, read_robot
from campaigns.settings.sections import ValidationConfig
from campaigns.shots.shot_sets import ShotSet

ALL = frozenset({ShotSet.ROTATION, ShotSet.STRAIGHTNESS, ShotSet.VALIDATION, ShotSet.REPEATABILITY})
CONFIG = ValidationConfig()
ROBOT = Reachable(NOMINAL, LIMITS)
PAIRS = (
    planned(5, ShotSet.VALIDATION, 2, 150.0, 60.0, -600.0),
    planned(6, ShotSet.VALIDATION, 2, -120.0, 80.0, -520.0, 0.2),
    planned(9, ShotSet.VALIDATION, 4, -80.0, -160.0, -650.0),
    planned(10, ShotSet.VALIDATION, 4, 60.0, -120.0, -500.0, -0.3),
)


def steps(
    only: frozenset[ShotSet] = ALL,
    config: ValidationConfig = CONFIG,
    robot: Reachable = ROBOT,
    pairs=PAIRS,
    seed: int = 1,
) -> Planned:
    return validation_steps(config, pairs, robot, only, np.random.default_rng(seed))


def poses(found: Planned, purpose: ShotSet) -> np.ndarray:
    return np.array([pose_row(s.planned.pose) for s in of(found, purpose)])


def of(found: Planned, purpose: ShotSet) -> list[Step]:
    return [step for step in found[0] if step.planned.purpose is purpose]


def test_every_test_asked_for_is_there_and_commanded_as_poses() -> None:
    found = steps()
    assert {step.command for step in found[0]} == {"pose"}
    assert [step.planned.shot for step in found[0]] == list(range(19 + 3 * 17 + 4 + 28))
    assert found[1] == ()


def test_joints_of_a_step_are_those_of_its_pose_with_the_controllers_geometry() -> None:
    other = par4(NOMINAL.parameters | {"plate_mm": 103.0})
    for step in steps(robot=Reachable(other, LIMITS))[0]:
        joints = np.array([step.planned.joints])
        away = other.forward(joints).values_or_raise()[0] - pose_row(step.planned.pose)
        assert np.abs(away).max() < 1e-6


def test_lines_run_through_the_centre_and_the_rotation_from_limit_to_limit() -> None:
    lines = poses(steps(), ShotSet.STRAIGHTNESS).reshape(3, 17, 4)
    for axis, (line, length) in enumerate(zip(lines, CONFIG.line_lengths_mm, strict=True)):
        assert np.ptp(line, axis=0) == pytest.approx(length * np.eye(4)[axis])
        assert line[8] == pytest.approx(CENTRE)
    turned = poses(steps(frozenset({ShotSet.ROTATION})), ShotSet.ROTATION)
    assert np.ptp(turned[:, :3], axis=0).tolist() == [0.0, 0.0, 0.0]
    assert np.degrees(turned[[0, 9, -1], 3]) == pytest.approx([-45.0, 0.0, 45.0])


def test_tests_too_long_are_trimmed_about_their_middle_or_refused() -> None:
    found = steps(config=CONFIG.model_copy(update={"line_lengths_mm": (1100.0, 800.0, 500.0)}))
    line = poses(found, ShotSet.STRAIGHTNESS)[:17]
    used = float(np.ptp(line[:, 0]))
    assert 800.0 < used < 1100.0
    assert line[8] == pytest.approx(CENTRE)
    (note,) = found[1]
    assert note.startswith(f"line along x shortened from 1100 to {used:.4g} mm: ")
    assert "limit" in note or "outside" in note or "reach" in note
    wide = replace(LIMITS, task=(None, None, None, tuple(np.radians([-80.0, 80.0]))))
    robot = Reachable(NOMINAL, replace(wide, forearm_swing_rad=np.radians(20.0)))
    (note,) = steps(frozenset({ShotSet.ROTATION}), robot=robot)[1]
    assert note.startswith("rotation shortened from 160 to ")
    config = CONFIG.model_copy(update={"line_lengths_mm": (800.0, 800.0, 2000.0)})
    with pytest.raises(PlanInvalid, match="line along z of 2000 mm cannot be done"):
        steps(config=config)


def test_pairs_that_the_controller_cannot_take_are_left_out_whole_or_all_refused() -> None:
    narrow = replace(LIMITS, joint=(np.radians(-45.0), np.radians(54.0)))
    found = steps(frozenset({ShotSet.VALIDATION}), robot=Reachable(NOMINAL, narrow))
    assert [step.planned.pair for step in found[0]] == [4, 4]
    (note,) = found[1]
    assert note == "validation pair 2 left out: joint 0 at 55.476° outside [-45°, 54°]"
    narrow = replace(LIMITS, joint=(np.radians(-45.0), np.radians(5.0)))
    with pytest.raises(PlanInvalid, match="nothing to validate: validation pair 2 left out"):
        steps(frozenset({ShotSet.VALIDATION}), robot=Reachable(NOMINAL, narrow))


def test_repeated_pose_is_approached_from_all_around() -> None:
    repeated = of(steps(frozenset({ShotSet.REPEATABILITY})), ShotSet.REPEATABILITY)
    assert {step.planned.pose for step in repeated} == {repeated[0].planned.pose}
    joints = np.array([step.approach[0] for step in repeated])
    away = NOMINAL.forward(joints).values_or_raise()[:, :3] - CENTRE[:3]
    assert np.linalg.norm(away, axis=1) == pytest.approx(APPROACHES_MM[0])
    assert np.abs(away.mean(axis=0)).max() < 0.05 * APPROACHES_MM[0]
    directions = away / APPROACHES_MM[0]
    nearest = np.sort(directions @ directions.T, axis=1)[:, -2]
    assert np.degrees(np.arccos(nearest)).min() > 15.0


@pytest.mark.parametrize(
    "member",
    [
        pytest.param(each, marks=() if each.name == "delta" else pytest.mark.long)
        for each in MEMBERS
    ],
    ids=lambda each: each.name,
)
def test_a_cycle_comes_to_each_of_isos_poses_from_the_same_other_one(member) -> None:
    only, config = frozenset({ShotSet.ISO_CUBE}), ValidationConfig(cube_cycles=3)
    centre, robot = member.shipped.workspace_centre, member.shipped
    region = FeasibleRegion(
        robot.kinematics, robot.limits, centre, np.array([3e3, 0.0, 0.0]), np.eye(3)[0], np.pi
    )
    reach = Reachable(robot.kinematics, robot.limits)
    found, notes = validation_steps(config, (), reach, only, np.random.default_rng(1), region)
    p5, p4, p3, p2, p1 = poses((found, ()), ShotSet.ISO_CUBE)[:5, :3]
    half_mm = 0.5 * np.ptp([p2, p3, p4, p5], axis=0)  # 0.8 of half the cube's edge
    assert half_mm == pytest.approx(np.full(3, half_mm[0]))
    assert half_mm[0] > 0.8 * 0.5 * 250.0
    assert p1 == pytest.approx((p2 + p4) / 2.0)
    assert p1 == pytest.approx((p3 + p5) / 2.0)
    assert notes[0].startswith(f"ISO 9283's cube of {2.0 * half_mm[0] / 0.8:.4g} mm about [")
    turned = [step.planned.pose.theta_rad for step in found]
    assert set(turned) <= {0.0, None}
    joints = [step.planned.joints for step in found]
    assert [step.approach for step in found] == [((*q,),) for q in (joints[4], *joints[:-1])]
    assert joints[:5] * 3 == joints


def test_a_cube_is_as_large_as_said_and_the_workspace_must_hold_one() -> None:
    only, config = frozenset({ShotSet.ISO_CUBE}), ValidationConfig(cube_edge_mm=200.0)
    found, notes = steps(only, config)
    assert len(found) == 150
    assert np.ptp(poses((found, ()), ShotSet.ISO_CUBE)[:, :3], axis=0) == pytest.approx(160.0)
    assert notes == ("ISO 9283's cube of 200 mm about [0, 0, -575] mm",)
    with pytest.raises(PlanInvalid, match="ISO 9283's cube of 3000 mm cannot be done with"):
        steps(only, ValidationConfig(cube_edge_mm=3000.0))


def test_centre_out_of_reach_and_nothing_to_validate_are_refused() -> None:
    config = CONFIG.model_copy(update={"centre_mm": (0.0, 0.0, 100.0)})
    with pytest.raises(PlanInvalid, match="repeatability cannot be done"):
        steps(frozenset({ShotSet.REPEATABILITY}), config)
    with pytest.raises(PlanInvalid, match="nothing to validate: no test was named"):
        steps(frozenset())
    with pytest.raises(PlanInvalid, match="nothing to validate"):
        steps(frozenset({ShotSet.VALIDATION}), pairs=())


def test_unsafe_way_between_poses_is_refused_beforehand(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(RobotModel, "safe_paths", lambda _, stops: [None] * (len(stops) - 1))
    with pytest.raises(PlanInvalid, match="no safe way from validation shot 0 to validation shot"):
        steps()


def test_corrected_poses_bring_the_nominal_controller_to_the_joints_of_the_wanted_ones() -> None:
    real = par4(NOMINAL.parameters | {"plate_mm": 103.0, "arm1.arm_mm": 351.0})
    correct = TargetCorrection(real, NOMINAL, LIMITS).commanded
    found = steps(robot=Reachable(real, LIMITS, correct=correct))
    assert len(found[0]) > 90
    for step in found[0]:
        assert step.corrected is not None
        assert step.corrected != step.planned.pose
        row = pose_row(step.corrected)[None]
        joints = NOMINAL.inverse(row).values_or_raise()[0]
        np.testing.assert_allclose(joints, step.planned.joints, atol=1e-9)
    assert all(step.corrected is None for step in steps()[0])


def test_joints_come_to_every_corrected_pose_from_a_known_side() -> None:
    sides = list[np.ndarray]()

    def correct(poses: np.ndarray, approach: np.ndarray | None) -> KinematicSolution:
        sides.extend([] if approach is None else [approach])
        return KinematicSolution.where(np.ones(len(poses), dtype=bool), poses.copy())

    steps(robot=Reachable(NOMINAL, LIMITS, correct=correct))
    (taken,) = sides
    assert (np.abs(taken) == 1.0).all()


def in_a_plane(robot: Reachable, *only: ShotSet) -> Planned:
    """Tests of a robot in a plane about a point well inside its workspace."""
    config = ValidationConfig(
        centre_mm=(0.0, 300.0, 0.0), line_lengths_mm=(60.0, 60.0, 60.0), cube_edge_mm=60.0
    )
    return validation_steps(config, (), robot, frozenset(only), np.random.default_rng(1))


def test_robot_in_a_plane_is_tested_within_it(tmp_path) -> None:
    robot = read_robot(robot_file(tmp_path, "five-bar")).robot
    five_bar = Reachable(robot.kinematics, robot.limits)
    found = in_a_plane(five_bar, ShotSet.STRAIGHTNESS, ShotSet.REPEATABILITY, ShotSet.ISO_CUBE)
    assert not any(pose_row(step.planned.pose)[2] for step in found[0])
    lines = poses(found, ShotSet.STRAIGHTNESS)
    assert len(lines) == 2 * CONFIG.line_points
    assert np.ptp(lines[:17, 0]) == pytest.approx(60.0)
    assert np.ptp(lines[17:, 1]) == pytest.approx(60.0)
    corners = np.unique(poses(found, ShotSet.ISO_CUBE)[:, :2] - [0.0, 300.0], axis=0)
    assert sorted(map(tuple, np.round(corners, 9).tolist())) == [
        *((-24.0, -24.0), (-24.0, 24.0), (0.0, 0.0), (24.0, -24.0), (24.0, 24.0))
    ]
    # from evenly around a circle, as far away as the robot has room for
    passed = [step.approach[0] for step in of(found, ShotSet.REPEATABILITY)]
    away = robot.kinematics.forward(np.array(passed)).values[:, :2] - [0.0, 300.0]
    assert np.ptp(np.linalg.norm(away, axis=1)) < 1e-6
    assert np.diff(np.sort(np.arctan2(away[:, 1], away[:, 0]))).max() < 0.5


def test_each_of_three_turns_is_tested_by_itself(tmp_path) -> None:
    robot = read_robot(robot_file(tmp_path, "hexapod")).robot
    config = ValidationConfig(centre_mm=(0.0, 0.0, -550.0), rotation_steps=5)
    hexapod, turns = Reachable(robot.kinematics, robot.limits), frozenset({ShotSet.ROTATION})
    found = validation_steps(config, (), hexapod, turns, np.random.default_rng(1))
    turned = np.degrees(poses(found, ShotSet.ROTATION)[:, 3:])
    wanted = [(15.0, 0), (15.0, 1), (20.0, 2)]
    for rows, (limit, axis) in zip(np.split(turned, 3), wanted, strict=True):
        expected = np.zeros((5, 3))
        expected[:, axis] = np.linspace(-limit, limit, 5)
        np.testing.assert_allclose(rows, expected, atol=1e-9)


def test_a_turn_ends_where_the_tracker_loses_the_reflector(tmp_path) -> None:
    """On a platform of its own the reflector turns too, but about the beam it stays in sight."""
    robot = read_robot(robot_file(tmp_path, "hexapod")).robot
    config = ValidationConfig(centre_mm=(0.0, 0.0, -550.0), rotation_steps=5)
    view = View((2500.0, 0.0, -550.0), (1.0, 0.0, 0.0), np.radians(12.0))
    region = region_of(robot, view, pose_of(robot.workspace_centre))
    hexapod, turns = Reachable(robot.kinematics, robot.limits), frozenset({ShotSet.ROTATION})
    found = validation_steps(config, (), hexapod, turns, np.random.default_rng(1), region)
    turned = np.degrees(poses(found, ShotSet.ROTATION)[:, 3:])
    assert np.abs(turned).max(axis=0) == pytest.approx([15.0, 12.0, 12.0], abs=0.1)
    assert found[1] == (
        "rotation shortened from 30 to 24°: the reflector turns 15° from the tracker, limit 12°",
        "rotation shortened from 40 to 24°: the reflector turns 20° from the tracker, limit 12°",
    )
