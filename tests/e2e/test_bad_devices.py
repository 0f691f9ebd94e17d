"""Devices that are not there, not the right ones, not ready, or fail while the robot is at work.

Each ends in one line that names the device, exit code 3, and a journal that can be gone on with.
"""

import contextlib
import math
import socket
import threading
import time
from functools import partial

import pytest
from command_line import change

from campaigns.campaign import open_campaign
from campaigns.journal.journal import read_journal
from campaigns.journal.records import Intent, SessionStopped
from drivers.emscon.client import EmsconDeadlines
from drivers.emscon.tracker import EmsconTracker
from drivers.robotline.robot import LineRobot, RobotlineDeadlines
from drivers.wire.robotline import ControllerStatus
from sim.cell import Cell
from sim.clock import ScaledClock
from sim.embedded import EmbeddedCell
from sim.scenarios.scenario import load_scenario

IMPATIENT_ROBOT = RobotlineDeadlines(answer_s=0.3, stop_answer_s=0.3, standstill_s=3.0)
IMPATIENT_TRACKER = EmsconDeadlines(answer_s=0.3, measuring_margin_s=0.3)
LONG_S = 500.0
"""Of the cell's time, which is half a second of ours: nobody fails to notice."""
KINDS = ("late", "silent", "garbage", "torn", "close")
ANSWERS = (60, 61, 62)
"""One of them answers a question; an event that is lost or late would go unnoticed."""

WIRE_FAULTS = [
    pytest.param(device, kind, marks=[] if brief else pytest.mark.long)
    for device, kind, brief in (
        *(("controller", kind, kind == "torn") for kind in KINDS),
        *(("tracker", kind, kind == "silent") for kind in KINDS),
    )
]


@pytest.fixture
def impatient(monkeypatch):
    """Drivers that give up soon; `undo` makes them patient again."""
    robot = partial(LineRobot, deadlines=IMPATIENT_ROBOT)
    monkeypatch.setattr("drivers.robotline.robot.LineRobot", robot)
    tracker = partial(EmsconTracker, deadlines=IMPATIENT_TRACKER)
    monkeypatch.setattr("drivers.emscon.tracker.EmsconTracker", tracker)
    return monkeypatch


@contextlib.contextmanager
def stranger(says=b""):
    """Somebody who listens where a device should be; gives the URL."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(5.0)

        def serve():
            accepted, _ = listener.accept()
            with accepted:
                accepted.settimeout(5.0)
                with contextlib.suppress(OSError):
                    while accepted.recv(4096):
                        accepted.sendall(says)

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield f"tcp://127.0.0.1:{listener.getsockname()[1]}"
        finally:
            thread.join()


def nobody():
    """A URL where nobody answers."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return f"tcp://127.0.0.1:{listener.getsockname()[1]}"


def no_shot_is_lost(pkmcal, folder, how):
    """The journal tells how it ended, and another run completes it."""
    with read_journal(folder / "campaign.db") as journal:
        assert [e.record.how for e in journal.records_of(SessionStopped)] == [how]
    resumed = pkmcal("run", folder, "--yes")
    assert resumed.code == 0, resumed.err
    with read_journal(folder / "campaign.db") as journal:
        assert len(journal.shots(1)) == 10
        tries = [(e.record.shot, e.record.attempt) for e in journal.records_of(Intent)]
        assert len(tries) == len(set(tries)), "no number is given twice"
        assert not sum(series.unstopped for series in journal.series())


@pytest.mark.parametrize("device", ["controller", "tracker"])
def test_a_device_that_is_not_there(pkmcal, tiny, device):
    url = nobody()
    change(tiny / "campaign.yaml", {f"{device}.url": url})
    ended = pkmcal("run", tiny, "--yes")
    assert ended.code == 3
    assert f"{url}: nobody answers" in ended.error_line
    assert not (tiny / "campaign.db").exists()


def test_a_serial_line_that_is_not_there(pkmcal, tiny):
    change(tiny / "campaign.yaml", {"controller.url": "serial:///dev/ttyNOWHERE"})
    ended = pkmcal("devices", tiny)
    assert ended.code == 3
    assert "/dev/ttyNOWHERE" in ended.error_line


@pytest.mark.parametrize("device", ["controller", "tracker"])
@pytest.mark.usefixtures("impatient")
def test_somebody_who_listens_and_says_nothing(pkmcal, tiny, device):
    with stranger() as url:
        change(tiny / "campaign.yaml", {f"{device}.url": url})
        ended = pkmcal("run", tiny, "--yes")
    assert ended.code == 3
    assert f"{url}: no answer to" in ended.error_line
    assert not (tiny / "campaign.db").exists()


