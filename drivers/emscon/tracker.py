"""A laser tracker that speaks emScon (docs/reference/emscon.md).

This module is the port: it says in which order a measurement or motion happens, and what a failure
means. `client.py` has the conversation, `setup.py` the settings, `results.py` judges a result.
"""

from math import cos, isfinite, radians, sin

from typing_extensions import override

from drivers import errors, values
from drivers.declaration import Surroundings
from drivers.emscon import setup
from drivers.emscon.client import (
    BEAM_REMEDY,
    OTHER_CLIENT,
    EmsconClient,
    EmsconDeadlines,
    beam_failure,
)
from drivers.emscon.results import measurement_of, require_own, require_still
from drivers.plausible import require_weather
from drivers.session import Preparation, PreparedTracker
from drivers.wire import emscon as wire
from drivers.wire import emscon_messages as bodies
from drivers.wire.emscon_constants import (
    SENSOR_NAMES,
    Command,
    ResultStatus,
    StatusBit,
    TrackerLight,
)

SIMULATED = "SIM-LT"
"""Name by which our simulated tracker says what it is; no instrument is called so."""
RECONNECT_PAUSE_S = 0.1
READINESS: dict[int, values.Readiness] = {
    TrackerLight.BUSY: values.Readiness.BUSY,
    TrackerLight.READY: values.Readiness.READY,
}


