"""Units on the emScon wire: from and to what the simulated tracker uses (mm, rad, °C, hPa)."""

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite, pi, radians, sqrt

from drivers.values import Vector3
from drivers.wire.emscon import NOTHING, Request
from drivers.wire.emscon_constants import (
    AdmStatus,
    AngleUnit,
    Command,
    CoordinateSystemType,
    HumidityUnit,
    LaserStatus,
    LengthUnit,
    Mode,
    PressureUnit,
    ProcessorStatus,
    ResultStatus,
    Statistics,
    StatusBit,
    SystemChange,
    TemperatureUnit,
    WeatherMonitor,
)
from drivers.wire.emscon_messages import (
    Body,
    CoordinateSystem,
    Direction,
    Environment,
    MeasurementMode,
    MeasurementStatusInfo,
    ReflectorChoice,
    ReflectorEntry,
    SearchParams,
    SingleResult,
    SingleResult2,
    StationaryMode,
    StatisticMode,
    SystemSettings,
    SystemStatus,
    TrackerInfo,
    Units,
)
from sim.tracker.instrument import SimulatedTracker, TrackerShot

MM_PER_UNIT: dict[int, float] = {
    LengthUnit.METRE: 1000.0,
    LengthUnit.MILLIMETRE: 1.0,
    LengthUnit.MICRON: 0.001,
    LengthUnit.FOOT: 304.8,
    LengthUnit.YARD: 914.4,
    LengthUnit.INCH: 25.4,
}
RAD_PER_UNIT: dict[int, float] = {
    AngleUnit.RADIAN: 1.0,
    AngleUnit.DEGREE: radians(1.0),
    AngleUnit.GON: pi / 200.0,
}
HPA_PER_UNIT: dict[int, float] = {
    PressureUnit.MILLIBAR: 1.0,
    PressureUnit.HECTOPASCAL: 1.0,
    PressureUnit.KILOPASCAL: 10.0,
    PressureUnit.MM_MERCURY: 1.33322,
    PressureUnit.PSI: 68.94757,
    PressureUnit.INCH_WATER: 2.49082,
    PressureUnit.INCH_MERCURY: 33.86379,
}
POWER_ON_UNITS = Units(
    LengthUnit.METRE,
    AngleUnit.RADIAN,
    TemperatureUnit.CELSIUS,
    PressureUnit.MILLIBAR,
    HumidityUnit.RELATIVE_PERCENT,
)


def first_unknown(units: Units) -> int | None:
    """Return the number, from 1, of the first parameter that names no unit."""
    known = (
        units.length in MM_PER_UNIT,
        units.angle in RAD_PER_UNIT,
        units.temperature in set(TemperatureUnit),
        units.pressure in HPA_PER_UNIT,
        units.humidity in set(HumidityUnit),
    )
    return None if all(known) else 1 + known.index(False)


@dataclass(frozen=True, slots=True)
class Scale:
    """Converts by one client's choice of units."""

    units: Units

    def length(self, length_mm: float) -> float:
        """Convert a length for the wire."""
        return length_mm / MM_PER_UNIT[self.units.length]

    def length_mm(self, length: float) -> float:
        """Convert a length from the wire."""
        return length * MM_PER_UNIT[self.units.length]

    def point(self, point_mm: Vector3) -> Vector3:
        """Convert a point for the wire."""
        x_mm, y_mm, z_mm = point_mm
        return self.length(x_mm), self.length(y_mm), self.length(z_mm)

    def point_mm(self, point: Vector3) -> Vector3:
        """Convert a point from the wire."""
        x, y, z = point
        return self.length_mm(x), self.length_mm(y), self.length_mm(z)

    def angle(self, angle_rad: float) -> float:
        """Convert an angle for the wire."""
        return angle_rad / RAD_PER_UNIT[self.units.angle]

    def air(self, air: tuple[float, float, float]) -> tuple[float, float, float]:
        """Convert temperature °C, pressure hPa and humidity % for the wire."""
        celsius, hectopascal, humidity = air
        is_celsius = self.units.temperature == TemperatureUnit.CELSIUS
        temperature = celsius if is_celsius else 1.8 * celsius + 32.0
        return temperature, hectopascal / HPA_PER_UNIT[self.units.pressure], humidity


NO_POINTING_ERROR: Vector3 = (0.0, 0.0, 0.0)
"""Distance of the beam from the reflector's centre; the simulated beam is never beside it."""


def result_of(shot: TrackerShot, scale: Scale, *, extended: bool) -> SingleResult | SingleResult2:
    """Write a shot in the client's units.

    The covariance that it was drawn by stands for the observed and for the a-priori one.
    """
    point = scale.point(shot.point_in_tracker_mm)
    std = _std(shot, scale)
    total = sqrt(sum(value * value for value in std))
    air = scale.air((shot.temperature_degC, shot.pressure_hPa, shot.humidity_percent))
    head = (int(ResultStatus.ALL_OK), int(Mode.STATIONARY), 0, point, std, total)
    if not extended:
        return SingleResult(*head, NO_POINTING_ERROR, std, total, *air)
    mixed = _covariance(shot, scale)
    return SingleResult2(*head, mixed, NO_POINTING_ERROR, std, total, mixed, *air)


