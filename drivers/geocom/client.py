"""Client of GeoCOM: numbered questions, and return codes as errors that say what to do next."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from drivers.errors import BeamBroken, DeviceNotReady, DeviceRefused, WireError
from drivers.link import Link, LinkClient
from drivers.plausible import require
from drivers.polling import ask_until
from drivers.ports import Clock
from drivers.transport import Transport
from drivers.values import Bounds
from drivers.wire import geocom
from drivers.wire.geocom_constants import DELIVERED, Result, Rpc, procedure_text, result_text

BUSY_PAUSE_S = 0.1
DECIMALS = 10
"""Decimals of what the instrument sends: 1e-10 m and rad are far below what it can tell."""
WRITTEN_DECIMALS = 6
"""Decimals of what it is told, at most."""
DIGITS = Bounds("number of decimals", 0.0, 15.0, "")
"""As GeoCOM allows them."""
LAST_TRANSACTION = 2**15 - 1
GREETING = (
    Rpc.COM_GET_DOUBLE_PRECISION,
    Rpc.CSV_GET_INSTRUMENT_NAME,
    Rpc.CSV_GET_INSTRUMENT_NO,
    Rpc.COM_GET_SW_VERSION,
    Rpc.CSV_GET_SW_VERSION,
)
"""Questions with which a session begins; what is answered is asked again where it is needed."""

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
REFUSAL_REMEDY = "see docs/geocom.md#errors and the instrument's own display"


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


Value = TypeVar("Value")
Read = Callable[[Sequence[str]], Value]
"""Reads an answer's words; raises `WireError`."""


@dataclass(frozen=True, slots=True)
class GeocomDeadlines:
    """Deadlines of the instrument, in seconds."""

    answer_s: float = 5.0
    greeting_s: float = 15.0
    """Deadline of the first answers: what an earlier client had begun may have to end first."""
    distance_s: int = 10
    """Deadline of a measurement; the instrument is told."""
    motion_s: float = 60.0
    """Deadline of a turn with its search; an instrument gives up by itself before."""
    busy_s: float = 30.0


