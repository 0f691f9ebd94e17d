"""A journal that others delete, replace or cut while it is written is found out at once."""

import sqlite3
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path

import pytest
from journal_story import SESSION, beginning, intent, outcome, ticking
from lost_files import HARMS, cut_log, delete, empty_log, link, log_of, scribble_in_log

from campaigns.errors import JournalFailed
from campaigns.journal import own_file
from campaigns.journal.journal import Journal, open_journal, read_journal
from campaigns.journal.own_file import OwnFile
from campaigns.journal.records import Event

RECORDS = 3


@pytest.fixture
def journal(path: Path) -> Iterator[Journal]:
    with open_journal(path, now_utc=ticking(), create=True) as journal:
        run = journal.start_series(beginning())
        journal.append(SESSION, series=run)
        journal.append(intent(1), series=run)
        yield journal


def refused(journal: Journal) -> JournalFailed:
    with pytest.raises(JournalFailed) as caught:
        journal.append(outcome(1), series=1)
    return caught.value


SAID = {
    "delete": "campaign.db: was deleted or moved away",
    "replace": "campaign.db: was replaced by another file",
    "overwrite": "campaign.db: was ",
    "truncate": "campaign.db: was cut from",
    "link": "campaign.db: has 2 names",
    "delete_log": "campaign.db-wal: was deleted",
    "cut_log": "campaign.db-wal: was cut from",
    "scribble_in_log": "campaign.db-wal: was changed by another program",
    "delete_index": "campaign.db-shm: was deleted",
}


@pytest.mark.parametrize("harm", HARMS)
def test_whatever_happens_to_the_files_is_said_and_no_further_record_is_written(
    journal: Journal, path: Path, harm: str
) -> None:
    HARMS[harm](path)
    assert SAID.get(harm, "campaign.db") in refused(journal).problem
    with pytest.raises(JournalFailed, match="none is written any more"):
        journal.append(intent(2), series=1)


@pytest.mark.parametrize("harm", ["delete", "delete_all", "move_away", "replace", "delete_log"])
def test_records_of_a_file_that_is_gone_are_kept_in_another(
    journal: Journal, path: Path, harm: str
) -> None:
    told = journal.records()
    HARMS[harm](path)
    error = refused(journal)
    assert f"its {RECORDS} records are whole in campaign-rescued-1.db" in error.remedy
    with read_journal(path.with_name("campaign-rescued-1.db")) as reader:
        assert reader.records() == told
    assert [p.name for p in path.parent.glob("campaign-rescued*")] == ["campaign-rescued-1.db"]


def test_a_rescued_journal_is_gone_on_with_as_the_error_says(journal: Journal, path: Path) -> None:
    delete(path)
    refused(journal)
    log_of(path).unlink(missing_ok=True)
    path.with_name("campaign-rescued-1.db").rename(path)
    with open_journal(path, now_utc=ticking()) as again:
        assert again.append(intent(1, 2), series=1) == RECORDS + 1


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_a_cut_log_is_left_as_it_was_found_and_gives_the_records_before_the_cut(
    path: Path, share: float
) -> None:
    with open_journal(path, now_utc=ticking(), create=True) as journal:
        run = journal.start_series(beginning())
        for shot in range(1, 12):
            journal.append(intent(shot), series=run)
            journal.append(outcome(shot), series=run)
        told, log = journal.records(), log_of(path)
        with log.open("r+b") as file:
            file.truncate(int(log.stat().st_size * share))
        left = path.read_bytes(), log.read_bytes()
        with pytest.raises(JournalFailed, match="cut from"):
            journal.append(intent(12), series=run)
        assert (path.read_bytes(), log.read_bytes()) == left
    assert (path.read_bytes(), log.read_bytes()) == left
    with read_journal(path) as reader:
        found = reader.records()
    assert 0 < len(found) < len(told)
    assert found == told[: len(found)]


def test_others_may_read_meanwhile(journal: Journal, path: Path) -> None:
    with read_journal(path) as reader:
        assert len(reader.records()) == RECORDS
    with closing(sqlite3.connect(path)) as other:
        assert other.execute("SELECT count(*) FROM record").fetchone() == (RECORDS,)
    journal.append(outcome(1), series=1)


