"""Client of emScon: commands, answers, and statuses as errors that say what to do next."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar

from drivers.errors import BeamBroken, DeviceNotReady, DeviceRefused, WireError
from drivers.link import Link, LinkClient
from drivers.polling import ask_until
from drivers.ports import Clock
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
)
from drivers.wire.framing import Packet

BUSY_PAUSE_S = 0.1
MOST_REFLECTORS = 1000
OTHER_CLIENT = ResultStatus.MULTI_CONNECTIONS_NOT_ALLOWED
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
SETTINGS_COMMANDS = frozenset(c for c in Command if c.name.startswith(("GET_", "SET_")))
"""Commands whose error is not about a measurement; one that names a motion or nothing may be."""

BodyType = TypeVar("BodyType", bound=bodies.Body)
Result = bodies.SingleResult | bodies.SingleResult2

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

BEAM_LOST: frozenset[int] = frozenset(
    {
        ResultStatus.UNKNOWN,
        ResultStatus.NO_DISTANCE_SET,
        ResultStatus.MEASUREMENT_STATUS_NOT_READY,
        ResultStatus.NO_STATIONARY_RESULT,
    }
)
"""Statuses that can mean a broken beam while one is needed: no public source has its number."""

BEAM_REMEDY = "clear the line of sight and put the beam back on the reflector"
OTHER_CLIENT_REMEDY = "end the other program that is connected to the tracker, then try again"
REFUSAL_REMEDY = "see docs/emscon.md#errors and the tracker's own status"


def refused(where: str, doing: str, status: int) -> DeviceRefused:
    """Return the error for a refused command."""
    problem = f"{where}: {doing} was refused: {status_text(status)}"
    if remedy := NOT_READY.get(status):
        return DeviceNotReady(problem, remedy=remedy, code=str(status))
    if status == ResultStatus.MULTI_CONNECTIONS_NOT_ALLOWED:
        return DeviceRefused(problem, remedy=OTHER_CLIENT_REMEDY, code=str(status))
    return DeviceRefused(problem, remedy=REFUSAL_REMEDY, code=str(status))


def failed_with_beam(where: str, doing: str, status: int, *, beam_lost: bool) -> DeviceRefused:
    """Return the error for something that needs the beam: `BeamBroken` when that was it.

    `beam_lost` is what the tracker's traffic light says after the failure. It decides for the
    numbers that are in no public table, which a tracker's controller passes on.
    """
    error = refused(where, doing, status)
    if status in BEAM_LOST or (beam_lost and status not in set(ResultStatus)):
        return BeamBroken(
            f"{where}: the beam is lost: {doing} failed: {status_text(status)}",
            remedy=BEAM_REMEDY,
            code=str(status),
        )
    return error


def beam_not_locked(where: str, doing: str) -> BeamBroken:
    """Return the error for a search that ended well but found nothing."""
    return BeamBroken(f"{where}: {doing} found no reflector", remedy=BEAM_REMEDY)


@dataclass(frozen=True, slots=True)
class EmsconDeadlines:
    """Deadlines of the tracker, in seconds."""

    answer_s: float = 5.0
    busy_s: float = 30.0
    initialise_s: float = 120.0
    motion_s: float = 30.0
    search_timeout_s: float = 10.0
    """How long the tracker looks for a lost reflector."""
    measuring_margin_s: float = 20.0
    old_connection_s: float = 5.0
    """Time for which it may hold a connection that has broken."""


class EmsconClient(LinkClient[wire.FromServer]):
    """Commands and their answers over one connection; any fault of the wire closes it.

    Closing never sends ExitApplication: it would end the tracker's server. `instrument_clock` is
    time as the tracker lives it, by which a measurement's duration is judged.
    """

    def __init__(
        self,
        transport: Transport,
        clock: Clock,
        cancelled: Callable[[], bool],
        deadlines: EmsconDeadlines,
        instrument_clock: Clock,
    ) -> None:
        link = Link(
            transport,
            wire.from_server(),
            clock_s=clock.now_s,
            is_event=_comes_unasked,
            keeps=self._hear,
            cancelled=cancelled,
        )
        super().__init__(link)
        self._clock = clock
        self._deadlines = deadlines
        self._instrument_clock = instrument_clock
        self._settings_in_doubt = False
        self._asked_s = 0.0
        self._first_end_s: float | None = None
        self.may_hear_old_results = False
        """Whether the result of a measurement that failed may still come."""
        self.passed_over = 0
        """Packets so far of types that nobody knows, and states that nobody asked for."""

    def ask(
        self,
        command: Command,
        answer: type[BodyType],
        body: bodies.Body = wire.NOTHING,
        *,
        within_s: float | None = None,
    ) -> BodyType:
        """Return a command's answer; raises `DeviceRefused` when the tracker says no."""
        reply = self._exchange(wire.EmsconRequest(command, body), within_s)
        if reply.status != ResultStatus.ALL_OK:
            raise refused(self.name, command.title, reply.status)
        return _body_of(reply, answer)

    def ask_or_none(
        self, command: Command, answer: type[BodyType], body: bodies.Body = wire.NOTHING
    ) -> BodyType | None:
        """Return a command's answer, or None from a tracker that refuses it or lacks it."""
        reply = self._exchange(wire.EmsconRequest(command, body), None)
        return None if reply.status != ResultStatus.ALL_OK else _body_of(reply, answer)

    def tell(
        self, command: Command, body: bodies.Body = wire.NOTHING, *, within_s: float | None = None
    ) -> None:
        """Give a command whose answer is bare; raises `DeviceRefused`."""
        self.ask(command, bodies.Nothing, body, within_s=within_s)

    def attempt(
        self, command: Command, body: bodies.Body = wire.NOTHING, *, within_s: float | None = None
    ) -> int:
        """Give a command and return the status of its answer."""
        return self._exchange(wire.EmsconRequest(command, body), within_s).status

    def reflectors(self) -> list[bodies.ReflectorEntry]:
        """Return every reflector; the tracker sends one answer for each."""
        self.drain()
        entries = [self.ask(Command.GET_REFLECTORS, bodies.ReflectorEntry)]
        total = entries[0].total
        if total > MOST_REFLECTORS:
            raise self._wrong(f"it claims {total} reflectors, at most {MOST_REFLECTORS} are read")
        while len(entries) < total:
            reply = self._link.await_event(
                _is_reflector, within_s=self._deadlines.answer_s, what="the list of reflectors"
            )
            entries.append(_body_of(reply, bodies.ReflectorEntry))
        return entries[: max(total, 0)]

    def start_measurement(self) -> int:
        """Drop older results, start a measurement and return the status of the answer."""
        self.drain()
        return self.attempt(Command.START_MEASUREMENT)

    def ending(self, within_s: float) -> tuple[Result | bodies.ErrorResponse, float]:
        """Return what ends a running measurement, its result or an error, and when it came.

        In seconds of the instrument's clock, from before the question was sent.
        """
        message = self._link.await_event(
            _ends_measurement, within_s=within_s, what="the measurement"
        )
        assert isinstance(
            message, bodies.SingleResult | bodies.SingleResult2 | bodies.ErrorResponse
        )
        assert self._first_end_s is not None, "whatever ends a measurement was heard"
        return message, self._first_end_s - self._asked_s

    def another_ending(self) -> bool:
        """Tell whether the measurement goes on, or is ended twice, after what seemed to end it.

        Waits until the tracker is no longer busy: by then its own result has come.
        """
        light = ask_until(
            lambda light: light != TrackerLight.BUSY,
            lambda: self.ask(Command.GET_TRACKER_STATUS, bodies.Code).value,
            self._clock,
            give_up_s=self._clock.now_s() + self._deadlines.busy_s,
            pause_s=BUSY_PAUSE_S,
        )
        return any(map(_ends_measurement, self._taken())) or light == TrackerLight.BUSY

    def abandon_measurement(self) -> None:
        """Stop a measurement that failed; closes the wire when it cannot be stopped.

        A result of it may be under way all the same: the next one is then looked at twice.
        """
        self.may_hear_old_results = True
        if self.attempt(Command.STOP_MEASUREMENT) == ResultStatus.SERVER_BUSY:
            self.close()

    def drain(self) -> None:
        """Drop what came unasked, old results too.

        Raises `DeviceRefused` when the tracker says that it belongs to another program.
        """
        self._taken()

    def settings_in_doubt(self) -> bool:
        """Drain, and tell whether settings may be others than when they were last confirmed.

        They may be after an event that says so, whoever caused it, after live results, which we
        have switched off, and when the queue was too short for what came.
        """
        self.drain()
        self._settings_in_doubt |= self._link.has_lost_events()
        return self._settings_in_doubt

    @contextmanager
    def confirming_settings(self) -> Iterator[None]:
        """End the doubt about settings, unless the block raises or they are changed meanwhile."""
        self._settings_in_doubt = False
        try:
            yield
        except BaseException:
            self._settings_in_doubt = True
            raise

    def _taken(self) -> list[wire.FromServer]:
        """Empty the queue of events; raises `DeviceRefused` for another program's tracker."""
        events = self._link.events()
        self._first_end_s = None
        if any(map(_is_other_client, events)):
            self.close()
            raise refused(self.name, "the connection", OTHER_CLIENT)
        return events

    def _hear(self, event: wire.FromServer) -> bool:
        """Latch what an event says at its arrival, and tell whether it is worth queueing."""
        self._settings_in_doubt |= _may_change_settings(event)
        self.passed_over += _is_passed_over(event)
        ends = _ends_measurement(event)
        if ends and self._first_end_s is None:
            self._first_end_s = self._instrument_clock.now_s()
        return ends or _is_reflector(event)

    def _exchange(
        self, request: wire.EmsconRequest, within_s: float | None
    ) -> wire.Answer | bodies.ErrorResponse:
        """Ask, and ask again while the tracker is busy with something else."""
        return ask_until(
            lambda reply: reply.status != ResultStatus.SERVER_BUSY,
            lambda: self._once(request, within_s or self._deadlines.answer_s),
            self._clock,
            give_up_s=self._clock.now_s() + self._deadlines.busy_s,
            pause_s=BUSY_PAUSE_S,
        )

    def _once(
        self, request: wire.EmsconRequest, within_s: float
    ) -> wire.Answer | bodies.ErrorResponse:
        self._asked_s = self._instrument_clock.now_s()
        reply = self._link.ask(
            wire.encode(request),
            answers=lambda message: _is_answer(message, request.command),
            within_s=within_s,
            what=request.command.title,
        )
        assert isinstance(reply, wire.Answer | bodies.ErrorResponse)
        return reply

    def _wrong(self, problem: str) -> WireError:
        self.close()
        return WireError(f"{self.name}: {problem}")


