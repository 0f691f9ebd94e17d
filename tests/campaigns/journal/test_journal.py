"""What the journal takes, what it refuses, and what it tells afterwards."""

import sqlite3
from contextlib import closing, suppress
from pathlib import Path

import pytest
from journal_story import SESSION, STOPPED, beginning, imported, intent, outcome, tell, ticking

from campaigns.errors import JournalFailed
from campaigns.journal.journal import Journal, open_journal, read_journal
from campaigns.journal.records import (
    Event,
    Finding,
    Outcome,
    PairVoided,
    Record,
    Rejected,
    SeriesFinished,
)
from campaigns.journal.views import all_series


@pytest.fixture
def run(journal: Journal) -> int:
    return journal.start_series(beginning())


def appended(journal: Journal, run: int, *records: Record) -> None:
    for record in records:
        journal.append(record, series=run)


def test_each_record_is_there_for_another_connection_before_append_returns(
    journal: Journal, run: int, path: Path
) -> None:
    told: tuple[Record, ...] = (SESSION, intent(1), outcome(1), STOPPED)
    with read_journal(path) as reader:
        for number, record in enumerate(told, start=2):
            assert journal.append(record, series=run) == number
            assert reader.records()[-1].record == record


LONG = 40_000
"""Characters of a record, a hundred of which do not fit into what SQLite keeps in memory."""


def test_records_of_one_commit_come_at_once(journal: Journal, run: int, path: Path) -> None:
    events = [Event("operator note", str(number) + LONG * "x") for number in range(100)]
    with read_journal(path) as reader:
        with journal.in_one_commit():
            appended(journal, run, *events)
            assert reader.last_number() == 1
        assert [entry.record for entry in reader.records()[1:]] == events
    appended(journal, run, SESSION, intent(1))
    journal.prove()
    assert journal.last_number() == 103


def test_of_a_commit_that_fails_nothing_is_left_and_the_journal_goes_on(
    journal: Journal, run: int, path: Path
) -> None:
    def fail() -> None:
        with journal.in_one_commit():
            for number in range(100):
                journal.append(Event("operator note", str(number) + LONG * "x"), series=run)
            assert journal.last_number() == 101
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    with read_journal(path) as reader:
        assert reader.last_number() == journal.last_number() == 1
    appended(journal, run, SESSION, intent(1), outcome(1))
    journal.prove()
    assert [shot.outcome for shot in journal.shots(run)] == [outcome(1)]


def test_every_commit_waits_for_the_disk(journal: Journal) -> None:
    full = 2
    assert journal._connection.execute("PRAGMA synchronous").fetchone() == (full,)
    assert journal._connection.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    assert not journal._connection.in_transaction


def test_records_come_back_equal_in_order_and_stamped(journal: Journal, run: int) -> None:
    told: tuple[Record, ...] = (
        SESSION,
        intent(1),
        outcome(1),
        intent(2),
        Rejected(2, 1, "gate", outcome(2)),
        PairVoided(1, (1, 2), "gate"),
        Event("beam broken", "at 2.5 m"),
        SeriesFinished(),
        STOPPED,
    )
    appended(journal, run, *told)

    entries = journal.records(run)

    assert tuple(entry.record for entry in entries[1:]) == told
    assert [entry.number for entry in entries] == list(range(1, 11))
    assert [entry.at_utc[-3:] for entry in entries] == [f"{second:02d}Z" for second in range(10)]


def test_a_reopened_journal_goes_on_where_it_was(path: Path) -> None:
    with open_journal(path, now_utc=ticking(), create=True) as journal:
        tell(journal)
        before = journal.records()
    with open_journal(path, now_utc=ticking()) as journal:
        assert journal.records() == before
        assert journal.append(Event("operator note", "on again")) == len(before) + 1
        assert journal.start_series(beginning("after")) == 3


