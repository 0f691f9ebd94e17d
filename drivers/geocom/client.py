"""Client of GeoCOM: requests, replies, and return codes as errors that say what to do next."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

from geocompy.geo import GeoCom
from geocompy.geo.gctypes import GeoComResponse

from drivers.errors import BeamBroken, DeviceNotReady, DeviceRefused, WireError
from drivers.geocom.connection import GeocomConnection
from drivers.plausible import require
from drivers.polling import ask_until
from drivers.ports import Clock
from drivers.transport import Transport
from drivers.values import Bounds
from drivers.wire.geocom import decode_reply
from drivers.wire.geocom_constants import DELIVERED, Result, result_text

LEVEL = "level the instrument and let it stand still, then try again"
MOTORS = "check that nothing blocks the telescope, then try again"
WAIT = "wait until the instrument has finished, then try again"
WAKE = "switch the instrument on, leave it in GeoCOM mode and keep it awake, then try again"

NOT_READY: Mapping[int, str] = {
    Result.SYSTEM_BUSY: WAIT,
    Result.TMC_BUSY: WAIT,
    Result.MOTOR_BUSY: WAIT,
    Result.SHUT_DOWN: WAKE,
    Result.SLEEP_MODE: WAKE,
    Result.COM_CONSULT: WAKE,
    Result.COM_SLEEPING: WAKE,
    Result.COM_OFF: WAKE,
    Result.LOW_POWER: "charge or change the battery, then try again",
    Result.BATTERY_EMPTY: "charge or change the battery, then try again",
    Result.OUT_OF_TEMPERATURE: "bring the instrument to a temperature it works at",
    Result.HARDWARE_FAILURE: "restart the instrument; if it comes back, have it serviced",
    Result.INSTRUMENT_TILT: LEVEL,
    Result.ANGLE_ERROR: LEVEL,
    Result.AUT_ANGLE_ERROR: LEVEL,
    Result.AUT_TIMEOUT: MOTORS,
    Result.AUT_MOTOR_ERROR: MOTORS,
    Result.AUT_DETENT_ERROR: MOTORS,
    Result.AUT_NOT_ENABLED: "prepare the tracker again, which switches target recognition on",
    Result.AUT_NO_LOCK: "prepare the tracker again, which switches lock mode on",
    Result.DISTANCE_PPM: "check the instrument's distance meter settings (ppm, mm)",
    Result.NOT_AVAILABLE: "have the instrument licensed for GeoCOM robotic functions",
}

BEAM_LOST: frozenset[int] = frozenset(
    {
        Result.ATR_NO_TARGETS,
        Result.ANGLES_ONLY,
        Result.ANGLES_ONLY_NO_FULL_CORRECTION,
        Result.ANGLES_ONLY_ACCURACY_NOT_GUARANTEED,
        Result.DISTANCE_ERROR,
        Result.SIGNAL_ERROR,
        Result.MOTOR_NOT_LOCKED,
        Result.AUT_INACCURATE,
        Result.AUT_DEVIATION_ERROR,
        Result.AUT_NO_TARGET,
        Result.AUT_MULTIPLE_TARGETS,
        Result.AUT_BAD_ENVIRONMENT,
        Result.AUT_DETECTOR_ERROR,
        Result.AUT_ACCURACY,
    }
)
"""Codes without a prism, without a distance to it, or not settled on it."""

BUSY: frozenset[int] = frozenset({Result.SYSTEM_BUSY, Result.TMC_BUSY, Result.MOTOR_BUSY})
"""Codes of a question that is worth asking again."""

BEAM_REMEDY = "clear the line of sight, let one prism face the instrument, and aim at it"
REFUSAL_REMEDY = "see docs/geocom.md, section Errors, and the instrument's own display"


def refused(where: str, doing: str, code: int) -> DeviceRefused:
    """Return the error for a return code other than OK."""
    problem = f"{where}: {doing} failed: {result_text(code)}"
    if code in BEAM_LOST:
        return BeamBroken(problem, remedy=BEAM_REMEDY, code=str(code))
    if remedy := NOT_READY.get(code):
        return DeviceNotReady(problem, remedy=remedy, code=str(code))
    return DeviceRefused(problem, remedy=REFUSAL_REMEDY, code=str(code))


def not_locked(where: str, doing: str) -> BeamBroken:
    """Return the error for a telescope that doesn't follow a prism."""
    return BeamBroken(f"{where}: {doing}: not locked on a prism", remedy=BEAM_REMEDY)


BUSY_PAUSE_S = 0.1
DECIMALS = 10
"""Decimals of what the instrument sends: 1e-10 m and rad are far below what it can tell."""

DIGITS = Bounds("number of decimals", 0.0, 15.0, "")
"""As GeoCOM allows them."""

Value = TypeVar("Value")
Question = Callable[[GeoCom], GeoComResponse[Value]]


