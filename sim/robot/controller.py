"""The simulated controller: its axes' motions in time, its limits, troubles and parameters.

Theory of operation. The controller has no thread and no timer. Every call brings the time, and
`_advance` first carries out what has ended by then; so the state is the same whether it is asked a
thousand times during a motion or once after it. A move goes through these steps:

1. readiness, speed and limits are checked, in this order; the first that fails is a `Refusal`;
2. a pose becomes joints by the controller's own parameters, which are not the true robot's;
3. the driven robot says how much of the straight joint path its mechanism can follow; a mechanism
   that holds the axes, or a scripted fault, shortens the motion and leaves a trouble at its end;
4. the encoders follow a smooth profile until the motion's end;
5. there the robot arrives: only then its play, scatter and yielding are drawn and kept.

Encoders read whole steps, and they read the commanded joints: what gears add is behind them.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.values import RobotState
from sim.errors import AssemblyLost
from sim.faults import Counted, Fault, FaultScript
from sim.geometry import PAR4, Array, Kind, PlateKind, geometry_of, problem_with
from sim.random_streams import WorkedTime, target_key
from sim.robot.assembly import OutOfReach, joints_for
from sim.robot.bars import EquationsOf, free_mechanism
from sim.robot.driven_robot import DrivenRobot
from sim.robot.section import ControllerSection
from sim.robot.tilting_kinematics import KnownPlate, is_level, tilted_joints_for
from sim.robot.transmission import readings_for

PEAK_OF_SMOOTH = 1.875
"""Highest speed of the smooth profile over its mean: derivative of `smooth` in the middle."""
FARTHEST_MM = 1e6
"""Coordinate beyond any robot, below which squares of lengths do not overflow."""
SHORTEST_S = 0.05
"""Least duration of a motion."""
BRAKING_S = 0.05
HALFWAY = 0.5
HELD_FOR_S = 10.0
"""Time until an operator has acknowledged that the mechanism held the axes."""
LIMIT_ROUNDING = 1e-9
"""Excess over a limit that the conversion of units can cause, rad or mm."""

Profile = Callable[[float], float]


def smooth(part_of_time: float) -> float:
    """Return the travelled part; starts and ends without speed or acceleration."""
    # the polynomial of least degree with these six conditions, 10 t³ - 15 t⁴ + 6 t⁵
    t = part_of_time
    return t * t * t * (10.0 - t * (15.0 - 6.0 * t))


def braking(part_of_time: float) -> float:
    """Return the travelled part; from full speed to rest at constant deceleration."""
    return part_of_time * (2.0 - part_of_time)


@dataclass(frozen=True, slots=True, eq=False)
class AxisMotion:
    """Motion of all joints together, along a straight joint path from rest or speed to rest."""

    start: Array
    """(n,) rad or mm"""
    target: Array
    start_s: float
    duration_s: float
    profile: Profile

    @property
    def end_s(self) -> float:
        """Time of the motion's end."""
        return self.start_s + self.duration_s

    def joints(self, now_s: float) -> Array:
        """Return the joints (n,) at a time; before the start and after the end they rest."""
        part = (now_s - self.start_s) / self.duration_s
        travelled = self.profile(min(max(part, 0.0), 1.0))
        return self.start + travelled * (self.target - self.start)


def plan_motion(
    start: Array, target: Array, speed_per_s: float | Array, now_s: float
) -> AxisMotion:
    """Plan a motion in which the joint that needs longest just reaches its speed."""
    longest_s = float((PEAK_OF_SMOOTH * abs(target - start) / speed_per_s).max())
    duration_s = max(longest_s, SHORTEST_S)
    return AxisMotion(start, target, now_s, duration_s, smooth)


def brake(motion: AxisMotion, now_s: float) -> AxisMotion:
    """Brake a motion at once on its own path; one that is nearly over stays unchanged."""
    remaining_s = motion.end_s - now_s
    if remaining_s < 1.5 * BRAKING_S:
        return motion
    # Constant deceleration from the present speed v covers v · BRAKING_S / 2. The speed is taken by
    # a difference over a glimpse, for a profile may be any function.
    here = motion.joints(now_s)
    glimpse_s = 1e-3 * BRAKING_S
    ahead = motion.joints(now_s + glimpse_s) - here
    target = here + ahead * (0.5 * BRAKING_S / glimpse_s)
    return AxisMotion(here, target, now_s, BRAKING_S, braking)


