"""A robot whose controller is LinuxCNC, over linuxcncrsh: units and meaning."""

from collections.abc import Callable, Mapping, Sequence
from math import degrees, radians

from drivers.errors import DeviceNotReady, DriverError, LinkDown, RobotStateUnknown, WrongDevice
from drivers.link import never
from drivers.linuxcnc_access import LinuxcncAccess
from drivers.linuxcnc_conversation import LinuxcncConversation
from drivers.linuxcnc_motion import Target
from drivers.linuxcnc_mover import LinuxcncMover
from drivers.linuxcnc_settings import Kinematics, KinematicsOf, LinuxcncSettings, ParameterStore
from drivers.linuxcnc_state import Coordinates, position_in, read_joints_deg
from drivers.linuxcnc_way import way_to
from drivers.ports import Clock
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
        self._clock = clock
        self._settings = settings
        self._store = store
        self._kinematics_of = kinematics_of
        self._kinematics: Kinematics | None = None
        self._cancelled = cancelled
        self._stopping = False
        self._access = LinuxcncAccess(open_transport, clock, settings, self._is_cancelled)
        self._mover = LinuxcncMover(self._access, clock, settings)
        self._conversation: LinuxcncConversation | None = None

    def connect(self) -> None:
        """Open the wire, take control, stop what moves; raises `LinkDown` or `WrongDevice`.

        From the second time on it must be the same controller that answers.
        """
        if self._conversation is not None:
            self._conversation.close()
        self._kinematics = None
        self._conversation = self._access.enter()
        self._mover.renew()

    def reconnect(self) -> None:
        """Open anew after a fault of the wire, and stop what moves before anything else."""
        self.connect()

    def prepare(self) -> None:
        """Release the e-stop, switch on, home if need be. Homing may move the robot.

        Raises `EmergencyStop`, `MotionFault` or `DeviceRefused` with LinuxCNC's words, and
        `WrongDevice` when another kinematics than Par4's, or with other parameters, is at work.
        """
        conversation = self._opened_before()
        self._access.setup(conversation).bring_up()
        self._mover.renew()
        self._kinematics = None
        self._check_kinematics(conversation)

    def identity(self) -> Identity:
        """Who answered when the connection was opened."""
        self._opened_before()
        return self._access.identity

    def state(self) -> RobotState:
        """The joints as read now. It takes up to some 10 ms to be sure that they stand."""
        return self._mover.state(self._opened_before())

    def move_joints(self, joints_rad: Sequence[float], speed_fraction: float) -> None:
        """Start a move to joints; raises `LimitViolation`, `MotionFault` or `EmergencyStop`.

        A controller that works in world coordinates is led along by poses.
        """
        self._settings.limits.check(joints_rad)
        self._start(joints_rad, None, speed_fraction)

    def move_pose(self, pose: Pose, speed_fraction: float) -> None:
        """Start a move to a pose; raises like a joint move.

        By LinuxCNC's own kinematics, or, where it only takes joints, converted with the stored set.
        """
        joints_rad = self._active().joints_rad(pose)
        self._settings.limits.check(joints_rad)
        self._start(joints_rad, pose, speed_fraction)

    def stop(self) -> None:
        """Stop at once, also when the wire is down or another client has control.

        Returns when LinuxCNC has been seen to stand; raises `RobotStateUnknown`.
        """
        greeted = self._conversation
        self._stopping = True
        try:
            self._stop_within(self._settings.deadlines.stop_s)
        finally:
            self._stopping = False
            if self._conversation is not greeted:
                self.close()

    def read_geometry(self) -> Mapping[str, float]:
        """The parameters that poses are converted with, by flat name, mm and deg."""
        return self._store.read()

    def write_geometry(self, geometry: Mapping[str, float]) -> None:
        """Replace all parameters, or none; the robot must stand.

        Where LinuxCNC itself works with them, its drives are switched off first and stay off: with
        the power on, the joints would jump to where the new parameters put them.
        """
        conversation = self._opened_before()
        if self._store.needs_machine_off:
            if self._mover.is_moving(conversation):
                raise DeviceNotReady("the robot moves", remedy="wait until it stands still")
            self._access.setup(conversation).switch_off()
        self._kinematics = None
        self._store.write(geometry)

    def close(self) -> None:
        """Stop, give control back, close; raises `RobotStateUnknown` when a motion may go on."""
        conversation = self._conversation
        if conversation is None or not conversation.is_open:
            return
        try:
            self._access.leave(conversation)
        except DriverError as error:
            if self._mover.has_started:
                raise _unknown(f"LinuxCNC could not be left standing ({error.problem})") from error
        finally:
            conversation.close()

    @property
    def _works_in_world(self) -> bool:
        return self._settings.coordinates is Coordinates.WORLD

    def _opened_before(self) -> LinuxcncConversation:
        if self._conversation is None or not self._conversation.is_open:
            raise LinkDown("LinuxCNC is not connected", remedy="connect again")
        return self._conversation

    def _is_cancelled(self) -> bool:
        """Look at the operator's wish to stop, but never abandon the stop itself for it."""
        return not self._stopping and self._cancelled()

    def _active(self) -> Kinematics:
        """The stored parameters at work; read once, and again whenever they may have changed."""
        if self._kinematics is None:
            self._kinematics = self._kinematics_of(self._store.read())
        return self._kinematics

    def _start(self, joints_rad: Sequence[float], pose: Pose | None, speed_fraction: float) -> None:
        conversation = self._opened_before()
        here_rad = tuple(map(radians, read_joints_deg(conversation)))
        travel_rad = max(abs(q - now) for q, now in zip(joints_rad, here_rad, strict=True))
        numbers = [tuple(map(degrees, joints_rad))]
        if self._works_in_world:
            passing = self._settings.limits.wider_by(self._settings.passing_slack_rad)
            way = way_to(self._active(), passing, here_rad, joints_rad)
            numbers = [*map(_world, way[:-1]), _world(pose or way[-1])]
        targets = [Target.of(self._settings.coordinates, place) for place in numbers]
        self._mover.start(conversation, targets, travel_rad, speed_fraction)

    def _check_kinematics(self, conversation: LinuxcncConversation) -> None:
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

    def _stop_within(self, within_s: float) -> None:
        deadline_s = self._clock.now_s() + within_s
        while True:
            try:
                return self._stop_and_watch(deadline_s)
            except DriverError as error:
                if self._clock.now_s() >= deadline_s:
                    problem = f"the stop was not confirmed within {within_s:g} s ({error.problem})"
                    raise _unknown(problem) from error
            self._clock.sleep_s(self._settings.deadlines.poll_s)

    def _stop_and_watch(self, deadline_s: float) -> None:
        if self._conversation is None or not self._conversation.is_open:
            self._conversation = self._access.enter()
        self._mover.halt(self._conversation, deadline_s)


def _unknown(problem: str) -> RobotStateUnknown:
    return RobotStateUnknown(f"robot state unknown: {problem}", remedy="use the hardware stop")


def _world(pose: Pose) -> tuple[float, ...]:
    """X, Y, Z in mm and C in deg."""
    return pose.x_mm, pose.y_mm, pose.z_mm, degrees(pose.theta_rad)


def _listed(numbers: Sequence[float]) -> str:
    return ", ".join(f"{number:.4f}" for number in numbers)