@pytest.mark.parametrize("device", ["controller", "tracker"])
@pytest.mark.parametrize(
    "says",
    [b"SSH-2.0-OpenSSH_9.6\r\n" * 20, bytes(range(256)) * 64],
    ids=["another protocol", "garbage"],
)
@pytest.mark.usefixtures("impatient")
def test_a_stranger_in_the_place_of_a_device(pkmcal, tiny, device, says):
    with stranger(says) as url:
        change(tiny / "campaign.yaml", {f"{device}.url": url})
        ended = pkmcal("run", tiny, "--yes")
    assert ended.code == 3
    assert "check the cable and the device's protocol" in ended.error_line
    assert not (tiny / "campaign.db").exists()


@pytest.mark.parametrize("device", ["controller", "tracker"])
@pytest.mark.usefixtures("impatient")
def test_garbage_names_the_device_it_came_from(pkmcal, tiny, device):
    with stranger(bytes(range(256))) as url:
        change(tiny / "campaign.yaml", {f"{device}.url": url})
        ended = pkmcal("devices", tiny)
    assert url in ended.error_line


@pytest.mark.parametrize(
    ("device", "serial"), [("controller", "SIM-C-0001"), ("tracker", "390001")]
)
def test_a_device_that_is_not_the_expected_one(pkmcal, tiny, device, serial):
    change(tiny / "campaign.yaml", {f"{device}.serial": "B-17"})
    ended = pkmcal("run", tiny, "--yes")
    assert ended.code == 3
    for word in (device, serial, "B-17"):
        assert word in ended.error_line
    assert not (tiny / "campaign.db").exists()


@pytest.mark.parametrize(
    ("cell", "campaign", "words"),
    [
        ({"tracker.warm_up_s": 3600}, {}, ["heating up", "wait"]),
        ({}, {"tracker.reflector": "CCR-0.5in"}, ["no reflector 'CCR-0.5in'", "CCR-1.5in"]),
        ({"controller.emergency_stop": True}, {}, ["emergency stop is pressed"]),
        ({"controller.joint_limits_deg": [-1, 60]}, {}, ["joint", "limits -1 deg to 60 deg"]),
    ],
    ids=["not warm", "without the reflector", "e-stop pressed", "refusing"],
)
def test_a_device_that_says_no(pkmcal, tiny, cell, campaign, words):
    change(tiny / "cell.yaml", {"controller": {}} | cell)
    change(tiny / "campaign.yaml", campaign)
    ended = pkmcal("run", tiny, "--yes")
    assert ended.code == 3
    for word in words:
        assert word in ended.error_line


@pytest.mark.parametrize("joint_deg", [1e300, 1e7])
def test_a_controller_whose_joints_cannot_be(pkmcal, tiny, monkeypatch, joint_deg):
    absurd = ControllerStatus(moving=False, emergency_stop=False, fault="", joints=(joint_deg,) * 4)
    monkeypatch.setattr("sim.servers.robotline_server.RobotlineSession._status", lambda *_: absurd)
    began_s = time.monotonic()
    ended = pkmcal("run", tiny, "--yes")
    assert ended.code == 3
    assert f"answers what cannot be: joint q0 at {joint_deg:g}°" in ended.error_line
    assert "tcp://127.0.0.1" in ended.error_line
    assert time.monotonic() - began_s < 10.0


@pytest.mark.parametrize(
    ("dead", "alive", "words"),
    [
        ("controller", "tracker", ["390001", "CCR-1.5in", "1013"]),
        ("tracker", "controller", ["SIM-C-0001", "joints deg"]),
    ],
)
def test_devices_goes_on_after_a_dead_device(pkmcal, tiny, dead, alive, words):
    url = nobody()
    change(tiny / "campaign.yaml", {f"{dead}.url": url})
    ended = pkmcal("devices", tiny)
    assert ended.code == 3
    assert f"{url}: nobody answers" in ended.error_line
    assert f"{dead} at {url}\n  failed  {dead} at {url}: nobody answers" in ended.out
    shown = ended.out.partition(f"{alive} at ")[2]
    for word in words:
        assert word in shown


