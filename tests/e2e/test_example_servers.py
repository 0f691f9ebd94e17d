"""The servers under examples/servers: their answers word for word, and a run by them."""

import json
import subprocess
import sys
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from threading import Lock

import pytest
from command_line import change
from robotline_layouts import PAR4_LAYOUT, PAR4_LINES

from drivers.wire import pointline, robotline
from drivers.wire.lines import Nothing, Question

ROOT = Path(__file__).parents[2]
SERVERS = ROOT / "examples/servers"
GOLDEN = json.loads((ROOT / "tests/data/robotline-golden.json").read_text(encoding="utf-8"))


@pytest.fixture
def controller(monkeypatch):
    """A session of the controller to copy."""
    monkeypatch.syspath_prepend(SERVERS)
    server = import_module("robotline_server")
    return server.RobotlineSession(server.Controller(), Lock())


@pytest.fixture
def instrument(monkeypatch):
    """A session of the instrument to copy, which sees nothing."""
    monkeypatch.syspath_prepend(SERVERS)
    server = import_module("pointline_server")
    return server.PointlineSession(server.Instrument(), Lock())


@contextmanager
def serving(script, *words):
    """A server in a process of its own; gives its port."""
    command = (sys.executable, SERVERS / script, "0", *words)
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process.stdout.readline().split()[-1]
        finally:
            process.kill()


@pytest.mark.parametrize("case", GOLDEN["bad_requests"], ids=lambda case: case["why"])
def test_controller_to_copy_answers_bad_lines_as_the_page_says(controller, case):
    answer = controller.answer(case["line"].encode())
    if case["answer"] is None:
        assert answer is None
    else:
        assert answer.decode().startswith(case["answer"])
        assert PAR4_LINES.decode_answer(answer[:-1])


def asked(session, grammar, verb, *body):
    """The session's answer to a question, read by our grammar."""
    line = session.answer(grammar.encode_question(Question(7, verb, *body))[:-1])
    return grammar.decode_answer(line[:-1])


def test_instrument_to_copy_whose_robot_is_silent_says_so(instrument):
    instrument._instrument._robot = "127.0.0.1", 1
    assert asked(instrument, pointline.GRAMMAR, "MEASURE").body.code == "FAULT"
    assert asked(instrument, pointline.GRAMMAR, "DIRECTION").body.code == "NONE"


def test_controller_to_copy_replaces_all_parameters_or_none_and_keeps_them(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(SERVERS)
    server = import_module("robotline_server")
    session = server.RobotlineSession(server.Controller(tmp_path / "kept"), Lock())

    def told(verb, *body):
        return asked(session, PAR4_LINES, verb, *body).body

    parts = [told("GEOM", robotline.ReadPart(name)) for name in PAR4_LAYOUT.parts]
    changed = [robotline.Part(p.name, tuple(1.5 + value for value in p.values)) for p in parts]
    told("STAGE", changed[0])
    assert told("COMMIT").code == "GEOMETRY"
    for part in changed:
        told("STAGE", part)
    assert told("COMMIT") == Nothing()
    again = server.RobotlineSession(server.Controller(tmp_path / "kept"), Lock())
    assert asked(again, PAR4_LINES, "GEOM", robotline.ReadPart("ARM 0")).body == changed[0]


@pytest.mark.long
def test_a_run_by_the_servers_to_copy(pkmcal, tiny):
    with (
        serving("robotline_server.py", "--deg-per-s", "900") as robot,
        serving("pointline_server.py", "--robot", f"127.0.0.1:{robot}") as seen,
    ):
        devices = {
            "controller.url": f"tcp://127.0.0.1:{robot}",
            "tracker.url": f"tcp://127.0.0.1:{seen}",
            "tracker.driver": "pointline",
            "tracker.measuring_time_s": 0.001,
            "settle.time_s": 0.001,
        }
        change(tiny / "campaign.yaml", devices)
        found = pkmcal("devices", tiny, "--json").document
        assert (found["controller"]["serial"], found["tracker"]["serial"]) == ("EX-0001", "4711")
        ended = pkmcal("run", tiny, "--yes", "--json")
    assert ended.code == 0, ended.err
    assert ended.document["shots"] == 10


@pytest.mark.long
def test_own_controller_is_rehearsed_with_a_simulated_tracker(pkmcal, tmp_path):
    with serving("robotline_server.py", "--deg-per-s", "900") as robot:
        folder = tmp_path / "own"
        own = f"tcp://127.0.0.1:{robot}"
        made = pkmcal("new", folder, "--controller", own, "--tracker", "sim://paper-simulation")
        assert made.code == 0, made.err
        change(folder / "campaign.yaml", {"settle.time_s": 0.001, "plan.drift_shots": 2})
        change(folder / "campaign.yaml", {"plan.shots": 48, "plan.validation_pairs": 4})
        assert pkmcal("plan", folder).code == 0
        assert pkmcal("run", folder, "--yes", "--json").document["shots"] == 58
    found = pkmcal("identify", folder, "--json").document
    assert found["unseen_mm"]["before"]["mean_abs"] > 0.5
    assert found["unseen_mm"]["after"]["mean_abs"] < 0.05
