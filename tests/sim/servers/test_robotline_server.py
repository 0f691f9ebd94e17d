"""The simulated controller's side of robotline, as the specification demands it."""

import json
from binascii import crc_hqx
from dataclasses import dataclass, field
from math import radians
from pathlib import Path

import pytest
from robotline_layouts import PAR4_LAYOUT, TILTING_LAYOUT

from drivers.values import RobotState
from drivers.wire.lines import written
from drivers.wire.robotline import grammar
from sim.geometry import PAR4, Kind
from sim.robot.controller import Refusal
from sim.servers.robotline_server import RobotlineSession

GEOMETRY = {name: float(number) for number, name in enumerate(PAR4.names)}


@dataclass
class FakeController:
    """Writes down what it is asked to do."""

    kind: Kind = PAR4
    extensions: tuple[str, ...] = ()
    vendor: str = "pkmcal"
    model: str = "Par4 (simulated)"
    serial: str = "7"
    firmware: str = "1.0"
    moving: bool = False
    fault: str = ""
    refusal: Refusal | None = None
    joints: tuple[float, ...] = (0.0, radians(45.0), radians(-90.0), 0.5)
    parameters: dict[str, float] = field(default_factory=lambda: dict(GEOMETRY))
    calls: list[tuple[object, ...]] = field(default_factory=list)

    def state(self, now_s):
        return RobotState((0.0, radians(45.0), radians(-90.0), 0.5), self.moving, self.fault, False)

    def move_joints(self, target_rad, speed_fraction, now_s):
        return self._move("move_joints", tuple(target_rad), speed_fraction, now_s)

    def move_pose(self, x_mm, y_mm, z_mm, theta_rad, speed_fraction, now_s):
        return self._move("move_pose", x_mm, y_mm, z_mm, theta_rad, speed_fraction, now_s)

    def stop(self, now_s):
        self.calls.append(("stop", now_s))
        self.moving = False

    def geometry(self):
        return dict(self.parameters)

    def replace_geometry(self, geometry, now_s):
        self._call("replace_geometry", dict(geometry), now_s)
        self.parameters = dict(geometry)

    def _move(self, *call):
        self._call(*call)
        self.moving = True
        return 1.25

    def _call(self, *call):
        if self.refusal is not None:
            raise self.refusal
        self.calls.append(call)


NOW_S = 12.5
GOLDEN = json.loads((Path(__file__).parents[2] / "data/robotline-golden.json").read_text())


class Client:
    """One connection to a fake controller, spoken to by hand."""

    layout = PAR4_LAYOUT

    def __init__(self, controller=None):
        self.controller = controller or FakeController()
        self.sent = []
        self.session = RobotlineSession(self.controller, self.sent.append)

    def ask(self, command):
        """The answer to a question, without number, verb and checksum."""
        self.sent.clear()
        self.session.received(checked(f">5 {command}"), NOW_S)
        (answer,) = self.sent
        head = f"<5 {command.split()[0]} "
        grammar(self.layout).decode_answer(answer[:-1])
        body = answer.decode().rpartition(" *")[0]
        assert body.startswith(head)
        return body.removeprefix(head)

    def stage_all(self, geometry):
        return [
            self.ask(" ".join(["STAGE", *written(part)])) for part in PAR4_LAYOUT.parts_of(geometry)
        ]


class TiltingClient(Client):
    """The same to one that computes plate tilt."""

    layout = TILTING_LAYOUT


def checked(body):
    data = body.encode()
    return b"%s *%04X\n" % (data, crc_hqx(data, 0xFFFF))


@pytest.fixture
def client():
    return Client()


LIMIT = Refusal("LIMIT", "joint 2 to 95.0°, limit 90°")
ANSWERS = [
    ({}, "HELLO 1", "OK 1 pkmcal Par4%20(simulated) 7 1.0 4"),
    ({}, "HELLO 2", "NO VERSION "),
    ({}, "STATE", "OK 0 0 - 0.0 45.0 -90.0 28.64788975654116"),
    ({"moving": True, "fault": "drive fault axis 2"}, "STATE", "OK 1 0 drive%20fault%20axis%202 "),
    (
        {"refusal": LIMIT},
        "MOVEJ 0.0 0.0 95.0 0.0 25.0",
        "NO LIMIT joint 2 to 95.0 deg, limit 90 deg",
    ),
    ({}, "GEOM ARM 1", "OK ARM 1 7.0 8.0 9.0 10.0 11.0 12.0 13.0"),
    ({}, "GEOM PLATE", "OK PLATE 28.0"),
]


