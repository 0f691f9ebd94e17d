"""A journal that others delete, cut, change or exchange: exit code 4, and nothing is claimed."""

import shutil

import pytest
from command_line import change, ended, started
from tampering import change_text, make_version_1, tamper
from test_interrupted import FAST, SLOW, is_at_work, wait_until

from campaigns.journal.journal import read_journal
from campaigns.journal.records import Outcome

pytestmark = pytest.mark.long

BACKUP = "bring campaign.db back from a backup"


def test_a_run_whose_journal_is_deleted_ends_with_4_and_goes_on_from_the_one_that_was_rescued(
    planned, pkmcal
):
    path = planned / "campaign.db"
    change(planned / "cell.yaml", SLOW)
    process = started("run", planned, "--yes", "--json")
    try:
        wait_until(lambda: is_at_work(planned), process)
        path.unlink()
        stopped = ended(process)
    finally:
        process.kill()
        process.communicate()
    assert (stopped.code, stopped.out) == (4, "")
    assert "has all" not in stopped.err
    assert "are whole in campaign-rescued-1.db" in stopped.error_line
    (planned / "campaign-rescued-1.db").rename(path)
    for name in ("campaign.db-wal", "campaign.db-shm"):
        (planned / name).unlink(missing_ok=True)
    with read_journal(path) as journal:
        kept = {(e.record.shot, e.record.attempt) for e in journal.records_of(Outcome)}
    change(planned / "cell.yaml", FAST)
    assert pkmcal("run", planned, "--yes").code == 0
    with read_journal(path) as journal:
        assert len(journal.shots(1)) == 59
        assert kept <= {(e.record.shot, e.record.attempt) for e in journal.records_of(Outcome)}


def first_outcome(folder):
    with read_journal(folder / "campaign.db") as journal:
        return journal.records_of(Outcome)[0]


def digit_changed(folder):
    """The first digit of a measured coordinate, made another one; gives the record's number."""
    found = first_outcome(folder)
    old = repr(found.record.point_in_tracker_mm[0])
    digit = "7" if old[0] != "7" else "3"
    change_text(folder / "campaign.db", found.number, f"[{old}", f"[{digit}{old[1:]}")
    return found.number


COMMANDS = (
    ["identify"],
    ["run", "--yes"],
    ["report"],
    ["export"],
    ["export", "--shots"],
    ["check-journal"],
)


def test_every_command_refuses_a_journal_with_a_changed_digit_and_names_the_record(
    measured, pkmcal
):
    number = digit_changed(measured)
    for name, *options in COMMANDS:
        refused = pkmcal(name, measured, *options)
        assert refused.code == 4, name
        assert f"record {number} was changed after it was written" in refused.error_line
        assert BACKUP in refused.error_line


def test_every_command_refuses_the_journal_of_another_campaign(measured, planned, pkmcal):
    other = planned.with_name("other")
    assert pkmcal("new", other, "--scenario", "paper-simulation").code == 0
    shutil.copy(measured / "campaign.db", other)
    shutil.copy(measured / "plan.csv", other)
    for name, *options in COMMANDS:
        refused = pkmcal(name, other, *options)
        assert refused.code == 4, name
        assert "series 1 is of another campaign, '" in refused.error_line
        assert BACKUP in refused.error_line
    with read_journal(measured / "campaign.db") as journal:
        identity = journal.series()[0].started.configuration["identity"]
    change(other / "campaign.yaml", {"identity": identity})
    assert pkmcal("check-journal", other).code == 0


def test_a_campaign_from_before_identities_goes_on(measured, pkmcal):
    """Neither its settings nor its journal have one, and the journal no digests."""
    path = measured / "campaign.db"
    tamper(path, 'UPDATE record SET body = replace(body, \'"identity": "\', \'"was": "\')')
    make_version_1(path)
    change(measured / "campaign.yaml", {"identity": None})
    assert pkmcal("check-journal", measured).code == 0
    assert pkmcal("identify", measured).code == 0
    assert pkmcal("report", measured).code == 0
    after = pkmcal("check-journal", measured, "--json")
    assert after.code == 0
    assert after.document["version"] == 2
    assert after.document["chained"] == 1


def test_check_journal_says_what_is_there_and_changes_nothing(measured, pkmcal):
    path = measured / "campaign.db"
    before = path.read_bytes()
    said = pkmcal("check-journal", measured, "--json")
    with read_journal(measured / "campaign.db") as journal:
        records, end = journal.last_number(), journal.end()
    assert said.code == 0
    assert said.document == {
        "path": str(measured / "campaign.db"),
        "whole": True,
        "version": 2,
        "records": records,
        "chained": records,
        "digest": end.digest,
        "series": 1,
        "sessions": 1,
        "crashed_sessions": 0,
        "crashed": 0,
        "shots": 59,
        "problems": [],
    }
    assert "the journal is whole" in pkmcal("check-journal", measured).out
    assert path.read_bytes() == before
    make_version_1(path)
    before = path.read_bytes()
    assert pkmcal("check-journal", measured).code == 0
    assert path.read_bytes() == before


def test_check_journal_names_everything_that_is_wrong(measured, pkmcal):
    path = measured / "campaign.db"
    first = digit_changed(measured)
    tamper(path, "DROP INDEX one_series")
    refused = pkmcal("check-journal", measured, "--json")
    assert refused.code == 4
    texts = [each["problem"] for each in refused.document["problems"]]
    assert texts[0] == f"record {first} was changed after it was written"
    assert "the rule 'one_series' has been taken out of the file" in texts
    assert "(and 1 more)" in refused.error_line
