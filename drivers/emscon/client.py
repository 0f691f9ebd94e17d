"""From an emScon status to an error that tells the operator what to do next."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar

from drivers.errors import BeamBroken, DeviceNotReady, DeviceRefused, WireError
from drivers.link import Link, LinkClient
from drivers.polling import ask_until
from drivers.ports import Clock
from drivers.transport import Transport
from drivers.wire.emscon import NOTHING, Answer, FromServer, FromServerFramer, Request, encode
from drivers.wire.emscon_constants import Command, ResultStatus, SystemChange, status_text
from drivers.wire.emscon_messages import (
    Body,
    ErrorResponse,
    Nothing,
    ReflectorEntry,
    SingleResult,
    SingleResult2,
    StatusChange,
)

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
"""No public source has a number for a broken beam; these can mean one while a beam is needed."""

BEAM_REMEDY = "clear the line of sight and put the beam back on the reflector"
OTHER_CLIENT_REMEDY = "end the other program that is connected to the tracker, then try again"
REFUSAL_REMEDY = "see docs/emscon.md, section Errors, and the tracker's own status"


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

BodyType = TypeVar("BodyType", bound=Body)
Result = SingleResult | SingleResult2


@dataclass(frozen=True, slots=True)
class EmsconDeadlines:
    """How long the tracker may take, in seconds."""

    answer_s: float = 5.0
    busy_s: float = 30.0
    initialise_s: float = 120.0
    motion_s: float = 30.0
    measuring_margin_s: float = 20.0
    old_connection_s: float = 5.0
    """How long it may hold a connection that has broken."""


class EmsconClient(LinkClient[FromServer]):
    """Commands and their answers over one connection; any fault of the wire closes it.

    Closing never sends ExitApplication: it would end the tracker's server.
    """

    def __init__(
        self,
        transport: Transport,
        clock: Clock,
        cancelled: Callable[[], bool],
        deadlines: EmsconDeadlines,
    ) -> None:
        link = Link(
            transport,
            FromServerFramer(),
            clock_s=clock.now_s,
            is_event=_comes_unasked,
            cancelled=cancelled,
        )
        super().__init__(link)
        self._clock = clock
        self._deadlines = deadlines
        self._settings_touched = False

    def ask(
        self,
        command: Command,
        answer: type[BodyType],
        body: Body = NOTHING,
        *,
        within_s: float | None = None,
    ) -> BodyType:
        """Return a command's answer; raises `DeviceRefused` when the tracker says no."""
        reply = self._exchange(Request(command, body), within_s)
        if reply.status != ResultStatus.ALL_OK:
            raise refused(self.name, command.title, reply.status)
        return _body_of(reply, answer)

    def ask_or_none(
        self, command: Command, answer: type[BodyType], body: Body = NOTHING
    ) -> BodyType | None:
        """Return a command's answer, or None from a tracker that refuses it or lacks it."""
        reply = self._exchange(Request(command, body), None)
        return None if reply.status != ResultStatus.ALL_OK else _body_of(reply, answer)

    def tell(
        self, command: Command, body: Body = NOTHING, *, within_s: float | None = None
    ) -> None:
        """Give a command whose answer is bare; raises `DeviceRefused`."""
        self.ask(command, Nothing, body, within_s=within_s)

    def attempt(
        self, command: Command, body: Body = NOTHING, *, within_s: float | None = None
    ) -> int:
        """Give a command and return the status of its answer."""
        return self._exchange(Request(command, body), within_s).status

    def reflectors(self) -> list[ReflectorEntry]:
        """Return every reflector; the tracker sends one answer for each."""
        self.drain()
        entries = [self.ask(Command.GET_REFLECTORS, ReflectorEntry)]
        total = entries[0].total
        if total > MOST_REFLECTORS:
            raise self._wrong(f"it claims {total} reflectors, at most {MOST_REFLECTORS} are read")
        while len(entries) < total:
            reply = self._link.await_event(
                _is_reflector, within_s=self._deadlines.answer_s, what="the list of reflectors"
            )
            entries.append(_body_of(reply, ReflectorEntry))
        return entries[: max(total, 0)]

    def result(self, within_s: float) -> Result | ErrorResponse:
        """Return what ends a running measurement: its result or an error."""
        message = self._link.await_event(
            _ends_measurement, within_s=within_s, what="the measurement"
        )
        assert isinstance(message, SingleResult | SingleResult2 | ErrorResponse)
        return message

    def abandon_measurement(self) -> None:
        """Make sure that no result of a failed measurement can come later, or close the wire."""
        if self.attempt(Command.STOP_MEASUREMENT) == ResultStatus.SERVER_BUSY:
            self.close()

    def drain(self) -> None:
        """Drop what came unasked, old results too; remembers that settings were changed.

        Raises `DeviceRefused` when the tracker says that it belongs to another program.
        """
        for event in self._link.events():
            if _is_other_client(event):
                self.close()
                raise refused(self.name, "the connection", OTHER_CLIENT)
            self._settings_touched |= isinstance(event, StatusChange) and event.code in SETTINGS

    def settings_touched(self) -> bool:
        """Drain, and tell whether anybody, also we, changed settings since the last call."""
        self.drain()
        touched, self._settings_touched = self._settings_touched, False
        return touched

    def _exchange(self, request: Request, within_s: float | None) -> Answer | ErrorResponse:
        """Ask, and ask again while the tracker is busy with something else."""
        return ask_until(
            lambda reply: reply.status != ResultStatus.SERVER_BUSY,
            lambda: self._once(request, within_s or self._deadlines.answer_s),
            self._clock,
            give_up_s=self._clock.now_s() + self._deadlines.busy_s,
            pause_s=BUSY_PAUSE_S,
        )

    def _once(self, request: Request, within_s: float) -> Answer | ErrorResponse:
        reply = self._link.ask(
            encode(request),
            answers=lambda message: _is_answer(message, request.command),
            within_s=within_s,
            what=request.command.title,
        )
        assert isinstance(reply, Answer | ErrorResponse)
        return reply

    def _wrong(self, problem: str) -> WireError:
        self.close()
        return WireError(f"{self.name}: {problem}")


def _body_of(reply: FromServer, kind: type[BodyType]) -> BodyType:
    assert isinstance(reply, Answer)
    assert isinstance(reply.body, kind)  # the grammar ties a command to its answer
    return reply.body


def _is_answer(message: FromServer, command: Command) -> bool:
    if isinstance(message, ErrorResponse) and message.status != ResultStatus.ALL_OK:
        return message.command == command or _is_other_client(message)
    return isinstance(message, Answer) and message.command == command


def _comes_unasked(message: FromServer) -> bool:
    """Tell events from answers; of a list's answers all but the first come without being asked."""
    return not isinstance(message, Answer) or _is_reflector(message)


def _is_reflector(message: FromServer) -> bool:
    return (
        isinstance(message, Answer)
        and message.command == Command.GET_REFLECTORS
        and message.status == ResultStatus.ALL_OK
    )


def _ends_measurement(message: FromServer) -> bool:
    return isinstance(message, SingleResult | SingleResult2 | ErrorResponse)


def _is_other_client(message: FromServer) -> bool:
    return isinstance(message, ErrorResponse) and message.status == OTHER_CLIENT
