"""A robot controller that speaks robotline (docs/reference/robotline.md): units and meaning.

The grammar (`drivers/wire/robotline.py`) has mm and deg, as on the wire; the port has mm and rad.
They are converted here and nowhere else. What the operator's wish to stop may end differs:

* A question about a motion is abandoned at once, so that `stop` need not wait for its answer.
* A question to a robot at rest (identity, parameters) is always finished. It moves nothing, and a
  set of parameters that was sent by half would have to be found out by reading back.

Parameters are staged line by line without any effect, and put to work together by COMMIT.
"""

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

SIMULATED = "pkmcal"
"""Vendor that a simulated controller names."""
# Controllers differ in what they make of a word they do not know; the page allows only ARGUMENT.
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
    """Of COMMIT, after which the controller keeps the new set over a restart."""
    stop_answer_s: float = 0.5
    """Patience of the first try to stop; each further one waits longer."""
    standstill_s: float = 5.0
    """Time in which a stop must be confirmed."""
    poll_s: float = 0.01
    """Pause between two questions whether the robot stands."""


class LineRobot(RobotController):
    """A controller at the other end of a wire.

    Any fault of the wire closes it, and every call but `stop` raises `LinkDown` until `reconnect`.
    At the operator's wish to stop, a question about a motion is abandoned, which closes the wire
    too; `stop` then goes over a new one. What is asked of a robot at rest is always finished.
    """

    def __init__(
        self, surroundings: RobotSurroundings, deadlines: RobotlineDeadlines = RobotlineDeadlines()
    ) -> None:
        self._open_transport = surroundings.open_transport
        self._in_process = surroundings.in_process
        self._clock = surroundings.clock
        self._layout = surroundings.layout
        self._dialect = Dialect(
            wire.grammar(surroundings.layout),
            REFUSALS,
            "docs/reference/robotline.md",
            deadlines.answer_s,
        )
        self._numbers = numbers_from(surroundings.first_number)
        self._deadlines = deadlines
        self._session = DeviceSession("controller", self._open_client, self._greet)
        # Parameters of imperfect parts that the controller has; None: not asked yet.
        self._extensions: tuple[str, ...] | None = None
        # By the latest answer: the next STATE must be answered sooner while the robot moves.
        self._is_moving = False
        self._stopping = StopProcedure(
            surroundings.clock,
            within_s=deadlines.standstill_s,
            answer_s=deadlines.stop_answer_s,
            pause_s=deadlines.poll_s,
            cancelled=surroundings.cancelled,
            alarm=surroundings.alarm,
        )

    @property
    @override
    def knows_its_time(self) -> bool:
        return self._in_process or self._session.identity.vendor != SIMULATED

    @override
    def connect(self) -> None:
        # The controller may come back with another program, and other parameters.
        self._extensions = None
        with self._stopping.undisturbed():
            self._session.open()

    def reconnect(self) -> None:
        """Open again after a fault. The controller has stopped, and dropped what was staged."""
        self.connect()

    @override
    def identity(self) -> Identity:
        with self._stopping.undisturbed():
            return self._session.recognise(self._greet(self._session.connection))

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
        if not self._layout.has_movep:
            names = " ".join(axis.name for axis in self._layout.coordinates if not axis.is_fixed)
            raise DeviceRefused(
                f"MOVEP of robotline {wire.VERSION} has no poses of {names}, which this robot has",
                remedy="run the tests from a program: `pkmcal plan DIR --program csv`, then "
                "`pkmcal import DIR FILE --stage before`",
                code="ARGUMENT",
            )
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
            extensions = self._read(self._known_extensions())
        # A zero is the same robot as one without the parameter: left out, sets compare equal.
        geometry |= {name: value for name, value in extensions.items() if value}
        return geometry

    def lacks(self, names: Collection[str]) -> tuple[str, ...]:
        """Return which of the named parameters the controller does not have."""
        # Every controller has the other parameters: nothing is asked about them.
        extensions = {*names} & {*self._layout.extensions}
        with self._stopping.undisturbed():
            available = {*self._layout.parameters}
            if extensions:
                available |= {*self._known_extensions()}
        return tuple(name for name in names if name not in available)

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
            # After a refusal everything is still staged. A later COMMIT must not find it there.
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
            # Number and verb fit, and still it is of another arm: its numbers would be mixed up.
            if part.name != name:
                self.close()
                raise WireError(f"the controller answered for {part.name}, asked for {name}")
            geometry |= self._layout.flat(part)
        return geometry

    def _known_extensions(self) -> tuple[str, ...]:
        """Return the controller's parameters of imperfect parts; ask once a connection.

        A controller has a kind for all arms or for none: the first parameter of a kind decides.
        """
        if self._extensions is None:
            kinds = self._layout.extension_kinds
            self._extensions = tuple(
                n for names in kinds if self._has_parameter(names[0]) for n in names
            )
        return self._extensions

    def _has_parameter(self, name: str) -> bool:
        try:
            self._read((name,))
        except DeviceRefused as error:
            if error.code not in NOT_KNOWN:
                raise
            return False
        return True

    def _begin(self, verb: str, move: wire.MoveJoints | wire.MovePose) -> None:
        self._session.connection.ask(verb, wire.MotionBegun, move)
        # From the OK on, by the page, until STATE says otherwise.
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

    def _open_client(self, first: str = "") -> LineClient:
        return LineClient(
            self._open_transport(timeout_s=self._stopping.patience_s(CONNECT_S)),
            self._dialect,
            self._numbers,
            clock_s=self._clock.now_s,
            cancelled=self._stopping.is_cancelled,
            first=first,
        )

    def _stop_and_watch(self, give_up_s: float, answer_s: float) -> None:
        # 1. STOP over the open connection, else as the first word on a new one. A greeting before
        #    it would cost a question's time, and the page has STOP answered before HELLO.
        # 2. STATE until the robot stands: the answer to STOP says only that braking has begun.
        if self._session.is_open:
            self._session.connection.ask("STOP", Nothing, within_s=answer_s)
        else:
            self._session.use(self._open_client("STOP"))
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
