"""Comes to LinuxCNC and leaves it: the same machine as before, in control, with nothing moving."""

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from math import degrees

from drivers.errors import DeviceNotReady, DeviceRefused, DriverError, WrongDevice
from drivers.link import never
from drivers.linuxcnc.client import LinuxcncClient
from drivers.linuxcnc.machine_state import Machine, agree
from drivers.linuxcnc.motion import MDI, Motion, way_to
from drivers.linuxcnc.settings import (
    Coordinates,
    Kinematics,
    KinematicsOf,
    LinuxcncSettings,
    ParameterStore,
)
from drivers.ports import Clock
from drivers.session import Session
from drivers.stopping import Alarm, StopProcedure, state_unknown, unheard
from drivers.transport import CONNECT_S, Opener
from drivers.values import Identity, Pose, RobotState

SAME_PLACE = 1e-3
"""mm or deg, between what LinuxCNC says and what its joints and the parameters make of it: far
above rounding, far below what another kinematics or another robot would give."""
PER_MINUTE = "G94"
"""The mode of feed that an operator expects: after a paced move, F is a time."""


class LinuxcncRobot:
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
        store: ParameterStore,
        kinematics_of: KinematicsOf,
        cancelled: Callable[[], bool] = never,
        alarm: Alarm = unheard,
    ) -> None:
        self._open_transport = open_transport
        self._clock = clock
        self._settings = settings
        self._store = store
        self._kinematics_of = kinematics_of
        self._kinematics: Kinematics | None = None
        self._stopping = StopProcedure(
            clock,
            within_s=settings.deadlines.stop_s,
            answer_s=settings.deadlines.stop_answer_s,
            pause_s=settings.deadlines.poll_s,
            cancelled=cancelled,
            alarm=alarm,
        )
        self._session = Session("controller", self._opened, self._greet)
        self._machine = Machine(self._session, clock, settings)
        self._motion = Motion(self._machine, clock, settings)

    def connect(self) -> None:
        """Open the wire, take control, stop what moves; raises `LinkDown` or `WrongDevice`.

        From the second time on it must be the same controller that answers.
        """
        self._kinematics = None
        with self._stopping.undisturbed():
            self._enter()
        self._motion.renew()

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
        self._motion.renew()
        self._kinematics = None
        self._check_kinematics()

    def identity(self) -> Identity:
        """The machine that answered when the connection was opened."""
        return self._session.identity

    def state(self) -> RobotState:
        """The joints as read now. It takes up to some 10 ms to be sure that they stand."""
        return self._motion.state()

    def move_joints(self, joints: Sequence[float], speed_fraction: float) -> None:
        """Start a move to joints; raises `LimitViolation`, `MotionFault` or `EmergencyStop`.

        A controller that works in world coordinates is led along by poses.
        """
        self._start(joints, None, speed_fraction)

    def move_pose(self, pose: Pose, speed_fraction: float) -> None:
        """Start a move to a pose; raises like a joint move.

        By LinuxCNC's own kinematics, or, where it only takes joints, converted with the stored set.
        """
        self._start(self._active().joints(pose), pose, speed_fraction)

    def stop(self) -> None:
        """Stop at once, also when the wire is down or another client has control.

        Returns when LinuxCNC has been seen to stand; raises `RobotStateUnknown`.
        """
        self._stopping.insist(self._session, self._stop_and_watch, self.close)

    def read_geometry(self) -> Mapping[str, float]:
        """The parameters that poses are converted with, by flat name, mm and deg."""
        return self._store.read()

    def lacks(self, names: Collection[str]) -> tuple[str, ...]:  # noqa: ARG002 - it has them all
        """Nothing: pkmkins has all parameters, and so has what converts poses to joints."""
        return ()

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
        except DriverError as error:
            if self._motion.has_started:
                raise state_unknown(
                    f"LinuxCNC could not be left standing ({error.problem})"
                ) from error
        finally:
            self._session.close()

    def _write_geometry(self, geometry: Mapping[str, float]) -> None:
        if self._store.needs_machine_off:
            if self._motion.is_moving():
                raise DeviceNotReady("the robot moves", remedy="wait until it stands still")
            self._machine.switch_off()
        self._kinematics = None
        self._store.write(geometry)

    def _opened(self) -> LinuxcncClient:
        return LinuxcncClient(
            self._open_transport(timeout_s=self._stopping.patience_s(CONNECT_S)),
            clock_s=self._clock.now_s,
            patience=self._settings.deadlines.patience,
            cancelled=self._stopping.is_cancelled,
        )

    def _greet(self, client: LinuxcncClient) -> Identity:
        greeting = client.greet(
            self._settings.passwords,
            within_s=self._stopping.patience_s(self._settings.deadlines.patience.greeting_s),
            aborting=self._stopping.is_under_way,
        )
        return Identity(
            vendor="LinuxCNC",
            model=f"{self._settings.axes.robot} in {self._settings.letters}",
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
            client.take_control(self._settings.passwords)
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
            with suppress(DeviceRefused):  # not in MDI mode, or off by now: then it needs nothing
                client.order(MDI, PER_MINUTE)
        client.order("enable", "off")

    def _stop_and_watch(self, *, give_up_s: float, answer_s: float) -> None:  # noqa: ARG002 - its own
        if not self._session.is_open:
            self._enter()
        self._motion.halt(give_up_s)

    @property
    def _works_in_world(self) -> bool:
        return self._settings.coordinates is Coordinates.WORLD

    def _active(self) -> Kinematics:
        """The stored parameters at work; read once, and again whenever they may have changed."""
        if self._kinematics is None:
            self._kinematics = self._kinematics_of(self._store.read())
        return self._kinematics

    def _start(self, joints: Sequence[float], pose: Pose | None, speed_fraction: float) -> None:
        """Start a move; a pose is that of these joints, as it was asked for."""
        self._settings.limits.check(joints)
        axes = self._settings.axes
        here = tuple(map(axes.from_machine, self._machine.joints()))
        travel = max(abs(q - now) for q, now in zip(joints, here, strict=True))
        way = [tuple(map(axes.to_machine, joints))]
        if self._works_in_world:
            *between, end = way_to(self._active(), self._settings.passing, here, joints)
            way = [*map(self._world, between), self._world(pose or end)]
        self._motion.start(way, travel, speed_fraction)

    def _check_kinematics(self) -> None:
        """Raise `WrongDevice` unless LinuxCNC's coordinates are what its joints make of them."""
        expected = self._machine.joints()
        told = self._machine.position()
        if self._works_in_world:
            joints = tuple(map(self._settings.axes.from_machine, expected))
            expected = self._world(self._active().pose(joints))
        if agree(told, expected, SAME_PLACE):
            return
        letters = self._settings.letters
        raise WrongDevice(
            f"{self._machine.client.name}: LinuxCNC says its {letters} is {_listed(told)}; "
            f"of its joints it should be {_listed(expected)}",
            remedy="another kinematics or other parameters are at work: check [KINS]KINEMATICS and "
            "the HAL file, then restart LinuxCNC",
        )

    def _world(self, pose: Pose) -> tuple[float, ...]:
        """X, Y, Z in mm and, of a plate that turns, C in deg."""
        position = pose.x_mm, pose.y_mm, pose.z_mm
        if not self._settings.axes.has_turn:
            return position
        return *position, degrees(pose.theta_rad or 0.0)


def _listed(numbers: Sequence[float]) -> str:
    return ", ".join(f"{number:.4f}" for number in numbers)
