"""Numbers of the emScon interface that the driver and its simulated server use."""

from enum import IntEnum, IntFlag


class DataType(IntEnum):
    """The type field of a packet."""

    COMMAND = 0
    ERROR = 1
    SINGLE_RESULT = 2
    MULTI_RESULT = 3
    STATIONARY_PROBE_RESULT = 4
    CONTINUOUS_PROBE_RESULT = 5
    NIVEL_RESULT = 6
    REFLECTOR_POSITION = 7
    STATUS_CHANGE = 8
    SINGLE_RESULT_2 = 9
    MULTI_RESULT_2 = 10
    PROBE_POSITION = 11


class Command(IntEnum):
    """The commands that this grammar knows."""

    GET_SYSTEM_STATUS = 1
    GET_TRACKER_STATUS = 2
    SET_UNITS = 5
    GET_UNITS = 6
    INITIALIZE = 7
    SET_ENVIRONMENT_PARAMS = 20
    GET_ENVIRONMENT_PARAMS = 21
    SET_MEASUREMENT_MODE = 24
    GET_MEASUREMENT_MODE = 25
    SET_COORDINATE_SYSTEM_TYPE = 26
    GET_COORDINATE_SYSTEM_TYPE = 27
    SET_STATIONARY_MODE_PARAMS = 28
    GET_STATIONARY_MODE_PARAMS = 29
    SET_REFLECTOR = 40
    GET_REFLECTOR = 41
    GET_REFLECTORS = 42
    SET_SEARCH_PARAMS = 43
    GET_SEARCH_PARAMS = 44
    SET_SYSTEM_SETTINGS = 47
    GET_SYSTEM_SETTINGS = 48
    START_MEASUREMENT = 49
    STOP_MEASUREMENT = 52
    GO_POSITION = 55
    FIND_REFLECTOR = 63
    GET_DIRECTION = 66
    SET_STATISTIC_MODE = 80
    GET_STATISTIC_MODE = 81
    GET_MEASUREMENT_STATUS_INFO = 122
    GET_TRACKER_INFO = 132

    @property
    def title(self) -> str:
        """As people who know the interface write it: GoPosition."""
        return "".join(word.capitalize() for word in self.name.split("_"))


class SystemChange(IntEnum):
    """Codes of unsolicited status changes that mean something to us."""

    LASER_WARMED_UP = 1
    SEARCH_PARAMS = 4
    UNITS = 6
    REFLECTOR = 7
    SYSTEM_SETTINGS = 8
    COORDINATE_SYSTEM_TYPE = 12
    MEASUREMENT_MODE = 17
    STATIONARY_MODE_PARAMS = 18
    STATISTIC_MODE = 24
    LIGHT_NOT_READY = 25
    LIGHT_BUSY = 26
    LIGHT_READY = 27
    INITIALIZATION = 151


class LengthUnit(IntEnum):
    """Units of length."""

    METRE = 0
    MILLIMETRE = 1
    MICRON = 2
    FOOT = 3
    YARD = 4
    INCH = 5


class AngleUnit(IntEnum):
    """Units of angle."""

    RADIAN = 0
    DEGREE = 1
    GON = 2


class TemperatureUnit(IntEnum):
    """Units of temperature."""

    CELSIUS = 0
    FAHRENHEIT = 1


class PressureUnit(IntEnum):
    """Units of air pressure."""

    MILLIBAR = 0
    HECTOPASCAL = 1
    KILOPASCAL = 2
    MM_MERCURY = 3
    PSI = 4
    INCH_WATER = 5
    INCH_MERCURY = 6


class HumidityUnit(IntEnum):
    """Units of air humidity."""

    RELATIVE_PERCENT = 0


class CoordinateSystemType(IntEnum):
    """Of eight systems, the one that we use: right-handed, rectangular."""

    RIGHT_HANDED_RECTANGULAR = 0


class Mode(IntEnum):
    """Of the measurement modes, the one that we use."""

    STATIONARY = 0


class TrackerLight(IntEnum):
    """The traffic light, as GetTrackerStatus says it."""

    NOT_READY = 0
    BUSY = 1
    READY = 2
    SIX_D_INVALID = 3


class ProcessorStatus(IntEnum):
    """Steps of the start-up ladder that matter here."""

    BOOTED = 3
    INITIALIZED = 5


class LaserStatus(IntEnum):
    """State of the interferometer's laser."""

    COMMUNICATION_FAILED = 0
    NOT_AVAILABLE = 1
    HEATING_UP = 2
    READY = 3
    UNABLE_TO_STABILIZE = 4
    OFF = 5


class AdmStatus(IntEnum):
    """State of the absolute distance meter."""

    READY = 2


class WeatherMonitor(IntEnum):
    """What the instrument does with its weather station."""

    NOT_CONNECTED = 0
    READ_ONLY = 1
    READ_AND_REFRACT = 2


class Statistics(IntEnum):
    """How much a result says about its uncertainty."""

    STANDARD = 0
    EXTENDED = 1


class StatusBit(IntFlag):
    """Bits of GetMeasurementStatusInfo."""

    TRACKER_FOUND = 1
    TRACKER_COMPENSATION = 2
    ADM_FOUND = 4
    ADM_COMPENSATION = 8
    REFLECTOR_FOUND = 2048
    IN_FACE_1 = 4096
    INITIALIZED = 65536


SENSOR_NAMES: dict[int, str] = {
    3: "LTD500",
    4: "LT300",
    5: "LT301",
    6: "LTD800",
    7: "LTD700",
    8: "LTD600",
    9: "LTD640",
    10: "LTD706",
    11: "LTD709",
    12: "LTD840",
    13: "AT901-B",
    14: "AT901-MR",
    15: "AT901-LR",
    70: "AT401",
    72: "AT402",
    73: "AT403",
}
"""Sensor type numbers of the instruments that speak emScon."""