def test_devices_tells_of_both_when_both_are_dead(pkmcal, tiny):
    urls = [nobody(), nobody()]
    change(tiny / "campaign.yaml", dict(zip(("controller.url", "tracker.url"), urls, strict=True)))
    ended = pkmcal("devices", tiny, "--json")
    assert ended.code == 3
    assert ended.out == ""
    for device, url in zip(("controller", "tracker"), urls, strict=True):
        assert f"failed  {device} at {url}: nobody answers" in ended.err


def test_devices_asks_nobody_while_a_run_is_under_way(pkmcal, tiny):
    before = (tiny / "cell-memory.json").exists()
    with open_campaign(tiny).held():
        ended = pkmcal("devices", tiny)
    assert ended.code == 2
    assert "another process works on this campaign: process" in ended.error_line
    assert (tiny / "cell-memory.json").exists() == before
    assert pkmcal("devices", tiny).code == 0


def test_air_that_cannot_be(pkmcal, tiny, monkeypatch):
    monkeypatch.setattr(
        "sim.tracker.instrument.SimulatedTracker.weather", lambda *_: (math.nan, 1008.0, 44.0)
    )
    ended = pkmcal("devices", tiny, "--json")
    assert ended.code == 3
    assert "air temperature nan °C, possible is -40 to 70 °C" in ended.error_line


def test_a_tracker_that_is_not_initialised_is_initialised(pkmcal, tiny):
    change(tiny / "cell.yaml", {"tracker.initialised": False})
    before = pkmcal("devices", tiny, "--json")
    assert before.document["tracker"]["initialised"] is False
    assert pkmcal("run", tiny, "--yes").code == 0
    assert pkmcal("devices", tiny, "--json").document["tracker"]["initialised"] is True


def test_a_tracker_that_another_program_uses(pkmcal, tiny):
    scenario = load_scenario(str(tiny / "cell.yaml"))
    with EmbeddedCell(Cell(scenario), ScaledClock(1000.0)) as cell:
        change(tiny / "campaign.yaml", {"tracker.url": cell.tracker_url})
        port = int(cell.tracker_url.rpartition(":")[2])
        with socket.create_connection(("127.0.0.1", port)):
            ended = pkmcal("run", tiny, "--yes")
    assert ended.code == 3
    assert "end the other program" in ended.error_line


@pytest.mark.parametrize(("device", "kind"), WIRE_FAULTS)
def test_a_wire_that_fails_while_the_robot_works(pkmcal, tiny, impatient, device, kind):
    seconds = {"seconds": LONG_S} if kind == "late" else {}
    faults = [{"device": device, "at_answer": at, "kind": kind, **seconds} for at in ANSWERS]
    change(tiny / "cell.yaml", {"faults": faults})
    ended = pkmcal("run", tiny, "--yes")
    assert ended.code == 3
    assert " → check the" in ended.error_line
    impatient.undo()
    change(tiny / "cell.yaml", {"faults": []})  # a busy machine asks often enough to meet it again
    no_shot_is_lost(pkmcal, tiny, "aborted")


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("emergency_stop", "emergency stop is pressed"),
        ("drive_fault", "drive fault axis 2"),
        ("stall", "from its target"),
    ],
)
def test_a_robot_that_fails_on_its_way(pkmcal, tiny, kind, words):
    change(tiny / "cell.yaml", {"faults": [{"at_move": 4, "kind": kind, "seconds": LONG_S}]})
    ended = pkmcal("run", tiny, "--yes")
    assert ended.code == 3
    assert words in ended.error_line
    no_shot_is_lost(pkmcal, tiny, "aborted")


def test_a_beam_that_is_broken_for_a_moment_only_costs_time(pkmcal, tiny):
    change(
        tiny / "cell.yaml",
        {"faults": [{"at_measurement": 8, "kind": "beam_break", "seconds": 0.5}]},
    )
    ended = pkmcal("run", tiny, "--yes")
    assert ended.code == 0
    assert "! shot" in ended.err
    assert "beam" in ended.err


def test_a_run_with_another_plan_is_not_mixed(pkmcal, tiny):
    change(
        tiny / "cell.yaml", {"faults": [{"at_move": 4, "kind": "drive_fault", "seconds": LONG_S}]}
    )
    assert pkmcal("run", tiny, "--yes").code == 3
    assert pkmcal("plan", tiny, "--seed", 8).code == 0
    refused = pkmcal("run", tiny, "--yes")
    assert refused.code == 2
    assert "another plan" in refused.error_line
    again = pkmcal("run", tiny, "--yes", "--anew", "--json").document
    assert (again["series"], again["shots"]) == (2, 10)
