"""A simulated emScon instrument: its settings, readings and results, in mm, rad, °C and hPa.

Settings belong to the instrument, not to a connection: they are those of power-on until a client
sets them, and stay when it leaves. A setting that exists and a value that it cannot have are
refused by emScon's number of the wrong parameter; a command that this instrument lacks, or a value
of which it has only one, as not implemented.
"""

from collections.abc import Callable, Mapping
from dataclasses import astuple, dataclass
from math import isfinite, sqrt
from typing import cast

from drivers.values import Measurement, Vector3, vector
from drivers.wire import emscon_messages as said
from drivers.wire.emscon import NOTHING, EmsconRequest
from drivers.wire.emscon_constants import (
    ADM_READY,
    READ_AND_REFRACT,
    RIGHT_HANDED_RECTANGULAR,
    STATIONARY,
    WRONG_PARAMETERS,
    Command,
    LaserStatus,
    ProcessorStatus,
    ResultStatus,
    Statistics,
    StatusBit,
    SystemChange,
)
from sim.servers.emscon_units import POWER_ON_UNITS, are_known
from sim.tracker.instrument import SimulatedTracker

POWER_ON_SETTINGS = said.SystemSettings(READ_AND_REFRACT, 0, 0, 1, 1, 0, 0, 0, 0)
MS_PER_S = 1000.0
LONGEST_NAME = 31
MOST_DIGITS = 9
ZERO: Vector3 = (0.0, 0.0, 0.0)
ONLY_VALUES: Mapping[Command, said.Code] = {
    Command.SET_MEASUREMENT_MODE: said.Code(STATIONARY),
    Command.SET_COORDINATE_SYSTEM_TYPE: said.Code(RIGHT_HANDED_RECTANGULAR),
}
"""Settings that have only one value here."""
EQUIPMENT_FOUND = (
    StatusBit.TRACKER_FOUND
    | StatusBit.TRACKER_COMPENSATION
    | StatusBit.ADM_FOUND
    | StatusBit.ADM_COMPENSATION
)


@dataclass(frozen=True, slots=True)
class EmsconOutcome:
    """Outcome of a command: a status, its answers, and the change of settings to report."""

    status: int = ResultStatus.ALL_OK
    bodies: tuple[said.Body, ...] = (NOTHING,)
    change: SystemChange | None = None


NOT_IMPLEMENTED = EmsconOutcome(ResultStatus.NOT_IMPLEMENTED)


