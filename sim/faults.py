"""Fault script of a simulated cell: what goes wrong and when, counted, each once.

A fault is due at the N-th occurrence of its kind (measurement, move, answer, result), never at a
time: the N-th move is the same move on every computer, in one process or in ten, since the counts
are in the cell's memory. The part that performs an occurrence asks `FaultScript.next` and acts:

- the controller asks for each move (sim/robot/controller.py: trips, emergency stop, stall);
- the tracker asks for each measurement (sim/tracker/instrument.py: broken beam, wrong target);
- an emScon session asks for each measurement begun (sim/servers/emscon_server.py: wrong results);
- the conversation asks for each message sent (sim/servers/conversation.py: late, torn, lost …).
"""

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
"""Faults of an emScon tracker's results: sent before the measuring time is over; the previous bytes
again; `seconds` after the measurement was reported as failed; in units of another program."""


@dataclass(frozen=True, slots=True)
class Fault:
    """Fault at the `at`-th measurement, move or answer, counted from 1.

    `seconds` is how long the fault lasts, or how late the answer is; None: for good.
    """

    counted: Counted
    at: int
    kind: str
    seconds: float | None


class FaultScript:
    """Faults by the occurrence at which they are due. None comes twice, even after a restart."""

    def __init__(self, faults: Iterable[Fault], counts: Mapping[str, int]) -> None:
        self._faults = {(fault.counted, fault.at): fault for fault in faults}
        self._counts = dict(counts)

    def next(self, counted: Counted) -> Fault | None:
        """Count one more occurrence, and return the fault that is due at it, or None."""
        number = self._counts.get(counted, 0) + 1
        self._counts[str(counted)] = number
        return self._faults.get((counted, number))

    def memory(self) -> dict[str, int]:
        """Return the counts so far."""
        return dict(self._counts)
