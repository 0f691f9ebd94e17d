"""Conversation with an emScon tracker: commands and answers, and what the tracker sends unasked.

One command is open at a time; a tracker that is at work answers a second one with "server busy",
and the client asks again until `busy_s` is over. The answer to a command that moves or initialises
comes when that has ended. Beside answers, on the same socket and at any time, come packets that no
one has asked for (`is_event`):

* the result of a measurement, or an error packet in its place. It follows the answer to
  StartMeasurement, and may overtake it;
* changes of state and settings, by this client's commands or another's, and live positions;
* of a list, such as that of the reflectors, all answers but the first.

The link calls `_note_event` for each when it arrives. What only counts (a change of settings, a
packet of an unknown type) is counted there and dropped; only results, errors that end a measurement
and entries of a list are queued. A stream of live positions can thus push no result out of the
queue.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeVar

from drivers.declaration import Surroundings
from drivers.errors import BeamBroken, DeviceNotReady, DeviceRefused, WireError
from drivers.link import Link, LinkClient
from drivers.polling import ask_until
from drivers.transport import Transport
from drivers.wire import emscon as wire
from drivers.wire import emscon_messages as bodies
from drivers.wire.emscon_constants import (
    Command,
    DataType,
    ResultStatus,
    SystemChange,
    TrackerLight,
    status_text,
    status_words,
)
from drivers.wire.framing import Packet

BUSY_PAUSE_S = 0.1
MOST_REFLECTORS = 1000
OTHER_CLIENT = ResultStatus.MULTI_CONNECTIONS_NOT_ALLOWED
DATA_TYPES = frozenset(DataType)
SETTINGS = frozenset(
    {
        SystemChange.UNITS,
        SystemChange.REFLECTOR,
        SystemChange.SYSTEM_SETTINGS,
        SystemChange.COORDINATE_SYSTEM_TYPE,
        SystemChange.MEASUREMENT_MODE,
        SystemChange.STATIONARY_MODE_PARAMS,
    }
)
"""Changes that would make the next result mean something else."""
STATES = frozenset(
    {Command.GET_SYSTEM_STATUS, Command.GET_TRACKER_STATUS, Command.GET_MEASUREMENT_STATUS_INFO}
)
"""Questions about the tracker's state: an answer to them that comes unasked changes nothing."""
SETTINGS_COMMANDS = frozenset(c for c in Command if c.name.startswith(("GET_", "SET_")))
"""Commands whose error is not about a measurement; one that names a motion or nothing may be."""
NOT_READY: Mapping[int, str] = {
    ResultStatus.SERVER_BUSY: "wait until the tracker has finished, then try again",
    ResultStatus.WRONG_CURRENT_REFLECTOR: "prepare the tracker with the reflector that is mounted",
    ResultStatus.NO_TRACKER_PROCESSOR_FOUND: "check the cable between controller and tracker head",
    ResultStatus.NO_ADM: "this tracker has no absolute distance meter, which measuring needs",
    ResultStatus.NO_TRACKER_CONNECTED: "check the cable between controller and tracker head",
    ResultStatus.TRACKER_NOT_INITIALIZED: "prepare the tracker again, which initialises it",
    ResultStatus.EXTERNAL_CONTROL: "end the other program that controls the tracker",
    ResultStatus.IN_COMPENSATION_MODE: "end the tracker's compensation, then try again",
    ResultStatus.INTERNAL_PROCESS_ACTIVE: "wait until the tracker has finished, then try again",
    ResultStatus.NO_VALID_ADM_COMPENSATION: "have the tracker's distance meter compensated",
    ResultStatus.ADM_START_UP_BUSY: "wait until the distance meter has started, then try again",
    ResultStatus.SENSOR_NOT_LEVELED: "level the tracker, then try again",
    ResultStatus.SENSOR_NOT_WARMED_UP: "wait until the tracker is warm, then try again",
    ResultStatus.SENSOR_NOT_STABLE: "check the tracker's stand, let it settle, then try again",
    ResultStatus.SYSTEM_NOT_READY_FOR_MEASUREMENT: "see the tracker's own status, then try again",
    ResultStatus.COMMUNICATION_WITH_SENSOR_FAILED: "check the cable to the tracker head",
    ResultStatus.NOT_LEVELED_FOR_INITIALIZATION: "level the tracker, then try again",
    ResultStatus.ADM_HARDWARE_PROBLEM: "have the tracker's distance meter serviced",
    ResultStatus.ATR_HARDWARE_PROBLEM: "have the tracker's target camera serviced",
}
"""Remedies for a tracker that is not ready, by the status of its answer."""
# No public source has the number of a broken beam. These are taken for one while a beam is needed;
# for a number outside the public table the traffic light decides.
BEAM_LOST: frozenset[int] = frozenset(
    {
        ResultStatus.UNKNOWN,
        ResultStatus.NO_DISTANCE_SET,
        ResultStatus.MEASUREMENT_STATUS_NOT_READY,
        ResultStatus.NO_STATIONARY_RESULT,
    }
)
"""Statuses that can mean a broken beam while one is needed."""
BEAM_REMEDY = "clear the line of sight and put the beam back on the reflector"

