"""The simulated controller's side of robotline, as the specification demands it."""

import json
from binascii import crc_hqx
from math import radians
from pathlib import Path

import numpy as np
import pytest
from robotline_layouts import PAR4_LAYOUT, TILTING_LAYOUT

from drivers.wire.lines import words_of
from drivers.wire.robotline import grammar
from sim.cell import Cell
from sim.geometry import geometry_of
from sim.robot.assembly import joints_for
from sim.robot.section import nominal_robot
from sim.scenarios.scenario import load_scenario
from sim.servers.robotline_server import RobotlineSession

NOW_S = 12.5
SCENARIO = load_scenario("paper-simulation")
GOLDEN = json.loads((Path(__file__).parents[2] / "data/robotline-golden.json").read_text())
CHANGED = {n: v + 0.5 for n, v in nominal_robot("par4-prototype")[1].items()}


class Client:
    """One connection to the controller of a simulated cell, spoken to by hand."""

    def __init__(self, layout=PAR4_LAYOUT, **controller):
        section = SCENARIO.controller.model_copy(update=controller)
        self.controller = Cell(SCENARIO.model_copy(update={"controller": section})).controller
        self.grammar = grammar(layout)
        self.sent = []
        self.session = RobotlineSession(self.controller, self.sent.append)
        self.now_s = NOW_S

    def ask(self, command):
        """The answer to a question, without number, verb and checksum."""
        self.sent.clear()
        self.session.received(checked(f">5 {command}"), self.now_s)
        (answer,) = self.sent
        head = f"<5 {command.split()[0]} "
        self.grammar.decode_answer(answer[:-1])
        body = answer.decode().rpartition(" *")[0]
        assert body.startswith(head)
        return body.removeprefix(head)

    def stage_all(self, geometry=CHANGED):
        return [
            self.ask(" ".join(["STAGE", *words_of(part)]))
            for part in PAR4_LAYOUT.parts_of(geometry)
        ]

    def state(self):
        return self.controller.state(self.now_s)


def checked(body):
    data = body.encode()
    return b"%s *%04X\n" % (data, crc_hqx(data, 0xFFFF))


@pytest.fixture
def client():
    return Client()


ANSWERS = [
    ({}, "HELLO 1", "OK 1 pkmcal simulated%20Par4%20controller SIM-C-0001 1.0 4"),
    ({}, "HELLO 2", "NO VERSION "),
    ({"emergency_stop": True}, "STATE", "OK 0 1 emergency%20stop%20pressed "),
    (
        {},
        "MOVEJ 0.0 0.0 95.0 0.0 25.0",
        "NO LIMIT joint 2 to 95.0000 deg, limits -45 deg to 90 deg",
    ),
    ({}, "GEOM ARM 1", "OK ARM 1 172.5 -222.5 0.0 315.0 0.0 350.0 700.0"),
    ({}, "GEOM PLATE", "OK PLATE 100.0"),
]


@pytest.mark.parametrize(("controller", "question", "answer"), ANSWERS)
def test_question_is_answered_in_degrees_and_plain_ascii(controller, question, answer):
    said = Client(**controller).ask(question)
    assert said == answer or (answer.endswith(" ") and said.startswith(answer))


def test_orders_are_in_degrees_and_millimetres_and_need_no_hello(client):
    ok, takes_s = client.ask("MOVEJ 20.0 25.0 15.0 30.0 25.0").split()
    assert ok == "OK"
    client.now_s += float(takes_s)
    assert np.degrees(client.state().joints) == pytest.approx([20.0, 25.0, 15.0, 30.0])
    said = client.ask("STATE").split()
    assert said[:4] == ["OK", "0", "0", "-"]
    assert [float(word) for word in said[4:]] == pytest.approx([20.0, 25.0, 15.0, 30.0])
    client.now_s += float(client.ask("MOVEP 1.5 2.5 -575.0 30.0 100.0").split()[1])
    geometry = geometry_of(client.controller.geometry())
    joints = joints_for(geometry, np.array([1.5, 2.5, -575.0]), radians(30.0))
    assert client.state().joints == pytest.approx(joints, abs=1e-7)


def test_stop_ends_a_motion(client):
    client.ask("MOVEJ 60.0 55.0 50.0 45.0 5.0")
    client.now_s += 0.1
    assert client.ask("STOP") == "OK"
    client.now_s += 0.1
    assert not client.state().moving


def test_staged_geometry_works_only_after_the_commit(client):
    before = client.controller.geometry()
    assert client.stage_all() == ["OK"] * 5
    assert client.controller.geometry() == before
    assert client.ask("COMMIT") == "OK"
    assert client.controller.geometry() == CHANGED


@pytest.mark.parametrize("forget", ["ABANDON", "HELLO 1", "COMMIT"])
def test_nothing_is_staged_any_more_after(client, forget):
    client.stage_all()
    assert client.ask(forget).startswith("OK")
    assert client.ask("COMMIT").startswith("NO GEOMETRY")


def test_refused_commit_keeps_what_is_staged(client):
    takes_s = float(client.ask("MOVEJ 60.0 55.0 50.0 45.0 5.0").split()[1])
    client.stage_all()
    assert client.ask("COMMIT") == "NO BUSY the robot is moving"
    client.now_s += takes_s
    assert client.ask("COMMIT") == "OK"
    assert client.controller.geometry() == CHANGED


def test_motion_is_stopped_when_its_client_is_lost(client):
    client.ask("MOVEJ 60.0 55.0 50.0 45.0 5.0")
    client.session.closed(NOW_S + 0.1)
    assert not client.controller.state(NOW_S + 0.2).moving


@pytest.mark.parametrize("case", GOLDEN["bad_requests"], ids=lambda case: case["why"])
def test_bad_line_is_answered_as_specified_and_does_nothing(client, case):
    before = client.controller.geometry()
    client.session.received(case["line"].encode() + b"\n", NOW_S)
    assert not client.state().moving
    assert client.controller.geometry() == before
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
    client = Client(TILTING_LAYOUT, computes_plate_tilt=True)
    for tilts in ({"arm1": 0.5}, {"arm0": 0.02}):
        client.stage_all()
        for arm, tilt_deg in tilts.items():
            assert client.ask(f"STAGE {arm}.axis_tilt_deg {tilt_deg}") == "OK"
        assert client.ask("COMMIT") == "OK"
    assert client.controller.geometry() == CHANGED | {"arm0.axis_tilt_deg": 0.02}
    assert client.ask("GEOM arm0.axis_tilt_deg") == "OK arm0.axis_tilt_deg 0.02"
    assert client.ask("GEOM arm1.axis_tilt_deg") == "OK arm1.axis_tilt_deg 0.0"
