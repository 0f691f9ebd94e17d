"""The simulated controller's side of robotline (docs/robotline.md): one connection, no socket."""

from collections.abc import Callable
from math import radians

from typing_extensions import override

from drivers.values import Coordinate
from drivers.wire import robotline as wire
from drivers.wire.numbered_lines import BadRequest, CommandDone, Hello, Refused
from sim.geometry import Kind
from sim.robot.controller import Refusal, SimulatedController
from sim.servers.peers import ServedSession


def layout_of(kind: Kind, extensions: tuple[str, ...] = ()) -> wire.RobotLayout:
    """Joints, coordinates and parameters of a mechanism, as the wire has them."""
    joints = [Coordinate(f"q{arm}", not kind.on_rails) for arm in range(kind.arms)]
    task = [Coordinate(name, is_angle=False) for name in "xyz"]
    if kind.turn is not None:
        task.append(Coordinate("theta", is_angle=True))
    known = [(name, arm, field.stem) for name, (arm, field) in kind.parameters.items()]
    return wire.RobotLayout.of(joints, task, known, extensions)


class RobotlineSession(ServedSession):
    """Answers one client. What is staged, and the motion that it started, end with it."""

    def __init__(self, controller: SimulatedController, send: Callable[[bytes], None]) -> None:
        self._controller = controller
        self._layout = layout_of(controller.kind, controller.extensions)
        self._send = send
        self._grammar = wire.grammar(self._layout)
        self._lines = self._grammar.line_framer()
        self._staged: dict[str, float] = {}
        self._has_moved = False

    @override
    def received(self, data: bytes, now_s: float) -> None:
        """Obey every line that these bytes complete, and answer each."""
        for line in self._lines.feed(data):
            if line and (reply := self._reply(line, now_s)) is not None:
                self._send(self._grammar.encode_reply(reply))

    @override
    def closed(self, now_s: float) -> None:
        """Stop the motion that nobody watches any more."""
        self._staged.clear()
        if self._has_moved and self._controller.state(now_s).moving:
            self._controller.stop(now_s)

    def _reply(self, line: bytes, now_s: float) -> wire.RobotlineReply | None:
        outcome: wire.Answer | Refused
        try:
            request = self._grammar.decode_request(line)
            outcome = self._obey(request.command, now_s)
        except BadRequest as bad:
            return bad.reply
        except Refusal as refusal:
            outcome = Refused(refusal.code, refusal.text.replace("°", " deg"))
        return wire.RobotlineReply(
            request.sequence, self._grammar.verb_of(request.command), outcome
        )

    def _obey(self, command: wire.Command, now_s: float) -> wire.Answer | Refused:
        match command:
            case Hello(version):
                return self._greet(version)
            case wire.Order.STATE:
                return self._status(now_s)
            case wire.MoveJoints() | wire.MovePose():
                return self._move(command, now_s)
            case wire.Order.STOP:
                self._controller.stop(now_s)
                return CommandDone()
            case wire.ReadPart(name):
                held = dict.fromkeys(self._layout.extensions, 0.0) | self._controller.geometry()
                values = tuple(held[parameter] for parameter in self._layout.names_of(name))
                return wire.Part(name, values)
            case wire.Part() | wire.Order():
                return self._replace_geometry(command, now_s)

    def _greet(self, version: int) -> wire.ControllerGreeting | Refused:
        if version != wire.VERSION:
            return Refused("VERSION", f"version {wire.VERSION} is spoken here, not {version}")
        self._staged.clear()
        who = self._controller
        return wire.ControllerGreeting(
            wire.VERSION, who.vendor, who.model, who.serial, who.firmware, who.kind.arms
        )

    def _status(self, now_s: float) -> wire.ControllerStatus:
        state = self._controller.state(now_s)
        joints = tuple(map(self._controller.kind.outer, state.joints))
        return wire.ControllerStatus(state.moving, state.emergency_stop, state.fault, joints)

    def _move(self, command: wire.MoveJoints | wire.MovePose, now_s: float) -> wire.MotionBegun:
        speed = command.speed_percent / wire.FASTEST_PERCENT
        if isinstance(command, wire.MoveJoints):
            target = tuple(map(self._controller.kind.inner, command.joints))
            expected_s = self._controller.move_joints(target, speed, now_s)
        else:
            x_mm, y_mm, z_mm, *turn_deg = command.coordinates
            theta_rad = radians(sum(turn_deg))
            expected_s = self._controller.move_pose(x_mm, y_mm, z_mm, theta_rad, speed, now_s)
        self._has_moved = True
        return wire.MotionBegun(expected_s)

    def _replace_geometry(self, command: wire.Part | wire.Order, now_s: float) -> CommandDone:
        if isinstance(command, wire.Part):
            self._staged |= self._layout.flat(command)
            return CommandDone()
        if command is wire.Order.COMMIT:
            self._controller.replace_geometry(self._staged, now_s)
        self._staged.clear()
        return CommandDone()