BodyType = TypeVar("BodyType", bound=bodies.Body)
Result = bodies.SingleResult | bodies.SingleResult2


def refusal_of(where: str, doing: str, status: int) -> DeviceRefused:
    """Return the error for a refused command."""
    problem = f"{where}: {doing} was refused: {status_text(status)}"
    if remedy := NOT_READY.get(status):
        return DeviceNotReady(problem, remedy=remedy, code=str(status))
    remedy = "see docs/reference/emscon.md#errors and the tracker's own status"
    if status == OTHER_CLIENT:
        remedy = "end the other program that is connected to the tracker, then try again"
    return DeviceRefused(problem, remedy=remedy, code=str(status))


def beam_failure(where: str, doing: str, status: int, *, beam_lost: bool) -> DeviceRefused:
    """Return the error for an action that needs the beam: `BeamBroken` if the beam is lost.

    `beam_lost`: the tracker's traffic light is red after the failure, which decides for numbers
    outside the public table.
    """
    is_unlisted = not status_words(status)
    if status not in BEAM_LOST and not (beam_lost and is_unlisted):
        return refusal_of(where, doing, status)
    problem = f"{where}: the beam is lost: {doing} failed: {status_text(status)}"
    return BeamBroken(problem, remedy=BEAM_REMEDY, code=str(status))


@dataclass(frozen=True, slots=True)
class EmsconDeadlines:
    """Deadlines of the tracker, in seconds."""

    answer_s: float = 5.0
    busy_s: float = 30.0
    initialise_s: float = 120.0
    motion_s: float = 30.0
    search_timeout_s: float = 10.0
    """Time for which the tracker looks for a lost reflector."""
    measuring_margin_s: float = 20.0
    old_connection_s: float = 5.0
    """Time for which it may hold a connection that has broken."""


