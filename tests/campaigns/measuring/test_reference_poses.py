"""Spread poses measured again: tracker, encoder or robot, and nothing where it is only scatter."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fake_cell import NOMINAL, ROBOT, TRACKER_FROM_BASE, FakeCell
from par4_space import par4
from small_plans import FOUR_PAIRS, interrupted, work
from tested_journal import journal_in

from campaigns.errors import GateRefused
from campaigns.fit.rigid_transforms import from_paper_angles
from campaigns.fit.tracker_noise import TrackerUncertainty
from campaigns.journal.records import Outcome
from campaigns.kinematics.model import Kinematics
from campaigns.measuring.reference_poses import ReferenceNoise, reference_poses, rigid_body_test
from campaigns.planning.steps import joint_steps

STD_MM = 0.015
STEPS = joint_steps(FOUR_PAIRS)
NOISE = ReferenceNoise(TrackerUncertainty(), 0.0)
COVARIANCE = tuple(tuple(row) for row in (STD_MM**2 * np.eye(3)).tolist())
TRUE = par4({**ROBOT.parameters, "arm1.arm_mm": ROBOT.parameters["arm1.arm_mm"] + 0.8})


def outcomes(
    rng: np.random.Generator,
    robot: Kinematics = TRUE,
    slip_rad: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0),
    std_mm: float = STD_MM,
) -> list[Outcome]:
    """All shots as a tracker sees them; they stand up to 0.01° beside their targets."""
    joints = np.array([shot.joints for shot in FOUR_PAIRS])
    read = joints + rng.uniform(-1.7e-4, 1.7e-4, joints.shape)
    points = TRACKER_FROM_BASE.apply(robot.forward(read + slip_rad).values_or_raise()[:, :3])
    points = points + rng.normal(0.0, std_mm, points.shape)
    return [
        Outcome(shot.shot, 1, tuple(q), tuple(point), COVARIANCE, None, "", "", None)
        for shot, q, point in zip(FOUR_PAIRS, read.tolist(), points.tolist(), strict=True)
    ]


def comparison(then: list[Outcome], now: list[Outcome], noise: ReferenceNoise = NOISE):
    poses = reference_poses(STEPS, then)
    first = [first for _, first in poses]
    again = [now[step.planned.shot] for step, _ in poses]
    return rigid_body_test(NOMINAL, then, first, again, noise)


def compared(then: list[Outcome], now: list[Outcome], noise: ReferenceNoise = NOISE):
    return comparison(then, now, noise).change


def test_poses_are_spread_if_there_are_enough_off_a_line() -> None:
    shots = outcomes(np.random.default_rng(1))
    poses = reference_poses(STEPS, shots)
    assert poses[0][0].planned.shot == 0
    assert len({step.planned.shot for step, _ in poses}) == 4
    places = np.array([first.point_in_tracker_mm for _, first in poses[:3]])
    assert np.linalg.svd(places - places.mean(axis=0), compute_uv=False)[1] > 100.0
    line = [replace(s, point_in_tracker_mm=(100.0 * n, 0.0, 2000.0)) for n, s in enumerate(shots)]
    point = [replace(s, point_in_tracker_mm=(0.0, 0.0, 2000.0)) for s in shots]
    counts = [len(reference_poses(STEPS, few)) for few in ([], shots[:2], shots[:3], line, point)]
    assert counts == [0, 1, 3, 1, 1]


def test_scatter_of_the_tracker_and_of_the_robot_is_no_change() -> None:
    rng = np.random.default_rng(2)
    robot = ReferenceNoise(TrackerUncertainty(), 0.2)
    for _ in range(15):
        assert not compared(outcomes(rng), outcomes(rng))
        worn = compared(outcomes(rng, std_mm=0.2), outcomes(rng, std_mm=0.2), robot)
        assert not worn


def test_moved_tracker_is_told_by_how_much() -> None:
    rng = np.random.default_rng(3)
    then, still = outcomes(rng), outcomes(rng)
    turn = from_paper_angles(np.array([1e-4, -5e-5, 0.0]), np.zeros(3)).rotation
    now = [
        replace(s, point_in_tracker_mm=tuple(turn @ s.point_in_tracker_mm + (0.0, 0.1, 0.0)))
        for s in still
    ]
    found = compared(then, now)
    assert found.startswith("the tracker, its stand or the robot's base has moved")
    assert "encoder" not in found


@pytest.mark.parametrize("joint", [0, 3])
def test_slipped_encoder_is_named_with_its_angle(joint: int) -> None:
    rng = np.random.default_rng(4)
    slip = np.zeros(4)
    slip[joint] = np.radians(0.05)
    found = compared(outcomes(rng), outcomes(rng, slip_rad=tuple(slip)))
    assert re.match(rf"the encoder of joint q{joint} has changed by \+0\.0(4[5-9]|5[0-5])°", found)


def test_grown_arm_is_neither_trackers_nor_an_encoders() -> None:
    rng = np.random.default_rng(5)
    forearm_mm = ROBOT.parameters["arm2.forearm_mm"]
    grown = par4({**ROBOT.parameters, "arm2.forearm_mm": forearm_mm + 1.0})
    found = compared(outcomes(rng, NOMINAL), outcomes(rng, grown))
    assert found.startswith("the robot has changed: the points moved by")


def test_only_what_no_motion_of_the_stand_explains_is_a_change_of_the_robot() -> None:
    rng = np.random.default_rng(8)
    then, still = outcomes(rng), outcomes(rng)
    turn = from_paper_angles(np.array([1e-4, -5e-5, 0.0]), np.zeros(3)).rotation
    moved = [replace(s, point_in_tracker_mm=tuple(turn @ s.point_in_tracker_mm)) for s in still]
    slipped = outcomes(rng, slip_rad=(0.0, float(np.radians(0.3)), 0.0, 0.0))
    both = [replace(s, point_in_tracker_mm=tuple(turn @ s.point_in_tracker_mm)) for s in slipped]
    of_robot = [comparison(then, now).is_robots for now in (still, moved, slipped, both)]
    assert of_robot == [False, False, True, True]


def test_moved_farther_than_the_limit_and_scatter_of_few_shots_allow() -> None:
    rng = np.random.default_rng(6)
    loose = ReferenceNoise(TrackerUncertainty(), 2.0, limit_mm=1.0)
    now = [
        replace(s, point_in_tracker_mm=tuple(np.add(s.point_in_tracker_mm, (0.0, 1.2, 0.0))))
        for s in outcomes(rng)
    ]
    assert compared(outcomes(rng), now, loose)
    assert not compared(outcomes(rng), now, replace(loose, limit_mm=5.0))
    rng = np.random.default_rng(6)
    now = outcomes(rng, std_mm=3.0 * STD_MM)
    assert compared(outcomes(rng), now)
    assert not compared(outcomes(rng), now, replace(NOISE, freedom=4.0))
    worse = replace(NOISE, point_mm=3.0 * STD_MM)
    assert not compared(outcomes(rng), now, worse)


def test_stand_that_was_bumped_ends_the_run_before_anything_is_measured(tmp_path: Path) -> None:
    cell = FakeCell()
    cell.tracker.shifted_mm[:] = (0.6, 0.6, 0.6)
    interrupted(tmp_path, 8, FOUR_PAIRS)
    with journal_in(tmp_path, cell.calls) as journal:
        kept = [shot.outcome for shot in journal.shots(1)]
        with pytest.raises(GateRefused, match="the tracker, its stand or the robot's base") as said:
            cell.measure(journal, work(FOUR_PAIRS))
        assert [shot.outcome for shot in journal.shots(1)] == [
            each for each in kept if each.shot != 7
        ]
    assert "--anew" in said.value.remedy
    assert "--force" in said.value.remedy
    assert len(cell.named("robot.stop")) == 1
