"""A simulated emScon instrument: its settings, readings and results, in mm, rad, °C and hPa."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import singledispatchmethod
from math import isfinite, sqrt

from drivers.values import Vector3
from drivers.wire import emscon_messages as said
from drivers.wire.emscon import NOTHING, EmsconRequest
from drivers.wire.emscon_constants import (
    AdmStatus,
    Command,
    CoordinateSystemType,
    LaserStatus,
    Mode,
    ProcessorStatus,
    ResultStatus,
    Statistics,
    StatusBit,
    SystemChange,
    TelescopeFace,
    WeatherMonitor,
)
from sim.servers.emscon_units import POWER_ON_UNITS, Scale, first_unknown
from sim.tracker.instrument import SimulatedTracker, TrackerShot

POWER_ON_SETTINGS = said.SystemSettings(WeatherMonitor.READ_AND_REFRACT, 0, 0, 1, 1, 0, 0, 0, 0)
POWER_ON_REFRACTION = said.Refraction(1.000271, 1.000275)
"""About those of 20 °C, 1013 hPa and 50 % at the wavelengths of the two distance meters."""
LEAST_INDEX, MOST_INDEX = 1.000150, 1.000331
"""Bounds within which instruments take a refractive index."""
MS_PER_S = 1000.0
LONGEST_NAME = 31
MOST_DIGITS = 9
ZERO: Vector3 = (0.0, 0.0, 0.0)
CARTESIAN = said.CoordinateSystem(CoordinateSystemType.RIGHT_HANDED_RECTANGULAR)
STATIONARY = said.MeasurementMode(Mode.STATIONARY)
FOUND = (
    StatusBit.TRACKER_FOUND
    | StatusBit.TRACKER_COMPENSATION
    | StatusBit.ADM_FOUND
    | StatusBit.ADM_COMPENSATION
    | StatusBit.IN_FACE_1
)


@dataclass(frozen=True, slots=True)
class EmsconOutcome:
    """Outcome of a command: a status, one answer or several, and what others are told."""

    status: int = ResultStatus.ALL_OK
    bodies: tuple[said.Body, ...] = (NOTHING,)
    change: SystemChange | None = None


def wrong_parameter(number: int) -> EmsconOutcome:
    """Refuse because of the parameter of that number, from 1."""
    return EmsconOutcome(ResultStatus.WRONG_PARAMETER + number)


NOT_IMPLEMENTED = EmsconOutcome(ResultStatus.NOT_IMPLEMENTED)


class EmsconInstrument:
    """Settings, as an instrument keeps them from power-on whoever is connected, and readings."""

    def __init__(self, tracker: SimulatedTracker) -> None:
        self._tracker = tracker
        self.scale = Scale(POWER_ON_UNITS)
        self.settings = POWER_ON_SETTINGS
        self._stationary = said.StationaryMode(time_ms=500, use_adm=1)
        self._statistics = said.StatisticMode(Statistics.STANDARD, Statistics.STANDARD)
        self._refraction = POWER_ON_REFRACTION
        self._orientation = said.StationOrientation(ZERO, ZERO)
        self._transformation = said.Transformation(ZERO, ZERO, 1.0)
        """Kept, and not applied, as the orientation."""
        self._readers: dict[Command, Callable[[float], said.Body]] = {
            Command.GET_SYSTEM_STATUS: self._system_status,
            Command.GET_UNITS: lambda _: self.scale.units,
            Command.GET_ENVIRONMENT_PARAMS: lambda now_s: said.Environment(*tracker.weather(now_s)),
            Command.GET_MEASUREMENT_MODE: lambda _: STATIONARY,
            Command.GET_COORDINATE_SYSTEM_TYPE: lambda _: CARTESIAN,
            Command.GET_STATIONARY_MODE_PARAMS: lambda _: self._stationary,
            Command.GET_REFLECTOR: lambda _: said.ReflectorChoice(tracker.selected),
            Command.GET_SEARCH_PARAMS: lambda _: said.SearchParams(
                tracker.search_radius_mm, round(tracker.search_timeout_s * MS_PER_S)
            ),
            Command.GET_SYSTEM_SETTINGS: lambda _: self.settings,
            Command.GET_DIRECTION: lambda now_s: said.Direction(*tracker.direction(now_s)),
            Command.GET_STATISTIC_MODE: lambda _: self._statistics,
            Command.GET_MEASUREMENT_STATUS_INFO: self._status_info,
            Command.GET_TRACKER_INFO: self._tracker_info,
            Command.GET_FACE: lambda _: said.Face(TelescopeFace.FACE_1),
            Command.GET_SYSTEM_SOFTWARE_VERSION: lambda _: said.SoftwareVersion(tracker.firmware),
            Command.GET_REFRACTION_PARAMS: lambda _: self._refraction,
            Command.GET_STATION_ORIENTATION_PARAMS: lambda _: self._orientation,
            Command.GET_TRANSFORMATION_PARAMS: lambda _: self._transformation,
        }

    @property
    def measuring_time_s(self) -> float:
        """Duration of one measurement."""
        return self._stationary.time_ms / MS_PER_S

    def obey(self, request: EmsconRequest, now_s: float) -> EmsconOutcome:
        """Do what a command wants, or refuse it."""
        reader = self._readers.get(request.command)
        if reader is not None:
            return EmsconOutcome(bodies=(reader(now_s),))
        if request.command == Command.GET_REFLECTORS:
            return EmsconOutcome(bodies=self._reflectors())
        return self._set(request.body)

    def result_of(self, shot: TrackerShot) -> said.SingleResult | said.SingleResult2:
        """Result of a shot, with covariances if they are wanted; the beam points at the centre.

        The covariance that it was drawn by stands for the observed and for the a-priori one.
        """
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = shot.covariance_mm2
        std: Vector3 = (sqrt(xx), sqrt(yy), sqrt(zz))
        total = sqrt(sum(value * value for value in std))
        air = (shot.temperature_degC, shot.pressure_hPa, shot.humidity_percent)
        status, mode = int(ResultStatus.ALL_OK), int(Mode.STATIONARY)
        head = (status, mode, 0, shot.point_in_tracker_mm, std, total)
        if self._statistics.stationary != Statistics.EXTENDED:
            return said.SingleResult(*head, ZERO, std, total, *air)
        mixed: Vector3 = (xy, xz, yz)
        return said.SingleResult2(*head, mixed, ZERO, std, total, mixed, *air)

    @singledispatchmethod
    def _set(self, _other: said.Body) -> EmsconOutcome:
        return NOT_IMPLEMENTED

    @_set.register
    def _(self, _air: said.Environment) -> EmsconOutcome:
        return EmsconOutcome()  # its own weather station goes on

    @_set.register
    def _(self, mode: said.MeasurementMode) -> EmsconOutcome:
        return _only(STATIONARY, mode, SystemChange.MEASUREMENT_MODE)

    @_set.register
    def _(self, system: said.CoordinateSystem) -> EmsconOutcome:
        return _only(CARTESIAN, system, SystemChange.COORDINATE_SYSTEM_TYPE)

    @_set.register
    def _(self, refraction: said.Refraction) -> EmsconOutcome:
        for number, index in enumerate((refraction.interferometer, refraction.distance_meter)):
            if not LEAST_INDEX <= index <= MOST_INDEX:
                return EmsconOutcome(ResultStatus.PARAMETER_1_OUT_OF_RANGE_NOK + 2 * number)
        self._refraction = refraction
        return EmsconOutcome(change=SystemChange.REFRACTION_PARAMS)

    @_set.register
    def _(self, wanted: said.StationOrientation) -> EmsconOutcome:
        if number := _first_endless(*wanted.place, *wanted.rotation):
            return wrong_parameter(number)
        self._orientation = wanted
        return EmsconOutcome(change=SystemChange.STATION_ORIENTATION_PARAMS)

    @_set.register
    def _(self, wanted: said.Transformation) -> EmsconOutcome:
        if number := _first_endless(*wanted.place, *wanted.rotation, wanted.scale):
            return wrong_parameter(number)
        if wanted.scale <= 0.0:
            return wrong_parameter(7)
        self._transformation = wanted
        return EmsconOutcome(change=SystemChange.TRANSFORMATION_PARAMS)

    @_set.register
    def _(self, units: said.Units) -> EmsconOutcome:
        if number := first_unknown(units):
            return wrong_parameter(number)
        self.scale = Scale(units)
        return EmsconOutcome(change=SystemChange.UNITS)

    @_set.register
    def _(self, mode: said.StationaryMode) -> EmsconOutcome:
        if mode.time_ms <= 0:
            return wrong_parameter(1)
        self._stationary = mode
        return EmsconOutcome(change=SystemChange.STATIONARY_MODE_PARAMS)

    @_set.register
    def _(self, mode: said.StatisticMode) -> EmsconOutcome:
        for number, value in enumerate((mode.stationary, mode.continuous), start=1):
            if value not in set(Statistics):
                return wrong_parameter(number)
        self._statistics = mode
        return EmsconOutcome(change=SystemChange.STATISTIC_MODE)

    @_set.register
    def _(self, search: said.SearchParams) -> EmsconOutcome:
        if not isfinite(search.radius) or search.radius <= 0.0:
            return wrong_parameter(1)
        if search.timeout_ms <= 0:
            return wrong_parameter(2)
        self._tracker.search_radius_mm = search.radius
        self._tracker.search_timeout_s = search.timeout_ms / MS_PER_S
        return EmsconOutcome(change=SystemChange.SEARCH_PARAMS)

    @_set.register
    def _(self, settings: said.SystemSettings) -> EmsconOutcome:
        if settings.apply_transformation or settings.apply_station_orientation:
            return NOT_IMPLEMENTED
        self.settings = settings
        return EmsconOutcome(change=SystemChange.SYSTEM_SETTINGS)

    @_set.register
    def _(self, choice: said.ReflectorChoice) -> EmsconOutcome:
        if not self._tracker.select_reflector(choice.identifier):
            return wrong_parameter(1)
        return EmsconOutcome(change=SystemChange.REFLECTOR)

    def _system_status(self, now_s: float) -> said.SystemStatus:
        is_up, is_warm = self._tracker.initialised(now_s), self._tracker.laser_warm(now_s)
        major, minor, build = (*map(int, self._tracker.firmware.split(".")), 0, 0, 0)[:3]
        return said.SystemStatus(
            ResultStatus.ALL_OK,
            ProcessorStatus.INITIALIZED if is_up else ProcessorStatus.BOOTED,
            LaserStatus.READY if is_warm else LaserStatus.HEATING_UP,
            AdmStatus.READY,
            major,
            minor,
            build,
            self.settings.weather_monitor,
            flags=0,
            serial=self._serial(),
        )

    def _status_info(self, now_s: float) -> said.MeasurementStatusInfo:
        bits = FOUND
        if self._tracker.beam_locked(now_s):
            bits |= StatusBit.REFLECTOR_FOUND
        if self._tracker.initialised(now_s):
            bits |= StatusBit.INITIALIZED
        return said.MeasurementStatusInfo(ResultStatus.ALL_OK, bits)

    def _tracker_info(self, _now_s: float) -> said.TrackerInfo:
        """Name and serial number; a sensor type and ranges it has none."""
        return said.TrackerInfo(
            sensor_type=0,
            name=self._tracker.name[:LONGEST_NAME],
            serial=self._serial(),
            compensation=1,
            has_adm=1,
            has_overview_camera=0,
            has_nivel=0,
            nivel_mount_offset=0.0,
            longest_distance=0.0,
            shortest_distance=0.0,
            highest_data_rate=0,
            faces=1,
            horizontal_range=0.0,
            vertical_range=0.0,
            accuracy_model=0,
            laser_firmware_major=0,
            laser_firmware_minor=0,
        )

    def _reflectors(self) -> tuple[said.ReflectorEntry, ...]:
        known = self._tracker.reflectors
        if not known:
            return (said.ReflectorEntry(0, 0, 0, 0.0, ""),)
        return tuple(
            said.ReflectorEntry(
                len(known), r.id, r.target_type, r.surface_offset_mm, r.name[:LONGEST_NAME]
            )
            for r in known
        )

    def _serial(self) -> int:
        """Return the last digits of the serial number: the wire has a 32-bit integer for it."""
        digits = [char for char in self._tracker.serial if char in "0123456789"]
        return int("".join(digits[-MOST_DIGITS:]) or "0")


def _only(supported: said.Body, wanted: said.Body, change: SystemChange) -> EmsconOutcome:
    return EmsconOutcome(change=change) if wanted == supported else NOT_IMPLEMENTED


def _first_endless(*values: float) -> int | None:
    """Return the number, from 1, of the first parameter that is no finite number."""
    return next((n for n, value in enumerate(values, start=1) if not isfinite(value)), None)