def test_series_are_numbered_by_the_journal_and_found_by_stage(journal: Journal) -> None:
    assert [journal.start_series(beginning(stage)) for stage in ("before", "run", "run")] == [
        1,
        2,
        3,
    ]
    journal.append(SeriesFinished(), series=2)

    assert [(series.number, series.finished) for series in journal.series("run")] == [
        (2, True),
        (3, False),
    ]
    assert [series.number for series in journal.series()] == [1, 2, 3]
    latest = journal.latest_series("run")
    assert latest is not None
    assert (latest.number, latest.started) == (3, beginning("run"))
    assert journal.latest_series("after") is None


def test_only_events_and_findings_stand_outside_a_series(journal: Journal) -> None:
    journal.append(Event("operator note", "cell cleaned"))
    journal.append(Finding("load", {"verified": True}))
    with pytest.raises(JournalFailed, match="intent of shot 1, attempt 1 cannot"):
        journal.append(intent(1))


def test_the_latest_accepted_outcome_is_the_shot(journal: Journal, run: int) -> None:
    appended(journal, run, intent(2), outcome(2), intent(1), outcome(1))
    appended(journal, run, intent(2, 2), outcome(2, 2, x_mm=5.0))
    appended(journal, run, intent(1, 2), Rejected(1, 2, "gate", outcome(1, 2)))

    assert [(shot.intent, shot.outcome) for shot in journal.shots(run)] == [
        (intent(1), outcome(1)),
        (intent(2, 2), outcome(2, 2, x_mm=5.0)),
    ]


def test_shots_of_another_series_do_not_count(journal: Journal, run: int) -> None:
    other = journal.start_series(beginning("import"))
    appended(journal, run, intent(1), outcome(1))
    appended(journal, other, intent(1), imported(1), PairVoided(1, (1,), "other"))

    assert [shot.outcome for shot in journal.shots(run)] == [outcome(1)]
    assert journal.shots(other) == ()


def test_a_voided_pair_counts_again_only_once_it_is_measured_anew(
    journal: Journal, run: int
) -> None:
    appended(journal, run, intent(1), outcome(1), intent(3), outcome(3), intent(2))
    appended(journal, run, Rejected(2, 1, "beam broken"), PairVoided(1, (1, 2), "beam broken"))
    assert [shot.outcome for shot in journal.shots(run)] == [outcome(3)]

    appended(journal, run, intent(1, 2), outcome(1, 2))
    assert [shot.outcome for shot in journal.shots(run)] == [outcome(1, 2), outcome(3)]


def test_a_session_without_stop_is_counted_in_its_series(journal: Journal, run: int) -> None:
    appended(journal, run, SESSION, STOPPED, SESSION)
    other = journal.start_series(beginning("after"))
    appended(journal, other, SESSION, STOPPED)
    assert [(each.sessions, each.unstopped) for each in journal.series()] == [(2, 1), (1, 0)]


@pytest.mark.parametrize(
    "again",
    [intent(1), outcome(1), Rejected(1, 1, "gate"), SeriesFinished()],
    ids=["intent", "outcome", "outcome then rejected", "finish"],
)
def test_numbers_are_never_given_twice(journal: Journal, run: int, again: Record) -> None:
    appended(journal, run, intent(1), outcome(1), SeriesFinished())
    before = journal.records()
    with pytest.raises(JournalFailed, match=r"never reused|once"):
        journal.append(again, series=run)
    assert journal.records() == before


@pytest.mark.parametrize("end", [outcome(1), Rejected(1, 1, "gate")])
def test_an_outcome_needs_its_intent(journal: Journal, run: int, end: Outcome | Rejected) -> None:
    appended(journal, run, intent(2), intent(1, 2))
    with pytest.raises(JournalFailed, match="never intended"):
        journal.append(end, series=run)


def test_a_record_needs_its_series(journal: Journal, run: int) -> None:
    with pytest.raises(JournalFailed, match="no such series"):
        journal.append(intent(1), series=run + 1)


