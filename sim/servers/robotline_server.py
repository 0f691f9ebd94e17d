"""The simulated controller's side of robotline (docs/robotline.md): one connection, no socket."""

from collections.abc import Callable
from math import radians

from drivers.wire.robotline import (
    BadRequest,
    Refused,
    Reply,
    decode_request,
    encode_reply,
    line_framer,
)
from drivers.wire.robotline_messages import (
    FASTEST_PERCENT,
    VERSION,
    Abandon,
    Answer,
    AskState,
    Command,
    Commit,
    Done,
    Greeting,
    Hello,
    Motion,
    MoveJoints,
    MovePose,
    Parameters,
    Part,
    ReadPart,
    RobotLayout,
    Stage,
    Status,
    Stop,
)
from sim.geometry import Kind
from sim.robot.controller import Refusal, SimulatedController


def layout_of(kind: Kind, extensions: tuple[str, ...] = ()) -> RobotLayout:
    """Names of a mechanism's joints, coordinates and parameters, as the wire has them."""
    turn = () if kind.turn is None else ("theta_deg",)
    joints = tuple(f"q{arm}_{kind.unit}" for arm in range(kind.arms))
    return RobotLayout(joints, ("x_mm", "y_mm", "z_mm", *turn), kind.names, extensions)


class RobotlineSession:
    """Answers one client. What is staged, and the motion that it started, end with it."""

    def __init__(self, controller: SimulatedController, send: Callable[[bytes], None]) -> None:
        self._controller = controller
        self._layout = layout_of(controller.kind, controller.extensions)
        self._send = send
        self._lines = line_framer()
        self._staged: dict[str, float] = {}
        self._has_moved = False

    def received(self, data: bytes, now_s: float) -> None:
        """Obey every line that these bytes complete, and answer each."""
        for line in self._lines.feed(data):
            if line and (reply := self._reply(line, now_s)) is not None:
                self._send(encode_reply(reply))

    def advance(self, now_s: float) -> None:
        """Do nothing: this protocol says nothing unasked."""

    def next_due_s(self) -> float | None:
        """Return None: nothing is ever due."""
        return None

    def closed(self, now_s: float) -> None:
        """Stop the motion that nobody watches any more."""
        self._staged.clear()
        if self._has_moved and self._controller.state(now_s).moving:
            self._controller.stop(now_s)

    def _reply(self, line: bytes, now_s: float) -> Reply | None:
        try:
            request = decode_request(line, self._layout)
        except BadRequest as bad:
            return bad.reply
        outcome = self._outcome(request.command, now_s)
        return Reply(request.sequence, request.command.verb, outcome)

    def _outcome(self, command: Command, now_s: float) -> Answer | Refused:
        try:
            return self._obey(command, now_s)
        except Refusal as refusal:
            return Refused(refusal.code, refusal.text.replace("°", " deg"))

    def _obey(self, command: Command, now_s: float) -> Answer | Refused:
        match command:
            case Hello(version):
                return self._greet(version)
            case AskState():
                return self._status(now_s)
            case MoveJoints() | MovePose():
                return self._move(command, now_s)
            case Stop():
                self._controller.stop(now_s)
                return Done()
            case ReadPart(name):
                held = dict.fromkeys(self._layout.extensions, 0.0) | self._controller.geometry()
                values = tuple(held[parameter] for parameter in self._layout.names_of(name))
                return Parameters(Part(name, values))
            case Stage() | Commit() | Abandon():
                return self._replace_geometry(command, now_s)

    def _greet(self, version: int) -> Greeting | Refused:
        if version != VERSION:
            return Refused("VERSION", f"version {VERSION} is spoken here, not {version}")
        self._staged.clear()
        who = self._controller
        return Greeting(VERSION, who.vendor, who.model, who.serial, who.firmware, who.kind.arms)

    def _status(self, now_s: float) -> Status:
        state = self._controller.state(now_s)
        joints = tuple(map(self._controller.kind.outer, state.joints))
        return Status(state.moving, state.emergency_stop, state.fault, joints)

    def _move(self, command: MoveJoints | MovePose, now_s: float) -> Motion:
        speed = command.speed_percent / FASTEST_PERCENT
        if isinstance(command, MoveJoints):
            target = tuple(map(self._controller.kind.inner, command.joints))
            expected_s = self._controller.move_joints(target, speed, now_s)
        else:
            x_mm, y_mm, z_mm, *turn_deg = command.coordinates
            theta_rad = radians(sum(turn_deg))
            expected_s = self._controller.move_pose(x_mm, y_mm, z_mm, theta_rad, speed, now_s)
        self._has_moved = True
        return Motion(expected_s)

    def _replace_geometry(self, command: Stage | Commit | Abandon, now_s: float) -> Done:
        if isinstance(command, Stage):
            self._staged |= self._layout.flat(command.part)
            return Done()
        if isinstance(command, Commit):
            self._controller.replace_geometry(self._staged, now_s)
        self._staged.clear()
        return Done()