class GeocomClient(LinkClient[geocom.GeocomReply]):
    """Commands and their answers; any fault of the wire closes it.

    A reply to another transaction is stale (after a fault it can sit in a serial line's buffer):
    the link keeps it with the events, of which this protocol has none, and nobody ever reads it.
    Questions are numbered from `first_transaction` on, but for those of the greeting.
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
        link = Link(
            transport,
            geocom.replies(),
            clock_s=clock.now_s,
            is_event=lambda reply: reply.transaction != self._asked,
            cancelled=cancelled,
        )
        super().__init__(link)
        self._transport = transport
        self._first_transaction = first_transaction
        self._clock = clock
        self.deadlines = deadlines
        self._asked = -1
        self._decimals = WRITTEN_DECIMALS
        self.next_transaction = 0
        """A number that no question has had yet."""

    def greet(self) -> None:
        """Wake the instrument by an empty line, and have values sent with enough digits.

        Raises `DeviceNotReady` for one that takes no commands.
        """
        within_s = self.deadlines.greeting_s
        self._transport.send(geocom.TERMINATOR, within_s)
        if self.attempt(Rpc.COM_NULL_PROC, within_s=within_s):
            problem = f"{self.name}: the instrument answers, but takes no commands"
            raise DeviceNotReady(problem, remedy=WAKE)
        for rpc in GREETING:
            self.attempt(rpc, within_s=within_s)
        self.next_transaction = self._first_transaction
        self.attempt(Rpc.COM_SET_DOUBLE_PRECISION, DECIMALS)
        digits = self.ask(Rpc.COM_GET_DOUBLE_PRECISION, whole)
        require(self.name, DIGITS, digits)
        self._decimals = min(digits, WRITTEN_DECIMALS)

    def ask(
        self, rpc: Rpc, read: Read[Value], *values: float | str, within_s: float | None = None
    ) -> Value:
        """Return a command's values; raises `DeviceRefused` when the instrument says no."""
        return self._read(rpc, read, self._accepted(rpc, values, within_s))

    def ask_or_none(self, rpc: Rpc, read: Read[Value], *values: float | str) -> Value | None:
        """Return a command's values, or None from an instrument that refuses it or lacks it.

        One that answers something else lacks it too.
        """
        reply = self._reply(rpc, values, None)
        if reply.code != Result.OK:
            return None
        try:
            return read(reply.parameters)
        except WireError:
            return None

    def tell(self, rpc: Rpc, *values: float | str) -> None:
        """Give a command that has no values; raises `DeviceRefused`."""
        self._accepted(rpc, values, None)

    def attempt(self, rpc: Rpc, *values: float | str, within_s: float | None = None) -> int:
        """Give a command that has no values, and return its code."""
        return self._reply(rpc, values, within_s).code

    def deliver(
        self, rpc: Rpc, read: Read[Value], *values: float | str, within_s: float
    ) -> tuple[Value, geocom.GeocomReply]:
        """Return values that may come with a warning, and the reply, whose code tells.

        Raises `DeviceRefused` when none come.
        """
        reply = self._reply(rpc, values, within_s)
        if reply.code not in DELIVERED:
            raise refused(self.name, procedure_text(rpc), reply.code)
        return self._read(rpc, read, reply), reply

    def _accepted(
        self, rpc: Rpc, values: Sequence[float | str], within_s: float | None
    ) -> geocom.GeocomReply:
        reply = self._reply(rpc, values, within_s)
        if reply.code != Result.OK:
            raise refused(self.name, procedure_text(rpc), reply.code)
        return reply

    def _reply(
        self, rpc: Rpc, values: Sequence[float | str], within_s: float | None
    ) -> geocom.GeocomReply:
        """Ask, and ask again while the instrument is busy with something else."""
        words = geocom.words_of(*values, decimals=self._decimals)
        return ask_until(
            lambda reply: reply.code not in BUSY,
            lambda: self._once(rpc, words, within_s or self.deadlines.answer_s),
            self._clock,
            give_up_s=self._clock.now_s() + self.deadlines.busy_s,
            pause_s=BUSY_PAUSE_S,
        )

    def _once(self, rpc: Rpc, words: tuple[str, ...], within_s: float) -> geocom.GeocomReply:
        self._asked = number = self.next_transaction % (LAST_TRANSACTION + 1)
        self.next_transaction += 1
        return self._link.ask(
            geocom.encode_request(geocom.GeocomRequest(rpc, number, words)),
            answers=lambda reply: reply.transaction == number,
            within_s=within_s,
            what=procedure_text(rpc),
        )

    def _read(self, rpc: Rpc, read: Read[Value], reply: geocom.GeocomReply) -> Value:
        try:
            return read(reply.parameters)
        except WireError as error:
            self.close()
            problem = f"{self.name}: {procedure_text(rpc)} answers {reply.line!r:.120}"
            raise WireError(problem) from error


def whole(words: Sequence[str]) -> int:
    """Read a whole number."""
    (number,) = wholes(1)(words)
    return number


def wholes(count: int) -> Read[tuple[int, ...]]:
    """Read so many whole numbers."""
    return lambda words: tuple(map(geocom.parse_whole, geocom.parse_words(words, count)))


def numbers(count: int) -> Read[tuple[float, ...]]:
    """Read so many numbers, one that is none (NaN) too: bounds tell what cannot be."""
    return lambda words: tuple(map(any_number, geocom.parse_words(words, count)))


def any_number(word: str) -> float:
    """Read a number as any program writes it, NaN and infinity too; raises `WireError`.

    Python alone writes `1_0`; other scripts' digits do not come over this wire.
    """
    try:
        if "_" not in word:
            return float(word)
    except ValueError:
        pass
    raise WireError(f"{word!r:.80} is not a number")


def text(words: Sequence[str]) -> str:
    """Read a string, as it came: its escapes are part of a prism's name."""
    (word,) = geocom.parse_words(words, 1)
    return word.removeprefix('"').removesuffix('"')
