"""Numbers of the emScon interface that the driver and its simulated server use.

They were collected from public sources, under names of our own; none was captured from a real
instrument (docs/reference/emscon.md). Tables are as long as we use them: an instrument may send
other numbers in every field, so that fields stay plain integers and are compared with these.
"""

from enum import IntEnum, IntFlag


class DataType(IntEnum):
    """The type field of a packet."""

    COMMAND = 0  # also of answers: the direction distinguishes them
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
    """The commands that this grammar has."""

    # ExitApplication (0) is left out on purpose: it ends the server in the tracker.
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
        """Name as people who know the interface write it: GoPosition."""
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


RIGHT_HANDED_RECTANGULAR = 0
"""Coordinate system, of eight the one that we use."""
STATIONARY = 0
"""Measurement mode, of several the one that we use."""


class TrackerLight(IntEnum):
    """The traffic light, in the numbers of GetTrackerStatus."""

    NOT_READY = 0
    BUSY = 1
    READY = 2
    SIX_D_INVALID = 3


class ProcessorStatus(IntEnum):
    """Steps of the start-up ladder that matter here."""

    # The ladder begins with 0, no tracker processor, and is only climbed upwards.
    BOOTED = 3
    INITIALIZED = 5


class LaserStatus(IntEnum):
    """State of the interferometer's laser."""

    # An AT40x measures with its distance meter alone. What it says here is unconfirmed.
    COMMUNICATION_FAILED = 0
    NOT_AVAILABLE = 1
    HEATING_UP = 2
    READY = 3
    UNABLE_TO_STABILIZE = 4
    OFF = 5


ADM_READY = 2
"""State of the absolute distance meter."""
READ_AND_REFRACT = 2
"""Use that the instrument makes of its weather station."""


class Statistics(IntEnum):
    """Detail of the uncertainty that a result carries."""

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


# AT930 and AT960 have no number in public sources. One that is not listed here is called by the
# name that it sends.
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


class ResultStatus(IntEnum):
    """Status values that a driver meets; an instrument may send others."""

    # Processes of the tracker's controller pass on errors in ranges of their own, such as 24000 to
    # 24999, for which no public table has words.
    ALL_OK = 0
    SERVER_BUSY = 1
    NOT_IMPLEMENTED = 2
    WRONG_PARAMETER = 3
    WRONG_CURRENT_REFLECTOR = 23
    NO_TRACKER_PROCESSOR_FOUND = 26
    NO_WEATHER_MONITOR_FOUND = 27
    NO_LAST_MEASURED_POINT = 28
    NO_ADM = 30
    USAGE_CONFLICT = 35
    UNKNOWN = 36
    NO_DISTANCE_SET = 37
    NO_TRACKER_CONNECTED = 38
    TRACKER_NOT_INITIALIZED = 39
    MODULE_NOT_STARTED = 40
    MODULE_TIMED_OUT = 41
    EXTERNAL_CONTROL = 46
    METEO_DATA_OUT_OF_RANGE = 57
    IN_COMPENSATION_MODE = 58
    INTERNAL_PROCESS_ACTIVE = 59
    NO_TEMPERATURE_FROM_WEATHER_MONITOR = 94
    NO_PRESSURE_FROM_WEATHER_MONITOR = 95
    NO_HUMIDITY_FROM_WEATHER_MONITOR = 96
    INVALID_INPUT_DATA = 98
    NO_VALID_ADM_COMPENSATION = 10002
    PRESSURE_SENSOR_PROBLEM = 10003
    MEASUREMENT_STATUS_NOT_READY = 10004
    ADM_START_UP_BUSY = 10005
    NO_ATR = 10007
    NO_STATIONARY_RESULT = 10009
    SENSOR_NOT_LEVELED = 10010
    MULTI_CONNECTIONS_NOT_ALLOWED = 10011
    SENSOR_NOT_WARMED_UP = 10012
    SENSOR_NOT_STABLE = 10013
    SYSTEM_NOT_READY_FOR_MEASUREMENT = 10014
    COMMUNICATION_WITH_SENSOR_FAILED = 10015
    NO_SENSOR_BATTERY = 10016
    WARMED_UP_STATE_REACHED = 10018
    NOT_LEVELED_FOR_INITIALIZATION = 10019
    ADM_HARDWARE_PROBLEM = 10020
    ATR_HARDWARE_PROBLEM = 10021


WRONG_PARAMETERS = range(4, 11)
"""Statuses of a wrong parameter, from the first one on."""
OUT_OF_RANGE = range(11, 23)
"""Statuses of a parameter out of its range, two for each of six: taken, and not taken."""


def status_words(status: int) -> str:
    """Return the meaning of a status; empty for a number that is not in the public table."""
    if status in WRONG_PARAMETERS:
        return f"wrong parameter {WRONG_PARAMETERS.index(status) + 1}"
    if status in OUT_OF_RANGE:
        return f"parameter {OUT_OF_RANGE.index(status) // 2 + 1} out of range"
    names = {known.value: known.name for known in ResultStatus}
    return names.get(status, "").replace("_", " ").lower()


def status_text(status: int) -> str:
    """Return `emScon error 39 (tracker not initialized)`; a bare number where it has no words."""
    words = status_words(status)
    return f"emScon error {status} ({words})" if words else f"emScon error {status}"