class EmsconTracker(PreparedTracker[EmsconClient, setup.Settings]):
    """A tracker at the other end of a wire.

    A simulated tracker of another process is not judged by its measuring time, which is not known.
    """

    def __init__(
        self,
        surroundings: Surroundings,
        deadlines: EmsconDeadlines = EmsconDeadlines(),  # noqa: B008 - frozen
    ) -> None:
        super().__init__()
        self._surroundings = surroundings
        self._deadlines = deadlines
        # The latest result as it came, over all connections and also if it was refused: a tracker
        # can repeat it after a reconnection as well.
        self._last_result = b""

    def reconnect(self) -> None:
        """Open again after a fault, and prepare the tracker as it was.

        It may still hold the broken connection, and refuse a new one for a while.
        """
        clock = self._surroundings.clock
        give_up_s = clock.now_s() + self._deadlines.old_connection_s
        while True:
            try:
                return super().reconnect()
            except errors.DeviceRefused as error:
                if error.code != str(OTHER_CLIENT) or clock.now_s() >= give_up_s:
                    raise
            clock.sleep_s(RECONNECT_PAUSE_S)

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
            ignored_packets=client.passed_over,
        )

    @override
    def weather(self) -> values.Weather:
        client = self._session.connection
        air = client.ask(Command.GET_ENVIRONMENT_PARAMS, bodies.Environment)
        weather = values.Weather(air.temperature, air.pressure, air.humidity)
        require_weather(client.name, weather)
        return weather

    @override
    def reflectors(self) -> tuple[values.Reflector, ...]:
        return tuple(
            values.Reflector(entry.name, entry.identifier, entry.surface_offset)
            for entry in self._session.connection.reflectors()
        )

    def measure(self) -> values.Measurement:
        """Take one stationary measurement; raises `BeamBroken` when the reflector is lost.

        One of these is `NoReflector`, when it could not begin; another `NotAMeasurement`, when the
        result cannot be of this measurement.
        """
        # 1. Settings that an event puts in doubt are read back.
        client = self._session.connection
        preparation, agreed = self._require_prepared()
        setup.require_unchanged(client, agreed)
        # 2. Start. A beam that is missing now was missing before: `NoReflector`.
        if status := client.start_measurement():
            error = self._failure(Command.START_MEASUREMENT.title, status)
            if isinstance(error, errors.BeamBroken):
                raise errors.NoReflector(error.problem, remedy=error.remedy, code=error.code)
            raise error
        # 3. Await the result, or the error that comes in its place.
        measurement_time_s = preparation.measuring_time_s
        result, after_s = client.await_end(measurement_time_s + self._deadlines.measuring_margin_s)
        if isinstance(result, bodies.ErrorResponse) or result.status != ResultStatus.ALL_OK:
            client.abandon_measurement()
            raise self._failure(Command.START_MEASUREMENT.title, result.status)
        # 4. Refuse a result that cannot be of this measurement.
        before, self._last_result = self._last_result, wire.encode(result)
        try:
            require_own(
                client,
                result,
                is_repeated=self._last_result == before,
                after_s=after_s,
                measuring_time_s=measurement_time_s if self._knows_its_time() else None,
            )
        except errors.NotAMeasurement:
            client.abandon_measurement()
            raise
        # 5. Units changed during the measurement would have changed the result's numbers.
        client.may_hear_old_results = False
        setup.require_unchanged(client, agreed)
        # 6. Refuse one whose readings show a motion: units are the agreed ones.
        require_still(client.name, result)
        return measurement_of(client.name, result)

    @override
    def direction(self) -> values.Vector3 | None:
        beam = self._session.connection.ask_or_none(Command.GET_DIRECTION, bodies.Direction)
        if beam is None or not (isfinite(beam.horizontal) and isfinite(beam.vertical)):
            return None
        # Degrees, as `setup.UNITS` has set; the zenith angle is 0 upwards.
        azimuth, zenith = radians(beam.horizontal), radians(beam.vertical)
        return sin(zenith) * cos(azimuth), sin(zenith) * sin(azimuth), cos(zenith)

    @override
    def go_to(self, point_in_tracker_mm: values.Vector3) -> None:
        self._move(Command.GO_POSITION, bodies.BeamTarget(point_in_tracker_mm, setup.ADM_ON))

    @override
    def find_reflector(self, distance_mm: float) -> None:
        self._move(Command.FIND_REFLECTOR, bodies.ApproximateDistance(distance_mm))

    @override
    def _open(self) -> EmsconClient:
        client = EmsconClient(
            self._surroundings.open_transport(), self._surroundings, self._deadlines
        )
        # A measurement that was running when the last connection broke may still send its result.
        client.may_hear_old_results = self._session.latest is not None
        return client

    @override
    def _greet(self, client: EmsconClient) -> values.Identity:
        # A tracker that another program holds may say so as soon as it is connected to.
        client.drain()
        client.order(Command.SET_UNITS, setup.UNITS)
        return self._ask_identity(client)

    @override
    def _ask_identity(self, client: EmsconClient) -> values.Identity:
        status = client.ask(Command.GET_SYSTEM_STATUS, bodies.SystemStatus)
        info = client.ask_or_none(Command.GET_TRACKER_INFO, bodies.TrackerInfo)
        model = "laser tracker"
        if info is not None:
            model = SENSOR_NAMES.get(info.sensor_type) or info.name or f"sensor {info.sensor_type}"
        return values.Identity(
            vendor="Leica",
            model=model,
            serial=str(status.serial),
            firmware=f"{status.version_major}.{status.version_minor}.{status.version_build}",
            protocol="emScon",
        )

    @override
    def _set_up(self, client: EmsconClient, wanted: Preparation) -> setup.Settings:
        return setup.set_up(client, wanted.reflector, wanted.measuring_time_s, self._deadlines)

    def _knows_its_time(self) -> bool:
        """Return whether the tracker's seconds are known: a simulated one's may be shorter."""
        return self._surroundings.in_process or self._session.identity.model != SIMULATED

    def _move(self, command: Command, body: bodies.Body) -> None:
        client = self._session.connection
        _, agreed = self._require_prepared()
        # In other units the same numbers would turn the head to another place.
        setup.require_unchanged(client, agreed)
        # The answer comes when the motion and the search after it have ended.
        within_s = self._deadlines.motion_s + self._deadlines.search_timeout_s
        if status := client.attempt(command, body, within_s=within_s):
            raise self._failure(command.title, status)
        if self._readiness() is values.Readiness.NOT_READY:
            problem = f"{client.name}: {command.title} found no reflector"
            raise errors.BeamBroken(problem, remedy=BEAM_REMEDY)

    def _failure(self, doing: str, status: int) -> errors.DeviceRefused:
        """Find out what a failure means.

        A tracker without a beam may have restarted: then it needs preparing, not a clear view.
        """
        client = self._session.connection
        beam_lost = self._readiness() is values.Readiness.NOT_READY
        error = beam_failure(client.name, doing, status, beam_lost=beam_lost)
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
