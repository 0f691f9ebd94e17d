"""A cell without wires: virtual time, one list of everything that was asked, faults on schedule."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from math import degrees
from pathlib import Path

import numpy as np
from par4_cases import CENTRE, NOMINAL, TRACKER_FROM_BASE
from par4_space import par4
from tested_journal import Told, journal_in
from virtual_time import Act, StopWish, VirtualClock

from campaigns.journal.journal import Journal
from campaigns.kinematics.model import Kinematics
from campaigns.measuring.run_state import Progress, RunObserver, Wishes
from campaigns.measuring.session import measure_series
from campaigns.measuring.work import UNATTENDED_BEAM_WAIT_S, Devices, RawReaders, Work
from campaigns.robots.robot import find_robot
from drivers import values
from drivers.errors import BeamBroken, Cancelled

ROBOT = find_robot("par4-prototype").robot
COVARIANCE_MM2 = ((1e-4, 0.0, 0.0), (0.0, 1e-4, 0.0), (0.0, 0.0, 1e-4))
AIR = values.Weather(20.0, 1013.0, 50.0)
MEASURING_S = 1.0
PATIENCE_S = 0.05


@dataclass
class FakeRobot:
    """Moves its joints evenly in virtual time. `during_move` acts half way through the nth move."""

    clock: VirtualClock
    calls: list[tuple[object, ...]]
    serial: str = "R-1"
    shows_motion: bool = True
    knows_its_time: bool = True
    joints: np.ndarray = field(default_factory=lambda: NOMINAL.inverse(CENTRE[None]).values[0])
    full_speed_rad_s: float = 3.0
    off_target_rad: np.ndarray = field(default_factory=lambda: np.zeros(4))
    wobble_rad: float = 0.0
    fault: str = ""
    emergency_stop: bool = False
    keeps_moving: bool = False
    geometry: dict[str, float] = field(default_factory=lambda: dict(ROBOT.parameters))
    during_move: dict[int, Act] = field(default_factory=dict)
    stop_errors: list[BaseException] = field(default_factory=list)
    state_errors: list[BaseException] = field(default_factory=list)
    stopped_s: float | None = None

    def __post_init__(self) -> None:
        self._from = self.joints
        self._began_s = self._ends_s = 0.0
        self._moves = 0
        self._readings = 0

    def identity(self) -> values.Identity:
        return values.Identity("Acme", "Par4", self.serial, "1.0", "robotline")

    def true_joints(self) -> np.ndarray:
        left_s = self._ends_s - self.clock.now_s()
        if left_s <= 0.0:
            return self.joints
        part = 1.0 - left_s / (self._ends_s - self._began_s)
        return self._from + part * (self.joints - self._from)

    def state(self) -> values.RobotState:
        self._log("robot.state")
        if self.state_errors:
            raise self.state_errors.pop()
        self._readings += 1
        joints = self.true_joints() + (self.wobble_rad * (self._readings % 2)) * np.eye(4)[2]
        moving = self.keeps_moving or self.clock.now_s() < self._ends_s
        raw = f"reading {self._readings}"
        return values.RobotState(
            tuple(joints.tolist()), moving, self.fault, self.emergency_stop, raw
        )

    def move_joints(self, joints: Sequence[float], speed_fraction: float) -> None:
        self._log("robot.move_joints", *rounded_deg(joints))
        self._move(np.array(joints), speed_fraction)

    def move_pose(self, pose: values.Pose, speed_fraction: float) -> None:
        self._log("robot.move_pose", pose.x_mm, pose.y_mm, pose.z_mm, round(pose.theta_rad, 6))
        row = np.array([[pose.x_mm, pose.y_mm, pose.z_mm, pose.theta_rad]])
        self._move(par4(self.geometry).inverse(row).values_or_raise()[0], speed_fraction)

    def stop(self) -> None:
        self._log("robot.stop")
        if self.stop_errors:
            raise self.stop_errors.pop(0)
        self.stopped_s = self.clock.now_s()
        self.joints, self._ends_s = self.true_joints(), self.clock.now_s()

    def read_geometry(self) -> Mapping[str, float]:
        return dict(self.geometry)

    def lacks(self, names: Collection[str]) -> tuple[str, ...]:
        return tuple(names)

    def write_geometry(self, geometry: Mapping[str, float]) -> None:
        self.geometry = dict(geometry)

    def reconnect(self) -> None:
        self._log("robot.reconnect")

    def close(self) -> None:
        pass

    def _move(self, target: np.ndarray, speed_fraction: float) -> None:
        self._from, self._began_s = self.true_joints(), self.clock.now_s()
        self.joints = target + self.off_target_rad
        takes_s = np.abs(self.joints - self._from).max() / (self.full_speed_rad_s * speed_fraction)
        self._ends_s = self._began_s + takes_s
        self._moves += 1
        if act := self.during_move.pop(self._moves, None):
            self.clock.after(0.5 * takes_s, act)

    def _log(self, *call: object) -> None:
        if not (self.calls and call == self.calls[-1] == ("robot.state",)):
            self.calls.append(call)


@dataclass
class FakeTracker:
    """Sees where the true robot's reflector is. `during_measure` acts half way through the nth."""

    clock: VirtualClock
    calls: list[tuple[object, ...]]
    robot: FakeRobot
    truth: Kinematics = NOMINAL
    serial: str = "T-7"
    air: values.Weather = AIR
    shifted_mm: np.ndarray = field(default_factory=lambda: np.zeros(3))
    on_wrong_target: bool = False
    beam_broken: bool = False
    finds: bool = True
    searches: bool = True
    """Whether it finds a reflector from where it points; else only where it is sent."""
    stays_rad: np.ndarray | None = None
    """Where the robot has stayed, whatever its encoders say."""
    tells_direction: bool = False
    during_measure: dict[int, Act] = field(default_factory=dict)
    cancelled: Callable[[], bool] = lambda: False
    measured: int = 0

    def identity(self) -> values.Identity:
        return values.Identity("Leica", "AT403", self.serial, "2.3", "emScon")

    def state(self) -> values.TrackerState:
        return values.TrackerState(values.Readiness.READY, True, True, not self.beam_broken, "CCR")

    def weather(self) -> values.Weather:
        return self.air

    def reflectors(self) -> tuple[values.Reflector, ...]:
        return (values.Reflector("CCR", 1, 19.05),)

    def prepare(self, reflector: str, measuring_time_s: float) -> None:
        pass

    def measure(self) -> values.Measurement:
        self.calls.append(("tracker.measure",))
        self.measured += 1
        if act := self.during_measure.pop(self.measured, None):
            self.clock.after(0.5 * MEASURING_S, act)
        self._wait(MEASURING_S)
        if self.beam_broken:
            raise BeamBroken("the beam is broken", remedy="find the reflector")
        raw = f"measurement {self.measured}"
        return values.Measurement(self.seen_mm(), COVARIANCE_MM2, self.air, raw)

    def seen_mm(self) -> values.Vector3:
        if self.on_wrong_target:
            return (1000.0, 2000.0, 300.0)
        joints = self.robot.true_joints() if self.stays_rad is None else self.stays_rad
        plate = self.truth.forward(joints[None]).values_or_raise()[:, :3]
        point = TRACKER_FROM_BASE.apply(plate)[0] + self.shifted_mm
        return tuple(point.tolist())

    def direction(self) -> values.Vector3 | None:
        if not self.tells_direction:
            return None
        point_mm = np.array(self.seen_mm())
        return tuple((point_mm / np.linalg.norm(point_mm)).tolist())

    def go_to(self, point_in_tracker_mm: values.Vector3) -> None:
        self.calls.append(("tracker.go_to", tuple(round(v, 1) for v in point_in_tracker_mm)))
        self.on_wrong_target = False
        away_mm = np.linalg.norm(np.subtract(point_in_tracker_mm, self.seen_mm()))
        self._look(found=self.finds and bool(away_mm < 50.0))

    def find_reflector(self, distance_mm: float) -> None:
        """Searches where it points: one on a wrong target finds that again."""
        self.calls.append(("tracker.find_reflector", distance_mm))
        self._look(found=self.finds and self.searches)

    def reconnect(self) -> None:
        pass

    def close(self) -> None:
        pass

    def leave_robot(self) -> None:
        self.stays_rad = self.robot.true_joints()

    def break_beam(self) -> None:
        self.beam_broken = True

    def hide_reflector(self) -> None:
        self.beam_broken, self.finds = True, False

    def take_wrong_target(self) -> None:
        self.on_wrong_target = True

    def take_right_target(self) -> None:
        self.on_wrong_target = False

    def _look(self, *, found: bool) -> None:
        self._wait(MEASURING_S)
        self.beam_broken = not found
        if not found:
            raise BeamBroken("no reflector found", remedy="look for it")

    def _wait(self, seconds: float) -> None:
        """As a link waits: looking now and then whether the operator wants to stop."""
        end_s = self.clock.now_s() + seconds
        while (left_s := end_s - self.clock.now_s()) > 1e-9:
            if self.cancelled():
                raise Cancelled("the measurement was abandoned", remedy="start again when ready")
            self.clock.sleep_s(min(left_s, PATIENCE_S))


