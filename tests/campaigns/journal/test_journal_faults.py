"""Full disks, locks, torn files, killed processes: nothing half written, nothing lost."""

import os
import shutil
import signal
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from journal_story import SESSION, beginning, intent, outcome, ticking
from tampering import add_by_hand

from campaigns.errors import CampaignLocked, JournalFailed
from campaigns.files.lock import NO_LOCKS, campaign_lock
from campaigns.journal import database
from campaigns.journal.journal import Journal, open_journal
from campaigns.journal.records import Event

NOTE = Event("operator note", "x" * 3000)


def write_until_it_fails(journal: Journal) -> None:
    for _ in range(200):
        journal.append(NOTE)


def test_a_full_disk_fails_the_record_and_every_later_one(journal: Journal, path: Path) -> None:
    journal._connection.execute("PRAGMA max_page_count = 20")
    with pytest.raises(JournalFailed, match="disk is full") as failed:
        write_until_it_fails(journal)
    assert "free space" in failed.value.remedy
    written = journal.last_number()
    journal._connection.execute("PRAGMA max_page_count = 2000")
    with pytest.raises(JournalFailed, match="none is written any more"):
        journal.append(NOTE)
    with open_journal(path, now_utc=ticking()) as later:
        assert [entry.number for entry in later.records()] == list(range(1, written + 1))
        assert later.append(NOTE) == written + 1


def test_a_journal_that_another_program_keeps_locked_fails_with_what_to_do(
    journal: Journal, path: Path
) -> None:
    journal._connection.execute("PRAGMA busy_timeout = 0")
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(JournalFailed, match="close the other program"):
            journal.append(NOTE)


def test_a_file_system_without_locks_is_named(
    journal: Journal, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """SQLite takes ENOLCK for a lock that another program holds."""
    journal._connection.execute("PRAGMA busy_timeout = 0")
    monkeypatch.setattr(database, "has_record_locks", lambda _: False)
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(JournalFailed) as failed:
            journal.append(NOTE)
    assert failed.value.remedy == NO_LOCKS


def test_a_journal_that_became_write_protected_or_was_closed_fails(journal: Journal) -> None:
    journal._connection.execute("PRAGMA query_only = ON")
    with pytest.raises(JournalFailed, match="right to write"):
        journal.append(NOTE)
    journal.close()
    with pytest.raises(JournalFailed, match="closed database"):
        journal.records()


def test_a_closed_journal_writes_nothing(journal: Journal) -> None:
    journal.close()
    with pytest.raises(JournalFailed, match="closed database"):
        journal.append(NOTE)


def test_a_record_that_somebody_wrote_by_hand_is_named_when_it_cannot_be_read(
    journal: Journal, path: Path
) -> None:
    journal.start_series(beginning())
    add_by_hand(path, "event", "{}")
    with pytest.raises(JournalFailed, match="record 2 cannot be read: event: kind: Field required"):
        journal.records()


@pytest.mark.parametrize("share_kept", [0.0, 0.6, 0.999])
def test_a_log_torn_by_a_power_cut_gives_the_records_before_the_tear(
    journal: Journal, path: Path, tmp_path: Path, share_kept: float
) -> None:
    run = journal.start_series(beginning())
    for shot in range(1, 12):
        journal.append(intent(shot), series=run)
        journal.append(outcome(shot), series=run)
    written = journal.records()
    torn = tmp_path / "torn"
    torn.mkdir()
    log = path.with_name("campaign.db-wal").read_bytes()
    (torn / "campaign.db-wal").write_bytes(log[: int(len(log) * share_kept)])
    with open_journal(Path(shutil.copy(path, torn)), now_utc=ticking()) as rescued:
        records = rescued.records()
        assert records == written[: len(records)]
        assert len(records) < len(written)
        rescued.append(Event("operator note", "after the power cut"))


def test_a_process_killed_between_intent_and_outcome_leaves_its_records_and_no_lock(
    path: Path,
) -> None:
    process = writer_that_waits(path)
    try:
        with (
            pytest.raises(CampaignLocked, match=f"process {process} on "),
            campaign_lock(path.parent, now_utc=ticking()),
        ):
            pytest.fail("two processes hold the campaign")
    finally:
        os.kill(process, signal.SIGKILL)
        os.waitpid(process, 0)
    with (
        campaign_lock(path.parent, now_utc=ticking()),
        open_journal(path, now_utc=ticking()) as journal,
    ):
        run = journal.latest_series("run")
        assert run is not None
        assert not run.finished
        assert [shot.outcome for shot in journal.shots(run.number)] == [outcome(1)]
        assert journal.records()[-1].record == intent(2)
        assert (run.sessions, run.unstopped) == (1, 1)
        journal.append(SESSION, series=run.number)
        assert journal.append(intent(2, 2), series=run.number) == 7


def writer_that_waits(path: Path) -> int:
    """Another process that has locked the campaign and written an intent; returns its number."""
    read_end, write_end = os.pipe()
    process = os.fork()
    if process == 0:
        try:
            clock = ticking()
            with (
                campaign_lock(path.parent, now_utc=clock),
                open_journal(path, now_utc=clock) as journal,
            ):
                run = journal.start_series(beginning())
                for record in (SESSION, intent(1), outcome(1), intent(2)):
                    journal.append(record, series=run)
                os.write(write_end, b"intended")
                signal.pause()
        finally:
            os._exit(1)  # nothing may go on with what the parent does
    os.close(write_end)
    with os.fdopen(read_end, "rb") as said:
        assert said.read(8) == b"intended"
    return process