def test_a_value_that_is_not_finite_is_refused_before_it_is_written(
    journal: Journal, run: int
) -> None:
    appended(journal, run, intent(1))
    before = journal.last_number()
    with pytest.raises(JournalFailed, match="outcome of shot 1, attempt 1 cannot be written"):
        journal.append(outcome(1, x_mm=float("nan")), series=run)
    with pytest.raises(JournalFailed, match="none is written any more"):
        journal.append(outcome(1), series=run)
    assert journal.last_number() == before


def test_the_digest_depends_on_every_record_and_can_be_taken_back_in_time(
    journal: Journal, run: int
) -> None:
    appended(journal, run, intent(1), outcome(1))
    digest, place = journal.digest(), journal.last_number()
    journal.append(Finding("identification", {"journal": digest, "through": place}))

    assert journal.digest() != digest
    assert journal.digest(through=place) == digest
    assert journal.digest(through=place - 1) != digest
    assert journal.digest(through=place) == digest


def test_series_of_a_journal_that_grows_are_those_of_all_its_records(
    journal: Journal, run: int
) -> None:
    more = (intent(1), outcome(1), intent(2), outcome(2), PairVoided(1, (1,), "beam broken"))
    for record in (*more, SESSION):
        appended(journal, run, record)
        assert journal.series() == all_series(journal.records())
    with suppress(RuntimeError), journal.in_one_commit():
        appended(journal, run, intent(3), outcome(3))
        assert len(journal.shots(run)) == 2
        raise RuntimeError
    appended(journal, run, intent(4), outcome(4))
    assert [shot.intent.shot for shot in journal.shots(run)] == [2, 4]


@pytest.mark.parametrize(
    "tampering",
    [
        "UPDATE record SET body = '{}' WHERE id = 2",
        "UPDATE record SET id = 99 WHERE id = 2",
        "DELETE FROM record WHERE id = 3",
        "DELETE FROM record",
        "INSERT OR REPLACE INTO record VALUES (2, '', 'event', 1, NULL, NULL, '{}', 'd')",
        "INSERT OR REPLACE INTO record VALUES (3, '', 'event', 1, NULL, NULL, '{}', 'd')",
        "REPLACE INTO record VALUES (NULL, '', 'intent', 1, 1, 1, '{}', 'd')",
        "REPLACE INTO record VALUES (NULL, '', 'outcome', 1, 1, 1, '{}', 'd')",
        "REPLACE INTO record VALUES (NULL, '', 'series-started', 1, NULL, NULL, '{}', 'd')",
        "INSERT OR IGNORE INTO record VALUES (NULL, '', 'intent', 1, 1, 1, '{}', 'd')",
        "INSERT INTO record VALUES (-5, '', 'event', 1, NULL, NULL, '{}', 'd')",
        "INSERT INTO record VALUES (NULL, '', 'gossip', 1, NULL, NULL, '{}', 'd')",
        "INSERT INTO record VALUES (NULL, '', 'intent', 1, NULL, 1, '{}', 'd')",
        "INSERT INTO record VALUES (NULL, '', 'event', 1, NULL, NULL, x'00', 'd')",
        "INSERT INTO record VALUES (NULL, '', 'event', 'one', NULL, NULL, '{}', 'd')",
    ],
)
def test_the_database_itself_refuses_what_would_change_history(
    journal: Journal, run: int, path: Path, tampering: str
) -> None:
    appended(journal, run, intent(1), outcome(1))
    before = journal.digest()
    with closing(sqlite3.connect(path)) as other, pytest.raises(sqlite3.IntegrityError):
        other.execute(tampering)
    with read_journal(path) as reader:
        assert reader.digest() == before


def test_a_place_between_two_records_cannot_be_filled_later(journal: Journal, path: Path) -> None:
    place = "INSERT INTO record VALUES (?, '', 'event', NULL, NULL, NULL, '{}', 'd')"
    with closing(sqlite3.connect(path)) as other:
        other.execute(place, (7,))
        with pytest.raises(sqlite3.IntegrityError, match="after all others"):
            other.execute(place, (5,))
