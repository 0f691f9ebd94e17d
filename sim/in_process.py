"""A simulated cell in this process: its devices answer over pipes of memory, in the cell's time.

No thread, no socket: waiting itself runs the cell. A driver gets the `InProcessCell` as its clock
and a `MemoryPipe` as its transport; both end in `step`, which

1. finds the first time at which a device has something to do (an answer that is due, a motion's
   end, a late message), or takes the end of the wait if that comes first;
2. lets the cell's time pass to there, at once on an `EventClock`;
3. gives a turn to each conversation that is due.

On an `EventClock` the campaign, its drivers and its devices thus take turns in an order that the
seed and the scenario determine, and nothing depends on the processor's speed.
"""

import math
from functools import partial

from drivers.errors import LinkDown
from sim.cell import Cell
from sim.clock import EventClock, ScaledClock
from sim.faults import ANSWERS_OF, DeviceName
from sim.servers.conversation import Conversation
from sim.sessions import controller_sessions, tracker_sessions

SHORTEST_WAIT_S = 0.0005
"""Least step of time: a session that stays due could otherwise stop the clock for ever."""


class InProcessCell:
    """A cell and its time, a driver's `Clock`: during a sleep the devices do what is due."""

    def __init__(
        self, cell: Cell, time: EventClock | ScaledClock, *, tracker_speaks: str = "emscon"
    ) -> None:
        """Put a cell on an `EventClock`, or on the wall clock beside a device that is real."""
        self.cell = cell
        self._time = time
        self._tracker_sessions = tracker_sessions(cell, tracker_speaks)
        self._conversations: dict[DeviceName, list[Conversation]] = {}

    def now_s(self) -> float:
        """Return the seconds of the cell's time."""
        return self._time.now_s()

    def sleep_s(self, seconds: float) -> None:
        """Let a number of the cell's seconds pass."""
        end_s = self.now_s() + seconds
        while self.now_s() < end_s:
            self.step(end_s)

    def step(self, end_s: float) -> None:
        """Let time pass until what is due first has been done, or until `end_s`."""
        now_s = self.now_s()
        dues_s: dict[Conversation, float] = {}
        for conversations in self._conversations.values():
            for conversation in conversations:
                due_s = None if conversation.is_over else conversation.next_due_s()
                if due_s is not None:
                    dues_s[conversation] = due_s
        first_s = max(min(dues_s.values(), default=math.inf), now_s + SHORTEST_WAIT_S)
        self._time.sleep_s(min(first_s, end_s) - now_s)
        # by the times from before the sleep: a turn may make another device due, in the next step
        for conversation, due_s in dues_s.items():
            if due_s <= self.now_s():
                conversation.turn()

    def connect(self, device: DeviceName, name: str) -> "MemoryPipe":
        """Open a pipe to a device; `name` stands for it in error texts."""
        already_open = [c for c in self._conversations.get(device, []) if not c.is_over]
        next_fault = partial(self.cell.faults.next, ANSWERS_OF[device])
        sessions = self._tracker_sessions if device == "tracker" else controller_sessions(self.cell)
        conversation = Conversation(sessions, len(already_open), next_fault, self.now_s)
        self._conversations[device] = [*already_open, conversation]
        return MemoryPipe(self, conversation, name)

    def memory(self) -> dict[str, object]:
        """Return the state for the next cell, as plain values for JSON."""
        # a motion that is over by now has to be among the arrivals that the memory counts
        self.cell.advance(self.now_s())
        return self.cell.memory()


class MemoryPipe:
    """A driver's `Transport` to a device of this process: waiting lets the cell's time pass."""

    def __init__(self, cell: InProcessCell, conversation: Conversation, name: str) -> None:
        self.name = name
        self._cell = cell
        self._conversation = conversation

    def send(self, data: bytes, timeout_s: float) -> None:  # noqa: ARG002 - it is taken at once
        """Pass all bytes to the device, and let it act on them before any time passes."""
        self._require_open()
        self._conversation.hear(data)
        self._conversation.turn()

    def receive(self, timeout_s: float) -> bytes:
        """Return the bytes that have arrived; empty if none came in time."""
        end_s = self._cell.now_s() + timeout_s
        self._conversation.turn()
        # This wait alone runs the cell meanwhile, also for the other device. A scripted hang-up
        # comes after the bytes that were sent before it.
        while not (data := self._conversation.going()):
            if self._conversation.wants_close:
                self._conversation.end_as_scripted(stays=False)
            self._require_open()
            if self._cell.now_s() >= end_s:
                break
            self._cell.step(end_s)
        self._conversation.gone(len(data))
        return data

    def close(self) -> None:
        """Hang up; a second time does nothing."""
        self._conversation.hang_up()

    def _require_open(self) -> None:
        if self._conversation.is_over:
            raise LinkDown(
                f"{self.name}: the device closed the connection",
                remedy="check the device, then try again",
            )