def _body_of(reply: wire.FromServer, kind: type[BodyType]) -> BodyType:
    assert isinstance(reply, wire.Answer)
    assert isinstance(reply.body, kind)  # the grammar ties a command to its answer
    return reply.body


def _is_answer(message: wire.FromServer, command: Command) -> bool:
    if isinstance(message, bodies.ErrorResponse) and message.status != ResultStatus.ALL_OK:
        return message.command == command or _is_other_client(message)
    return isinstance(message, wire.Answer) and message.command == command


def _comes_unasked(message: wire.FromServer) -> bool:
    """Whether it is an event; of a list's answers all but the first come unasked."""
    return not isinstance(message, wire.Answer) or _is_reflector(message) or _is_state(message)


def _is_state(message: wire.FromServer) -> bool:
    """Whether it answers a question about the tracker's state, which changes nothing if unasked.

    Asked for, it is an answer; an earlier one that came unasked is gone by then.
    """
    return isinstance(message, wire.Answer) and message.command in STATES


def _is_passed_over(message: wire.FromServer) -> bool:
    return _is_state(message) or (isinstance(message, Packet) and message.kind not in set(DataType))


def _is_reflector(message: wire.FromServer) -> bool:
    return (
        isinstance(message, wire.Answer)
        and message.command == Command.GET_REFLECTORS
        and message.status == ResultStatus.ALL_OK
    )


def _ends_measurement(message: wire.FromServer) -> bool:
    """Whether it is a result, or an error that is none of a setting's or a question's."""
    if isinstance(message, bodies.ErrorResponse):
        is_about_it = message.command not in SETTINGS_COMMANDS or _is_other_client(message)
        return is_about_it and message.status != ResultStatus.ALL_OK
    return isinstance(message, bodies.SingleResult | bodies.SingleResult2)


def _may_change_settings(message: wire.FromServer) -> bool:
    """Tell events after which settings must be read back: changes, and streams that we never want.

    A stream of positions or of continuous results shows that somebody switched it on.
    """
    if isinstance(message, bodies.StatusChange):
        return message.code in SETTINGS
    if isinstance(message, Packet):
        return message.kind in set(DataType)
    return isinstance(message, bodies.ReflectorPosition)


def _is_other_client(message: wire.FromServer) -> bool:
    return isinstance(message, bodies.ErrorResponse) and message.status == OTHER_CLIENT
