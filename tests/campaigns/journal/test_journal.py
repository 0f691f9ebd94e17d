"""What the journal takes, what it refuses, and what it tells afterwards."""

from pathlib import Path

import pytest
from journal_story import SESSION, STOPPED, beginning, imported, intent, outcome

from campaigns.errors import JournalFailed
from campaigns.journal.journal import Journal, read_journal
from campaigns.journal.records import (
    Event,
    Finding,
    Outcome,
    PairVoided,
    Record,
    Rejected,
    SeriesFinished,
)


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


def test_every_commit_waits_for_the_disk(journal: Journal) -> None:
    full = 2
    assert journal._connection.execute("PRAGMA synchronous").fetchone() == (full,)
    assert journal._connection.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    assert not journal._connection.in_transaction


LONG = 40_000
"""Characters of a record, a hundred of which do not fit into what SQLite keeps in memory."""


def test_records_of_one_commit_come_at_once(journal: Journal, run: int, path: Path) -> None:
    events = [Event("operator note", str(number) + LONG * "x") for number in range(100)]
    with read_journal(path) as reader:
        with journal.in_one_commit():
            appended(journal, run, *events)
            assert reader.last_number() == 1
        assert [entry.record for entry in reader.records()[1:]] == events
    journal.prove()
    assert journal.last_number() == 101


def test_of_a_commit_that_fails_nothing_is_left_and_the_journal_goes_on(
    journal: Journal, run: int, path: Path
) -> None:
    def fail() -> None:
        with journal.in_one_commit():
            for number in range(100):
                journal.append(Event("operator note", str(number) + LONG * "x"), series=run)
            assert len(journal.records()) == 101
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    with read_journal(path) as reader:
        assert reader.last_number() == journal.last_number() == 1
    appended(journal, run, SESSION, intent(1), outcome(1))
    journal.prove()
    assert [shot.outcome for shot in journal.shots(run)] == [outcome(1)]


def test_series_are_numbered_by_the_journal_and_found_by_stage(journal: Journal) -> None:
    numbers = [journal.start_series(beginning(stage)) for stage in ("before", "run", "run")]
    assert numbers == [1, 2, 3]
    journal.append(SeriesFinished(), series=2)
    runs = [(series.number, series.finished) for series in journal.series("run")]
    assert runs == [(2, True), (3, False)]
    assert [series.number for series in journal.series()] == [1, 2, 3]
    latest = journal.latest_series("run")
    assert latest is not None
    assert (latest.number, latest.started) == (3, beginning("run"))
    assert journal.latest_series("after") is None


def test_the_latest_accepted_outcome_that_is_not_voided_is_the_shot(
    journal: Journal, run: int
) -> None:
    def shots() -> list[Outcome]:
        return [shot.outcome for shot in journal.shots(run)]

    appended(journal, run, intent(2), outcome(2), intent(1), outcome(1))
    appended(journal, run, intent(2, 2), outcome(2, 2, x_mm=5.0))
    appended(journal, run, intent(1, 2), Rejected(1, 2, "gate", outcome(1, 2)))
    assert shots() == [outcome(1), outcome(2, 2, x_mm=5.0)]
    appended(journal, run, intent(3), outcome(3), PairVoided(1, (1, 2), "beam broken"))
    assert shots() == [outcome(3)]
    appended(journal, run, intent(1, 3), outcome(1, 3))
    assert shots() == [outcome(1, 3), outcome(3)]


def test_shots_of_another_series_do_not_count(journal: Journal, run: int) -> None:
    other = journal.start_series(beginning("import"))
    appended(journal, run, intent(1), outcome(1))
    appended(journal, other, intent(1), imported(1), PairVoided(1, (1,), "other"))
    assert [shot.outcome for shot in journal.shots(run)] == [outcome(1)]
    assert journal.shots(other) == ()


@pytest.mark.parametrize(
    ("record", "series", "said"),
    [
        (intent(1), 1, "never reused"),
        (outcome(1), 1, "never reused"),
        (Rejected(1, 1, "gate"), 1, "never reused"),
        (SeriesFinished(), 1, "finishes once"),
        (outcome(2), 1, "never intended"),
        (Rejected(1, 2, "gate"), 1, "never intended"),
        (intent(2), 2, "no such series"),
        (intent(2), None, "intent of shot 2, attempt 1 cannot"),
        (Event("operator note", "half a sign \ud800"), 1, "event cannot be written"),
    ],
)
def test_a_record_that_does_not_fit_is_refused_and_so_is_every_later_one(
    journal: Journal, run: int, record: Record, series: int | None, said: str
) -> None:
    appended(journal, run, intent(1), outcome(1), SeriesFinished())
    before = journal.records()
    with pytest.raises(JournalFailed, match=said):
        journal.append(record, series=series)
    with pytest.raises(JournalFailed, match="none is written any more"):
        journal.append(Event("operator note", "on"), series=run)
    assert journal.records() == before


def test_the_digest_is_the_last_records_and_can_be_taken_back_in_time(
    journal: Journal, run: int
) -> None:
    assert journal.digest(through=0) == ""
    appended(journal, run, intent(1), outcome(1))
    digest, place = journal.digest(), journal.last_number()
    journal.append(Finding("identification", {"journal": digest, "through": place}))
    assert journal.digest(through=place) == digest
    assert len({journal.digest(through=number) for number in range(1, place + 2)}) == place + 1
