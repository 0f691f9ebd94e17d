"""emScon laser tracker: results as measurements with a covariance that can be used."""

from math import cos, isfinite, radians, sin

from typing_extensions import override

from drivers import errors, values
from drivers.declaration import Surroundings
from drivers.emscon import setup
from drivers.emscon.client import (
    OTHER_CLIENT,
    EmsconClient,
    EmsconDeadlines,
    Result,
    beam_not_locked,
    failed_with_beam,
)
from drivers.emscon.own_result import OwnResult
from drivers.plausible import require, require_point, require_weather
from drivers.session import PreparedTracker
from drivers.wire import emscon as wire
from drivers.wire import emscon_messages as bodies
from drivers.wire.emscon_constants import (
    SENSOR_NAMES,
    STATIONARY,
    Command,
    ResultStatus,
    StatusBit,
    TrackerLight,
)

SIMULATED = "SIM-LT"
"""Name by which our simulated tracker says what it is; no instrument is called so."""
ADM_ON = 1
RECONNECT_PAUSE_S = 0.1
READINESS: dict[int, values.Readiness] = {
    TrackerLight.BUSY: values.Readiness.BUSY,
    TrackerLight.READY: values.Readiness.READY,
}
NO_COVARIANCE: values.Vector3 = (0.0, 0.0, 0.0)
LEAST_STD_MM = 1e-7
"""Least value taken for a standard deviation; a zero is a field that the instrument left out."""
SMALLEST_DETERMINANT = 1e-9
"""Determinant of the correlation matrix: less is singular within the rounding of what was sent."""
REMEDY = "measure again; if it comes back, look at the tracker's own status"


def measurement_of(
    where: str, result: bodies.SingleResult | bodies.SingleResult2
) -> values.Measurement:
    """Interpret a result in mm, °C and hPa; raises `DeviceRefused` for one that is no data."""
    _require_stationary(where, result)
    air = values.Weather(result.temperature, result.pressure, result.humidity)
    require_point(where, result.point)
    require_weather(where, air)
    return values.Measurement(
        point_in_tracker_mm=result.point,
        covariance_mm2=_covariance(where, result),
        weather=air,
        raw=wire.encode(result).hex(),
    )


def recorded_measurement(raw: str) -> tuple[values.Vector3, values.Matrix3 | None]:
    """Point, mm, and covariance, mm², of a result as records keep it; raises `DriverError`."""
    try:
        packet = bytes.fromhex(raw)
    except ValueError as error:
        raise errors.WireError(f"no packet in hexadecimal digits: {raw!r:.80}") from error
    found = wire.from_server()(packet)
    if len(found) != 1 or not isinstance(found[0], bodies.SingleResult | bodies.SingleResult2):
        raise errors.WireError(f"no single measurement: {raw!r:.80}")
    measured = measurement_of("the tracker", found[0])
    return measured.point_in_tracker_mm, measured.covariance_mm2


def _require_stationary(where: str, result: bodies.SingleResult | bodies.SingleResult2) -> None:
    if result.mode != STATIONARY or result.is_trial:
        raise errors.DeviceRefused(
            f"{where}: a result of mode {result.mode}, trial {result.is_trial}, "
            f"is not the stationary measurement that was asked for",
            remedy="end other programs that use the tracker, then prepare it again",
        )


def _covariance(where: str, result: bodies.SingleResult | bodies.SingleResult2) -> values.Matrix3:
    """Return the larger by trace of the observed and the a-priori covariance.

    The observed one is the scatter within this measurement and may be smaller than what the
    instrument can do; the a-priori one comes from its accuracy model and doesn't know this shot.
    """
    for value in (*result.std, *result.apriori_std):
        if isfinite(value) and value > 0.0:  # zeros and no numbers are fields that were left out
            require(where, values.SIGMA, value)
    observed, apriori = NO_COVARIANCE, NO_COVARIANCE
    if isinstance(result, bodies.SingleResult2):
        observed, apriori = result.covariance, result.apriori_covariance
    candidates = [_matrix(result.std, observed), _matrix(result.apriori_std, apriori)]
    possible = [matrix for matrix in candidates if matrix]
    best = max(possible, key=lambda m: m[0][0] + m[1][1] + m[2][2], default=None)
    if best is None:
        raise errors.DeviceRefused(
            f"{where}: a result without uncertainty: observed {result.std} mm, "
            f"a priori {result.apriori_std} mm",
            remedy=REMEDY,
        )
    return best


