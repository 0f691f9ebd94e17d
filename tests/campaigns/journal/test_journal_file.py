"""Which files are opened as a journal, which are left alone, and how an old one is read."""

import os
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
from journal_story import SESSION, beginning, imported, outcome, ticking, write_story

from campaigns.errors import JournalFailed
from campaigns.journal import database as journal_database
from campaigns.journal.journal import open_journal, read_journal

Door = Callable[[Path], None]
DATA = Path(__file__).parents[2] / "data"
GOLDEN = DATA / "journal-v1.db"
ALL_GOLDEN = [DATA / f"journal-v{version}.db" for version in (1, 2)]
DIGESTS = {
    "journal-v1.db": "58f6c759c2ba37356b9d08ed987d3d4caa2b39f4ec90dd47d44ff8636ff564c5",
    "journal-v2.db": "79b769c568b74cd68bf14775afc22300675a4d0b8d2ecbde5e22f102cbf096bc",
}


def opened_for_writing(path: Path) -> None:
    open_journal(path, now_utc=ticking()).close()


def opened_for_reading(path: Path) -> None:
    read_journal(path).close()


both_doors = pytest.mark.parametrize("door", [opened_for_writing, opened_for_reading])


def database(path: Path, *statements: str) -> Path:
    with closing(sqlite3.connect(path)) as connection:
        for statement in statements:
            connection.execute(statement)
    return path


def names_in(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir()]


@pytest.mark.parametrize("golden", ALL_GOLDEN)
def test_the_golden_file_of_every_version_reads_as_it_was_told(
    tmp_path: Path, golden: Path
) -> None:
    golden = Path(shutil.copy(golden, tmp_path))
    write_story(tmp_path / "today.db")
    before = golden.read_bytes()
    with read_journal(golden) as old, read_journal(tmp_path / "today.db") as today:
        assert old.records()[:-1] == today.records()[:-1]
        assert old.digest() == DIGESTS[golden.name]
        assert [series.finished for series in old.series()] == [True, False]
        assert [shot.outcome for shot in old.shots(1)] == [
            outcome(1, 3, x_mm=1000.3),
            outcome(2, 3),
        ]
        assert [shot.outcome for shot in old.shots(2)] == [imported(1)]
        assert [series.unstopped for series in old.series()] == [1, 0]
    assert golden.read_bytes() == before


def newer(path: Path) -> None:
    shutil.copy(GOLDEN, path)
    database(path, f"PRAGMA user_version = {journal_database.VERSION + 1}")


FOREIGN: dict[str, tuple[Callable[[Path], object], str]] = {
    "newer": (newer, "newer pkmcal"),
    "another program's": (lambda path: database(path, "CREATE TABLE t (x)"), "not a journal"),
    "marked": (lambda path: database(path, "PRAGMA application_id = 7"), "not a journal"),
    "text": (lambda path: path.write_text("pair,q0_deg\n" * 200), "not a database"),
}


@both_doors
@pytest.mark.parametrize(("make", "reason"), FOREIGN.values(), ids=FOREIGN)
def test_a_file_that_is_no_journal_of_ours_is_refused_and_left_as_it_was(
    tmp_path: Path, door: Door, make: Callable[[Path], object], reason: str
) -> None:
    path = tmp_path / "a.db"
    make(path)
    before = path.read_bytes()
    with pytest.raises(JournalFailed, match=reason):
        door(path)
    assert path.read_bytes() == before
    assert names_in(tmp_path) == [path.name]


def test_a_missing_journal_or_folder_is_said_and_none_is_made(tmp_path: Path) -> None:
    with pytest.raises(JournalFailed, match="no journal"):
        read_journal(tmp_path / "campaign.db")
    assert names_in(tmp_path) == []
    with pytest.raises(JournalFailed, match=r"cannot be made: .* check that the folder"):
        opened_for_writing(tmp_path / "nowhere" / "campaign.db")


def test_a_journal_whose_making_is_cut_short_leaves_no_half_of_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "campaign.db"
    with monkeypatch.context() as patch:
        patch.setattr(journal_database, "_RULES", ("SELECT nothing",))
        with pytest.raises(JournalFailed, match="the journal cannot be made"):
            opened_for_writing(path)
    assert not path.exists()
    write_story(path)
    assert names_in(tmp_path) == ["campaign.db"]


def test_a_reader_cannot_write(tmp_path: Path) -> None:
    write_story(tmp_path / "campaign.db")
    with (
        read_journal(tmp_path / "campaign.db") as journal,
        pytest.raises(sqlite3.OperationalError, match="readonly"),
    ):
        journal._connection.execute("INSERT INTO record (kind) VALUES ('event')")
    assert names_in(tmp_path) == ["campaign.db"]


def test_a_path_with_url_signs_is_taken_literally(tmp_path: Path) -> None:
    folder = tmp_path / "50% of #2?mode=memory"
    folder.mkdir()
    write_story(folder / "campaign.db")
    assert names_in(folder) == ["campaign.db"]


def test_a_write_protected_journal_is_read_without_a_trace(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_story(tmp_path / "campaign.db")
    monkeypatch.setattr(os, "access", lambda path, mode: mode != os.W_OK)
    with read_journal(tmp_path / "campaign.db") as journal:
        assert len(journal.shots(1)) == 2
        assert names_in(tmp_path) == ["campaign.db"]


def test_a_write_protected_journal_is_not_read_without_its_latest_records(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "campaign.db"
    monkeypatch.setattr(os, "access", lambda path, mode: mode != os.W_OK)
    with open_journal(path, now_utc=ticking()) as journal:
        series = journal.start_series(beginning())
        journal.append(SESSION, series=series)
        with pytest.raises(JournalFailed, match=r"campaign\.db-wal"):
            read_journal(path)
