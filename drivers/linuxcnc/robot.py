"""Drives LinuxCNC: comes to it and leaves it, starts, watches and stops its moves."""

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from math import degrees, inf

from typing_extensions import override

from drivers import errors, stopping
from drivers.declaration import RobotSurroundings
from drivers.link import never
from drivers.linuxcnc.client import LinuxcncClient
from drivers.linuxcnc.machine_state import Machine, Snapshot, agree
from drivers.linuxcnc.machine_state import joints_said as joints_said
from drivers.linuxcnc.moves import MachinePlace, block, rounded, way_to
from drivers.linuxcnc.settings import Coordinates, LinuxcncSettings, PosesOfJoints
from drivers.polling import comes_true
from drivers.ports import Clock, RobotController
from drivers.session import DeviceSession
from drivers.transport import CONNECT_S, Opener
from drivers.values import Identity, Pose, RobotState

SAME_KINEMATICS = 1e-3
"""mm or deg, between what LinuxCNC says and what its joints and the parameters make of it: far
above rounding, far below what another kinematics or another robot would give."""
MDI = "mdi"
PER_MINUTE = "G94"
"""The mode of feed that an operator expects: after a paced move, F is a time."""
READINGS = 3
READING_PAUSE_S = 0.005
MESSAGES_KEPT = 5
RESTART = "see that the robot stands, restart LinuxCNC"