def test_a_log_that_is_begun_again_is_the_own_work(journal: Journal, path: Path) -> None:
    sizes = []
    for _ in range(20):
        journal.append(Event("operator note", "x" * 400_000), series=1)
        sizes.append(path.stat().st_size)
    assert len(set(sizes)) > 1, "the log has been moved into the file at least once"


def test_a_record_that_others_wrote_is_not_built_upon(journal: Journal, path: Path) -> None:
    with closing(sqlite3.connect(path)) as other, other:
        other.execute("INSERT INTO record VALUES (4, '', 'event', 1, NULL, NULL, '{}', 'd')")
    assert "changed by another program" in refused(journal).problem


@pytest.mark.parametrize("harm", sorted({*HARMS} - {"scribble_in_log"}))
def test_harm_in_the_very_moment_of_writing_is_found_too(
    journal: Journal, path: Path, monkeypatch: pytest.MonkeyPatch, harm: str
) -> None:
    """After the look at the files and before the write, which then hides what was cut.

    What is scribbled far before the end of the log in that millisecond is found only at the end.
    """
    check = OwnFile.check

    def checked(self: OwnFile) -> None:
        check(self)
        HARMS[harm](path)

    with monkeypatch.context() as patch:
        patch.setattr(OwnFile, "check", checked)
        with suppress(JournalFailed):  # a new name or another index is found only at the next one
            journal.append(intent(2), series=1)
    with pytest.raises(JournalFailed):
        journal.append(outcome(1), series=1)


@pytest.mark.parametrize("harm", ["delete", "replace", "truncate", "delete_log", "cut_log"])
def test_harm_between_a_write_and_the_look_at_it_is_found_before_the_robot_could_move(
    journal: Journal, path: Path, monkeypatch: pytest.MonkeyPatch, harm: str
) -> None:
    insert = Journal._insert

    def inserted(self: Journal, *record: object) -> None:
        insert(self, *record)  # type: ignore[arg-type]
        HARMS[harm](path)

    monkeypatch.setattr(Journal, "_insert", inserted)
    with pytest.raises(JournalFailed):
        journal.append(intent(2), series=1)


def test_a_log_that_somebody_reads_is_moved_later(
    journal: Journal, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(own_file, "LONG_LOG_BYTES", 300_000)
    with closing(sqlite3.connect(path, isolation_level=None)) as reader:
        reader.execute("BEGIN")
        reader.execute("SELECT count(*) FROM record").fetchone()
        for _ in range(4):
            journal.append(Event("operator note", "x" * 400_000), series=1)
        assert log_of(path).stat().st_size > 1_500_000
        reader.execute("COMMIT")
        for _ in range(4):
            journal.append(Event("operator note", "x" * 400_000), series=1)
    assert log_of(path).stat().st_size < 1_000_000
    journal.prove()
    assert journal.last_number() == RECORDS + 8


@pytest.mark.parametrize("harm", [delete, cut_log, empty_log, scribble_in_log, link])
def test_the_end_of_a_run_is_not_said_of_a_file_that_others_changed(
    journal: Journal, path: Path, harm: object
) -> None:
    harm(path)  # type: ignore[operator]
    with pytest.raises(JournalFailed):
        journal.prove()


def test_a_journal_that_is_whole_is_opened_anew_and_goes_on(journal: Journal, path: Path) -> None:
    told = journal.records()
    journal.prove()
    assert journal.records() == told
    assert not log_of(path).exists() or not log_of(path).stat().st_size
    assert journal.append(outcome(1), series=1) == RECORDS + 1


def test_a_file_that_was_replaced_just_before_it_is_opened_anew_is_not_taken(
    journal: Journal, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    close = Journal.close

    def replaced(self: Journal) -> None:
        close(self)
        HARMS["replace"](path)

    with monkeypatch.context() as patch:
        patch.setattr(Journal, "close", replaced)
        with pytest.raises(JournalFailed, match="ends with record 22, and 3 were written"):
            journal.prove()
    with pytest.raises(JournalFailed, match="none is written any more"):
        journal.append(outcome(1), series=1)
