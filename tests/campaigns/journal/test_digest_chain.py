"""The chain of digests: whatever is changed, renumbered or taken out is found, with its place."""

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from journal_story import ticking
from tampering import change_text, tamper

from campaigns.errors import JournalFailed
from campaigns.journal.journal import open_journal, read_journal
from campaigns.journal.records import Event
from campaigns.journal.verification import JournalDamaged

DATA = Path(__file__).parents[2] / "data"
OLD, TODAY = DATA / "journal-v1.db", DATA / "journal-v2.db"
STORY = 22
"""Records of the story."""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return Path(shutil.copy(TODAY, tmp_path / "campaign.db"))


def refused(path: Path) -> JournalDamaged:
    with pytest.raises(JournalDamaged) as caught:
        read_journal(path)
    assert "bring campaign.db back from a backup" in caught.value.remedy
    assert str(path) in caught.value.problem
    return caught.value


CHANGES = [
    ("UPDATE record SET at_utc = '2027' || at_utc WHERE id = 1", "record 1 was changed after", 0),
    ("UPDATE record SET body = body || ' ' WHERE id = 11", "record 11 was changed after", 10),
    ("UPDATE record SET digest = upper(digest) WHERE id = 22", "record 22 was changed after", 21),
    ("DELETE FROM record WHERE id = 1", "record 1 is missing or was renumbered: 2 comes", 0),
    ("DELETE FROM record WHERE id = 9", "record 9 is missing or was renumbered: 10 comes", 8),
    ("DELETE FROM record WHERE id = 22", "the records from 22 to 22 are missing", 21),
    ("DELETE FROM record WHERE id > 15", "the records from 16 to 22 are missing", 15),
    ("DELETE FROM record", "the records from 1 to 22 are missing", 0),
    ("UPDATE record SET id = 99 WHERE id = 22", "record 22 is missing or was renumbered", 21),
    ("UPDATE record SET digest = NULL WHERE id = 12", "record 12 has no digest", 11),
    ("UPDATE record SET body = x'7b7d' WHERE id = 3", "holds what none may hold", 2),
    (
        "UPDATE record SET kind = CAST(x'7bff7d' AS TEXT) WHERE id = 6",
        "record 6 holds text that",
        5,
    ),
    (
        "INSERT INTO record VALUES (23, '', 'event', 1, NULL, NULL, '{}', 'd')",
        "record 23 was changed after",
        22,
    ),
    (
        "INSERT INTO record VALUES (23, '', 'event', 1, NULL, NULL, '{}', NULL)",
        "record 23 has no digest",
        22,
    ),
    ("DELETE FROM chain_end", "record 22 is not the last one that was written", 22),
]


@pytest.mark.parametrize(("change", "said", "verified"), CHANGES)
def test_any_change_is_found_and_the_records_before_it_are_kept_in_a_copy(
    path: Path, change: str, said: str, verified: int
) -> None:
    with read_journal(path) as journal:
        told = journal.records()
    tamper(path, "PRAGMA ignore_check_constraints = ON", change)
    assert said in refused(path).problem
    copy = path.with_name("campaign-rescued-1.db")
    with pytest.raises(JournalFailed, match=said) as caught:
        open_journal(path, now_utc=ticking())
    assert copy.exists() == (f"its {verified} records are whole in" in caught.value.remedy)
    assert copy.exists() == (verified > 0)
    if verified:
        with open_journal(copy, now_utc=ticking()) as kept:
            assert kept.records() == told[:verified]


def test_the_rules_in_the_file_refuse_what_would_change_history(path: Path) -> None:
    columns = "(id, at_utc, kind, series, shot, attempt, body, digest)"
    for tampering in (
        "UPDATE record SET body = '{}' WHERE id = 2",
        "DELETE FROM record WHERE id = 22",
        "INSERT OR REPLACE INTO record VALUES (2, '', 'event', 1, NULL, NULL, '{}', 'd')",
        "REPLACE INTO record VALUES (NULL, '', 'outcome', 1, 1, 1, '{}', 'd')",
        "REPLACE INTO record VALUES (NULL, '', 'series-started', 1, NULL, NULL, '{}', 'd')",
        f"INSERT OR IGNORE INTO record {columns} VALUES (NULL, '', 'intent', 1, 1, 1, '{{}}', 'd')",
        "INSERT INTO record VALUES (-5, '', 'event', 1, NULL, NULL, '{}', 'd')",
        "INSERT INTO record VALUES (NULL, '', 'gossip', 1, NULL, NULL, '{}', 'd')",
        "INSERT INTO record VALUES (NULL, '', 'intent', 1, NULL, 1, '{}', 'd')",
        "INSERT INTO record VALUES (NULL, '', 'event', 1, NULL, NULL, x'00', 'd')",
        "INSERT INTO record VALUES (NULL, '', 'event', 1, NULL, NULL, '{}', NULL)",
        "DELETE FROM chain_end",
    ):
        with closing(sqlite3.connect(path)) as other, pytest.raises(sqlite3.IntegrityError):
            other.execute(tampering)
    with read_journal(path) as reader:
        assert reader.last_number() == STORY


@pytest.fixture
def older(tmp_path: Path) -> Path:
    return Path(shutil.copy(OLD, tmp_path / "older.db"))


def test_an_older_journal_is_read_as_it_is_and_chained_from_the_next_record_on(older: Path) -> None:
    before = older.read_bytes()
    with read_journal(older) as reader:
        told = reader.records()
    assert older.read_bytes() == before
    with open_journal(older, now_utc=ticking()) as journal:
        journal.append(Event("operator note", "on again"))
        assert journal.records()[:-1] == told
    with closing(sqlite3.connect(older)) as connection:
        digests = [row[0] for row in connection.execute("SELECT digest FROM record ORDER BY id")]
    assert digests[:-1] == [None] * STORY
    assert digests[-1] is not None


def test_a_record_that_is_missing_in_an_older_journal_is_found(older: Path) -> None:
    tamper(older, "DELETE FROM record WHERE id = 9")
    damaged = refused(older)
    assert "record 9 is missing or was renumbered: 10 comes next" in damaged.problem
    assert len(damaged.verified) == 8


def test_a_change_in_the_older_part_is_found_once_a_chained_record_follows(older: Path) -> None:
    with open_journal(older, now_utc=ticking()) as journal:
        journal.append(Event("operator note", "on again"))
    change_text(older, 5, "1000.1", "1000.2")
    damaged = refused(older)
    assert "one of the records 1 to 23 was changed after it was written" in damaged.problem
    assert not damaged.verified