class LinuxcncRobot(RobotController):
    """A controller at the other end of a connection that has control of it.

    Connecting stops whatever moves: LinuxCNC itself finishes a motion whose client was lost. Any
    fault of the wire closes it, and every call but `stop` raises `LinkDown` until `reconnect`.
    `clock` is real time.
    """

    def __init__(
        self,
        open_transport: Opener,
        *,
        clock: Clock,
        settings: LinuxcncSettings,
        cancelled: Callable[[], bool] = never,
        alarm: stopping.Alarm = stopping.unheard,
    ) -> None:
        self._open_transport = open_transport
        self._clock = clock
        self._settings, self._deadlines = settings, settings.deadlines
        self._store = settings.store
        self._poses_of: PosesOfJoints | None = None
        self._stopping = stopping.StopProcedure(
            clock,
            within_s=settings.deadlines.stop_s,
            answer_s=settings.deadlines.stop_answer_s,
            pause_s=settings.deadlines.poll_s,
            cancelled=cancelled,
            alarm=alarm,
        )
        self._session = DeviceSession("controller", self._opened, self._greet)
        self._machine = Machine(self._session, clock, settings)
        self._target: MachinePlace | None = None
        self._messages: tuple[str, ...] = ()
        self._seen: tuple[float, ...] = ()
        self._changed_s = 0.0

    @override
    def connect(self) -> None:
        self._poses_of = None
        with self._stopping.undisturbed():
            self._enter()
        self._forget_motion()

    def reconnect(self) -> None:
        """Open anew after a fault of the wire, and stop what moves before anything else."""
        self.connect()

    def prepare(self) -> None:
        """Release the e-stop, switch on, home if need be. Homing may move the robot.

        A homing that fails, or that the operator wants to stop, is stopped first. Raises
        `EmergencyStop`, `MotionFault` or `DeviceRefused` with LinuxCNC's words, and `WrongDevice`
        when another kinematics than the robot's, or with other parameters, is at work.
        """
        self._machine.switch_on()
        if not self._machine.is_homed():
            try:
                self._machine.home()
            except BaseException:  # also an interrupt: nobody watches it any more
                self.stop()
                raise
        self._machine.enter_mdi()
        self._forget_motion()
        self._poses_of = None
        self._check_kinematics()

    def identity(self) -> Identity:
        """The machine that answered when the connection was opened."""
        return self._session.identity

    def state(self) -> RobotState:
        """The joints as read now. It takes up to some 10 ms to be sure that they stand."""
        first = self._machine.snapshot()
        standing = self._standing(first)
        snapshot, moving = standing or first, standing is None
        for message in self._machine.client.messages():
            if message not in self._messages:
                self._messages = (*self._messages, message)[-MESSAGES_KEPT:]
        fault = self._fault(snapshot, moving=moving)
        if not (moving or fault):
            self._target = None
        self._machine.require_plausible(snapshot.joints)
        return RobotState(
            joints=tuple(map(self._settings.from_machine, snapshot.joints)),
            moving=moving,
            fault=fault,
            emergency_stop=snapshot.emergency_stop,
            raw=snapshot.raw,
        )

    def move_joints(self, joints: Sequence[float], speed_fraction: float) -> None:
        """Start a move to joints; raises `LimitViolation`, `MotionFault` or `EmergencyStop`.

        A controller that works in world coordinates is led along by poses.
        """
        self._start(joints, None, speed_fraction)

    def move_pose(self, pose: Pose, speed_fraction: float) -> None:
        """Start a move to a pose; raises like a joint move.

        By LinuxCNC's own kinematics, or, where it only takes joints, converted with the stored set.
        """
        joints = self._active().joints(pose)
        self._settings.check(joints)
        if not self._works_in_world:
            joints = self._active().joints(pose, self._here())
        self._start(joints, pose, speed_fraction)

    def stop(self) -> None:
        """Stop at once, also when the wire is down or another client has control.

        Returns when LinuxCNC has been seen to stand; raises `RobotStateUnknown`.
        """
        self._stopping.insist(self._session, self._stop_and_watch, self.close)

    @override
    def read_geometry(self) -> Mapping[str, float]:
        return self._store.read()

    def lacks(self, names: Collection[str]) -> tuple[str, ...]:
        """Parameters among the named ones that its kinematics does not have."""
        return self._store.lacks(names)

    def write_geometry(self, geometry: Mapping[str, float]) -> None:
        """Replace all parameters, or none; the robot must stand.

        Where LinuxCNC itself works with them, its drives are switched off first and stay off: with
        the power on, the joints would jump to where the new parameters put them.
        """
        self.identity()  # raises `LinkDown` without a connection
        with self._stopping.undisturbed():
            self._write_geometry(geometry)

    def close(self) -> None:
        """Stop, give control back, close; raises `RobotStateUnknown` when a motion may go on."""
        if not self._session.is_open:
            return
        try:
            with self._stopping.undisturbed():
                self._give_back(self._session.connection)
        except errors.DriverError as error:
            if self._target is not None:
                raise stopping.state_unknown(
                    f"LinuxCNC could not be left standing ({error.problem})"
                ) from error
        finally:
            self._session.close()

    def _write_geometry(self, geometry: Mapping[str, float]) -> None:
        if self._works_in_world:
            if self._is_moving():
                raise errors.DeviceNotReady("the robot moves", remedy="wait until it stands still")
            self._machine.switch_off()
        self._poses_of = None
        self._store.write(geometry)

    def _opened(self) -> LinuxcncClient:
        return LinuxcncClient(
            self._open_transport(timeout_s=self._stopping.patience_s(CONNECT_S)),
            clock_s=self._clock.now_s,
            settings=self._settings,
            cancelled=self._stopping.is_cancelled,
        )

    def _greet(self, client: LinuxcncClient) -> Identity:
        greeting = client.greet(
            within_s=self._stopping.patience_s(self._deadlines.greeting_s),
            aborting=self._stopping.is_under_way,
        )
        return Identity(
            vendor="LinuxCNC",
            model=f"{self._settings.robot} in {self._settings.letters}",
            serial=greeting.name,
            firmware="not told",
            protocol=f"linuxcncrsh {greeting.version}",
        )

    def _enter(self) -> None:
        """Connect, see that the machine is ours, take control, and first of all stop what moves.

        A stop that is under way does that itself, and by other means when an abort is refused.
        """
        self._session.open()
        client = self._session.connection
        try:
            self._machine.check_model()
            client.take_control()
            if client.is_on("machine") and not self._stopping.is_under_way:
                client.order("abort")
        except BaseException:  # also an interrupt: what it leaves behind is closed
            client.close()
            raise

    def _give_back(self, client: LinuxcncClient) -> None:
        """Stop and give up control. Another client's motion is left alone."""
        if not client.is_on("enable"):
            return
        if client.is_on("machine"):
            client.order("abort")
            with suppress(
                errors.DeviceRefused
            ):  # not in MDI mode, or off by now: then it needs nothing
                client.order(MDI, PER_MINUTE)
        client.order("enable", "off")

    def _stop_and_watch(self, give_up_s: float, answer_s: float) -> None:  # noqa: ARG002 - its own
        """Have the robot stand, and see it stand; raises `DriverError` when that is not seen.

        By an abort, which brakes on the path; if that is not taken, by LinuxCNC's e-stop.
        """
        if not self._session.is_open:
            self._enter()
        client = self._machine.client
        if not client.is_on("enable"):
            client.take_control()
        if client.is_on("machine"):
            try:
                client.order("abort")
            except errors.DeviceRefused:
                self._cut_power(give_up_s)
        self._target = None
        self._stopping.await_standstill(self._is_moving, give_up_s=give_up_s)

    @property
    def _works_in_world(self) -> bool:
        return self._settings.coordinates is Coordinates.WORLD

    def _active(self) -> PosesOfJoints:
        """The stored parameters at work; read once, and again whenever they may have changed."""
        if self._poses_of is None:
            self._poses_of = self._settings.poses_of(self._store.read())
        return self._poses_of

    def _start(self, joints: Sequence[float], pose: Pose | None, speed_fraction: float) -> None:
        """Start a move; a pose is that of these joints, as it was asked for."""
        self._settings.check(joints)
        here = self._here()
        travel = max(abs(q - now) for q, now in zip(joints, here, strict=True))
        way = [tuple(map(self._settings.to_machine, joints))]
        if self._works_in_world:
            *between, end = way_to(self._active(), self._settings, here, joints)
            way = [*map(self._world, between), self._world(pose or end)]
        self._begin(way, travel, speed_fraction)

    def _here(self) -> tuple[float, ...]:
        return tuple(map(self._settings.from_machine, self._machine.joints()))

    def _forget_motion(self) -> None:
        """Forget the last motion and its faults: the machine has been made ready."""
        self._target, self._messages = None, ()

    def _begin(self, way: Sequence[MachinePlace], travel: float, speed_fraction: float) -> None:
        """Give the orders and see the motion begin; raises what LinuxCNC's refusal means.

        `travel` is how far the longest joint goes, rad or mm. Orders that follow are queued.
        """
        way = [rounded(place) for place in way]
        snapshot = self._machine.snapshot()
        if not snapshot.has_power:
            raise self._meaning(snapshot)
        self._machine.check_ready(snapshot)
        self._machine.enter_mdi()
        client = self._machine.client
        client.messages()  # old ones would be taken for reasons
        self._target, self._messages = way[-1], ()
        self._seen, self._changed_s = (), self._clock.now_s()
        duration_s = None
        if speed_fraction < 1.0:
            speed_per_s = speed_fraction * self._settings.full_speed_per_s
            duration_s = travel / len(way) / speed_per_s
        for place in way:
            try:
                client.order(MDI, block(self._settings.letters, place, duration_s))
            except errors.DeviceRefused as error:
                raise self._not_taken(error) from error
        if not self._comes(lambda: self._has_begun(way[-1])):
            raise errors.MotionFault(
                f"{client.name}: LinuxCNC has taken a move, but it has not begun within "
                f"{self._deadlines.start_s:g} s",
                remedy=f"its realtime part seems to have died: {RESTART}",
            )

    def _is_moving(self) -> bool:
        """True while anything moves, whoever started it."""
        return self._standing(self._machine.snapshot()) is None

    def _standing(self, first: Snapshot) -> Snapshot | None:
        """The last of several readings at which everything stood; None while anything moves."""
        latest = first
        for _ in range(READINGS - 1):
            if self._is_under_way(latest):
                return None
            self._clock.sleep_s(READING_PAUSE_S)
            latest = self._machine.snapshot()
            if not agree(latest.joints, first.joints, self._settings.still):
                return None
        return None if self._is_under_way(latest) else latest

    def _is_under_way(self, snapshot: Snapshot) -> bool:
        """True while the trajectory has way to go, as far as a machine without power can."""
        if not snapshot.machine_on:
            return False
        if self._target is None:
            return not snapshot.idle
        return not snapshot.is_commanded(self._target)

    def _fault(self, snapshot: Snapshot, *, moving: bool) -> str:
        """A fault in LinuxCNC's words where it has any; empty when nothing is wrong."""
        said = "; ".join(self._messages)
        if not snapshot.machine_on:
            return said or "the machine is off"
        if not snapshot.in_control:
            return "another client has taken control of LinuxCNC"
        if self._is_frozen(snapshot, moving=moving):
            return said or (
                f"a motion has not moved for {self._deadlines.frozen_s:g} s: "
                "feed hold, or a dead task or realtime part"
            )
        return said

    def _is_frozen(self, snapshot: Snapshot, *, moving: bool) -> bool:
        """Positions that should change have stopped changing: stale values look like it."""
        now_s, seen = self._clock.now_s(), (*snapshot.commanded, *snapshot.joints)
        if seen != self._seen or not moving:
            self._seen, self._changed_s = seen, now_s
        return now_s - self._changed_s > self._deadlines.frozen_s

    def _has_begun(self, target: MachinePlace) -> bool:
        """True when the move has begun; raises its refusal. What comes later `state` tells."""
        snapshot = self._machine.snapshot()
        messages = self._machine.client.messages()
        if messages or not snapshot.has_power:
            raise self._meaning(snapshot, messages)
        return not snapshot.idle or snapshot.is_commanded(target)

    def _meaning(self, snapshot: Snapshot, messages: Sequence[str] = ()) -> errors.DeviceRefused:
        """The meaning of what is said now; what was refused keeps no motion."""
        error = self._machine.refusal(snapshot, messages)
        self._target = None
        return error

    def _not_taken(self, error: errors.DeviceRefused) -> errors.DeviceRefused | errors.LinkDown:
        """The meaning of an order that was not even received."""
        snapshot = self._machine.snapshot()
        if not (snapshot.has_power and snapshot.in_control):
            return self._meaning(snapshot)
        self._machine.client.close()
        return errors.LinkDown(
            f"{error.problem}: it shows a machine that is on, but takes no orders",
            remedy=f"its task or realtime part seems to have died: {RESTART}",
        )

    def _cut_power(self, give_up_s: float) -> None:
        client = self._machine.client
        client.order("estop", "on")
        if not self._comes(lambda: not client.is_on("machine"), give_up_s):
            raise errors.MotionFault(
                f"{client.name}: LinuxCNC takes neither abort nor e-stop",
                remedy="use the hardware stop",
            )

    def _comes(self, is_so: Callable[[], bool], latest_s: float = inf) -> bool:
        give_up_s = min(self._clock.now_s() + self._deadlines.start_s, latest_s)
        return comes_true(is_so, self._clock, give_up_s=give_up_s, pause_s=self._deadlines.poll_s)

    def _check_kinematics(self) -> None:
        """Raise `WrongDevice` unless LinuxCNC's coordinates are what its joints make of them."""
        expected = self._machine.joints()
        told = self._machine.position()
        if self._works_in_world:
            joints = tuple(map(self._settings.from_machine, expected))
            expected = self._world(self._active().pose(joints))
        if agree(told, expected, SAME_KINEMATICS):
            return
        letters = self._settings.letters
        raise errors.WrongDevice(
            f"{self._machine.client.name}: LinuxCNC says its {letters} is {_listed(told)}; "
            f"of its joints it should be {_listed(expected)}",
            remedy="another kinematics or other parameters are at work: check [KINS]KINEMATICS and "
            "the HAL file, then restart LinuxCNC",
        )

    def _world(self, pose: Pose) -> tuple[float, ...]:
        """X, Y, Z in mm and, of a plate that turns, C in deg."""
        position = pose.x_mm, pose.y_mm, pose.z_mm
        if not self._settings.has_turn:
            return position
        return *position, degrees(pose.theta_rad or 0.0)


def _listed(numbers: Sequence[float]) -> str:
    return ", ".join(f"{number:.4f}" for number in numbers)


def make_robot(given: RobotSurroundings) -> LinuxcncRobot:
    """Make the robot that a campaign describes."""
    settings = given.settings
    assert isinstance(settings, LinuxcncSettings), "the campaign's settings were checked"
    return LinuxcncRobot(
        given.open_transport,
        clock=given.clock,
        settings=settings,
        cancelled=given.cancelled,
        alarm=given.alarm,
    )
