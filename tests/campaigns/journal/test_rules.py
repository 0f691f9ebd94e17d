"""The rules in a journal's file: proved at each opening, and played through by each record."""

import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
from command_line import CommandLine
from journal_story import SESSION, beginning, intent, outcome, ticking
from paper_campaign import new_campaign
from tampering import add_by_hand, forge, tamper

from campaigns.errors import JournalFailed
from campaigns.journal.journal import Journal, open_journal, read_journal
from campaigns.journal.verification import JournalDamaged, inspect_journal

DATA = Path(__file__).parents[2] / "data"
STORY = 22
"""Records of the golden story."""
COPY = "campaign-rescued-1.db"


@pytest.fixture(params=[1, 2])
def golden(tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    return Path(shutil.copy(DATA / f"journal-v{request.param}.db", tmp_path / "campaign.db"))


@pytest.fixture
def chained(tmp_path: Path) -> Path:
    return Path(shutil.copy(DATA / "journal-v2.db", tmp_path / "campaign.db"))


def run(path: Path, *statements: str) -> None:
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        for statement in statements:
            other.execute(statement)


def names(path: Path, kind: str) -> list[str]:
    query = "SELECT name FROM sqlite_master WHERE type = ? AND sql IS NOT NULL"
    with closing(sqlite3.connect(path)) as other:
        return [name for (name,) in other.execute(query, [kind])]


def drop_triggers(path: Path) -> None:
    run(path, *(f"DROP TRIGGER {name}" for name in names(path, "trigger")))


def rebuild_table(path: Path) -> None:
    """As viewers change a column: a new table is filled and renamed, and the triggers are gone."""
    run(
        path,
        "CREATE TABLE other AS SELECT * FROM record",
        "DROP TABLE record",
        "ALTER TABLE other RENAME TO record",
    )


def rescued(path: Path) -> int:
    """Open for writing what is damaged, take its rescued copy, and return its records."""
    with pytest.raises(JournalFailed, match=f"whole in {COPY}: move campaign.db"):
        open_journal(path, now_utc=ticking())
    path.with_name(COPY).replace(path)
    with open_journal(path, now_utc=ticking()) as journal:
        return journal.last_number()


def test_every_single_rule_is_missed_and_the_copy_has_it_again(
    golden: Path, tmp_path: Path
) -> None:
    whole = shutil.copy(golden, tmp_path / "whole.db")
    for kind in ("trigger", "index"):
        for name in names(golden, kind):
            shutil.copy(whole, golden)
            run(golden, f"DROP {kind} {name}")
            with pytest.raises(JournalDamaged, match=f"{name} are not as they were made"):
                read_journal(golden)
            assert rescued(golden) == STORY
            assert name in names(golden, kind)


@pytest.mark.parametrize("harm", [drop_triggers, rebuild_table])
def test_a_file_that_was_rebuilt_is_refused_before_a_record_goes_into_it(
    golden: Path, harm: Callable[[Path], None]
) -> None:
    harm(golden)
    before = golden.read_bytes()
    assert inspect_journal(golden).records == STORY
    with pytest.raises(JournalDamaged, match="another program has rebuilt or changed") as refused:
        read_journal(golden)
    assert (
        f"`pkmcal identify DIR` keeps the {STORY} records that verify in a copy"
        in refused.value.remedy
    )
    assert golden.read_bytes() == before
    assert rescued(golden) == STORY


def test_a_rule_of_somebody_else_is_refused_and_his_tables_are_not(golden: Path) -> None:
    run(golden, "CREATE TABLE notes (x)", "CREATE INDEX theirs ON record (at_utc)", "ANALYZE")
    with read_journal(golden) as journal:
        assert journal.last_number() == STORY
    run(golden, "CREATE TRIGGER theirs AFTER INSERT ON record BEGIN DELETE FROM notes; END")
    with pytest.raises(JournalDamaged, match="rules, theirs are not"):
        read_journal(golden)


@pytest.mark.parametrize(("table", "records"), [("record", 0), ("chain_end", STORY)])
def test_a_table_that_is_gone_is_named(chained: Path, table: str, records: int) -> None:
    run(chained, f"DROP TABLE {table}")
    with pytest.raises(JournalDamaged, match=f"rules, {table} and .* more are not") as refused:
        read_journal(chained)
    assert len(refused.value.verified) == records
    assert "bring campaign.db back from a backup" in refused.value.remedy


FORGERIES = {
    "no start": ("UPDATE record SET kind = 'event' WHERE id = 1", "record 1 is none that", 0),
    "no such series": ("UPDATE record SET series = 7 WHERE id = 3", "no such series has", 2),
    "no intent": (
        "UPDATE record SET attempt = 9 WHERE kind = 'intent' AND id < 6",
        "never intended",
        4,
    ),
}


@pytest.mark.parametrize(("change", "said", "records"), FORGERIES.values(), ids=FORGERIES)
def test_what_the_rules_would_have_refused_is_found_behind_a_sound_chain(
    chained: Path, change: str, said: str, records: int
) -> None:
    forge(chained, change)
    with pytest.raises(JournalDamaged, match=said) as refused:
        read_journal(chained)
    assert len(refused.value.verified) == records
    assert not inspect_journal(chained).whole


def test_a_text_that_is_of_another_shot_than_its_columns_is_no_record(chained: Path) -> None:
    shot = "replace(body, '\"shot\": 1', '\"shot\": 5')"
    forge(chained, f"UPDATE record SET body = {shot} WHERE kind = 'outcome'")
    with read_journal(chained) as journal, pytest.raises(JournalDamaged, match="shot is not 1"):
        journal.series()
    assert not inspect_journal(chained).whole


def test_a_long_reader_verifies_what_others_write_meanwhile(journal: Journal, path: Path) -> None:
    journal.start_series(beginning())
    with read_journal(path) as reader:
        for number, record in enumerate((SESSION, intent(1), outcome(1)), start=2):
            journal.append(record, series=1)
            assert reader.last_number() == number
        tamper(path, "UPDATE record SET at_utc = '2001' WHERE id = 1")  # read already
        add_by_hand(path, "event", '{"kind": "operator note", "text": ""}')
        assert reader.last_number() == 5
        tamper(path, "INSERT INTO record VALUES (6, '', 'event', 1, NULL, NULL, '{}', 'd')")
        with pytest.raises(JournalDamaged, match="record 6 was changed after it was written"):
            reader.last_number()


def test_commands_refuse_a_journal_without_rules_and_go_on_with_the_copy(
    tmp_path: Path, pkmcal: CommandLine
) -> None:
    paper = new_campaign(tmp_path / "c")
    paper.run(pairs=6, unseen=0)
    drop_triggers(paper.campaign.journal_path)
    for command in ("check-journal", "status", "report", "history"):
        refused = pkmcal(command, paper.folder)
        assert refused.code == 4
        assert f"`pkmcal identify {paper.folder}` keeps the" in refused.error_line
    assert pkmcal("identify", paper.folder).code == 4
    refused = pkmcal("status", paper.folder)
    assert (refused.code, f"rename {COPY} to campaign.db" in refused.error_line) == (4, True)
    (paper.folder / COPY).replace(paper.campaign.journal_path)
    assert pkmcal("check-journal", paper.folder).code == 0
