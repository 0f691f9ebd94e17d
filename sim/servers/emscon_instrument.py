"""Settings of a simulated emScon instrument, and its readings, by command."""

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite

from drivers.values import Vector3
from drivers.wire.emscon import NOTHING, Request
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
from drivers.wire.emscon_messages import (
    Body,
    CoordinateSystem,
    Direction,
    Environment,
    Face,
    MeasurementMode,
    MeasurementStatusInfo,
    ReflectorChoice,
    ReflectorEntry,
    Refraction,
    SearchParams,
    SoftwareVersion,
    StationaryMode,
    StationOrientation,
    StatisticMode,
    SystemSettings,
    SystemStatus,
    TrackerInfo,
    Transformation,
    Units,
)
from sim.servers.emscon_units import POWER_ON_UNITS, Scale, first_unknown
from sim.tracker.instrument import SimulatedTracker

POWER_ON_SETTINGS = SystemSettings(WeatherMonitor.READ_AND_REFRACT, 0, 0, 1, 1, 0, 0, 0, 0)
POWER_ON_STATIONARY = StationaryMode(time_ms=500, use_adm=1)
POWER_ON_STATISTICS = StatisticMode(Statistics.STANDARD, Statistics.STANDARD)
POWER_ON_REFRACTION = Refraction(1.000271, 1.000275)
"""About those of 20 °C, 1013 hPa and 50 % at the wavelengths of the two distance meters."""
LEAST_INDEX, MOST_INDEX = 1.000150, 1.000331
"""Bounds within which instruments take a refractive index."""
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


@dataclass(frozen=True, slots=True)
class Similarity:
    """Station orientation or transformation that somebody has set; it is kept, not applied."""

    place_mm: Vector3 = (0.0, 0.0, 0.0)
    rotation_rad: Vector3 = (0.0, 0.0, 0.0)
    scale: float = 1.0


class EmsconInstrument:
    """Settings, as an instrument keeps them from power-on whoever is connected, and readings."""

    def __init__(self, tracker: SimulatedTracker) -> None:
        self._tracker = tracker
        self.scale = Scale(POWER_ON_UNITS)
        self.stationary = POWER_ON_STATIONARY
        self.statistics = POWER_ON_STATISTICS
        self.settings = POWER_ON_SETTINGS
        self._refraction = POWER_ON_REFRACTION
        self._orientation = Similarity()
        self._transformation = Similarity()

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
            case _:
                return self._set_geometry(body)

    def _set_geometry(self, body: Body) -> Outcome:
        """Keep what instruments apply to points, which this one does not."""
        match body:
            case Refraction():
                return self._set_refraction(body)
            case StationOrientation(place, rotation):
                return self._set_orientation(place, rotation)
            case Transformation(place, rotation, scale):
                return self._set_transformation(place, rotation, scale)
        return NOT_IMPLEMENTED

    def _set_refraction(self, refraction: Refraction) -> Outcome:
        for number, index in enumerate((refraction.interferometer, refraction.distance_meter)):
            if not LEAST_INDEX <= index <= MOST_INDEX:
                return Outcome(ResultStatus.PARAMETER_1_OUT_OF_RANGE_NOK + 2 * number)
        self._refraction = refraction
        return Outcome(change=SystemChange.REFRACTION_PARAMS)

    def _set_orientation(self, place: Vector3, rotation: Vector3) -> Outcome:
        if number := _first_endless(*place, *rotation):
            return wrong_parameter(number)
        self._orientation = Similarity(self.scale.point_mm(place), self.scale.angles_rad(rotation))
        return Outcome(change=SystemChange.STATION_ORIENTATION_PARAMS)

    def _set_transformation(self, place: Vector3, rotation: Vector3, scale: float) -> Outcome:
        if number := _first_endless(*place, *rotation, scale):
            return wrong_parameter(number)
        if scale <= 0.0:
            return wrong_parameter(7)
        self._transformation = Similarity(
            self.scale.point_mm(place), self.scale.angles_rad(rotation), scale
        )
        return Outcome(change=SystemChange.TRANSFORMATION_PARAMS)

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
            Command.GET_FACE: lambda _: Face(TelescopeFace.FACE_1),
            Command.GET_SYSTEM_SOFTWARE_VERSION: lambda _: SoftwareVersion(self._tracker.firmware),
            Command.GET_REFRACTION_PARAMS: lambda _: self._refraction,
            Command.GET_STATION_ORIENTATION_PARAMS: lambda _: self._station_orientation(),
            Command.GET_TRANSFORMATION_PARAMS: lambda _: self._transformation_params(),
        }

    def _station_orientation(self) -> StationOrientation:
        kept = self._orientation
        return StationOrientation(
            self.scale.point(kept.place_mm), self.scale.angles(kept.rotation_rad)
        )

    def _transformation_params(self) -> Transformation:
        kept = self._transformation
        return Transformation(
            self.scale.point(kept.place_mm), self.scale.angles(kept.rotation_rad), kept.scale
        )

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
                reflector.id,
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


def _first_endless(*values: float) -> int | None:
    """Return the number, from 1, of the first parameter that is no finite number."""
    return next((n for n, value in enumerate(values, start=1) if not isfinite(value)), None)