def _matrix(std: values.Vector3, covariance: values.Vector3) -> values.Matrix3 | None:
    """Return a positive definite matrix, its diagonal if the whole is none, or None."""
    if not all(LEAST_STD_MM < value <= values.SIGMA.most for value in std):
        return None
    full = _symmetric(std, covariance)
    possible = values.is_positive_definite(full, SMALLEST_DETERMINANT)
    return full if possible else _symmetric(std, NO_COVARIANCE)


def _symmetric(std: values.Vector3, covariance: values.Vector3) -> values.Matrix3:
    xx, yy, zz = (value * value for value in std)
    xy, xz, yz = covariance
    return (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)


class EmsconTracker(PreparedTracker[EmsconClient, setup.Preparation, setup.Settings]):
    """A tracker at the other end of a wire.

    A simulated tracker of another process is not judged by its measuring time, which is not known.
    """

    def __init__(
        self,
        given: Surroundings,
        deadlines: EmsconDeadlines = EmsconDeadlines(),  # noqa: B008 - frozen
    ) -> None:
        super().__init__(given.open_transport, given.clock, given.cancelled)
        self._deadlines = deadlines
        self._instrument_clock = given.instrument_clock
        self._own_result = OwnResult()

    def reconnect(self) -> None:
        """Open anew after a fault, and prepare the tracker as it was."""
        give_up_s = self._clock.now_s() + self._deadlines.old_connection_s
        while not self._is_connected_again(give_up_s):
            self._clock.sleep_s(RECONNECT_PAUSE_S)
        self._prepare_again()

    @override
    def state(self) -> values.TrackerState:
        client = self._session.connection
        status = client.ask(Command.GET_SYSTEM_STATUS, bodies.SystemStatus)
        readiness = self._readiness()
        return values.TrackerState(
            readiness=readiness,
            initialised=setup.is_initialised(status),
            laser_warm=setup.is_warm(status),
            beam_locked=readiness is not values.Readiness.NOT_READY and self._sees_reflector(),
            reflector=self._reflector_in_use(),
            packets_passed_over=client.passed_over,
        )

    @override
    def weather(self) -> values.Weather:
        client = self._session.connection
        found = client.ask(Command.GET_ENVIRONMENT_PARAMS, bodies.Environment)
        air = values.Weather(found.temperature, found.pressure, found.humidity)
        require_weather(client.name, air)
        return air

    @override
    def reflectors(self) -> tuple[values.Reflector, ...]:
        return tuple(
            values.Reflector(entry.name, entry.identifier, entry.surface_offset)
            for entry in self._session.connection.reflectors()
        )

    def prepare(self, reflector: str, measuring_time_s: float) -> None:
        """Bring the tracker to what measuring needs; initialises it when it isn't, which moves it.

        Raises `DeviceNotReady` while it isn't warm and for a reflector that it doesn't know.
        """
        self._prepare(setup.Preparation(reflector, measuring_time_s))

    def measure(self) -> values.Measurement:
        """Take one stationary measurement; raises `BeamBroken` when the reflector is lost.

        One of these is `NoReflector`, when it could not begin; another `NotAMeasurement`, when the
        result cannot be of this measurement.
        """
        client, wanted, agreed = self._prepared()
        setup.require_unchanged(client, agreed)
        if status := client.start_measurement():
            error = self._failure(Command.START_MEASUREMENT.title, status)
            if isinstance(error, errors.BeamBroken):
                raise errors.NoReflector(error.problem, remedy=error.remedy, code=error.code)
            raise error
        result = self._result(client, wanted.measuring_time_s)
        setup.require_unchanged(client, agreed)
        return measurement_of(client.name, result)

    @override
    def direction(self) -> values.Vector3 | None:
        client = self._session.connection
        found = client.ask_or_none(Command.GET_DIRECTION, bodies.Direction)
        if found is None or not (isfinite(found.horizontal) and isfinite(found.vertical)):
            return None
        hz, zenith = radians(found.horizontal), radians(found.vertical)
        return sin(zenith) * cos(hz), sin(zenith) * sin(hz), cos(zenith)

    @override
    def go_to(self, point_in_tracker_mm: values.Vector3) -> None:
        self._move(Command.GO_POSITION, bodies.BeamTarget(point_in_tracker_mm, ADM_ON))

    @override
    def find_reflector(self, distance_mm: float) -> None:
        self._move(Command.FIND_REFLECTOR, bodies.ApproximateDistance(distance_mm))

    @override
    def _opened(self) -> EmsconClient:
        client = EmsconClient(
            self._open_transport(),
            self._clock,
            self._cancelled,
            self._deadlines,
            self._instrument_clock or self._clock,
        )
        client.may_hear_old_results = self._session.latest is not None
        return client

    @override
    def _greet(self, client: EmsconClient) -> values.Identity:
        client.drain()
        client.tell(Command.SET_UNITS, setup.UNITS)
        return self._who(client)

    @override
    def _who(self, client: EmsconClient) -> values.Identity:
        status = client.ask(Command.GET_SYSTEM_STATUS, bodies.SystemStatus)
        return values.Identity(
            vendor="Leica",
            model=_model(client),
            serial=str(status.serial),
            firmware=f"{status.version_major}.{status.version_minor}.{status.version_build}",
            protocol="emScon",
        )

    @override
    def _set_up(self, client: EmsconClient, wanted: setup.Preparation) -> setup.Settings:
        return setup.set_up(client, wanted, self._deadlines)

    def _is_connected_again(self, give_up_s: float) -> bool:
        """Whether the tracker is open again, or still holds our old connection."""
        try:
            self.connect()
        except errors.DeviceRefused as error:
            if error.code != str(OTHER_CLIENT) or self._clock.now_s() >= give_up_s:
                raise
            return False
        return True

    def _result(self, client: EmsconClient, measuring_time_s: float) -> Result:
        """Wait for the result of the measurement that was started; stops one that fails."""
        judged_s = measuring_time_s if self._knows_its_time() else None
        within_s = measuring_time_s + self._deadlines.measuring_margin_s
        try:
            result = self._own_result.require(client, within_s, judged_s)
        except errors.NotAMeasurement:
            client.abandon_measurement()
            raise
        if isinstance(result, bodies.ErrorResponse) or result.status != ResultStatus.ALL_OK:
            client.abandon_measurement()
            raise self._failure(Command.START_MEASUREMENT.title, result.status)
        client.may_hear_old_results = False
        return result

    def _knows_its_time(self) -> bool:
        """Tell whether the tracker's seconds are known: a simulated one's may be shorter."""
        return self._instrument_clock is not None or self._session.identity.model != SIMULATED

    def _move(self, command: Command, body: bodies.Body) -> None:
        client, _, agreed = self._prepared()
        setup.require_unchanged(client, agreed)
        within_s = self._deadlines.motion_s + self._deadlines.search_timeout_s
        if status := client.attempt(command, body, within_s=within_s):
            raise self._failure(command.title, status)
        if self._readiness() is values.Readiness.NOT_READY:
            raise beam_not_locked(client.name, command.title)

    def _failure(self, doing: str, status: int) -> errors.DeviceRefused:
        """Find out what a failure means: a tracker that cannot see may also not be up."""
        client = self._session.connection
        beam_lost = self._readiness() is values.Readiness.NOT_READY
        error = failed_with_beam(client.name, doing, status, beam_lost=beam_lost)
        if isinstance(error, errors.BeamBroken):
            system = client.ask(Command.GET_SYSTEM_STATUS, bodies.SystemStatus)
            setup.require_laser(client.name, system)
            if not setup.is_initialised(system):
                raise self._not_ready("is not initialised any more")
        return error

    def _readiness(self) -> values.Readiness:
        light = self._session.connection.ask(Command.GET_TRACKER_STATUS, bodies.Code).value
        return READINESS.get(light, values.Readiness.NOT_READY)

    def _sees_reflector(self) -> bool:
        info = self._session.connection.ask_or_none(
            Command.GET_MEASUREMENT_STATUS_INFO, bodies.MeasurementStatusInfo
        )
        return info is None or bool(info.bits & StatusBit.REFLECTOR_FOUND)

    def _reflector_in_use(self) -> str:
        choice = self._session.connection.ask_or_none(Command.GET_REFLECTOR, bodies.Code)
        if choice is None:
            return ""
        names = {entry.identifier: entry.name for entry in self.reflectors()}
        return names.get(choice.value, "")


def _model(client: EmsconClient) -> str:
    info = client.ask_or_none(Command.GET_TRACKER_INFO, bodies.TrackerInfo)
    if info is None:
        return "laser tracker"
    return SENSOR_NAMES.get(info.sensor_type) or info.name or f"sensor {info.sensor_type}"
