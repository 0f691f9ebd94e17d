"""Full disks, locks, torn files, killed processes: nothing half written, nothing lost."""

import errno
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest
from journal_story import SESSION, beginning, intent, outcome, ticking
from small_files import files_no_larger_than

from campaigns.errors import CampaignLocked, JournalFailed
from campaigns.files.lock import NO_LOCKS, campaign_lock
from campaigns.journal import database
from campaigns.journal.journal import Journal, open_journal, read_journal
from campaigns.journal.records import Event

WRITER = Path(__file__).with_name("journal_writer.py")


def noted_until_it_fails(journal: Journal) -> tuple[int, JournalFailed]:
    """How many notes could be written, and what ended it."""
    for written in range(200):
        try:
            journal.append(Event("operator note", "x" * 3000))
        except JournalFailed as failed:
            return written, failed
    pytest.fail("the disk never filled")


def test_a_full_disk_fails_the_record_and_every_later_one(journal: Journal, path: Path) -> None:
    journal._connection.execute("PRAGMA max_page_count = 20")
    written, failed = noted_until_it_fails(journal)
    assert "disk is full" in str(failed)
    assert "free space" in failed.remedy
    assert isinstance(failed.__cause__, sqlite3.OperationalError)

    journal._connection.execute("PRAGMA max_page_count = 2000")
    with pytest.raises(JournalFailed, match="none is written any more"):
        journal.append(Event("operator note", "space again"))
    with open_journal(path, now_utc=ticking()) as later:
        assert [entry.number for entry in later.records()] == list(range(1, written + 1))
        assert later.append(Event("operator note", "on again")) == written + 1


def test_a_write_that_the_system_refuses_leaves_only_whole_records(
    journal: Journal, path: Path
) -> None:
    with files_no_larger_than(100_000):
        written, failed = noted_until_it_fails(journal)
    assert written > 0
    assert "check the disk" in failed.remedy or "free space" in failed.remedy
    with read_journal(path) as reader:
        assert len(reader.records()) == written


def test_a_journal_that_another_program_keeps_locked_fails_with_what_to_do(
    journal: Journal, path: Path
) -> None:
    journal._connection.execute("PRAGMA busy_timeout = 0")
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(JournalFailed, match="close the other program"):
            journal.append(Event("operator note", "mine"))


def test_a_file_system_without_locks_of_records_is_named_and_nothing_is_left(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """SQLite takes ENOLCK for a lock that another program holds."""

    def refusing(*_: object) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    def busy(*_: object) -> None:
        error = sqlite3.OperationalError("database is locked")
        error.sqlite_errorcode = sqlite3.SQLITE_BUSY
        raise error

    path.with_name("campaign.yaml").touch()
    monkeypatch.setattr("fcntl.lockf", refusing)
    monkeypatch.setattr(database, "_create_tables", busy)
    with pytest.raises(JournalFailed, match="database is locked") as failed:
        open_journal(path, now_utc=ticking())
    assert failed.value.remedy == NO_LOCKS
    assert [file.name for file in path.parent.iterdir()] == ["campaign.yaml"]


def test_a_journal_that_became_write_protected_fails_with_what_to_do(journal: Journal) -> None:
    journal._connection.execute("PRAGMA query_only = ON")
    with pytest.raises(JournalFailed, match="right to write"):
        journal.append(Event("operator note", "mine"))


def test_a_closed_journal_fails_like_any_other(journal: Journal) -> None:
    journal.close()
    journal.close()
    with pytest.raises(JournalFailed, match="closed database"):
        journal.append(Event("operator note", "late"))
    with pytest.raises(JournalFailed, match="closed database"):
        journal.records()


def test_a_record_that_somebody_wrote_by_hand_is_named_when_it_cannot_be_read(
    journal: Journal, path: Path
) -> None:
    journal.start_series(beginning())
    with closing(sqlite3.connect(path)) as other:
        other.execute("INSERT INTO record VALUES (NULL, '', 'event', 1, NULL, NULL, '{}', 'd')")
        other.commit()
    with pytest.raises(JournalFailed, match="record 2 cannot be read: event: kind: Field required"):
        journal.records()


@pytest.mark.parametrize("share_kept", [0.0, 0.6, 0.95, 0.999])
def test_a_log_torn_by_a_power_cut_gives_the_records_before_the_tear(
    journal: Journal, path: Path, tmp_path: Path, share_kept: float
) -> None:
    run = journal.start_series(beginning())
    for shot in range(1, 12):
        journal.append(intent(shot), series=run)
        journal.append(outcome(shot), series=run)
    told = journal.records()
    torn = torn_copy(path, tmp_path / "torn", share_kept)

    with open_journal(torn, now_utc=ticking()) as rescued:
        found = rescued.records()
        assert found == told[: len(found)]
        assert len(found) < len(told)
        rescued.append(Event("operator note", "after the power cut"))


def torn_copy(path: Path, folder: Path, share_kept: float) -> Path:
    """The files as a power cut leaves them: the end of the write-ahead log is not there."""
    folder.mkdir()
    log = path.with_name("campaign.db-wal").read_bytes()
    (folder / "campaign.db-wal").write_bytes(log[: int(len(log) * share_kept)])
    return Path(shutil.copy(path, folder))


def test_a_process_killed_between_intent_and_outcome_leaves_all_it_said_and_no_lock(
    path: Path,
) -> None:
    kill_a_writer(path)
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


def kill_a_writer(path: Path) -> None:
    """Let another process lock the campaign and write, and kill it after an intent."""
    command = [sys.executable, str(WRITER), str(path)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    env = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}  # with tests/support
    with subprocess.Popen(command, env=env, **pipes) as writer:
        assert writer.stdout is not None
        try:
            assert writer.stdout.readline() == b"intended\n"
            with (
                pytest.raises(CampaignLocked, match=f"process {writer.pid} on "),
                campaign_lock(path.parent, now_utc=ticking()),
            ):
                pytest.fail("two processes hold the campaign")
        finally:
            writer.kill()
    assert writer.returncode == -signal.SIGKILL
