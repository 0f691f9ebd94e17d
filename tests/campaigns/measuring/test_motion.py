"""Moves by safe ways, and what counts as having arrived."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
from fake_cell import CENTRE, ROBOT, FakeCell, FakeRobot, rounded_deg
from par4_space import par4
from small_plans import LIMITS, OPEN, SETTLE, SPEED_FRACTION, commanded_as_pose, joints_at, planned

from campaigns.errors import Interrupted, NotSettled, TargetOutOfReach
from campaigns.measuring.motion import WAYS_AT_ONCE, Arrival, Mover
from campaigns.measuring.run_state import EngineState
from campaigns.planning.paths import RobotModel
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.steps import Step
from campaigns.robots.robot import pose_row
from campaigns.shots.shot_sets import ShotSet
from drivers.errors import EmergencyStop
from drivers.values import Pose

NEAR = planned(7, ShotSet.ROTATION, None, 120.0, 40.0, -600.0, 0.1)


def go(
    cell: FakeCell, step: Step, speed_fraction=SPEED_FRACTION
) -> tuple[Arrival, list[EngineState]]:
    states: list[EngineState] = []
    mover = Mover(cell.robot, cell.clock, speed_fraction, SETTLE, OPEN, cell.wish)
    return mover.go(step, states.append), states


def moves(cell: FakeCell) -> list[tuple[object, ...]]:
    return [call for call in cell.calls if call[0] in ("robot.move_joints", "robot.move_pose")]


def test_arrival_is_the_robot_at_rest_at_its_target() -> None:
    cell = FakeCell()
    stood = tuple(cell.robot.joints.tolist())
    arrival, states = go(cell, Step(NEAR, "joints"))
    assert states == [EngineState.MOVING, EngineState.SETTLING]
    assert arrival.state.joints == pytest.approx(NEAR.joints)
    assert not arrival.state.moving
    assert arrival.settle_s >= SETTLE.time_s
    assert arrival.came_from == pytest.approx(stood)
    assert arrival.move_s + arrival.settle_s == pytest.approx(cell.clock.now_s())


def test_a_stop_on_the_way_is_passed_and_kept_as_read_and_not_as_commanded() -> None:
    cell = FakeCell()
    via = planned(0, ShotSet.ROTATION, None, 60.0, 0.0, -520.0).joints
    cell.robot.off_target_rad = np.radians([0.0, 0.01, 0.0, 0.0])
    arrival, _ = go(cell, commanded_as_pose(NEAR, (via,)))
    apart_deg = np.degrees(np.subtract(arrival.came_from, via))
    assert apart_deg == pytest.approx([0.0, 0.01, 0.0, 0.0])
    assert moves(cell) == [
        ("robot.move_joints", *rounded_deg(via)),
        ("robot.move_pose", 120.0, 40.0, -600.0, 0.1),
    ]


def test_a_robot_that_stands_where_it_comes_from_goes_straight_on() -> None:
    cell = FakeCell()
    mover = Mover(cell.robot, cell.clock, SPEED_FRACTION, SETTLE, OPEN, cell.wish)
    far = planned(0, ShotSet.ROTATION, None, 60.0, 0.0, -520.0)
    for step in (Step(far, "pose"), commanded_as_pose(NEAR, (far.joints,))):
        mover.go(step, lambda _: None)
    assert len(moves(cell)) == 2
    mover.go(commanded_as_pose(NEAR, (far.joints,)), lambda _: None)
    assert len(moves(cell)) == 4  # it has to come from there again


HERE, THERE = joints_at(213.5, 215.6, -568.9, -0.3), joints_at(-312.2, -81.6, -611.6, -0.7)
"""Ends between which the straight way is not safe, but a way round is."""
FAR = Step(replace(NEAR, joints=tuple(THERE.tolist())), "joints")


def test_next_leg_waits_until_the_robot_is_where_the_leg_before_ends() -> None:
    cell = FakeCell()
    cell.robot.joints = HERE
    cell.robot.off_target_rad = np.array([0.0, 0.01, 0.0, 0.0])
    with pytest.raises(NotSettled, match=r"joint 1 is 0\.5730° from its target"):
        go(cell, FAR)
    assert len(moves(cell)) == 1


def test_robot_that_was_pushed_away_is_led_from_where_it_really_stands() -> None:
    cell = FakeCell()
    mover = Mover(cell.robot, cell.clock, SPEED_FRACTION, SETTLE, OPEN, cell.wish)
    mover.go(Step(NEAR, "joints"), lambda _: None)
    cell.robot.joints = HERE
    cell.calls.clear()
    mover.go(FAR, lambda _: None)
    legs = OPEN.legs(HERE, THERE)
    assert [call[1:] for call in moves(cell)] == [rounded_deg(leg) for leg in legs]


NOWHERE = tuple(np.radians([90.0, -90.0, 90.0, -90.0]).tolist())
HINDRANCES = {
    "unsafe way": ("joints", np.array(NOWHERE), NEAR, TargetOutOfReach, "no safe way to shot 7"),
    "nowhere": ("serial", "R-1", replace(NEAR, joints=NOWHERE), TargetOutOfReach, "no safe way"),
    "never rests": ("keeps_moving", True, NEAR, NotSettled, "moving for 10 s unasked"),
    "e-stop": ("emergency_stop", True, NEAR, EmergencyStop, "is pressed"),
}


@pytest.mark.parametrize(("name", "value", "target", "error", "said"), HINDRANCES.values())
def test_what_hinders_a_move_is_said_before_anything_moves(
    name: str, value: object, target: PlannedShot, error: type[Exception], said: str
) -> None:
    cell = FakeCell()
    setattr(cell.robot, name, value)
    with pytest.raises(error, match=said):
        go(cell, Step(target, "joints"))
    assert not moves(cell)


def test_wish_to_stop_is_looked_at_before_each_leg() -> None:
    cell = FakeCell()
    cell.robot.joints = HERE
    ends_s = np.abs(OPEN.legs(HERE, THERE)[0] - HERE).max() / 0.9
    cell.clock.after(ends_s, cell.wish.ask)
    with pytest.raises(Interrupted):
        go(cell, FAR)
    assert len(moves(cell)) == 1


UNSETTLED = {
    "off target": (
        {"off_target_rad": np.radians([0.0, 0.0, -0.03, 0.0])},
        "joint 2 is 0.0300° from its target (limit 0.02°) and stands there, 10 s after the move",
    ),
    "shakes": (
        {"wobble_rad": np.radians(0.0035)},
        "joint 2 moved 0.0035° within the settling time of 0.2 s (limit 0.002°), 10 s after",
    ),
    "slow": ({"full_speed_rad_s": 0.02}, "(limit 0.02°) and still moves"),
}


@pytest.mark.parametrize(("changes", "said"), UNSETTLED.values(), ids=UNSETTLED)
def test_joint_that_does_not_settle_is_named_with_value_and_limit(changes, said: str) -> None:
    cell = FakeCell()
    for name, value in changes.items():
        setattr(cell.robot, name, value)
    with pytest.raises(NotSettled) as caught:
        go(cell, Step(NEAR, "joints"))
    assert said in caught.value.problem
    assert cell.clock.now_s() == pytest.approx(SETTLE.timeout_s, abs=SETTLE.time_s + 0.05)


LOST_MOTION = par4({**ROBOT.parameters, **{f"arm{arm}.backlash_deg": 0.05 for arm in range(4)}})


@dataclass
class CompensatingRobot(FakeRobot):
    """Its controller takes up lost motion: joints of a pose depend on where it comes from."""

    def move_pose(self, pose: Pose, speed_fraction: float) -> None:
        row = pose_row(pose)[None]
        sides = np.sign(LOST_MOTION.inverse(row).values - self.true_joints())
        self._move(LOST_MOTION.inverse(row, sides).values[0], speed_fraction)


def test_a_pose_is_reached_from_each_side_of_a_lost_motion_that_the_controller_takes_up() -> None:
    """Half of 0.05° is farther than a joint may be off its target; either side is in place."""
    cell = FakeCell()
    cell.robot = CompensatingRobot(cell.clock, cell.calls)
    model = RobotModel(LOST_MOTION, LIMITS, CENTRE)
    mover = Mover(cell.robot, cell.clock, SPEED_FRACTION, SETTLE, model, cell.wish)
    off_deg = []
    for place in (NEAR, planned(8, ShotSet.ROTATION, None, 0.0, 0.0, -520.0, -0.1), NEAR):
        joints = LOST_MOTION.inverse(pose_row(place.pose)[None]).values[0]
        step = commanded_as_pose(replace(place, joints=tuple(joints.tolist())))
        arrival = mover.go(step, lambda _: None)
        off_deg.append(np.degrees(arrival.state.joints - joints))
    assert np.abs(off_deg) == pytest.approx(0.025)
    cell.robot.off_target_rad = np.radians([0.0, 0.08, 0.0, 0.0])
    with pytest.raises(NotSettled) as caught:
        mover.go(step, lambda _: None)
    assert "and stands there" in caught.value.problem
    assert "its controller computes the pose otherwise" in str(caught.value.remedy)
    cell.robot.off_target_rad = np.radians([0.0, 0.021, 0.0, 0.0])
    with pytest.raises(NotSettled):
        mover.go(replace(step, command="joints"), lambda _: None)


def test_robot_that_stands_in_place_is_not_late_because_a_lid_was_closed() -> None:
    cell = FakeCell()
    crept = np.add(NEAR.joints, np.radians([0.0, 0.0, 0.0035, 0.0]))
    sleep_s = cell.clock.sleep_s

    def sleep_through_the_deadline(seconds: float) -> None:
        is_open = cell.clock.now_s() > 3600.0 or cell.robot.state().moving
        sleep_s(seconds if is_open else 3600.0)

    cell.clock.sleep_s = sleep_through_the_deadline
    cell.clock.after(1800.0, lambda: setattr(cell.robot, "joints", crept))
    arrival, _ = go(cell, Step(NEAR, "joints"))
    assert arrival.state.joints == pytest.approx(crept)
    assert cell.clock.now_s() == pytest.approx(3600.0 + SETTLE.time_s, abs=2.0)


def test_move_and_settling_share_one_deadline() -> None:
    cell = FakeCell()
    cell.robot.wobble_rad = np.radians(0.0035)
    slow = 0.02
    with pytest.raises(NotSettled):
        go(cell, Step(NEAR, "joints"), slow)
    assert cell.robot._ends_s > 4.0
    assert cell.clock.now_s() == pytest.approx(SETTLE.timeout_s, abs=SETTLE.time_s + 0.05)


def test_controller_that_goes_on_reporting_motion_is_not_settled() -> None:
    cell = FakeCell()
    arrives_s = np.abs(np.subtract(NEAR.joints, cell.robot.joints)).max() / 0.9
    cell.clock.after(arrives_s + 0.1, lambda: setattr(cell.robot, "keeps_moving", True))
    with pytest.raises(NotSettled, match="the controller still reports motion"):
        go(cell, Step(NEAR, "joints"))


def test_robot_has_moved_when_a_joint_leaves_its_stillness_or_is_no_number() -> None:
    cell = FakeCell()
    mover = Mover(cell.robot, cell.clock, SPEED_FRACTION, SETTLE, OPEN, cell.wish)
    before = cell.robot.state()
    for moved_deg, has_moved in ((0.001, False), (0.003, True), (np.nan, True)):
        cell.robot.joints = np.add(before.joints, np.radians([0.0, 0.0, 0.0, moved_deg]))
        assert mover.has_moved(before) is has_moved


def test_ways_of_a_series_are_found_together_and_are_those_found_one_by_one(monkeypatch) -> None:
    rng, asked = np.random.default_rng(4), []
    places = enumerate(rng.uniform(-220.0, 220.0, (WAYS_AT_ONCE + 3, 2)))
    shots = [planned(n, ShotSet.ROTATION, None, *place, -600.0) for n, place in places]
    narrow = LIMITS.narrowed_by(swing_rad=0.5 * LIMITS.forearm_swing_rad)
    model = RobotModel(OPEN.kinematics, narrow, CENTRE)
    ends = list(pairwise(shot.joints for shot in shots))
    one_by_one = [model.legs(*move) for move in ends]
    assert any(way is None or len(way) > 1 for way in one_by_one)
    find = RobotModel.legs_of
    monkeypatch.setattr(
        RobotModel, "legs_of", lambda of, moves: asked.append(len(moves)) or find(of, moves)
    )
    cell = FakeCell()
    mover = Mover(cell.robot, cell.clock, SPEED_FRACTION, SETTLE, model, cell.wish)
    mover.foresee([Step(shot, "joints") for shot in shots])
    assert [mover._legs(*move) for move in ends] == one_by_one
    assert asked == [WAYS_AT_ONCE, 2]
    assert mover._legs(ends[0][0], ends[4][1]) == model.legs(ends[0][0], ends[4][1])
