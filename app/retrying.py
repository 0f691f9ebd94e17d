"""Retrying: connecting again after a lost link or a drive's fault, a few times in a row."""

from collections.abc import Callable

from campaigns.campaign import Campaign
from campaigns.errors import Interrupted, NotSettled
from campaigns.journal.records import Event, Outcome
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
"""Errors that may be over by the next try. An emergency stop is not: people have to release it."""
FIRST_PAUSE_S = 1.0
LONGEST_PAUSE_S = 60.0
LOOK_S = 0.02
"""How often a wait looks at the request to stop."""


class Retries:
    """Count of tries without a new shot; an accepted shot sets the count back to 0."""

    # Accepted shots are counted in the journal, which alone outlasts a try. Voided shots count as
    # well: a count that can fall would hide the next accepted shot.

    def __init__(self, campaign: Campaign, allowed: int, clock: Clock) -> None:
        self._campaign = campaign
        self._allowed = allowed
        self._clock = clock
        self._tried = 0
        """Tries since the last accepted shot."""
        self._outcomes = self._count_outcomes()

    def again_after(self, error: errors.ExplainedError) -> float | None:
        """Return the pause before the next try, s, and record it; None if no try is left."""
        # EmergencyStop is a MotionFault, which is retried
        if not isinstance(error, RETRIED) or isinstance(error, errors.EmergencyStop):
            return None
        outcomes = self._count_outcomes()
        if outcomes > self._outcomes:
            self._tried, self._outcomes = 0, outcomes
        if self._tried >= self._allowed:
            return None
        self._tried += 1
        if self._campaign.journal_path.exists():
            with self._campaign.opened_journal() as journal:
                journal.append(Event("reconnected", self.text(error)))
        return min(FIRST_PAUSE_S * 2.0 ** (self._tried - 1), LONGEST_PAUSE_S)

    def text(self, error: errors.ExplainedError) -> str:
        """Return a line with the number of the try and the error that made it necessary."""
        return (
            f"connecting again, {self._tried} of {self._allowed} in a row, after: {error.problem}"
        )

    def wait(self, seconds: float, stop_requested: Callable[[], bool]) -> None:
        """Wait for some seconds; raise `Interrupted` as soon as the operator asks to stop."""
        until_s = self._clock.now_s() + seconds
        while (remaining_s := until_s - self._clock.now_s()) > 0.0:
            if stop_requested():
                raise Interrupted("stopped by the operator", remedy="the same command resumes it")
            self._clock.sleep_s(min(remaining_s, LOOK_S))

    def _count_outcomes(self) -> int:
        """Return how many shots were ever accepted, also those that were voided since."""
        if not self._campaign.journal_path.exists():
            return 0
        with self._campaign.journal_reader() as journal:
            return len(journal.records_of(Outcome))
