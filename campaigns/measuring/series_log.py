"""Log of one series in the journal; every attempt and every session gets its end.

The engine writes through this log and nothing else, in the order in which it acts: `begin` before
the robot moves, an outcome or a rejection after the measurement, the session's end after the stop.
Each call returns when its record is on the disk. If a record cannot be written, the error ends the
run like any other: a robot is not moved for data that will not be kept.
"""

from collections.abc import Iterator
from contextlib import contextmanager, suppress

from campaigns.errors import Interrupted, JournalFailed
from campaigns.journal import records
from campaigns.journal.journal import Journal
from campaigns.measuring.run_state import SILENT, RunObserver
from campaigns.planning.steps import Step
from drivers.errors import Cancelled, ExplainedError, RobotStateUnknown


class SeriesLog:
    """One series, as the engine writes it. No other process writes to the journal meanwhile."""

    def __init__(self, journal: Journal, series: int, observer: RunObserver = SILENT) -> None:
        self._journal = journal
        self._observer = observer
        self._series = series
        self._open: records.Intent | None = None
        """Attempt that has no end yet."""
        # Numbers go on after those of earlier sessions, also after attempts that a crash cut off:
        # a number that is used twice could give a shot the intent of another attempt.
        self._attempts: dict[int, int] = {}
        self.reflector = ""
        """Reflector of the last attempt: an object's name; "": that of the robot file."""
        for entry in journal.records_of(records.Intent, series):
            self._attempts[entry.record.shot] = entry.record.attempt
            self._note_reflector(entry.record)

    def begin(self, step: Step) -> records.Intent:
        """Write the intent of an attempt at a step, under the next free number of attempt."""
        planned = step.planned
        intent = records.Intent(
            planned.shot,
            self._attempts.get(planned.shot, 0) + 1,
            planned.purpose.value,
            planned.pose,
            planned.joints,
            step.command,
            planned.pair,
            step.corrected,
            planned.nest,
            planned.reflector,
        )
        self.write(intent)
        self._attempts[intent.shot] = intent.attempt
        self._open = intent
        self._note_reflector(intent)
        return intent

    def write(self, record: records.Record) -> None:
        """Write a record, which is on the disk on return; raise `JournalFailed`."""
        self._journal.append(record, series=self._series)
        if isinstance(record, records.Outcome | records.Rejected):
            self._open = None

    def _note_reflector(self, intent: records.Intent) -> None:
        """Keep which reflector an attempt measures; that of a nest is not on the robot."""
        if not intent.nest:
            self.reflector = intent.reflector

    def announce(self, event: records.Event) -> None:
        """Write an event, and pass it to the display of the run."""
        self.write(event)
        self.show(event.text)

    def show(self, text: str) -> None:
        """Show on the run's display a text that is in the journal already."""
        self._observer.event(text)

    def close(self, how: records.Ending, reason: str) -> None:
        """Write how the session ended; reject an attempt that has no end yet."""
        if self._open is not None:
            self.write(records.Rejected(self._open.shot, self._open.attempt, reason))
        self.write(records.SessionStopped(how, reason))


@contextmanager
def closing(log: SeriesLog) -> Iterator[None]:
    """Write how a session ended, and raise the error that ended it again."""
    # Which error is raised matters more than the record:
    # 1. A robot whose state is unknown is dangerous: a journal that cannot be written either must
    #    not hide that.
    # 2. A journal that has failed takes no further record: the session looks crashed, which is
    #    right.
    # 3. Otherwise the record states whether someone has interrupted the run or an error ended it.
    try:
        yield
    except RobotStateUnknown as error:
        with suppress(JournalFailed):
            log.close("aborted", problem_of(error))
        raise
    except JournalFailed:
        raise
    except (Interrupted, Cancelled, KeyboardInterrupt) as error:
        log.close("interrupted", problem_of(error))
        raise
    except BaseException as error:
        log.close("aborted", problem_of(error))
        raise
    log.close("finished", "everything wanted was measured")


def problem_of(error: BaseException) -> str:
    """Return the problem of an error, without its remedy."""
    if isinstance(error, ExplainedError):
        return error.problem
    return str(error) or type(error).__name__