@pytest.mark.parametrize(("controller", "question", "answer"), ANSWERS)
def test_question_is_answered_in_degrees_and_plain_ascii(controller, question, answer):
    said = Client(FakeController(**controller)).ask(question)
    assert said == answer or (answer.endswith(" ") and said.startswith(answer))


TURN_RAD = radians(30.0)
QUARTERS_RAD = tuple(map(radians, (0.0, 45.0, -45.0, 90.0)))


@pytest.mark.parametrize(
    ("question", "answer", "call"),
    [
        ("MOVEJ 0.0 45.0 -45.0 90.0 25.0", "OK 1.25", ("move_joints", QUARTERS_RAD, 0.25)),
        (
            "MOVEP 1.5 2.5 -575.0 30.0 100.0",
            "OK 1.25",
            ("move_pose", 1.5, 2.5, -575.0, TURN_RAD, 1.0),
        ),
        ("STOP", "OK", ("stop",)),
    ],
)
def test_order_reaches_the_controller_in_millimetres_and_radians_without_a_hello(
    client, question, answer, call
):
    assert client.ask(question) == answer
    assert client.controller.calls == [(*call, NOW_S)]


def test_staged_geometry_works_only_after_the_commit(client):
    changed = {name: value + 0.5 for name, value in GEOMETRY.items()}
    assert client.stage_all(changed) == ["OK"] * 5
    assert client.controller.calls == []
    assert client.ask("COMMIT") == "OK"
    assert client.controller.calls == [("replace_geometry", changed, NOW_S)]


@pytest.mark.parametrize("forget", ["ABANDON", "HELLO 1", "COMMIT"])
def test_nothing_is_staged_any_more_after(client, forget):
    client.ask("STAGE PLATE 1.0")
    client.ask(forget)
    client.controller.calls.clear()
    client.ask("COMMIT")
    assert client.controller.calls == [("replace_geometry", {}, NOW_S)]


def test_refused_commit_keeps_what_is_staged():
    client = Client(FakeController(refusal=Refusal("BUSY", "the robot is moving")))
    client.stage_all(GEOMETRY)
    assert client.ask("COMMIT") == "NO BUSY the robot is moving"
    client.controller.refusal = None
    assert client.ask("COMMIT") == "OK"
    assert client.controller.calls == [("replace_geometry", GEOMETRY, NOW_S)]


def test_motion_is_stopped_when_its_client_is_lost(client):
    client.ask("MOVEJ 0.0 0.0 0.0 0.0 25.0")
    client.session.closed(NOW_S + 1.0)
    assert client.controller.calls[-1] == ("stop", NOW_S + 1.0)


@pytest.mark.parametrize("case", GOLDEN["bad_requests"], ids=lambda case: case["why"])
def test_bad_line_is_answered_as_specified_and_does_nothing(client, case):
    client.session.received(case["line"].encode() + b"\n", NOW_S)
    assert client.controller.calls == []
    if case["answer"] is None:
        assert client.sent == []
    else:
        assert [line.decode().startswith(case["answer"]) for line in client.sent] == [True]


def test_extensions_are_unknown_words_to_a_plain_controller(client):
    for question in ("GEOM arm0.axis_tilt_deg", "STAGE arm0.axis_tilt_deg 0.02"):
        client.sent.clear()
        client.session.received(checked(f">5 {question}"), NOW_S)
        assert client.sent[0].startswith(f"<5 {question.split()[0]} NO ARGUMENT".encode())


def test_extension_that_is_not_staged_is_zero_after_the_commit():
    controller = FakeController(extensions=PAR4.extensions)
    client = TiltingClient(controller)
    controller.parameters |= {"arm1.axis_tilt_deg": 0.5}
    assert client.ask("GEOM arm1.axis_tilt_deg") == "OK arm1.axis_tilt_deg 0.5"
    assert client.ask("GEOM arm0.axis_tilt_deg") == "OK arm0.axis_tilt_deg 0.0"
    client.stage_all(GEOMETRY)
    assert client.ask("STAGE arm0.axis_tilt_deg 0.02") == "OK"
    assert client.ask("COMMIT") == "OK"
    assert controller.parameters == GEOMETRY | {"arm0.axis_tilt_deg": 0.02}
    assert client.ask("GEOM arm1.axis_tilt_deg") == "OK arm1.axis_tilt_deg 0.0"
