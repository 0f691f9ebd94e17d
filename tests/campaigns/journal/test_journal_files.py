"""A journal that others delete, replace or cut while it is written: found out, and kept."""

import sqlite3
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path

import pytest
from journal_story import SESSION, beginning, intent, outcome, ticking
from lost_files import FORGERIES, HARMLESS, HARMS, log_of, shorten_log, sql

from campaigns.errors import JournalFailed
from campaigns.journal.journal import Journal, open_journal, read_journal
from campaigns.journal.records import Event

RECORDS = 3
RESCUED = "campaign-rescued-1.db"


@pytest.fixture
def journal(path: Path) -> Iterator[Journal]:
    with open_journal(path, now_utc=ticking()) as journal:
        run = journal.start_series(beginning())
        journal.append(SESSION, series=run)
        journal.append(intent(1), series=run)
        yield journal


def refused(journal: Journal) -> JournalFailed:
    with pytest.raises(JournalFailed) as caught:
        journal.append(outcome(1), series=1)
    return caught.value


def rescued(path: Path) -> tuple[object, ...]:
    """Records of the one copy that was kept beside a journal."""
    assert [p.name for p in path.parent.glob("*-rescued*")] == [RESCUED]
    with read_journal(path.with_name(RESCUED)) as reader:
        return reader.records()


@pytest.mark.parametrize("harm", HARMS)
def test_whatever_loses_records_stops_the_run_and_all_of_them_are_kept(
    journal: Journal, path: Path, harm: str
) -> None:
    told = journal.records()
    HARMS[harm](path)
    error = refused(journal)
    assert "while this process worked with it" in error.problem
    assert f"its {RECORDS} records are whole in {RESCUED}" in error.remedy
    assert rescued(path) == told
    with pytest.raises(JournalFailed, match="none is written any more"):
        journal.append(intent(2), series=1)


@pytest.mark.parametrize("harmless", HARMLESS)
def test_what_leaves_the_records_where_they_are_stops_nothing(
    journal: Journal, path: Path, harmless: str
) -> None:
    journal.append(Event("operator note", "x" * 100_000), series=1)
    for shot in range(1, 4):
        journal.append(outcome(shot), series=1)
        HARMLESS[harmless](path)
        path.with_name("linked.db").unlink(missing_ok=True)
        path.with_name("linked.db-wal").unlink(missing_ok=True)
        journal.append(intent(shot + 1), series=1)
    told = journal.records()
    journal.prove()
    assert journal.records() == told
    assert len(told) == RECORDS + 7
    assert journal.append(intent(4, 2), series=1) == RECORDS + 8
    assert not [*path.parent.glob("*-rescued*")]


@pytest.mark.parametrize("forgery", FORGERIES)
def test_what_others_changed_in_it_is_found_at_the_end_and_all_records_are_kept(
    journal: Journal, path: Path, forgery: str
) -> None:
    told = journal.records()
    FORGERIES[forgery](path)
    with pytest.raises(JournalFailed, match=r"campaign\.db: .* records are whole in"):
        journal.prove()
    assert rescued(path) == told


def test_a_folder_that_was_renamed_has_all_records_under_its_new_name(tmp_path: Path) -> None:
    folder, renamed = tmp_path / "old", tmp_path / "new"
    folder.mkdir()
    with open_journal(folder / "campaign.db", now_utc=ticking()) as journal:
        journal.start_series(beginning())
        told = journal.records()
        folder.rename(renamed)
        with pytest.raises(JournalFailed, match="old: was renamed or moved away") as caught:
            journal.append(SESSION, series=1)
    assert "start again with the folder's new name" in caught.value.remedy
    with open_journal(renamed / "campaign.db", now_utc=ticking()) as again:
        assert again.records() == told


def test_a_cut_log_is_left_as_it_was_found_and_gives_the_records_before_the_cut(
    journal: Journal, path: Path
) -> None:
    written, log = journal.records(), log_of(path)
    shorten_log(path, 1)
    cut = path.read_bytes(), log.read_bytes()
    refused(journal)
    journal.close()
    assert (path.read_bytes(), log.read_bytes()) == cut
    with read_journal(path) as reader:
        assert reader.records() == written[:-1]


FOREIGN = "INSERT INTO record VALUES (4, '', 'event', 1, NULL, NULL, '{}', 'd')"


def test_records_before_one_that_others_wrote_are_kept(journal: Journal, path: Path) -> None:
    told = journal.records()
    with closing(sqlite3.connect(path)) as other, other:
        other.execute(FOREIGN)
    error = refused(journal)
    assert "a record is never replaced" in error.problem
    assert f"its {RECORDS} records are whole in {RESCUED}" in error.remedy
    assert rescued(path) == told


MADE_UNWRITABLE = {
    "no table": ("DROP TABLE record",),
    "no end": ("DROP TABLE chain_end",),
    "other columns": ("ALTER TABLE record ADD COLUMN note",),
    "emptied": ("DROP TRIGGER a_record_is_never_removed", "DELETE FROM record"),
}


@pytest.mark.parametrize("statements", MADE_UNWRITABLE.values(), ids=MADE_UNWRITABLE)
def test_records_that_the_file_lost_are_kept_when_the_next_cannot_be_written(
    journal: Journal, path: Path, statements: tuple[str, ...]
) -> None:
    told = journal.records()
    sql(*statements)(path)
    assert f"its {RECORDS} records are whole in {RESCUED}" in refused(journal).remedy
    assert rescued(path) == told


def import_broken_off(journal: Journal) -> None:
    with journal.in_one_commit():
        journal.append(outcome(1), series=1)
        journal._connection.execute("DROP TABLE record")
        journal.append(intent(2), series=1)


def test_an_import_that_cannot_be_written_keeps_the_records_before_it(
    journal: Journal, path: Path
) -> None:
    told = journal.records()
    with pytest.raises(JournalFailed) as caught:
        import_broken_off(journal)
    assert "no such table" in caught.value.problem
    assert "rescued" not in caught.value.remedy
    journal.close()
    with read_journal(path) as reader:
        assert reader.records() == told


@pytest.mark.parametrize("harm", ["delete", "replace"])
@pytest.mark.parametrize("moment", ["before", "after"])
def test_harm_between_a_look_at_the_files_and_a_write_loses_no_record(
    journal: Journal, path: Path, monkeypatch: pytest.MonkeyPatch, harm: str, moment: str
) -> None:
    insert = Journal._insert

    def inserted(self: Journal, *record: object) -> None:
        if moment == "before":
            HARMS[harm](path)
        insert(self, *record)  # type: ignore[arg-type]
        if moment == "after":
            HARMS[harm](path)

    with monkeypatch.context() as patch, suppress(JournalFailed):
        patch.setattr(Journal, "_insert", inserted)
        journal.append(intent(2), series=1)
    with suppress(JournalFailed):
        journal.prove()
    records = [entry.record for entry in rescued(path)]
    assert records == [beginning(), SESSION, intent(1), intent(2)]


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
