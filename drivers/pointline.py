"""An instrument that speaks pointline (docs/reference/pointline.md): units and meaning."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import hypot
from typing import TypeVar

from typing_extensions import override

from drivers import errors, values
from drivers.declaration import Surroundings
from drivers.line_client import Dialect, LineClient, identity_of, recorded_answer
from drivers.plausible import RESTART, require, require_point, require_weather
from drivers.session import Preparation, PreparedTracker
from drivers.wire import pointline as wire
from drivers.wire.lines import Greeting, Hello, Nothing, numbers_from

NOT_THERE = "NONE"
"""Refusal of what the instrument does not have: a weather station, a direction."""
# Each reflector is a question of its own: a wrong count would be asked for hours.
MOST_REFLECTORS = 100
BEAM = "clear the line of sight, and let the instrument see the reflector"
REFUSALS: Mapping[str, tuple[type[errors.DeviceRefused], str]] = {
    "BEAM": (errors.BeamBroken, BEAM),
    "NOBEAM": (errors.NoReflector, BEAM),
    "REFLECTOR": (
        errors.DeviceNotReady,
        "set tracker.reflector to one that `pkmcal devices` lists",
    ),
    "COLD": (errors.DeviceNotReady, "wait until the instrument is warm, then try again"),
    "FAULT": (errors.DeviceNotReady, "look at the instrument's own display, then try again"),
}

Body = TypeVar("Body")


@dataclass(frozen=True, slots=True)
class PointlineDeadlines:
    """Deadlines of the instrument, in real seconds."""

    answer_s: float = 2.0
    greeting_s: float = 15.0
    """Deadline of the greeting: what an earlier client had begun may have to end first."""
    prepare_s: float = 600.0
    motion_s: float = 60.0
    measuring_margin_s: float = 15.0


class PointlineTracker(PreparedTracker[LineClient, Preparation]):
    """An instrument at the other end of a wire."""

    def __init__(
        self, surroundings: Surroundings, deadlines: PointlineDeadlines = PointlineDeadlines()
    ) -> None:
        super().__init__()
        self._surroundings = surroundings
        self._numbers = numbers_from(surroundings.first_number)
        self._dialect = Dialect(
            wire.GRAMMAR, REFUSALS, "docs/reference/pointline.md", deadlines.answer_s
        )
        self._deadlines = deadlines
        # Number of the latest measurement, over all connections; 0: it has none.
        self._last_count = 0

    @override
    def state(self) -> values.TrackerState:
        status = self._session.connection.ask("STATE", wire.InstrumentStatus)
        readiness = values.Readiness.NOT_READY
        if status.busy:
            readiness = values.Readiness.BUSY
        elif status.initialised and status.warm and status.locked:
            readiness = values.Readiness.READY
        return values.TrackerState(
            readiness=readiness,
            initialised=status.initialised,
            laser_warm=status.warm,
            beam_locked=status.locked,
            reflector=status.reflector,
        )

    @override
    def weather(self) -> values.Weather | None:
        air = self._if_it_has("AIR", wire.Air)
        if air is None:
            return None
        weather = values.Weather(air.temperature_degC, air.pressure_hPa, air.humidity_percent)
        require_weather(self._session.connection.name, weather)
        return weather

    @override
    def reflectors(self) -> tuple[values.Reflector, ...]:
        client = self._session.connection
        reflectors: list[values.Reflector] = []
        count = 1  # every instrument has one reflector at least; each answer has their number
        while (index := len(reflectors)) < min(count, MOST_REFLECTORS):
            question = wire.ReadReflector(index)
            entry = client.ask("REFLECTOR", wire.ReflectorDefinition, question)
            reflectors.append(values.Reflector(entry.name, index, entry.surface_offset_mm))
            count = entry.count
        return tuple(reflectors)

    @override
    def measure(self) -> values.Measurement:
        """Take one point; raises `BeamBroken` when the reflector is lost.

        `NoReflector` when it could not begin, `NotAMeasurement` for a number that came before.
        """
        client = self._session.connection
        wanted, _ = self._require_prepared()
        within_s = wanted.measuring_time_s + self._deadlines.measuring_margin_s
        result = client.ask("MEASURE", wire.PointMeasured, within_s=within_s)
        # Kept now: the question for the air would replace it.
        line = client.latest_line
        covariance_mm2 = _covariance_mm2(client.name, result)
        # An instrument whose program answers with its latest point, measured or not, repeats the
        # number. The point would be of the pose before.
        before, self._last_count = self._last_count, result.count
        if result.count == before != 0:
            raise errors.NotAMeasurement(
                f"{client.name}: the point is that of the measurement before, number {before}",
                remedy="measure again; if it comes back, compare the instrument's program with "
                "docs/reference/pointline.md",
            )
        if result.reflector != wanted.reflector:
            raise self._not_ready(
                f"measured with reflector '{result.reflector}', prepared was '{wanted.reflector}'"
            )
        return values.Measurement(result.point_mm, covariance_mm2, self.weather(), line)

    @override
    def direction(self) -> values.Vector3 | None:
        beam = self._if_it_has("DIRECTION", wire.BeamDirection)
        if beam is None or not (length := hypot(*beam.direction)):
            return None
        return values.vector(value / length for value in beam.direction)

    @override
    def go_to(self, point_in_tracker_mm: values.Vector3) -> None:
        self._aim("GOTO", wire.GoTo(values.vector(point_in_tracker_mm)))

    @override
    def find_reflector(self, distance_mm: float) -> None:
        self._aim("FIND", wire.Find(distance_mm))

    def _aim(self, verb: str, target: wire.GoTo | wire.Find) -> None:
        self._require_prepared()
        self._session.connection.ask(verb, Nothing, target, within_s=self._deadlines.motion_s)

    def _if_it_has(self, verb: str, kind: type[Body]) -> Body | None:
        try:
            return self._session.connection.ask(verb, kind)
        except errors.DeviceRefused as refused:
            if refused.code != NOT_THERE:
                raise
            return None

    @override
    def _open(self) -> LineClient:
        return LineClient(
            self._surroundings.open_transport(),
            self._dialect,
            self._numbers,
            clock_s=self._surroundings.clock.now_s,
            cancelled=self._surroundings.cancelled,
        )

    @override
    def _ask_identity(self, client: LineClient) -> values.Identity:
        hello = Hello(wire.VERSION)
        within_s = self._deadlines.greeting_s
        greeting = client.ask("HELLO", Greeting, hello, within_s=within_s)
        identity = identity_of(greeting, "pointline")
        if greeting.version != wire.VERSION:
            raise errors.WrongDevice(
                f"{identity} answers; pointline {wire.VERSION} is needed",
                remedy="check the address and the instrument's program",
            )
        return identity

    @override
    def _set_up(self, client: LineClient, wanted: Preparation) -> Preparation:
        body = wire.Prepare(wanted.reflector, wanted.measuring_time_s)
        client.ask("PREPARE", Nothing, body, within_s=self._deadlines.prepare_s)
        return wanted


def _covariance_mm2(where: str, result: wire.PointMeasured) -> values.Matrix3 | None:
    """Return a point's covariance if one is stated, else None; raises `ImplausibleAnswer`."""
    require_point(where, result.point_mm)
    # Six zeros state no covariance, by the page; `tracker.uncertainty` then counts.
    if not any(result.covariance_mm2):
        return None
    xx, xy, xz, yy, yz, zz = result.covariance_mm2
    covariance: values.Matrix3 = (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)
    if not values.is_positive_definite(covariance):
        raise errors.ImplausibleAnswer(
            f"{where}: a covariance of {result.covariance_mm2} mm² cannot be: it is not positive "
            "definite",
            remedy=RESTART,
        )
    for variance in (xx, yy, zz):
        require(where, values.SIGMA, variance**0.5)
    return covariance


def recorded_measurement(line: str) -> tuple[values.Vector3, values.Matrix3 | None]:
    """Read point, mm, and covariance, mm², from a record; raises `DriverError`."""
    result = recorded_answer(wire.GRAMMAR, line, wire.PointMeasured)
    return result.point_mm, _covariance_mm2("the tracker", result)
