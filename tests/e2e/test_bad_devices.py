"""Devices that are not there, not the right ones, not ready, or fail while the robot is at work.

Each ends in one line that names the device, exit code 3, and a journal that can be gone on with.
"""

import contextlib
import math
import socket
import threading
from itertools import product

import pytest
from command_line import change

from campaigns.campaign import open_campaign
from campaigns.journal.journal import read_journal
from campaigns.journal.records import Intent, SessionStopped
from drivers.wire.robotline import ControllerStatus

LONG_S = 500.0
"""Of the cell's time, which is half a second of ours: nobody fails to notice."""
DEVICES = ("controller", "tracker")
KINDS = ("late", "silent", "garbage", "torn", "close")
UNREADABLE = "check the cable and the device's protocol"
ANSWERS = (60, 61, 62)
"""One of them answers a question; an event that is lost or late would go unnoticed."""

BRIEF = ("tracker", "silent")
WIRE_FAULTS = [
    pytest.param(*fault, marks=[] if fault == BRIEF else pytest.mark.long)
    for fault in product(DEVICES, KINDS)
]


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


def no_shot_is_lost(pkmcal, folder):
    """The journal tells that it was aborted, and another run completes it."""
    with read_journal(folder / "campaign.db") as journal:
        assert [e.record.how for e in journal.records_of(SessionStopped)] == ["aborted"]
    resumed = pkmcal("run", folder, "--yes")
    assert resumed.code == 0, resumed.err
    with read_journal(folder / "campaign.db") as journal:
        assert len(journal.shots(1)) == 10
        tries = [(e.record.shot, e.record.attempt) for e in journal.records_of(Intent)]
        assert len(tries) == len(set(tries)), "no number is given twice"
        assert not sum(series.unstopped for series in journal.series())


@pytest.mark.parametrize("device", DEVICES)
def test_a_device_that_is_not_there(pkmcal, tiny, device):
    for url in (nobody(), "serial:///dev/ttyNOWHERE"):
        change(tiny / "campaign.yaml", {f"{device}.url": url})
        ended = pkmcal("run", tiny, "--yes")
        assert ended.code == 3
        assert url.removeprefix("serial://") in ended.error_line
    assert not (tiny / "campaign.db").exists()


@pytest.mark.parametrize(
    ("device", "says", "words"),
    [
        ("tracker", b"", "no answer to"),
        ("controller", b"SSH-2.0-OpenSSH_9.6\r\n" * 20, UNREADABLE),
        ("tracker", bytes(range(256)) * 64, UNREADABLE),
    ],
    ids=["silence", "another protocol", "garbage"],
)
@pytest.mark.usefixtures("impatient")
def test_a_stranger_in_the_place_of_a_device(pkmcal, tiny, device, says, words):
    with stranger(says) as url:
        change(tiny / "campaign.yaml", {f"{device}.url": url})
        ended = pkmcal("run", tiny, "--yes")
    assert ended.code == 3
    assert url in ended.error_line
    assert words in ended.error_line
    assert not (tiny / "campaign.db").exists()


SAYS_NO = {
    "another controller": ({}, {"controller.serial": "B-17"}, ["SIM-C-0001", "B-17"]),
    "without the reflector": (
        {},
        {"tracker.reflector": "CCR-0.5in"},
        ["no reflector 'CCR-0.5in'", "CCR-1.5in"],
    ),
    "e-stop pressed": ({"controller.emergency_stop": True}, {}, ["emergency stop is pressed"]),
    "refusing": ({"controller.joint_limits_deg": [-1, 60]}, {}, ["limits -1 deg to 60 deg"]),
}


@pytest.mark.parametrize(("cell", "campaign", "words"), SAYS_NO.values(), ids=SAYS_NO)
def test_a_device_that_says_no(pkmcal, tiny, cell, campaign, words):
    change(tiny / "cell.yaml", cell)
    change(tiny / "campaign.yaml", campaign)
    ended = pkmcal("run", tiny, "--yes")
    assert ended.code == 3
    assert [word for word in words if word not in ended.error_line] == []


def test_a_controller_whose_joints_and_a_tracker_whose_air_cannot_be(pkmcal, tiny, monkeypatch):
    nan_degC = (math.nan, 1008.0, 44.0)
    with monkeypatch.context() as patched:
        patched.setattr("sim.tracker.instrument.SimulatedTracker.weather", lambda *_: nan_degC)
        ended = pkmcal("devices", tiny, "--json")
    assert ended.code == 3
    assert "air temperature nan °C, possible is -40 to 70 °C" in ended.error_line
    absurd = ControllerStatus(moving=False, emergency_stop=False, fault="", joints=(1e300,) * 4)
    monkeypatch.setattr("sim.servers.robotline_server.RobotlineSession._status", lambda *_: absurd)
    ended = pkmcal("run", tiny, "--yes")
    assert ended.code == 3
    assert "answers what cannot be: joint q0 at 1e+300°" in ended.error_line
    assert "sim://cell/controller" in ended.error_line


def test_devices_goes_on_after_a_dead_device_and_tells_of_both(pkmcal, tiny):
    dead = {f"{device}.url": nobody() for device in DEVICES}
    shown = {"tracker": ["390001", "CCR-1.5in", "1013"], "controller": ["SIM-C-0001", "joints deg"]}
    for device, (alive, words) in zip(DEVICES, shown.items(), strict=True):
        url = dead[f"{device}.url"]
        change(tiny / "campaign.yaml", {f"{device}.url": url, f"{alive}.url": "sim://cell"})
        ended = pkmcal("devices", tiny)
        assert ended.code == 3
        assert f"{url}: nobody answers" in ended.error_line
        assert f"{device} at {url}\n  failed  {device} at {url}: nobody answers" in ended.out
        told = ended.out.partition(f"{alive} at ")[2]
        assert [word for word in words if word not in told] == []
    change(tiny / "campaign.yaml", dead)
    ended = pkmcal("devices", tiny, "--json")
    assert ended.code == 3
    assert "nobody answers" in ended.document["error"]["problem"]
    for name, url in dead.items():
        assert f"failed  {name.removesuffix('.url')} at {url}: nobody answers" in ended.err


def test_devices_asks_nobody_while_a_run_is_under_way(pkmcal, tiny):
    before = (tiny / "cell-memory.json").exists()
    with open_campaign(tiny).held():
        ended = pkmcal("devices", tiny)
    assert ended.code == 2
    assert "another process works on this campaign: process" in ended.error_line
    assert (tiny / "cell-memory.json").exists() == before
    assert pkmcal("devices", tiny).code == 0


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
    no_shot_is_lost(pkmcal, tiny)


def test_a_run_whose_robot_failed_is_gone_on_with_and_not_mixed_with_another_plan(pkmcal, tiny):
    fault = {"at_move": 4, "kind": "drive_fault", "seconds": LONG_S}
    change(tiny / "cell.yaml", {"faults": [fault]})
    ended = pkmcal("run", tiny, "--yes")
    assert ended.code == 3
    assert "drive fault axis 2" in ended.error_line
    assert pkmcal("plan", tiny, "--seed", 8).code == 0
    for how in ("--yes", "--dry"):
        refused = pkmcal("run", tiny, how)
        assert refused.code == 2
        assert "another plan" in refused.error_line
    (tiny / "plan-older-2.csv").replace(tiny / "plan.csv")
    no_shot_is_lost(pkmcal, tiny)
