"""The chain of digests: whatever is changed, renumbered or taken out is found, with its place."""

import hashlib
import json
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from journal_story import ticking
from tampering import change_text, tamper

from campaigns.errors import JournalFailed
from campaigns.journal import digest_chain
from campaigns.journal.journal import open_journal, read_journal
from campaigns.journal.records import Event

DATA = Path(__file__).parents[2] / "data"
OLD, TODAY = DATA / "journal-v1.db", DATA / "journal-v2.db"
STORY = 22
"""Records of the story."""
texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=8)
contents = st.lists(st.tuples(texts, texts, st.none() | st.integers(1, 9), texts), max_size=6)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return Path(shutil.copy(TODAY, tmp_path / "campaign.db"))


def damage(path: Path) -> digest_chain.JournalDamaged:
    with pytest.raises(digest_chain.JournalDamaged) as caught:
        read_journal(path)
    assert "bring campaign.db back from a backup" in caught.value.remedy
    assert str(path) in caught.value.problem
    with pytest.raises(JournalFailed):
        open_journal(path, now_utc=ticking())
    return caught.value


@pytest.mark.parametrize("number", [1, 11, STORY])
@pytest.mark.parametrize(
    "change",
    [
        "UPDATE record SET at_utc = '2027' || substr(at_utc, 5) WHERE id = {0}",
        "UPDATE record SET body = body || ' ' WHERE id = {0}",
        "UPDATE record SET digest = upper(digest) WHERE id = {0}",
    ],
    ids=["time", "body", "digest"],
)
def test_any_change_of_any_record_is_found(path: Path, number: int, change: str) -> None:
    tamper(path, change.format(number))
    assert f"record {number} was changed after" in damage(path).problem


@pytest.mark.parametrize(
    ("change", "said", "number"),
    [
        ("DELETE FROM record WHERE id = 1", "record 1 is missing or was renumbered: 2 comes", 1),
        ("DELETE FROM record WHERE id = 9", "record 9 is missing or was renumbered: 10 comes", 9),
        ("DELETE FROM record WHERE id = 22", "the records from 22 to 22 are missing", 22),
        ("DELETE FROM record WHERE id > 15", "the records from 16 to 22 are missing", 16),
        ("DELETE FROM record", "the records from 1 to 22 are missing", 1),
        ("UPDATE record SET id = 99 WHERE id = 22", "record 22 is missing or was renumbered", 22),
        ("UPDATE record SET digest = NULL WHERE id = 12", "record 12 has no digest", 12),
        ("UPDATE record SET body = x'7b7d' WHERE id = 3", "holds what none may hold", 3),
        (
            "INSERT INTO record VALUES (23, '', 'event', 1, NULL, NULL, '{}', 'd')",
            "record 23 was changed after",
            23,
        ),
        (
            "INSERT INTO record VALUES (23, '', 'event', 1, NULL, NULL, '{}', NULL)",
            "record 23 has no digest",
            23,
        ),
        ("DELETE FROM chain_end", "record 22 is not the last one that was written", 22),
    ],
)
def test_missing_renumbered_and_foreign_records_are_found(
    path: Path, change: str, said: str, number: int
) -> None:
    tamper(path, "PRAGMA ignore_check_constraints = ON", change)
    error = damage(path)
    assert said in error.problem
    assert error.number == number


@pytest.mark.parametrize("column", ["body", "at_utc", "kind"])
def test_text_that_is_no_utf8_is_found_with_its_record(path: Path, column: str) -> None:
    tamper(
        path,
        "PRAGMA ignore_check_constraints = ON",
        f"UPDATE record SET {column} = CAST(x'7bff7d' AS TEXT) WHERE id = 6",
    )
    error = damage(path)
    assert "record 6 holds text that is no UTF-8" in error.problem
    assert error.number == 6


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


def test_a_change_in_the_older_part_is_found_once_a_chained_record_follows(older: Path) -> None:
    with open_journal(older, now_utc=ticking()) as journal:
        journal.append(Event("operator note", "on again"))
    change_text(older, 5, "1000.1", "1000.2")
    error = damage(older)
    assert "one of the records 1 to 23 was changed after it was written" in error.problem
    assert error.number == 1


def test_an_older_journal_that_lacks_a_record_is_refused(older: Path) -> None:
    tamper(older, "DELETE FROM record WHERE id = 9")
    with pytest.raises(JournalFailed, match="record 9 is missing or was renumbered: 10 comes next"):
        read_journal(older)


def test_an_outsider_can_compute_the_chain_as_the_page_about_files_says() -> None:
    """Spelled out without our code: SHA-256 of a JSON list with the digest before in front."""
    with closing(sqlite3.connect(f"{TODAY.as_uri()}?immutable=1", uri=True)) as connection:
        columns = "id, at_utc, kind, series, shot, attempt, body, digest"
        digest = ""
        for *content, stored in connection.execute(f"SELECT {columns} FROM record ORDER BY id"):
            text = json.dumps([digest, *content], ensure_ascii=False)
            digest = hashlib.sha256(text.encode()).hexdigest()
            assert digest == stored
        assert connection.execute("SELECT record, digest FROM chain_end").fetchall() == [
            (STORY, digest)
        ]


def chained(
    bodies: list[tuple[str, str, int | None, str]], older: int = 0
) -> list[digest_chain.Row]:
    """Rows of a journal of which the first `older` have no digest."""
    rows: list[digest_chain.Row] = []
    digest = ""
    for number, (at_utc, kind, series, body) in enumerate(bodies, start=1):
        content = (number, at_utc, kind, series, None, None, body)
        digest = digest_chain.digest_after(digest, content)
        rows.append((*content, None if number <= older else digest))
    return rows


@given(contents, st.integers(0, 6))
def test_what_was_chained_is_whole(
    bodies: list[tuple[str, str, int | None, str]], older: int
) -> None:
    rows = chained(bodies, older)
    stated = (
        digest_chain.ChainEnd(len(rows), str(rows[-1][-1]))
        if len(rows) > older
        else digest_chain.EMPTY
    )
    assert digest_chain.chain_end(rows, stated).number == len(rows)


@given(contents.filter(bool), st.data())
def test_no_two_records_that_differ_anywhere_have_one_digest(
    bodies: list[tuple[str, str, int | None, str]], data: st.DataObject
) -> None:
    rows = chained(bodies)
    place = data.draw(st.integers(0, len(rows) - 1))
    column = data.draw(st.sampled_from([1, 2, 6]))
    changed = list(rows[place])
    changed[column] = str(changed[column]) + data.draw(texts.filter(bool))
    rows[place] = tuple(changed)  # type: ignore[assignment]
    with pytest.raises(digest_chain.JournalDamaged) as caught:
        digest_chain.chain_end(rows, digest_chain.ChainEnd(len(rows), str(rows[-1][-1])))
    assert caught.value.number == place + 1


def test_a_journal_whose_making_was_just_done_is_whole(tmp_path: Path) -> None:
    with open_journal(tmp_path / "new.db", now_utc=ticking(), create=True) as journal:
        assert journal.end() == digest_chain.EMPTY
    with read_journal(tmp_path / "new.db") as reader:
        assert reader.records() == ()