@dataclass
class FakeCell:
    """Robot, tracker and operator of one process, and the list of all that was asked of them."""

    truth: Kinematics = NOMINAL
    calls: list[tuple[object, ...]] = field(default_factory=list)
    beam_wait_s: float = UNATTENDED_BEAM_WAIT_S
    raw_readers: RawReaders | None = None

    def __post_init__(self) -> None:
        self.clock = VirtualClock()
        self.wish = StopWish(self.clock)
        self.robot = FakeRobot(self.clock, self.calls)
        self.tracker = FakeTracker(self.clock, self.calls, self.robot, self.truth)
        self.tracker.cancelled = self.wish
        self.observer = Listener()
        self.wishes = Wishes(self.wish)

    @property
    def devices(self) -> Devices:
        clock, wait_s = self.clock, self.beam_wait_s
        readers = self.raw_readers
        return Devices(
            self.robot, self.tracker, clock, clock, raw_readers=readers, beam_wait_s=wait_s
        )

    def measure(self, journal: Journal, work: Work, *, anew: bool = False) -> int:
        return measure_series(self.devices, journal, work, self.observer, self.wishes, anew=anew)

    def run(self, folder: Path, work: Work, *, anew: bool = False) -> Told:
        """Measure, and read what the journal on the disk holds of it."""
        with journal_in(folder, self.calls) as journal:
            self.measure(journal, work, anew=anew)
        return Told(folder)

    def named(self, name: str) -> list[tuple[object, ...]]:
        return [call for call in self.calls if call[0] == name]


@dataclass
class Listener(RunObserver):
    """Remembers what it was told."""

    told: list[Progress] = field(default_factory=list)
    events: list[str] = field(default_factory=list)

    def progress(self, progress: Progress) -> None:
        self.told.append(progress)

    def event(self, text: str) -> None:
        self.events.append(text)


def rounded_deg(joints: Sequence[float]) -> tuple[float, ...]:
    return tuple(round(degrees(joint), 2) for joint in joints)