class EmsconInstrument:
    """Settings that an instrument keeps from power-on for all its clients, and readings."""

    def __init__(self, tracker: SimulatedTracker) -> None:
        self._tracker = tracker
        self._kept: dict[Command, said.Body] = {
            Command.GET_UNITS: POWER_ON_UNITS,
            Command.GET_SYSTEM_SETTINGS: POWER_ON_SETTINGS,
            Command.GET_MEASUREMENT_MODE: ONLY_VALUES[Command.SET_MEASUREMENT_MODE],
            Command.GET_COORDINATE_SYSTEM_TYPE: ONLY_VALUES[Command.SET_COORDINATE_SYSTEM_TYPE],
            Command.GET_STATIONARY_MODE_PARAMS: said.StationaryMode(time_ms=500, use_adm=1),
            Command.GET_STATISTIC_MODE: said.StatisticMode(
                Statistics.STANDARD, Statistics.STANDARD
            ),
        }
        # readings are taken from the tracker at the time of the question, nothing is kept of them
        self._readers: dict[Command, Callable[[float], said.Body]] = {
            Command.GET_SYSTEM_STATUS: self._system_status,
            Command.GET_ENVIRONMENT_PARAMS: lambda now_s: said.Environment(*tracker.weather(now_s)),
            Command.GET_REFLECTOR: lambda _: said.Code(tracker.selected),
            Command.GET_SEARCH_PARAMS: lambda _: said.SearchParams(
                tracker.search_radius_mm, round(tracker.search_timeout_s * MS_PER_S)
            ),
            Command.GET_DIRECTION: lambda now_s: said.Direction(*tracker.direction(now_s)),
            Command.GET_MEASUREMENT_STATUS_INFO: self._status_info,
            Command.GET_TRACKER_INFO: self._tracker_info,
        }

    @property
    def units(self) -> said.Units:
        """Units of the wire that are set."""
        return cast("said.Units", self._kept[Command.GET_UNITS])

    @property
    def settings(self) -> said.SystemSettings:
        """Switches that are set."""
        return cast("said.SystemSettings", self._kept[Command.GET_SYSTEM_SETTINGS])

    @property
    def measuring_time_s(self) -> float:
        """Duration of one measurement."""
        mode = cast("said.StationaryMode", self._kept[Command.GET_STATIONARY_MODE_PARAMS])
        return mode.time_ms / MS_PER_S

    def obey(self, request: EmsconRequest, now_s: float) -> EmsconOutcome:
        """Carry out a command, or refuse it."""
        reader = self._readers.get(request.command)
        if reader is not None:
            return EmsconOutcome(bodies=(reader(now_s),))
        if request.command in self._kept:
            return EmsconOutcome(bodies=(self._kept[request.command],))
        if request.command == Command.GET_REFLECTORS:
            return EmsconOutcome(bodies=self._reflectors())
        return self._set(request.command, request.body)

    def result_of(self, shot: Measurement) -> said.SingleResult | said.SingleResult2:
        """Return the result packet of a shot, with covariances if statistics are extended."""
        # The covariance by which the shot was drawn stands for the observed and for the a-priori
        # one. Readings of a reflector that moves evenly over a length scatter by a twelfth of its
        # square more. Offsets of the beam from the reflector's centre are 0.
        assert shot.covariance_mm2 is not None, "our own tracker states it"
        assert shot.weather is not None, "it has a weather station"
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = shot.covariance_mm2
        std: Vector3 = (sqrt(xx), sqrt(yy), sqrt(zz))
        total = sqrt(sum(value * value for value in std))
        swept_mm, seen = self._tracker.swept_mm, std
        if any(swept_mm):
            pairs = zip(std, swept_mm, strict=True)
            seen = vector(sqrt(size**2 + way_mm**2 / 12.0) for size, way_mm in pairs)
        seen_total = sqrt(sum(value * value for value in seen))
        air = astuple(shot.weather)
        status, mode = int(ResultStatus.ALL_OK), STATIONARY
        head = (status, mode, 0, shot.point_in_tracker_mm, seen, seen_total)
        statistics = cast("said.StatisticMode", self._kept[Command.GET_STATISTIC_MODE])
        if statistics.stationary != Statistics.EXTENDED:
            return said.SingleResult(*head, ZERO, std, total, *air)
        mixed: Vector3 = (xy, xz, yz)
        return said.SingleResult2(*head, mixed, ZERO, std, total, mixed, *air)

    def _set(self, command: Command, wanted: said.Body) -> EmsconOutcome:
        """Keep a setting and return what has changed, or refuse it."""
        if command == Command.SET_ENVIRONMENT_PARAMS:
            return EmsconOutcome()  # its own weather station goes on
        name = command.name.removeprefix("SET_")
        if name not in SystemChange.__members__:
            return NOT_IMPLEMENTED
        if status := self._obstacle(command, wanted):
            return EmsconOutcome(status)
        self._kept[Command[f"GET_{name}"]] = wanted
        return EmsconOutcome(change=SystemChange[name])

    def _obstacle(self, command: Command, wanted: said.Body) -> int:
        """Return the status that refuses a setting, or 0; settings of the head are made here."""
        match wanted:
            case said.Code(identifier) if command == Command.SET_REFLECTOR:
                return _wrong_parameter(self._tracker.select_reflector(identifier))
            # settings with one possible value: it is accepted, any other is not implemented
            case said.Code():
                return 0 if wanted == ONLY_VALUES[command] else NOT_IMPLEMENTED.status
            case said.SearchParams(radius_mm, timeout_ms):
                status = _wrong_parameter(isfinite(radius_mm) and radius_mm > 0.0, timeout_ms > 0)
                if status == 0:
                    self._tracker.search_radius_mm = radius_mm
                    self._tracker.search_timeout_s = timeout_ms / MS_PER_S
                return status
        return _refusing_status(wanted)

    def _system_status(self, now_s: float) -> said.SystemStatus:
        is_up, is_warm = self._tracker.initialised(now_s), self._tracker.laser_warm(now_s)
        major, minor, build = (*map(int, self._tracker.firmware.split(".")), 0, 0, 0)[:3]
        return said.SystemStatus(
            ResultStatus.ALL_OK,
            # of the start-up ladder of a real controller only these two steps are simulated
            ProcessorStatus.INITIALIZED if is_up else ProcessorStatus.BOOTED,
            LaserStatus.READY if is_warm else LaserStatus.HEATING_UP,
            ADM_READY,
            major,
            minor,
            build,
            self.settings.weather_monitor,
            flags=0,
            serial=self._serial(),
        )

    def _status_info(self, now_s: float) -> said.MeasurementStatusInfo:
        bits = EQUIPMENT_FOUND | StatusBit.IN_FACE_1
        if self._tracker.beam_locked(now_s):
            bits |= StatusBit.REFLECTOR_FOUND
        if self._tracker.initialised(now_s):
            bits |= StatusBit.INITIALIZED
        return said.MeasurementStatusInfo(ResultStatus.ALL_OK, bits)

    def _tracker_info(self, _now_s: float) -> said.TrackerInfo:
        """Return name and serial number; it has no sensor type and no ranges."""
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
        # one packet for each definition, and each packet states their number. What an instrument
        # without definitions answers is not public: our choice is one empty entry.
        reflectors = self._tracker.reflectors
        if not reflectors:
            return (said.ReflectorEntry(0, 0, 0, 0.0, ""),)
        return tuple(
            said.ReflectorEntry(
                len(reflectors), r.id, r.target_type, r.surface_offset_mm, r.name[:LONGEST_NAME]
            )
            for r in reflectors
        )

    def _serial(self) -> int:
        """Return the last digits of the serial number: the wire has a 32-bit integer for it."""
        digits = [char for char in self._tracker.serial if char in "0123456789"]
        return int("".join(digits[-MOST_DIGITS:]) or "0")


def _refusing_status(wanted: said.Body) -> int:
    """Return the status that refuses a setting in any state of the instrument, or 0."""
    match wanted:
        case said.Units():
            return _wrong_parameter(*are_known(wanted))
        case said.StationaryMode(time_ms):
            return _wrong_parameter(time_ms > 0)
        case said.StatisticMode(stationary, continuous):
            return _wrong_parameter(stationary in set(Statistics), continuous in set(Statistics))
        case said.SystemSettings():
            applied = wanted.apply_transformation or wanted.apply_station_orientation
            return NOT_IMPLEMENTED.status if applied else 0
    return 0


def _wrong_parameter(*are_right: bool) -> int:
    """Return the status that names the first parameter that is not right; 0 when all are."""
    return 0 if all(are_right) else WRONG_PARAMETERS[are_right.index(False)]