class EmsconClient(LinkClient[wire.FromServer]):
    """Commands and their answers over one connection; any fault of the wire closes it.

    Closing never sends ExitApplication: it would end the server in the tracker.
    """

    def __init__(
        self, transport: Transport, surroundings: Surroundings, deadlines: EmsconDeadlines
    ) -> None:
        link = Link(
            transport,
            wire.from_server(),
            clock_s=surroundings.clock.now_s,
            is_event=is_event,
            keeps=self._note_event,
            cancelled=surroundings.cancelled,
        )
        super().__init__(link)
        self._clock = surroundings.clock
        self._deadlines = deadlines
        # Events so far that may have changed settings.
        self._changes = 0
        # Clock's seconds before the latest question, and at the first end of a measurement since
        # the queue was last emptied (`_has_ended`).
        self._asked_s = 0.0
        self._first_end_s = 0.0
        self._has_ended = False
        self.may_hear_old_results = False
        """Whether the result of a measurement that failed may still come."""
        self.changes_confirmed = 0
        """Value of `count_changes` up to which settings were read back and found unchanged."""
        self.passed_over = 0
        """Packets so far of unknown types, and states that were not asked for."""

    def ask(
        self,
        command: Command,
        answer: type[BodyType],
        body: bodies.Body = wire.NOTHING,
        *,
        within_s: float | None = None,
    ) -> BodyType:
        """Return a command's answer; raises `DeviceRefused` when the tracker says no."""
        reply = self._exchange(command, body, within_s)
        if reply.status != ResultStatus.ALL_OK:
            raise refusal_of(self.name, command.title, reply.status)
        return _body_of(reply, answer)

    def ask_or_none(self, command: Command, answer: type[BodyType]) -> BodyType | None:
        """Return a command's answer, or None from a tracker that refuses it or lacks it."""
        reply = self._exchange(command)
        return None if reply.status != ResultStatus.ALL_OK else _body_of(reply, answer)

    def order(
        self, command: Command, body: bodies.Body = wire.NOTHING, *, within_s: float | None = None
    ) -> None:
        """Give a command whose answer is bare; raises `DeviceRefused`."""
        self.ask(command, bodies.Nothing, body, within_s=within_s)

    def attempt(
        self, command: Command, body: bodies.Body = wire.NOTHING, *, within_s: float | None = None
    ) -> int:
        """Give a command and return the status of its answer."""
        return self._exchange(command, body, within_s).status

    def reflectors(self) -> list[bodies.ReflectorEntry]:
        """Return every reflector; the tracker sends one answer for each."""
        # 1. Drop entries of an earlier list. 2. Ask: the first entry is the answer, and has the
        #    total.
        # 3. Await the others, which come as events; their order and numbers are the tracker's.
        self.drain()
        entries = [self.ask(Command.GET_REFLECTORS, bodies.ReflectorEntry)]
        total = entries[0].total
        if total > MOST_REFLECTORS:
            self.close()
            raise WireError(
                f"{self.name}: it claims {total} reflectors, at most {MOST_REFLECTORS} are read"
            )
        while len(entries) < total:
            reply = self._link.await_event(
                _is_reflector, within_s=self._deadlines.answer_s, title="the list of reflectors"
            )
            entries.append(_body_of(reply, bodies.ReflectorEntry))
        # A tracker without reflectors may send one entry with total 0 (unconfirmed).
        return entries[: max(total, 0)]

    def start_measurement(self) -> int:
        """Drop older results, start a measurement and return the status of the answer."""
        self.drain()
        return self.attempt(Command.START_MEASUREMENT)

    def await_end(self, within_s: float) -> tuple[Result | bodies.ErrorResponse, float]:
        """Return what ends a running measurement, its result or an error, and when it came.

        That time is in seconds from before the question was sent.
        """
        message = self._link.await_event(
            _ends_measurement, within_s=within_s, title="the measurement"
        )
        assert isinstance(message, Result | bodies.ErrorResponse)
        return message, self._first_end_s - self._asked_s

    def await_idle_and_see_another_end(self) -> bool:
        """Wait until the tracker is idle, and return whether the measurement ended a second time.

        When the tracker is no longer busy, the measurement's own result has come: a second one
        shows that the first may be that of an earlier measurement. So does a tracker that stays
        busy.
        """
        light = ask_until(
            lambda light: light != TrackerLight.BUSY,
            lambda: self.ask(Command.GET_TRACKER_STATUS, bodies.Code).value,
            self._clock,
            give_up_s=self._clock.now_s() + self._deadlines.busy_s,
            pause_s=BUSY_PAUSE_S,
        )
        return any(map(_ends_measurement, self._take_events())) or light == TrackerLight.BUSY

    def abandon_measurement(self) -> None:
        """Stop a measurement that failed; closes the wire when it cannot be stopped.

        Its result may be under way nevertheless: the next measurement's result is looked at twice.
        """
        # Another refusal is no fault: the measurement may have ended already.
        self.may_hear_old_results = True
        if self.attempt(Command.STOP_MEASUREMENT) == ResultStatus.SERVER_BUSY:
            self.close()

    def drain(self) -> None:
        """Drop what came unasked, old results too.

        Raises `DeviceRefused` when the tracker says that it belongs to another program.
        """
        self._take_events()

    def count_changes(self) -> int:
        """Drain, and count what may have changed settings since the connection was opened.

        Counted are events of a change, by any client, live results, which we have switched off, and
        a queue that was too short for what came.
        """
        self.drain()
        self._changes += self._link.take_lost_events()
        return self._changes

    def _take_events(self) -> list[wire.FromServer]:
        """Empty the queue of events; raises `DeviceRefused` for another program's tracker."""
        events = self._link.events()
        self._has_ended = False
        if any(map(_is_other_client, events)):
            self.close()
            raise refusal_of(self.name, "the connection", OTHER_CLIENT)
        return events

    def _note_event(self, event: wire.FromServer) -> bool:
        """Count an event at its arrival, and return whether to queue it."""
        # The time of a result is that of its arrival, not of the moment when it is taken from the
        # queue: it decides whether the result can be of this measurement.
        self._changes += _may_change_settings(event)
        self.passed_over += _is_passed_over(event)
        is_end = _ends_measurement(event)
        if is_end and not self._has_ended:
            self._has_ended, self._first_end_s = True, self._clock.now_s()
        return is_end or _is_reflector(event)

    def _exchange(
        self, command: Command, body: bodies.Body = wire.NOTHING, within_s: float | None = None
    ) -> wire.Answer | bodies.ErrorResponse:
        """Ask, and ask again while the tracker is busy with something else."""
        request = wire.encode(wire.EmsconRequest(command, body))

        def ask_once() -> wire.Answer | bodies.ErrorResponse:
            # Of the last try: the tracker began nothing at those that it answered with "busy".
            self._asked_s = self._clock.now_s()
            reply = self._link.ask(
                request,
                answers=lambda message: _is_answer(message, command),
                within_s=within_s or self._deadlines.answer_s,
                title=command.title,
            )
            assert isinstance(reply, wire.Answer | bodies.ErrorResponse)
            return reply

        return ask_until(
            lambda reply: reply.status != ResultStatus.SERVER_BUSY,
            ask_once,
            self._clock,
            give_up_s=self._clock.now_s() + self._deadlines.busy_s,
            pause_s=BUSY_PAUSE_S,
        )


