"""Runs that nobody watches: lost links, poses that cannot be measured, `--dry`."""

import pytest
from command_line import change

from campaigns.journal.journal import read_journal
from campaigns.journal.records import Event, SessionStopped

pytestmark = pytest.mark.long

SHOTS = 10
LONG_S = 500.0
"""Of the cell's time, which is half a second of ours: nobody fails to notice."""


def events(folder, kind):
    with read_journal(folder / "campaign.db") as journal:
        return [e.record.text for e in journal.records_of(Event) if e.record.kind == kind]


def endings(folder):
    with read_journal(folder / "campaign.db") as journal:
        return [e.record.how for e in journal.records_of(SessionStopped)]


def rows_of(folder):
    return (folder / "plan.csv").read_text(encoding="utf-8").splitlines()


@pytest.mark.parametrize(
    "fault",
    [
        {"device": "controller", "at_answer": 60, "kind": "close"},
        {"device": "tracker", "at_answer": 60, "kind": "close"},
        {"at_move": 4, "kind": "drive_fault", "seconds": LONG_S},
    ],
    ids=lambda fault: fault.get("device", fault["kind"]),
)
def test_retry_connects_again_and_goes_on(pkmcal, tiny, fault):
    change(tiny / "cell.yaml", {"faults": [fault]})
    change(tiny / "campaign.yaml", {"run": {"retry": 2}})
    ran = pkmcal("run", tiny, "--yes", "--json")
    assert ran.code == 0, ran.err
    assert (ran.document["series"], ran.document["shots"]) == (1, SHOTS)
    assert "! connecting again, 1 of 2 in a row, after: " in ran.err
    device = fault.get("device", "controller")
    serial = {"controller": "SIM-C-0001", "tracker": "390001"}[device]
    (told,) = events(tiny, "reconnected")
    assert f"{device} {serial} at sim://cell/" in told
    assert endings(tiny) == ["aborted", "finished"]
    compared = [text for text in events(tiny, "drift check") if "after the restart" in text]
    assert len(compared) == 1, "reference poses were measured before it went on"


def test_pose_that_the_controller_refuses_is_skipped_and_listed(pkmcal, tiny):
    """One joint's limit rules out one pair, whatever the plan took as possible."""
    columns = rows_of(tiny)[0].split(",")
    joints = [at for at, name in enumerate(columns) if name.startswith("q")]
    largest = {}
    for row in (row.split(",") for row in rows_of(tiny)[1:]):
        values = [float(row[at]) for at in joints]
        largest[row[2]] = max(largest.get(row[2], (-180.0, "")), (max(values), row[0]))
    (next_deg, _), (last_deg, shot) = sorted(largest.values())[-2:]
    pair = next(name for name, found in largest.items() if found[1] == shot)
    limit = 0.5 * (next_deg + last_deg)
    change(tiny / "cell.yaml", {"controller": {"joint_limits_deg": [-120.0, limit]}})
    ran = pkmcal("run", tiny, "--yes", "--json")
    assert ran.code == 0, ran.err
    (skipped,) = ran.document["skipped"]
    partners = [int(row.split(",")[0]) for row in rows_of(tiny)[1:] if row.split(",")[2] == pair]
    assert skipped["shots"] == partners
    assert int(shot) in partners
    assert "limits -120" in skipped["reason"]
    assert ran.document["shots"] == SHOTS - 2
    assert len(events(tiny, "shot skipped")) == 2
    told = pkmcal("run", tiny, "--yes")
    assert "not measured: shots" in told.out
    assert f"{SHOTS - 2} shots; 2 of the plan were skipped" in told.out
    only = pkmcal("run", tiny, "--yes", "--skip", shot)
    assert (only.code, "all of the plan is measured" in only.err) == (0, True)


def test_dry_says_what_run_would_say_and_moves_nothing(pkmcal, tiny):
    first = pkmcal("run", tiny, "--dry", "--json").document
    assert (first["series"], first["measured"], len(first["left"])) == (None, 0, SHOTS)
    assert not (tiny / "campaign.db").exists()
    change(tiny / "cell.yaml", {"faults": [{"at_move": 5, "kind": "drive_fault"}]})
    assert pkmcal("run", tiny, "--yes").code == 3
    before = (tiny / "campaign.db").read_bytes()
    dry = pkmcal("run", tiny, "--dry", "--json", "--skip", "8")
    assert (tiny / "campaign.db").read_bytes() == before
    assert dry.document["measured"] + len(dry.document["left"]) + 2 == SHOTS
    line = next(line for line in dry.err.splitlines() if line.startswith("series 1 has "))
    ran = pkmcal("run", tiny, "--yes", "--skip", "8")
    assert line in ran.err
    done = pkmcal("run", tiny, "--dry", "--skip", "8")
    assert "all of the plan is measured" in done.err
