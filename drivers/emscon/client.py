"""One emScon connection: one command in flight, refusals as errors, events kept apart."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from drivers.emscon.errors import refused
from drivers.errors import WireError
from drivers.link import Link, OverLink
from drivers.ports import Clock
from drivers.transport import Transport
from drivers.waiting import ask_until
from drivers.wire.emscon import (
    NOTHING,
    Answer,
    FromServer,
    FromServerFramer,
    Request,
    encode,
)
from drivers.wire.emscon_body import Body
from drivers.wire.emscon_constants import Command, SystemChange
from drivers.wire.emscon_messages import (
    ErrorResponse,
    Nothing,
    ReflectorEntry,
    SingleResult,
    SingleResult2,
    StatusChange,
)
from drivers.wire.emscon_status import ResultStatus

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


class EmsconClient(OverLink[FromServer]):
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