@dataclass(frozen=True, slots=True)
class GeocomDeadlines:
    """Deadlines of the instrument, in seconds."""

    answer_s: float = 5.0
    greeting_s: float = 15.0
    """Deadline of the first answer: what an earlier client had begun may have to end first."""
    distance_s: int = 10
    """Deadline of a measurement; the instrument is told."""
    motion_s: float = 60.0
    """Deadline of a turn with its search; an instrument gives up by itself before."""
    busy_s: float = 30.0


class GeocomClient:
    """Commands and their answers; any fault of the wire closes it.

    Making one greets the instrument: geocompy's own start-up, which sleeps for a second. It is
    geocompy's class as it comes, because only patching it would spare that second.
    """

    def __init__(
        self,
        transport: Transport,
        clock: Clock,
        cancelled: Callable[[], bool],
        deadlines: GeocomDeadlines,
        *,
        first_transaction: int,
    ) -> None:
        self._clock = clock
        self.deadlines = deadlines
        self._connection = GeocomConnection(
            transport, clock_s=clock.now_s, within_s=deadlines.answer_s, cancelled=cancelled
        )
        self._geocom = self._greeted()
        self._geocom.transaction_counter = first_transaction

    @property
    def name(self) -> str:
        """Name of the instrument's place, for messages."""
        return self._connection.name

    @property
    def is_open(self) -> bool:
        """Whether a question can be asked."""
        return self._connection.is_open()

    @property
    def next_transaction(self) -> int:
        """A number that no question has had yet."""
        return self._geocom.transaction_counter

    def close(self) -> None:
        """Free the wire; the instrument stays on."""
        self._connection.close()

    def set_decimals(self) -> None:
        """Have values sent with enough digits, where the instrument lets us choose."""
        self.attempt(lambda geocom: geocom.com.set_double_precision(DECIMALS))
        digits = self.ask(lambda geocom: geocom.com.get_double_precision())
        require(self.name, DIGITS, digits)
        self._geocom.precision = digits

    def ask(self, question: Question[Value], *, within_s: float | None = None) -> Value:
        """Return a command's values; raises `DeviceRefused` when the instrument says no."""
        response, code = self._response(question, within_s)
        if code != Result.OK:
            raise refused(self.name, response.rpcname, code)
        return self._values(response)

    def ask_or_none(self, question: Question[Value]) -> Value | None:
        """Return a command's values, or None from an instrument that refuses it or lacks it."""
        response, code = self._response(question, None)
        return response.params if code == Result.OK else None

    def tell(self, question: Question[None], *, within_s: float | None = None) -> None:
        """Give a command that has no values; raises `DeviceRefused`."""
        response, code = self._response(question, within_s)
        if code != Result.OK:
            raise refused(self.name, response.rpcname, code)

    def attempt(self, question: Question[None], *, within_s: float | None = None) -> int:
        """Give a command that has no values, and return its code."""
        return self._response(question, within_s)[1]

    def deliver(self, question: Question[Value], *, within_s: float) -> "Delivery[Value]":
        """Return values that may come with a warning; raises `DeviceRefused` when none come."""
        response, code = self._response(question, within_s)
        if code not in DELIVERED:
            raise refused(self.name, response.rpcname, code)
        warned = code != Result.OK
        return Delivery(self._values(response), warned=warned, raw=response.response)

    def _greeted(self) -> GeoCom:
        try:
            with self._connection.patience(self.deadlines.greeting_s):
                return GeoCom(self._connection, attempts=1)
        except ConnectionRefusedError as error:
            self.close()
            if self._connection.failure is not None:
                raise self._connection.failure from error
            raise DeviceNotReady(
                f"{self.name}: the instrument answers, but takes no commands", remedy=WAKE
            ) from error

    def _response(
        self, question: Question[Value], within_s: float | None
    ) -> tuple[GeoComResponse[Value], int]:
        """Ask, and ask again while the instrument is busy with something else."""
        return ask_until(
            lambda answer: answer[1] not in BUSY,
            lambda: self._once(question, within_s or self.deadlines.answer_s),
            self._clock,
            give_up_s=self._clock.now_s() + self.deadlines.busy_s,
            pause_s=BUSY_PAUSE_S,
        )

    def _once(
        self, question: Question[Value], within_s: float
    ) -> tuple[GeoComResponse[Value], int]:
        with self._connection.patience(within_s):
            response = question(self._geocom)
        return response, self._code(response)

    def _code(self, response: GeoComResponse[Value]) -> int:
        """Return the code as it came, not as geocompy's table has it."""
        if self._connection.failure is not None:
            raise self._connection.failure
        reply = decode_reply(response.response.encode("ascii"))
        return reply.communication or reply.result

    def _values(self, response: GeoComResponse[Value]) -> Value:
        if response.params is None:
            self.close()
            raise WireError(f"{self.name}: {response.rpcname} answers {response.response!r:.120}")
        return response.params


@dataclass(frozen=True, slots=True)
class Delivery(Generic[Value]):
    """Values of a measurement; `warned`: the instrument doesn't vouch for their full accuracy."""

    values: Value
    warned: bool
    raw: str