class Refusal(Exception):
    """The controller refuses. `code` is LIMIT, REACH, FAULT, ESTOP, BUSY or GEOMETRY."""

    def __init__(self, code: str, text: str) -> None:
        super().__init__(code, text)
        self.code = code
        self.text = text


@dataclass(frozen=True, slots=True)
class _Trouble:
    """Reason why the robot stands although no stop was requested, and when it ends."""

    kind: str
    text: str
    until_s: float


NO_TROUBLE = _Trouble("", "", math.inf)


@dataclass(frozen=True, slots=True)
class ControllerKinematics:
    """Inverse kinematics that a controller can compute; parameters come with each call."""

    kind: Kind = PAR4
    plate: KnownPlate | None = None
    """Sizes of the plate, with which it computes the plate's tilt; None: it cannot."""
    ripple_rate: float | Array | None = None
    """Turn of each motor for 1 rad or mm of its joint, one for all or (n,), with which it computes
    errors of gears and encoders; None: it cannot."""
    equations: EquationsOf | None = None
    """Equations of a mechanism that has no parts here."""

    @property
    def extensions(self) -> tuple[str, ...]:
        """Flat names of the parameters of imperfect parts that it computes with."""
        has_tilts = self.plate is not None or not isinstance(self.kind, PlateKind)
        tilts = self.kind.extensions if has_tilts else ()
        gears = (*self.kind.transmission, self.kind.rate)
        return tilts if self.ripple_rate is None else tilts + gears

    def encoders_for(
        self, flat: Mapping[str, float], position_mm: Array, turn_rad: float, present: Array
    ) -> Array:
        """Compute the encoder readings (n,) of a pose by flat parameters, from present readings.

        Raises `OutOfReach`.
        """
        kind = self.kind
        if not isinstance(kind, PlateKind):
            mechanism = free_mechanism(kind, flat, self.equations)
            joints = mechanism.joints_for(np.array([*position_mm, 0.0, 0.0, turn_rad]))
        elif self.plate is None or is_level(flat, kind):
            joints = joints_for(geometry_of(flat, kind), position_mm, turn_rad)
        else:
            joints = tilted_joints_for(flat, kind, self.plate, position_mm, turn_rad)
        if self.ripple_rate is None:
            return joints
        # the loaded parameters may hold the ripples' rate; else it is that of the drawing
        stated = flat.get(kind.rate, 0.0)
        rate = self.ripple_rate
        if stated:
            rate = stated if kind.rate == "ripples_per_turn" else math.tau / stated
        return readings_for(flat, kind, rate, joints, present)


PLAIN_PAR4 = ControllerKinematics()


