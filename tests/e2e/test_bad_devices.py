"""Devices that are not there, not the right ones, not ready, or fail while the robot is at work.

Each ends in one line that names the device, exit code 3, and a journal that can be gone on with.
"""

import contextlib
import socket
import threading

import pytest
from command_line import change

from campaigns.campaign import open_campaign
from campaigns.journal.journal import read_journal
from campaigns.journal.records import Intent, SessionStopped

LONG_S = 500.0
"""Of the cell's time, which is half a second of ours: nobody fails to notice."""
DEVICES = ("controller", "tracker")
UNREADABLE = "check the cable and the device's protocol"
ANSWERS = (60, 61, 62)
"""One of them answers a question; an event that is lost or late would go unnoticed."""

WIRE_FAULTS = [
    ("tracker", "silent"),
    *(
        pytest.param(*fault, marks=pytest.mark.long)
        for fault in (
            *(("controller", "late"), ("tracker", "garbage"), ("controller", "torn")),
            *(("controller", "silent"), ("tracker", "close")),
        )
    ),
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


def test_a_device_that_is_not_there(pkmcal, tiny):
    for device, url in (("controller", nobody()), ("tracker", "serial:///dev/ttyNOWHERE")):
        change(tiny / "campaign.yaml", {f"{device}.url": url})
        ended = pkmcal("run", tiny, "--yes")
        assert ended.code == 3
        assert url.removeprefix("serial://") in ended.error_line
        change(tiny / "campaign.yaml", {f"{device}.url": "sim://cell"})
    assert not (tiny / "campaign.db").exists()


@pytest.mark.parametrize(
    ("device", "says", "words"),
    [("tracker", b"", "no answer to"), ("controller", b"SSH-2.0-OpenSSH_9.6\r\n" * 20, UNREADABLE)],
    ids=["silence", "another protocol"],
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
    "e-stop pressed": ({"controller.emergency_stop": True}, {}, ["emergency stop is pressed"]),
}


@pytest.mark.parametrize(("cell", "campaign", "words"), SAYS_NO.values(), ids=SAYS_NO)
def test_a_device_that_says_no(pkmcal, tiny, cell, campaign, words):
    change(tiny / "cell.yaml", cell)
    change(tiny / "campaign.yaml", campaign)
    ended = pkmcal("run", tiny, "--yes")
    assert ended.code == 3
    assert [word for word in words if word not in ended.error_line] == []


def test_devices_goes_on_after_a_dead_device_and_tells_of_both(pkmcal, tiny):
    dead = {f"{device}.url": nobody() for device in DEVICES}
    url = dead["controller.url"]
    change(tiny / "campaign.yaml", {"controller.url": url})
    ended = pkmcal("devices", tiny)
    assert ended.code == 3
    assert f"controller at {url}\n  failed  controller at {url}: nobody answers" in ended.out
    assert "390001" in ended.out.partition("tracker at ")[2]
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
    assert "--force plans anew" in pkmcal("plan", tiny, "--seed", 8).error_line
    assert pkmcal("plan", tiny, "--seed", 8, "--force").code == 0
    for how in ("--yes", "--dry"):
        refused = pkmcal("run", tiny, how)
        assert refused.code == 2
        assert "another plan" in refused.error_line
    (tiny / "plan-older-2.csv").replace(tiny / "plan.csv")
    no_shot_is_lost(pkmcal, tiny)
