"""A robot controller that speaks robotline (docs/reference/robotline.md): units and meaning."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite

from typing_extensions import override

from drivers.declaration import RobotSurroundings
from drivers.errors import (
    DeviceNotReady,
    DeviceRefused,
    EmergencyStop,
    LimitViolation,
    MotionFault,
    WireError,
    WrongDevice,
)
from drivers.line_client import Dialect, LineClient, identity_of, recorded_answer
from drivers.plausible import require_joints
from drivers.ports import RobotController
from drivers.session import DeviceSession
from drivers.stopping import StopProcedure
from drivers.transport import CONNECT_S
from drivers.values import Identity, Pose, RobotState, inner_units, outer_units
from drivers.wire import robotline as wire
from drivers.wire.lines import Hello, Nothing, Title, numbers_from

NOT_KNOWN = ("ARGUMENT", "GEOMETRY", "VERB")
"""Refusals of a parameter that a controller does not have."""

REFUSALS: Mapping[str, tuple[type[DeviceRefused], str]] = {
    "LIMIT": (LimitViolation, "compare the plan's limits with the controller's"),
    "REACH": (LimitViolation, "compare the plan's robot file with the controller's parameters"),
    "FAULT": (MotionFault, "clear the fault at the controller, then start again"),
    "ESTOP": (EmergencyStop, "release the emergency stop when it is safe, then start again"),
    "BUSY": (DeviceNotReady, "wait until the robot stands still, then try again"),
    "GEOMETRY": (DeviceRefused, "check the robot file; the controller keeps its old parameters"),
}


@dataclass(frozen=True, slots=True)
class RobotlineDeadlines:
    """Deadlines of the controller, in real seconds."""

    answer_s: float = 2.0
    moving_answer_s: float = 0.5
    """Of the state while the robot moves: a link may be dead without a sign."""
    commit_s: float = 15.0
    stop_answer_s: float = 0.5
    """Patience of the first try to stop; each further one waits longer."""
    standstill_s: float = 5.0
    poll_s: float = 0.01


class LineRobot(RobotController):
    """A controller at the other end of a wire.

    Any fault of the wire closes it, and every call but `stop` raises `LinkDown` until `reconnect`.
    At the operator's wish to stop, a question about a motion is abandoned, which closes the wire
    too; `stop` then goes over a new one. What is asked of a robot at rest is always finished.
    """

    def __init__(
        self, given: RobotSurroundings, deadlines: RobotlineDeadlines = RobotlineDeadlines()
    ) -> None:
        self._open_transport = given.open_transport
        self._clock = given.clock
        self._layout = given.layout
        self._dialect = Dialect(
            wire.grammar(given.layout), REFUSALS, "docs/reference/robotline.md", deadlines.answer_s
        )
        self._numbers = numbers_from(given.first_number)
        self._deadlines = deadlines
        self._session = DeviceSession("controller", self._opened, self._greet)
        self._extensions: tuple[str, ...] | None = None
        self._is_moving = False
        self._stopping = StopProcedure(
            given.clock,
            within_s=deadlines.standstill_s,
            answer_s=deadlines.stop_answer_s,
            pause_s=deadlines.poll_s,
            cancelled=given.cancelled,
            alarm=given.alarm,
        )

    @override
    def connect(self) -> None:
        self._extensions = None
        with self._stopping.undisturbed():
            self._session.open()

    def reconnect(self) -> None:
        """Open again after a fault. The controller has stopped, and dropped what was staged."""
        self.connect()

    @override
    def identity(self) -> Identity:
        with self._stopping.undisturbed():
            return self._session.recognised(self._greet(self._session.connection))

    @override
    def state(self) -> RobotState:
        client = self._session.connection
        deadlines = self._deadlines
        within_s = deadlines.moving_answer_s if self._is_moving else deadlines.answer_s
        status = client.ask("STATE", wire.ControllerStatus, within_s=within_s)
        self._is_moving = status.moving
        joints = inner_units(self._layout.joints, status.joints)
        require_joints(client.name, self._layout.joints, joints)
        return RobotState(
            joints=joints,
            moving=status.moving,
            fault=status.fault,
            emergency_stop=status.emergency_stop,
            raw=client.latest_line,
        )

    def prepare(self) -> None:
        """Do nothing: its operator has switched it on, and refusals say what is missing."""

    @override
    def move_joints(self, joints: Sequence[float], speed_fraction: float) -> None:
        on_wire = outer_units(self._layout.joints, joints)
        self._begin("MOVEJ", wire.MoveJoints(on_wire, speed_fraction * wire.FASTEST_PERCENT))

    @override
    def move_pose(self, pose: Pose, speed_fraction: float) -> None:
        on_wire = outer_units(self._layout.coordinates, pose.coordinates)
        self._begin("MOVEP", wire.MovePose(on_wire, speed_fraction * wire.FASTEST_PERCENT))

    def stop(self) -> None:
        """Stop at once, also when the wire is down or the operator has asked to stop.

        Returns when the controller has said that the robot stands; raises `RobotStateUnknown`.
        """
        self._stopping.insist(self._session, self._stop_and_watch, self.close)

    def read_geometry(self) -> Mapping[str, float]:
        """Read the parameters that the controller works with, by their flat names, mm and deg."""
        with self._stopping.undisturbed():
            geometry = self._read(self._layout.parts)
            beyond = self._read(self._known_extensions())
        geometry |= {name: value for name, value in beyond.items() if value}
        return geometry

    def lacks(self, names: Collection[str]) -> tuple[str, ...]:
        """Return which of the named parameters the controller does not have."""
        asked = {*names} & {*self._layout.extensions}
        with self._stopping.undisturbed():
            known = {*self._layout.parameters, *(self._known_extensions() if asked else ())}
        return tuple(name for name in names if name not in known)

    def write_geometry(self, geometry: Mapping[str, float]) -> None:
        """Replace all parameters at once, or none; raises `DeviceRefused`.

        When the wire breaks here, only reading back shows which parameters the controller has.
        """
        _check_geometry(geometry, self._layout)
        client = self._session.connection
        with self._stopping.undisturbed():
            try:
                for part in self._layout.parts_of(geometry):
                    client.ask("STAGE", Nothing, part)
                client.ask("COMMIT", Nothing, within_s=self._deadlines.commit_s)
            except DeviceRefused:
                client.ask("ABANDON", Nothing)
                raise

    @override
    def close(self) -> None:
        self._session.close()

    def _read(self, parts: Iterable[str]) -> dict[str, float]:
        client = self._session.connection
        geometry: dict[str, float] = {}
        for name in parts:
            part = client.ask("GEOM", wire.Part, wire.ReadPart(Title(name)))
            if part.name != name:
                self.close()
                raise WireError(f"the controller answered for {part.name}, asked for {name}")
            geometry |= self._layout.flat(part)
        return geometry

    def _known_extensions(self) -> tuple[str, ...]:
        """Return the parameters of imperfect parts that it has; asked once a connection.

        It has those of a kind of all arms or of none, so that the first of a kind decides.
        """
        if self._extensions is None:
            kinds = self._layout.extension_kinds
            self._extensions = tuple(n for names in kinds if self._knows(names[0]) for n in names)
        return self._extensions

    def _knows(self, name: str) -> bool:
        try:
            self._read((name,))
        except DeviceRefused as error:
            if error.code not in NOT_KNOWN:
                raise
            return False
        return True

    def _begin(self, verb: str, move: wire.MoveJoints | wire.MovePose) -> None:
        self._session.connection.ask(verb, wire.MotionBegun, move)
        self._is_moving = True

    def _greet(self, client: LineClient) -> Identity:
        greeting = client.ask("HELLO", wire.ControllerGreeting, Hello(wire.VERSION))
        identity = identity_of(greeting, "robotline")
        axes = len(self._layout.joints)
        if (greeting.version, greeting.axes) != (wire.VERSION, axes):
            raise WrongDevice(
                f"{identity} answers with {greeting.axes} axes; "
                f"robotline {wire.VERSION} with {axes} axes is needed",
                remedy="check the address and the controller's program",
            )
        return identity

    def _opened(self, first: str = "") -> LineClient:
        return LineClient(
            self._open_transport(timeout_s=self._stopping.patience_s(CONNECT_S)),
            self._dialect,
            self._numbers,
            clock_s=self._clock.now_s,
            cancelled=self._stopping.is_cancelled,
            first=first,
        )

    def _stop_and_watch(self, give_up_s: float, answer_s: float) -> None:
        if self._session.is_open:
            self._session.connection.ask("STOP", Nothing, within_s=answer_s)
        else:
            self._session.use(self._opened("STOP"))
            self._session.connection.await_first(Nothing, answer_s)

        def is_moving() -> bool:
            client = self._session.connection
            within_s = self._stopping.at_most_s(answer_s)
            return client.ask("STATE", wire.ControllerStatus, within_s=within_s).moving

        self._stopping.await_standstill(is_moving, give_up_s=give_up_s)


def _check_geometry(geometry: Mapping[str, float], layout: wire.RobotLayout) -> None:
    """Refuse, before anything is sent, what the controller could only refuse half way."""
    wrong = sorted((geometry.keys() - set(layout.extensions)) ^ layout.parameters)
    wrong += [name for name, value in geometry.items() if not isfinite(value)]
    if wrong:
        raise DeviceRefused(
            f"the parameter set has '{wrong[0]}' missing, unknown or without a finite value",
            remedy="check the robot file",
            code="GEOMETRY",
        )


def recorded_joints(line: str, layout: wire.RobotLayout) -> tuple[float, ...]:
    """Read joints, rad or mm, from a state as records keep it; raises `WireError`."""
    status = recorded_answer(wire.grammar(layout), line, wire.ControllerStatus)
    return inner_units(layout.joints, status.joints)
