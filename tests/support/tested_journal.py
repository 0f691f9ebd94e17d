"""A real journal that also lists what is written, and can die or fail at the nth record."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

from campaigns.errors import JournalFailed
from campaigns.journal.journal import Journal, open_journal, read_journal
from campaigns.journal.records import KIND_OF_TYPE, Intent, Outcome, Record, Rejected
from campaigns.journal.views import AcceptedShot, Entry, Series, all_series


class PowerCut(BaseException):
    """The process ends here: nothing that comes after reaches the disk."""


class TestedJournal(Journal):
    """Appends to `calls` what it has written."""

    __test__ = False

    def __init__(self, path: Path, calls: list[tuple[object, ...]], now_utc: Callable[[], str]):
        super().__init__(path, now_utc)
        self._connection.execute("PRAGMA synchronous = OFF")  # here nobody cuts the power
        self._calls = calls
        self._written = 0
        self._dead = False
        self.dies_before: int | None = None
        self.fails_from: int | None = None

    def append(self, record: Record, *, series: int | None = None) -> int:
        self._written += 1
        self._dead = self._dead or self._written == self.dies_before
        if self._dead:
            raise PowerCut
        if self.fails_from is not None and self._written >= self.fails_from:
            raise JournalFailed("the disk is full", remedy="free space")
        place = super().append(record, series=series)
        self._calls.append((f"journal.{KIND_OF_TYPE[type(record)]}", *_numbers(record)))
        return place


def _numbers(record: Record) -> tuple[int, ...]:
    if isinstance(record, Intent | Outcome | Rejected):
        return record.shot, record.attempt
    return ()


def ticking() -> Callable[[], str]:
    """A clock that is a second later each time it is read."""
    seconds = count()
    return lambda: f"2026-03-02T08:{(s := next(seconds)) // 60:02d}:{s % 60:02d}Z"


class Told:
    """What a journal on the disk holds, to be asked as a reader is, once it is closed."""

    def __init__(self, folder: Path) -> None:
        with read_journal(folder / "campaign.db") as journal:
            self._entries = journal.records()

    def records(self, series: int | None = None) -> tuple[Entry[Record], ...]:
        return tuple(e for e in self._entries if series in (None, e.series))

    def records_of(self, kind: type, series: int | None = None) -> tuple[Entry[Record], ...]:
        return tuple(e for e in self.records(series) if isinstance(e.record, kind))

    def series(self, stage: str | None = None) -> tuple[Series, ...]:
        return tuple(s for s in all_series(self._entries) if stage in (None, s.started.stage))

    def latest_series(self, stage: str) -> Series | None:
        return next(reversed(self.series(stage)), None)

    def shots(self, series: int = 1) -> tuple[AcceptedShot, ...]:
        return self.series()[series - 1].shots


@contextmanager
def journal_in(folder: Path, calls: list[tuple[object, ...]]) -> Iterator[TestedJournal]:
    with TestedJournal(folder / "campaign.db", calls, ticking()) as journal:
        yield journal


@contextmanager
def plain_journal(folder: Path) -> Iterator[Journal]:
    with open_journal(folder / "j.db", now_utc=ticking()) as journal:
        yield journal