def _body_of(reply: wire.FromServer, kind: type[BodyType]) -> BodyType:
    assert isinstance(reply, wire.Answer)
    assert isinstance(reply.body, kind)  # the grammar ties a command to its answer
    return reply.body


def _is_answer(message: wire.FromServer, command: Command) -> bool:
    """Return whether a message answers a command: also an error that names it."""
    # A refusal may come as an error packet (type 1) in place of an answer (type 0). That of a
    # tracker which another program holds may name any command.
    if isinstance(message, bodies.ErrorResponse) and message.status != ResultStatus.ALL_OK:
        return message.command == command or _is_other_client(message)
    return isinstance(message, wire.Answer) and message.command == command


def is_event(message: wire.FromServer) -> bool:
    """Return whether a message that answers no open question may come nevertheless.

    An answer may not, but for one about the tracker's state and those of a list after its first.
    """
    if not isinstance(message, wire.Answer):
        return True
    return message.command in STATES or _is_reflector(message)


def _is_passed_over(message: wire.FromServer) -> bool:
    if isinstance(message, Packet):
        return message.kind not in DATA_TYPES
    return isinstance(message, wire.Answer) and message.command in STATES


def _is_reflector(message: wire.FromServer) -> bool:
    return (
        isinstance(message, wire.Answer)
        and message.command == Command.GET_REFLECTORS
        and message.status == ResultStatus.ALL_OK
    )


def _ends_measurement(message: wire.FromServer) -> bool:
    """Return whether a message is a result, or an error that is not about a setting or question."""
    # Which command the error of a broken beam names is unconfirmed. Those of a setting or question
    # are not about a measurement; all others may be.
    if isinstance(message, bodies.ErrorResponse):
        is_about_it = message.command not in SETTINGS_COMMANDS or _is_other_client(message)
        return is_about_it and message.status != ResultStatus.ALL_OK
    return isinstance(message, Result)


def _may_change_settings(message: wire.FromServer) -> bool:
    """Return whether settings must be read back after a message: a change, or an unwanted stream.

    A stream of positions or of continuous results shows that another program switched it on.
    """
    if isinstance(message, bodies.StatusChange):
        return message.code in SETTINGS
    if isinstance(message, Packet):
        return message.kind in DATA_TYPES
    return isinstance(message, bodies.ReflectorPosition)


def _is_other_client(message: wire.FromServer) -> bool:
    return isinstance(message, bodies.ErrorResponse) and message.status == OTHER_CLIENT
