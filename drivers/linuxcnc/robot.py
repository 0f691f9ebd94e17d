"""Comes to LinuxCNC and leaves it: the same machine as before, in control, with nothing moving."""

from collections.abc import Callable, Mapping, Sequence
from math import degrees, radians

from drivers.errors import DeviceNotReady, DriverError, WrongDevice
from drivers.link import never
from drivers.linuxcnc.client import LinuxcncClient
from drivers.linuxcnc.machine_state import Coordinates, position_in, read_joints_deg
from drivers.linuxcnc.motion import Target
from drivers.linuxcnc.mover import LinuxcncMover, way_to
from drivers.linuxcnc.setup import (
    Kinematics,
    KinematicsOf,
    LinuxcncAccess,
    LinuxcncSettings,
    ParameterStore,
)
from drivers.ports import Clock
from drivers.session import Session
from drivers.stopping import StopProcedure, state_unknown
from drivers.transport import Transport
from drivers.values import Identity, Pose, RobotState

SAME_PLACE = 1e-3
"""mm or deg, between what LinuxCNC says and what its joints and the parameters make of it: far
above rounding, far below what another kinematics or another robot would give."""


class LinuxcncRobot:
    """A controller at the other end of a connection that has control of it.

    Connecting stops whatever moves: LinuxCNC itself finishes a motion whose client was lost. Any
    fault of the wire closes it, and every call but `stop` raises `LinkDown` until `reconnect`.
    `clock` is real time.
    """

    def __init__(
        self,
        open_transport: Callable[[], Transport],
        *,
        clock: Clock,
        settings: LinuxcncSettings,
        store: ParameterStore,
        kinematics_of: KinematicsOf,
        cancelled: Callable[[], bool] = never,
    ) -> None:
        self._settings = settings
        self._store = store
        self._kinematics_of = kinematics_of
        self._kinematics: Kinematics | None = None
        self._stopping = StopProcedure(
            clock,
            within_s=settings.deadlines.stop_s,
            pause_s=settings.deadlines.poll_s,
            cancelled=cancelled,
        )
        self._access = LinuxcncAccess(open_transport, clock, settings, self._stopping.is_cancelled)
        self._session = Session("controller", self._access.opened, self._access.greet)
        self._mover = LinuxcncMover(self._access, clock, settings)

    def connect(self) -> None:
        """Open the wire, take control, stop what moves; raises `LinkDown` or `WrongDevice`.

        From the second time on it must be the same controller that answers.
        """
        self._kinematics = None
        self._enter()
        self._mover.renew()

    def reconnect(self) -> None:
        """Open anew after a fault of the wire, and stop what moves before anything else."""
        self.connect()

    def prepare(self) -> None:
        """Release the e-stop, switch on, home if need be. Homing may move the robot.

        Raises `EmergencyStop`, `MotionFault` or `DeviceRefused` with LinuxCNC's words, and
        `WrongDevice` when another kinematics than Par4's, or with other parameters, is at work.
        """
        conversation = self._session.connection
        self._access.setup(conversation).bring_up()
        self._mover.renew()
        self._kinematics = None
        self._check_kinematics(conversation)

    def identity(self) -> Identity:
        """Who answered when the connection was opened."""
        return self._session.identity

    def state(self) -> RobotState:
        """The joints as read now. It takes up to some 10 ms to be sure that they stand."""
        return self._mover.state(self._session.connection)

    def move_joints(self, joints: Sequence[float], speed_fraction: float) -> None:
        """Start a move to joints; raises `LimitViolation`, `MotionFault` or `EmergencyStop`.

        A controller that works in world coordinates is led along by poses.
        """
        self._settings.limits.check(joints)
        self._start(joints, None, speed_fraction)

    def move_pose(self, pose: Pose, speed_fraction: float) -> None:
        """Start a move to a pose; raises like a joint move.

        By LinuxCNC's own kinematics, or, where it only takes joints, converted with the stored set.
        """
        joints = self._active().joints(pose)
        self._settings.limits.check(joints)
        self._start(joints, pose, speed_fraction)

    def stop(self) -> None:
        """Stop at once, also when the wire is down or another client has control.

        Returns when LinuxCNC has been seen to stand; raises `RobotStateUnknown`.
        """
        self._stopping.insist(self._session, self._stop_and_watch, self.close)

    def read_geometry(self) -> Mapping[str, float]:
        """The parameters that poses are converted with, by flat name, mm and deg."""
        return self._store.read()

    def write_geometry(self, geometry: Mapping[str, float]) -> None:
        """Replace all parameters, or none; the robot must stand.

        Where LinuxCNC itself works with them, its drives are switched off first and stay off: with
        the power on, the joints would jump to where the new parameters put them.
        """
        conversation = self._session.connection
        if self._store.needs_machine_off:
            if self._mover.is_moving(conversation):
                raise DeviceNotReady("the robot moves", remedy="wait until it stands still")
            self._access.setup(conversation).switch_off()
        self._kinematics = None
        self._store.write(geometry)

    def close(self) -> None:
        """Stop, give control back, close; raises `RobotStateUnknown` when a motion may go on."""
        if not self._session.is_open:
            return
        conversation = self._session.connection
        try:
            self._access.leave(conversation)
        except DriverError as error:
            if self._mover.has_started:
                raise state_unknown(
                    f"LinuxCNC could not be left standing ({error.problem})"
                ) from error
        finally:
            conversation.close()

    @property
    def _works_in_world(self) -> bool:
        return self._settings.coordinates is Coordinates.WORLD

    def _enter(self) -> None:
        self._session.open()
        self._access.take_over(self._session.connection)

    def _active(self) -> Kinematics:
        """The stored parameters at work; read once, and again whenever they may have changed."""
        if self._kinematics is None:
            self._kinematics = self._kinematics_of(self._store.read())
        return self._kinematics

    def _start(self, joints: Sequence[float], pose: Pose | None, speed_fraction: float) -> None:
        conversation = self._session.connection
        here_rad = tuple(map(radians, read_joints_deg(conversation)))
        travel_rad = max(abs(q - now) for q, now in zip(joints, here_rad, strict=True))
        numbers = [tuple(map(degrees, joints))]
        if self._works_in_world:
            passing = self._settings.limits.wider_by(self._settings.passing_slack_rad)
            way = way_to(self._active(), passing, here_rad, joints)
            numbers = [*map(_world, way[:-1]), _world(pose or way[-1])]
        targets = [Target.of(self._settings.coordinates, place) for place in numbers]
        self._mover.start(conversation, targets, travel_rad, speed_fraction)

    def _check_kinematics(self, conversation: LinuxcncClient) -> None:
        joints_deg = read_joints_deg(conversation)
        told = position_in(conversation.get("abs_act_pos"), self._settings.coordinates)
        expected: tuple[float, ...] = joints_deg
        if self._works_in_world:
            expected = _world(self._active().pose(tuple(map(radians, joints_deg))))
        if all(abs(a - b) <= SAME_PLACE for a, b in zip(told, expected, strict=True)):
            return
        letters = self._settings.coordinates.value
        raise WrongDevice(
            f"{conversation.name}: LinuxCNC says its {letters} is {_listed(told)}; "
            f"of its joints it should be {_listed(expected)}",
            remedy="another kinematics or other parameters are at work: check [KINS]KINEMATICS and "
            "the HAL file, then restart LinuxCNC",
        )

    def _stop_and_watch(self, give_up_s: float) -> None:
        if not self._session.is_open:
            self._enter()
        self._mover.halt(self._session.connection, give_up_s)


def _world(pose: Pose) -> tuple[float, ...]:
    """X, Y, Z in mm and C in deg."""
    return pose.x_mm, pose.y_mm, pose.z_mm, degrees(pose.theta_rad or 0.0)


def _listed(numbers: Sequence[float]) -> str:
    return ", ".join(f"{number:.4f}" for number in numbers)
