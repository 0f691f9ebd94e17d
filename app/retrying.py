"""Retrying: connecting again after a lost link or a drive's fault, a few times in a row."""

from collections.abc import Callable
from itertools import takewhile

from campaigns.campaign import Campaign
from campaigns.errors import Interrupted, NotSettled
from campaigns.journal.records import Event, Outcome, Stage
from campaigns.measuring.stability_check import AFTER_RESTART
from drivers import errors
from drivers.ports import Clock

RETRIED = (
    errors.LinkDown,
    errors.WireError,
    errors.MotionFault,
    NotSettled,
    errors.DeviceNotReady,
    errors.ImplausibleAnswer,
)
"""What may be over by the next try. Not an emergency stop: whoever pressed it starts the robot."""
FIRST_PAUSE_S = 1.0
LONGEST_PAUSE_S = 60.0
LOOK_S = 0.02


class Retries:
    """Tries left in a row; a shot that counts begins the row anew, and so does a passed check.

    Of checks after a restart as many count, between two shots, as tries are allowed: a fault that
    always comes after the check ends the run all the same.
    """

    def __init__(self, campaign: Campaign, stage: Stage, allowed: int, clock: Clock) -> None:
        self._campaign = campaign
        self._stage = stage
        self._allowed = allowed
        self._clock = clock
        self._tried = 0
        self._most_progress = self._progress()

    def again_after(self, error: errors.ExplainedError) -> float | None:
        """Pause before the next try, in seconds; None: there is none. The journal names it."""
        if not isinstance(error, RETRIED) or isinstance(error, errors.EmergencyStop):
            return None
        progress = self._progress()
        if progress > self._most_progress:
            self._tried, self._most_progress = 0, progress
        if self._tried >= self._allowed:
            return None
        self._tried += 1
        if self._campaign.journal_path.exists():
            with self._campaign.opened_journal() as journal:
                journal.append(Event("reconnected", self.text(error)))
        return min(FIRST_PAUSE_S * 2.0 ** (self._tried - 1), LONGEST_PAUSE_S)

    def text(self, error: errors.ExplainedError) -> str:
        """What is tried again, and for how many times now."""
        return (
            f"connecting again, {self._tried} of {self._allowed} in a row, after: {error.problem}"
        )

    def wait(self, seconds: float, stop_requested: Callable[[], bool]) -> None:
        """Wait; raises `Interrupted` as soon as the operator asks to stop."""
        until_s = self._clock.now_s() + seconds
        while (left_s := until_s - self._clock.now_s()) > 0.0:
            if stop_requested():
                raise Interrupted("stopped by the operator", remedy="the same command resumes it")
            self._clock.sleep_s(min(left_s, LOOK_S))

    def _progress(self) -> tuple[int, int, int]:
        """Latest series of the stage, outcomes in it, voided ones too, and checks passed since."""
        if not self._campaign.journal_path.exists():
            return 0, 0, 0
        with self._campaign.journal_reader() as journal:
            latest = journal.latest_series(self._stage)
            if latest is None:
                return 0, 0, 0
            records = [entry.record for entry in journal.records(latest.number)]
        outcomes = sum(isinstance(record, Outcome) for record in records)
        since = takewhile(lambda record: not isinstance(record, Outcome), reversed(records))
        passed = sum(isinstance(each, Event) and AFTER_RESTART in each.text for each in since)
        return latest.number, outcomes, min(passed, self._allowed)