def _std(shot: TrackerShot, scale: Scale) -> Vector3:
    (xx, _, _), (_, yy, _), (_, _, zz) = shot.covariance_mm2
    return scale.point((sqrt(xx), sqrt(yy), sqrt(zz)))


def _covariance(shot: TrackerShot, scale: Scale) -> Vector3:
    """Return the covariances 12, 13 and 23: squares of lengths."""
    (_, xy, xz), (_, _, yz), _ = shot.covariance_mm2
    return scale.point(scale.point((xy, xz, yz)))


POWER_ON_SETTINGS = SystemSettings(WeatherMonitor.READ_AND_REFRACT, 0, 0, 1, 1, 0, 0, 0, 0)
POWER_ON_STATIONARY = StationaryMode(time_ms=500, use_adm=1)
POWER_ON_STATISTICS = StatisticMode(Statistics.STANDARD, Statistics.STANDARD)
MS_PER_S = 1000.0
LONGEST_NAME = 31
MOST_DIGITS = 9
CARTESIAN = CoordinateSystem(CoordinateSystemType.RIGHT_HANDED_RECTANGULAR)
STATIONARY = MeasurementMode(Mode.STATIONARY)
FOUND = (
    StatusBit.TRACKER_FOUND
    | StatusBit.TRACKER_COMPENSATION
    | StatusBit.ADM_FOUND
    | StatusBit.ADM_COMPENSATION
    | StatusBit.IN_FACE_1
)


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of a command: a status, one answer or several, and what others are told."""

    status: int = ResultStatus.ALL_OK
    bodies: tuple[Body, ...] = (NOTHING,)
    change: SystemChange | None = None


def wrong_parameter(number: int) -> Outcome:
    """Refuse because of the parameter of that number, from 1."""
    return Outcome(ResultStatus.WRONG_PARAMETER + number)


NOT_IMPLEMENTED = Outcome(ResultStatus.NOT_IMPLEMENTED)


class InstrumentSettings:
    """Settings of one connection, as after power-on, and readings of the instrument."""

    def __init__(self, tracker: SimulatedTracker) -> None:
        self._tracker = tracker
        self.scale = Scale(POWER_ON_UNITS)
        self.stationary = POWER_ON_STATIONARY
        self.statistics = POWER_ON_STATISTICS
        self.settings = POWER_ON_SETTINGS

    @property
    def measuring_time_s(self) -> float:
        """Duration of one measurement."""
        return self.stationary.time_ms / MS_PER_S

    @property
    def wants_covariance(self) -> bool:
        """Whether stationary results carry covariances."""
        return self.statistics.stationary == Statistics.EXTENDED

    def obey(self, request: Request, now_s: float) -> Outcome:
        """Do what a command wants, or refuse it."""
        reader = self._readers().get(request.command)
        if reader is not None:
            return Outcome(bodies=(reader(now_s),))
        if request.command == Command.GET_REFLECTORS:
            return Outcome(bodies=self._reflectors())
        if request.command == Command.SET_REFLECTOR:
            return self._select(request.body)
        return self._set(request.body)

    def _set(self, body: Body) -> Outcome:
        match body:
            case Units():
                return self._set_units(body)
            case MeasurementMode():
                return _only(STATIONARY, body, SystemChange.MEASUREMENT_MODE)
            case CoordinateSystem():
                return _only(CARTESIAN, body, SystemChange.COORDINATE_SYSTEM_TYPE)
            case StationaryMode():
                return self._set_stationary(body)
            case StatisticMode():
                return self._set_statistics(body)
            case SearchParams():
                return self._set_search(body)
            case SystemSettings():
                return self._set_settings(body)
            case Environment():
                return Outcome()  # its own weather station goes on
        return NOT_IMPLEMENTED

    def _set_units(self, units: Units) -> Outcome:
        if number := first_unknown(units):
            return wrong_parameter(number)
        self.scale = Scale(units)
        return Outcome(change=SystemChange.UNITS)

    def _set_stationary(self, mode: StationaryMode) -> Outcome:
        if mode.time_ms <= 0:
            return wrong_parameter(1)
        self.stationary = mode
        return Outcome(change=SystemChange.STATIONARY_MODE_PARAMS)

    def _set_statistics(self, mode: StatisticMode) -> Outcome:
        for number, value in enumerate((mode.stationary, mode.continuous), start=1):
            if value not in set(Statistics):
                return wrong_parameter(number)
        self.statistics = mode
        return Outcome(change=SystemChange.STATISTIC_MODE)

    def _set_search(self, search: SearchParams) -> Outcome:
        radius_mm = self.scale.length_mm(search.radius)
        if not isfinite(radius_mm) or radius_mm <= 0.0:
            return wrong_parameter(1)
        if search.timeout_ms <= 0:
            return wrong_parameter(2)
        self._tracker.search_radius_mm = radius_mm
        self._tracker.search_timeout_s = search.timeout_ms / MS_PER_S
        return Outcome(change=SystemChange.SEARCH_PARAMS)

    def _set_settings(self, settings: SystemSettings) -> Outcome:
        if settings.apply_transformation or settings.apply_station_orientation:
            return NOT_IMPLEMENTED
        self.settings = settings
        return Outcome(change=SystemChange.SYSTEM_SETTINGS)

    def _select(self, body: Body) -> Outcome:
        assert isinstance(body, ReflectorChoice)
        if not self._tracker.select_reflector(body.identifier):
            return wrong_parameter(1)
        return Outcome(change=SystemChange.REFLECTOR)

    def _readers(self) -> dict[Command, Callable[[float], Body]]:
        return {
            Command.GET_SYSTEM_STATUS: self._system_status,
            Command.GET_UNITS: lambda _: self.scale.units,
            Command.GET_ENVIRONMENT_PARAMS: self._environment,
            Command.GET_MEASUREMENT_MODE: lambda _: STATIONARY,
            Command.GET_COORDINATE_SYSTEM_TYPE: lambda _: CARTESIAN,
            Command.GET_STATIONARY_MODE_PARAMS: lambda _: self.stationary,
            Command.GET_REFLECTOR: lambda _: ReflectorChoice(self._tracker.selected),
            Command.GET_SEARCH_PARAMS: self._search,
            Command.GET_SYSTEM_SETTINGS: lambda _: self.settings,
            Command.GET_DIRECTION: self._direction,
            Command.GET_STATISTIC_MODE: lambda _: self.statistics,
            Command.GET_MEASUREMENT_STATUS_INFO: self._status_info,
            Command.GET_TRACKER_INFO: self._tracker_info,
        }

    def _system_status(self, now_s: float) -> SystemStatus:
        is_up, is_warm = self._tracker.initialised(now_s), self._tracker.laser_warm(now_s)
        return SystemStatus(
            ResultStatus.ALL_OK,
            ProcessorStatus.INITIALIZED if is_up else ProcessorStatus.BOOTED,
            LaserStatus.READY if is_warm else LaserStatus.HEATING_UP,
            AdmStatus.READY,
            *self._version(),
            self.settings.weather_monitor,
            flags=0,
            serial=self._serial(),
        )

    def _environment(self, now_s: float) -> Environment:
        return Environment(*self.scale.air(self._tracker.weather(now_s)))

    def _search(self, _now_s: float) -> SearchParams:
        radius = self.scale.length(self._tracker.search_radius_mm)
        return SearchParams(radius, round(self._tracker.search_timeout_s * MS_PER_S))

    def _direction(self, now_s: float) -> Direction:
        horizontal_rad, vertical_rad = self._tracker.direction(now_s)
        return Direction(self.scale.angle(horizontal_rad), self.scale.angle(vertical_rad))

    def _status_info(self, now_s: float) -> MeasurementStatusInfo:
        bits = FOUND
        if self._tracker.beam_locked(now_s):
            bits |= StatusBit.REFLECTOR_FOUND
        if self._tracker.initialised(now_s):
            bits |= StatusBit.INITIALIZED
        return MeasurementStatusInfo(ResultStatus.ALL_OK, bits)

    def _tracker_info(self, _now_s: float) -> TrackerInfo:
        """Name and serial number; a sensor type and ranges it has none."""
        return TrackerInfo(
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

    def _reflectors(self) -> tuple[ReflectorEntry, ...]:
        known = self._tracker.reflectors
        if not known:
            return (ReflectorEntry(0, 0, 0, 0.0, ""),)
        return tuple(
            ReflectorEntry(
                len(known),
                reflector.identifier,
                reflector.target_type,
                self.scale.length(reflector.surface_offset_mm),
                reflector.name[:LONGEST_NAME],
            )
            for reflector in known
        )

    def _serial(self) -> int:
        """Return the last digits of the serial number: the wire has a 32-bit integer for it."""
        digits = [char for char in self._tracker.serial if char in "0123456789"]
        return int("".join(digits[-MOST_DIGITS:]) or "0")

    def _version(self) -> tuple[int, int, int]:
        parts = [int(part) for part in self._tracker.firmware.split(".")]
        major, minor, build = (*parts, 0, 0, 0)[:3]
        return major, minor, build


def _only(supported: Body, wanted: Body, change: SystemChange) -> Outcome:
    return Outcome(change=change) if wanted == supported else NOT_IMPLEMENTED
