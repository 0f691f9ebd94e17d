"""Fault script of a simulated cell: what goes wrong and when, counted, each once."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

DeviceName = Literal["controller", "tracker"]


class Counted(StrEnum):
    """Occurrences that a fault script counts, over all restarts of the cell."""

    MEASUREMENT = "measurement"
    MOVE = "move"
    CONTROLLER_ANSWER = "controller answer"
    TRACKER_ANSWER = "tracker answer"
    RESULT = "result"


ANSWERS_OF: Mapping[DeviceName, Counted] = {
    "controller": Counted.CONTROLLER_ANSWER,
    "tracker": Counted.TRACKER_ANSWER,
}
MEASUREMENT_FAULTS = ("beam_break", "wrong_target")
MOVE_FAULTS = ("emergency_stop", "drive_fault", "stall")
ANSWER_FAULTS = ("late", "silent", "garbage", "torn", "close")
RESULT_FAULTS = ("early", "repeated", "straggling", "other_units")
"""Faults of an emScon tracker's results: sent at once; the one before again; after a failure, by
`seconds` too late; in units that somebody else has just set."""


@dataclass(frozen=True, slots=True)
class Fault:
    """Fault at the `at`-th measurement, move or answer, counted from 1.

    `seconds` is how long it lasts, or how late the answer is; without it, for good.
    """

    counted: Counted
    at: int
    kind: str
    seconds: float | None


class FaultScript:
    """Faults by the occurrence they are due at. Counts survive a restart: none comes twice."""

    def __init__(self, faults: Iterable[Fault], counts: Mapping[str, int]) -> None:
        self._faults = {(fault.counted, fault.at): fault for fault in faults}
        self._counts = dict(counts)

    def next(self, counted: Counted) -> Fault | None:
        """Count one more of these; the fault that is due at it, if any."""
        number = self._counts.get(counted, 0) + 1
        self._counts[str(counted)] = number
        return self._faults.get((counted, number))

    def memory(self) -> dict[str, int]:
        """Return the counts so far."""
        return dict(self._counts)