class SimulatedController:
    """A controller with its own clockwork: every call gets the time."""

    vendor = "pkmcal"
    firmware = "1.0"

    def __init__(
        self,
        section: ControllerSection,
        robot: DrivenRobot,
        *,
        geometry: Mapping[str, float],
        faults: FaultScript,
        worked: WorkedTime,
        kinematics: ControllerKinematics = PLAIN_PAR4,
    ) -> None:
        self.kind = kind = kinematics.kind
        self._kinematics = kinematics
        self.model = f"simulated {'Par4' if kind is PAR4 else kind.name} controller"
        self.serial = section.serial
        self._limits = section.limits(kind)
        self._speed_per_s = section.speed_per_s(kind)
        self._encoder_step = section.encoder_step(kind)
        self._lies = section.lies
        self.watchdog_s = section.watchdog_s
        self._robot = robot
        self._first = robot.standing
        self._geometry = dict(geometry)
        self._joints = robot.standing.encoders
        self._faults = faults
        self._worked = worked
        self._motion: AxisMotion | None = None
        self._ends_in = NO_TROUBLE
        """Trouble that the present motion leaves at its end."""
        self._trouble = NO_TROUBLE
        if section.emergency_stop:
            self._trouble = _Trouble("emergency_stop", "emergency stop pressed", math.inf)

    def state(self, now_s: float) -> RobotState:
        """Read the encoders now."""
        moving, trouble = self.is_moving(now_s), self._trouble
        return RobotState(
            joints=tuple(map(float, self.encoders(now_s))),
            moving=moving,
            fault=trouble.text if trouble.kind != "stall" else "",
            emergency_stop=trouble.kind == "emergency_stop",
        )

    def reported(self, now_s: float) -> RobotState:
        """Return the state as a server of this controller reports it, which may be wrong."""
        state = self.state(now_s)
        if self._motion is not None and "targets as encoders" in self._lies:
            state = replace(state, joints=tuple(map(float, self._motion.target)))
        return replace(state, moving=state.moving and "never moving" not in self._lies)

    def is_moving(self, now_s: float) -> bool:
        """Whether the controller reports that the robot moves."""
        self._advance(now_s)
        # The fault "stall": a motion that has ended is reported as going on, until a stop request.
        return self._motion is not None or self._trouble.kind == "stall"

    def encoders(self, now_s: float) -> Array:
        """Return (n,): the encoders now, rad or mm, whole steps of the encoders' resolution."""
        self._advance(now_s)
        if self._motion is None:
            return self._joints
        return self._round_to_steps(self._motion.joints(now_s))

    def move_joints(self, target: Sequence[float], speed_fraction: float, now_s: float) -> float:
        """Start a joint move and return its duration, s; raises `Refusal`."""
        self._check_ready(now_s)
        self._check_speed(speed_fraction)
        joints = np.array(target, dtype=float)
        self._check_limits(joints)
        return self._start(self._round_to_steps(joints), speed_fraction, now_s)

    def move_pose(
        self,
        x_mm: float,
        y_mm: float,
        z_mm: float,
        theta_rad: float,
        speed_fraction: float,
        now_s: float,
    ) -> float:
        """Start a move to a pose by this controller's own kinematics; raises `Refusal`."""
        self._check_ready(now_s)
        position_mm = np.array([x_mm, y_mm, z_mm])
        if not np.isfinite([*position_mm, theta_rad]).all():
            raise Refusal("REACH", "the pose is not made of finite numbers")
        if np.abs(position_mm).max() > FARTHEST_MM:
            raise Refusal("REACH", f"the pose is {np.abs(position_mm).max():g} mm away")
        try:
            joints = self._kinematics.encoders_for(
                self._geometry, position_mm, theta_rad, self._joints
            )
        except OutOfReach as reason:
            raise Refusal("REACH", str(reason)) from reason
        return self.move_joints(joints.tolist(), speed_fraction, now_s)

    def follow(self, joints: Sequence[float]) -> None:
        """Put the robot at the joints, rad or mm, at which a real controller's robot stands.

        The simulated robot takes the straight joint path. Raise `AssemblyLost` if it cannot be at
        these joints.
        """
        # A real controller that was restarted may state joints far away, to which no straight way
        # leads from the present ones. The way is then tried from where this robot stood first.
        target = np.array(joints)
        if np.array_equal(target, self._joints):
            return
        if self._robot.passable_part(target) < 1.0:
            self._robot.standing = self._first
            if self._robot.passable_part(target) < 1.0:
                raise AssemblyLost(
                    f"the simulated robot cannot be at joints {self.kind.listed(target, '.2f')}",
                    remedy="keep the real controller's joints inside its workspace",
                )
        self._robot.arrive(target, target_key(target.tolist()))
        self._worked.seconds += float((np.abs(target - self._joints) / self._speed_per_s).max())
        self._joints = target

    @property
    def extensions(self) -> tuple[str, ...]:
        """Flat names of the parameters of imperfect parts that the controller's kinematics has."""
        return self._kinematics.extensions

    def stop(self, now_s: float) -> None:
        """Brake at once in any state; `state` reports when the robot stands."""
        self._advance(now_s)
        if self._trouble.kind == "stall":
            self._trouble = NO_TROUBLE
        if self._motion is not None:
            self._motion = brake(self._motion, now_s)
            # the braked motion ends short of where the fault or the mechanism would have stopped it
            self._ends_in = NO_TROUBLE

    def geometry(self) -> dict[str, float]:
        """Return the active parameters by their flat names, mm and deg."""
        return dict(self._geometry)

    def replace_geometry(self, geometry: Mapping[str, float], now_s: float) -> None:
        """Replace all parameters at once, or raise `Refusal` and keep the old ones."""
        if self.state(now_s).moving:
            raise Refusal("BUSY", "the robot is moving")
        if problem := problem_with(geometry, self.kind, extensions=self.extensions):
            raise Refusal("GEOMETRY", problem)
        self._geometry = {name: float(value) for name, value in geometry.items()}

    def _advance(self, now_s: float) -> None:
        """End the motion and the trouble whose time has come."""
        motion = self._motion
        if motion is not None and now_s >= motion.end_s:
            self._motion = None
            self._joints = self._round_to_steps(motion.target)
            self._robot.arrive(self._joints, target_key(self._joints.tolist()))
            # the nominal duration counts, however late this call is
            self._worked.seconds += motion.duration_s
            self._trouble = self._ends_in
        if now_s >= self._trouble.until_s:
            self._trouble = NO_TROUBLE

    def _start(self, target: Array, speed_fraction: float, now_s: float) -> float:
        """Start the motion to a target, as far as it goes, and return the whole one's duration."""
        # The client gets the duration of the whole motion even if a fault will shorten it: a real
        # controller does not foresee its faults either.
        fault = self._faults.next(Counted.MOVE)
        part = self._robot.passable_part(target)
        if fault is not None and part > HALFWAY:
            part = HALFWAY
        speed_per_s = speed_fraction * self._speed_per_s
        whole = plan_motion(self._joints, target, speed_per_s, now_s)
        if part < 1.0:
            target = self._joints + part * (target - self._joints)
        self._motion = plan_motion(self._joints, target, speed_per_s, now_s)
        self._ends_in = _trouble_after(fault, part, self._motion.end_s)
        return whole.duration_s

    def _check_ready(self, now_s: float) -> None:
        state = self.state(now_s)
        if state.emergency_stop:
            raise Refusal("ESTOP", "the emergency stop is pressed")
        if state.fault:
            raise Refusal("FAULT", state.fault)
        if state.moving:
            raise Refusal("BUSY", "the robot is moving")

    def _check_speed(self, speed_fraction: float) -> None:
        if not 0.0 < speed_fraction <= 1.0:
            raise Refusal("LIMIT", f"speed {speed_fraction:g} is outside 0 to 1")

    def _check_limits(self, target: Array) -> None:
        kind = self.kind
        if target.shape != (kind.arms,):
            raise Refusal("LIMIT", f"{target.size} joints were given, the robot has {kind.arms}")
        for joint, (value, lowest, highest) in enumerate(zip(target, *self._limits, strict=True)):
            if not lowest - LIMIT_ROUNDING <= value <= highest + LIMIT_ROUNDING:
                limits = f"{kind.text(joint, lowest, 'g')} to {kind.text(joint, highest, 'g')}"
                raise Refusal(
                    "LIMIT", f"joint {joint} to {kind.text(joint, value, '.4f')}, limits {limits}"
                )

    def _round_to_steps(self, joints: Array) -> Array:
        step = self._encoder_step
        steps: Array = np.round(joints / step)
        return steps * step


def _trouble_after(fault: Fault | None, part: float, end_s: float) -> _Trouble:
    """Return the trouble at a motion's end: a scripted fault, or axes held by the mechanism."""
    if fault is not None:
        texts = {"emergency_stop": "emergency stop pressed", "drive_fault": "drive fault axis 2"}
        until_s = math.inf if fault.seconds is None else end_s + fault.seconds
        return _Trouble(fault.kind, texts.get(fault.kind, ""), until_s)
    if part < 1.0:
        return _Trouble("drive_fault", "following error: the mechanism is held", end_s + HELD_FOR_S)
    return NO_TROUBLE
