"""The simulated controller's side of robotline (docs/reference/robotline.md): one connection.

Every question is answered at once. A move's answer states its expected duration, and the client
asks for the state until the robot stands. Parameters come in parts that are staged; COMMIT replaces
the active set by all of them or by none, so that a lost connection cannot leave half a set.
"""

from collections.abc import Callable
from math import radians

from typing_extensions import override

from drivers.values import Coordinate
from drivers.wire import robotline as wire
from drivers.wire.lines import Answer, BadQuestion, Hello, Nothing, Question, Refused
from sim.geometry import BarKind, Kind
from sim.robot.controller import Refusal, SimulatedController
from sim.servers.conversation import ServedSession


def layout_of(kind: Kind, extensions: tuple[str, ...] = ()) -> wire.RobotLayout:
    """Return the joints, coordinates and parameters of a mechanism, as the wire has them."""
    joints = [Coordinate(f"q{arm}", unit == "deg") for arm, unit in enumerate(kind.units)]
    is_in_plane = isinstance(kind, BarKind) and 2 not in kind.free
    task = [Coordinate("x", is_angle=False), Coordinate("y", is_angle=False)]
    task.append(Coordinate("z", is_angle=False, is_fixed=is_in_plane))
    task += [Coordinate(name, is_angle=True) for name in kind.turns]
    parameters = [(name, arm, field.stem) for name, (arm, field) in kind.parameters.items()]
    return wire.RobotLayout.of(joints, task, parameters, extensions)


class RobotlineSession(ServedSession):
    """Answers one client. Its staged parameters and its motion end with the connection."""

    def __init__(self, controller: SimulatedController, send: Callable[[bytes], None]) -> None:
        self._controller = controller
        self._layout = layout_of(controller.kind, controller.extensions)
        self._send = send
        self._grammar = wire.grammar(self._layout)
        self._lines = self._grammar.line_framer()
        self._staged: dict[str, float] = {}
        self._has_moved = False
        self._last_line_s = 0.0

    @override
    def received(self, data: bytes, now_s: float) -> None:
        """Obey every line that these bytes complete, and answer each."""
        self.advance(now_s)
        for line in self._lines.feed(data):
            if line and (reply := self._reply(line, now_s)) is not None:
                self._send(self._grammar.encode_answer(reply))

    @override
    def advance(self, now_s: float) -> None:
        """Stop a motion that is not watched any more."""
        due_s = self.next_due_s()
        if due_s is not None and now_s >= due_s:
            self._controller.stop(due_s)

    @override
    def next_due_s(self) -> float | None:
        """Return when the watchdog stops the motion; None without a watchdog or motion."""
        wait_s = self._controller.watchdog_s
        due_s = self._last_line_s + wait_s
        is_watched = wait_s > 0.0 and self._has_moved
        return due_s if is_watched and self._controller.is_moving(self._last_line_s) else None

    @override
    def closed(self, now_s: float) -> None:
        """Stop the motion whose client is lost."""
        # only its own: a client that merely reads the state must not stop another one's robot
        self._staged.clear()
        if self._has_moved and self._controller.state(now_s).moving:
            self._controller.stop(now_s)

    def _reply(self, line: bytes, now_s: float) -> Answer | None:
        try:
            question = self._grammar.decode_question(line)
            self._last_line_s = now_s
            outcome = self._obey(question, now_s)
        except BadQuestion as bad:
            return bad.answer
        except Refusal as refusal:
            outcome = Refused(refusal.code, refusal.text.replace("°", " deg"))
        return Answer(question.number, question.verb, outcome)

    def _obey(self, question: Question, now_s: float) -> object:
        match question.body:
            case Hello(version):
                return self._greet(version)
            case wire.MoveJoints() | wire.MovePose() as command:
                return self._move(command, now_s)
            case wire.ReadPart(name):
                # an extension that was never loaded is that of a perfect part, 0
                held = dict.fromkeys(self._layout.extensions, 0.0) | self._controller.geometry()
                values = tuple(held[parameter] for parameter in self._layout.names_of(name))
                return wire.Part(name, values)
            case wire.Part() as part:
                self._staged |= self._layout.flat(part)
                return Nothing()
        if question.verb == "STATE":
            return self._status(now_s)
        if question.verb == "STOP":
            self._controller.stop(now_s)
            return Nothing()
        if question.verb == "COMMIT":
            self._controller.replace_geometry(self._staged, now_s)
        # after a commit; ABANDON, the only verb left, just drops what is staged
        self._staged.clear()
        return Nothing()

    def _greet(self, version: int) -> wire.ControllerGreeting | Refused:
        if version != wire.VERSION:
            return Refused("VERSION", f"version {wire.VERSION} is spoken here, not {version}")
        self._staged.clear()
        who = self._controller
        return wire.ControllerGreeting(
            wire.VERSION, who.vendor, who.model, who.serial, who.firmware, who.kind.arms
        )

    def _status(self, now_s: float) -> wire.ControllerStatus:
        state = self._controller.reported(now_s)
        joints = tuple(self._controller.kind.outer(state.joints).tolist())
        return wire.ControllerStatus(state.moving, state.emergency_stop, state.fault, joints)

    def _move(self, command: wire.MoveJoints | wire.MovePose, now_s: float) -> wire.MotionBegun:
        speed = command.speed_percent / wire.FASTEST_PERCENT
        if isinstance(command, wire.MoveJoints):
            target = self._controller.kind.inner(command.joints).tolist()
            expected_s = self._controller.move_joints(target, speed, now_s)
        else:
            x_mm, y_mm, z_mm, *turn_deg = command.coordinates
            if len(turn_deg) > 1:
                raise Refusal("REACH", "a pose with three turns is reached by joints")
            theta_rad = radians(sum(turn_deg))
            expected_s = self._controller.move_pose(x_mm, y_mm, z_mm, theta_rad, speed, now_s)
        self._has_moved = True
        return wire.MotionBegun(expected_s)
