"""Runs that nobody watches: lost links, poses that cannot be measured, edited plans, `--dry`."""

import pytest
from command_line import change, ended, started

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


def write_rows(folder, rows):
    (folder / "plan.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")


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
    ran = pkmcal("run", tiny, "--yes", "--json", "--retry", 2)
    assert ran.code == 0, ran.err
    assert (ran.document["series"], ran.document["shots"]) == (1, SHOTS)
    assert "! connecting again, 1 of 2 in a row, after: " in ran.err
    device = fault.get("device", "controller")
    serial = {"controller": "SIM-C-0001", "tracker": "390001"}[device]
    (told,) = events(tiny, "reconnected")
    assert f"{device} {serial} at tcp://127.0.0.1:" in told
    assert endings(tiny) == ["aborted", "finished"]
    compared = [text for text in events(tiny, "drift check") if "after the restart" in text]
    assert len(compared) == 1, "reference poses were measured before it went on"


def test_retry_may_stand_in_campaign_yaml(pkmcal, tiny):
    fault = {"device": "tracker", "at_answer": 60, "kind": "close"}
    change(tiny / "cell.yaml", {"faults": [fault]})
    change(tiny / "campaign.yaml", {"run": {"retry": 1}})
    assert pkmcal("run", tiny, "--yes").code == 0


def test_retry_gives_up_after_so_many_in_a_row(pkmcal, tiny):
    """A drive that never recovers: the cell's memory forgets it, so each move of a try has one."""
    faults = [{"at_move": move, "kind": "drive_fault"} for move in range(3, 40)]
    change(tiny / "cell.yaml", {"faults": faults})
    ran = pkmcal("run", tiny, "--yes", "--retry", 1)
    assert ran.code == 3
    assert "controller SIM-C-0001 at tcp://" in ran.error_line
    assert "drive fault axis 2" in ran.error_line
    assert endings(tiny) == ["aborted"] * 2


def test_emergency_stop_is_never_retried(pkmcal, tiny):
    change(
        tiny / "cell.yaml",
        {"faults": [{"at_move": 4, "kind": "emergency_stop", "seconds": LONG_S}]},
    )
    ran = pkmcal("run", tiny, "--yes", "--retry", 5)
    assert ran.code == 3
    assert "emergency stop is pressed" in ran.error_line
    assert endings(tiny) == ["aborted"]


def test_another_device_at_the_address_is_not_gone_on_with(pkmcal, tiny):
    change(tiny / "cell.yaml", {"faults": [{"at_move": 4, "kind": "drive_fault"}]})
    assert pkmcal("run", tiny, "--yes").code == 3
    change(tiny / "cell.yaml", {"controller": {"serial": "SIM-C-0002"}})
    ran = pkmcal("run", tiny, "--yes", "--retry", 5)
    assert ran.code == 2
    assert "the controller of serial number SIM-C-0001, now it is SIM-C-0002" in ran.error_line


def test_term_during_the_pause_before_a_retry_ends_it(tiny):
    change(tiny / "campaign.yaml", {"controller.url": "tcp://127.0.0.1:9"})
    process = started("run", tiny, "--yes", "--retry", 1000)
    try:
        for line in process.stderr:
            if "connecting again, 3 of 1000" in line:
                break
        process.terminate()
        stopped = ended(process)
    finally:
        process.kill()
        process.communicate()
    assert stopped.code == 130


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
    assert (only.code, "nothing is left to measure" in only.err) == (0, True)


def test_unknown_shot_cannot_be_skipped(pkmcal, tiny):
    ran = pkmcal("run", tiny, "--yes", "--skip", 99)
    assert ran.code == 2
    assert "--skip 99: plan.csv has no such shot" in ran.error_line


def test_rows_may_be_taken_out_of_a_plan_and_added_while_it_is_measured(pkmcal, tiny):
    change(tiny / "cell.yaml", {"faults": [{"at_move": 4, "kind": "drive_fault"}]})
    assert pkmcal("run", tiny, "--yes").code == 3
    header, *rows = rows_of(tiny)
    gone = rows[-2].split(",")[2]
    kept = [row for row in rows if row.split(",")[2] != gone]
    write_rows(tiny, [header, *kept])
    dry = pkmcal("run", tiny, "--dry", "--json")
    assert dry.code == 0, dry.err
    assert (dry.document["series"], dry.document["shots"]) == (1, SHOTS - 2)
    assert pkmcal("run", tiny, "--yes").code == 0
    write_rows(tiny, [header, *rows])
    ran = pkmcal("run", tiny, "--yes", "--json")
    assert (ran.document["series"], ran.document["shots"]) == (1, SHOTS)


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
    assert "nothing is left to measure" in done.err


def test_dry_refuses_what_run_would_refuse(pkmcal, tiny):
    change(tiny / "cell.yaml", {"faults": [{"at_move": 4, "kind": "drive_fault"}]})
    assert pkmcal("run", tiny, "--yes").code == 3
    change(tiny / "campaign.yaml", {"tracker.serial": "390002"})
    refused = pkmcal("run", tiny, "--dry")
    assert refused.code == 2
    assert "the tracker of serial number 390001, now it is 390002" in refused.error_line
    change(tiny / "campaign.yaml", {"tracker.serial": None})
    assert pkmcal("plan", tiny, "--seed", 8).code == 0
    refused = pkmcal("run", tiny, "--dry")
    assert refused.code == 2
    assert "another plan" in refused.error_line


def test_stand_that_was_moved_is_refused_and_gone_on_with_anyway(pkmcal, tiny):
    change(tiny / "cell.yaml", {"faults": [{"at_move": 6, "kind": "drive_fault"}]})
    assert pkmcal("run", tiny, "--yes").code == 3
    change(tiny / "cell.yaml", {"tracker.station.x_mm": 1935.0})
    refused = pkmcal("run", tiny, "--yes")
    assert refused.code == 3
    assert "the tracker, its stand or the robot's base has moved" in refused.error_line
    assert "--anyway" in refused.error_line
    ran = pkmcal("run", tiny, "--yes", "--anyway", "--json")
    assert ran.code == 0, ran.err
    assert ran.document["shots"] == SHOTS
    assert len(events(tiny, "gone on anyway")) == 1
