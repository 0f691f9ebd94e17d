"""Numbers of GeoCOM: remote procedures, return codes, and the values of their parameters."""

from enum import IntEnum


class Rpc(IntEnum):
    """Remote procedures that a simulated instrument knows."""

    COM_NULL_PROC = 0
    COM_SET_DOUBLE_PRECISION = 107
    COM_GET_DOUBLE_PRECISION = 108
    COM_GET_SW_VERSION = 110
    TMC_DO_MEASURE = 2008
    TMC_GET_STATION = 2009
    TMC_SET_STATION = 2010
    TMC_GET_HEIGHT = 2011
    TMC_SET_HEIGHT = 2012
    TMC_SET_EDM_MODE = 2020
    TMC_GET_EDM_MODE = 2021
    TMC_GET_PRISM_CORR = 2023
    TMC_GET_FACE = 2026
    TMC_SET_ATM_CORR = 2028
    TMC_GET_ATM_CORR = 2029
    TMC_SET_REFRACTIVE_CORR = 2030
    TMC_GET_REFRACTIVE_CORR = 2031
    TMC_GET_COORDINATE = 2082
    TMC_GET_ANGLE_5 = 2107
    TMC_GET_SIMPLE_MEA = 2108
    TMC_SET_ORIENTATION = 2113
    TMC_IF_DATA_AZE_CORR_ERROR = 2114
    TMC_IF_DATA_INC_CORR_ERROR = 2115
    TMC_GET_SIMPLE_COORD = 2116
    TMC_SET_GEO_PPM = 2153
    TMC_GET_GEO_PPM = 2154
    CSV_GET_INSTRUMENT_NO = 5003
    CSV_GET_INSTRUMENT_NAME = 5004
    CSV_GET_INT_TEMP = 5011
    CSV_GET_SW_VERSION = 5034
    CSV_GET_DEVICE_CONFIG = 5035
    MOT_READ_LOCK_STATUS = 6021
    AUT_LOCK_IN = 9013
    AUT_MAKE_POSITIONING = 9027
    AUT_CHANGE_FACE = 9028
    AUT_SEARCH = 9029
    AUT_FINE_ADJUST = 9037
    BAP_SET_PRISM_TYPE = 17008
    BAP_GET_PRISM_TYPE = 17009
    BAP_MEAS_DISTANCE_ANGLE = 17017
    BAP_SET_TARGET_TYPE = 17021
    BAP_GET_TARGET_TYPE = 17022
    BAP_GET_PRISM_DEF = 17023
    BAP_SET_PRISM_TYPE_2 = 17030
    BAP_GET_PRISM_TYPE_2 = 17031
    BAP_GET_USER_PRISM_DEF = 17033
    AUS_SET_USER_ATR_STATE = 18005
    AUS_GET_USER_ATR_STATE = 18006
    AUS_SET_USER_LOCK_STATE = 18007
    AUS_GET_USER_LOCK_STATE = 18008


class Result(IntEnum):
    """Return codes that a driver acts on and a simulated instrument sends."""

    OK = 0
    UNDEFINED = 1
    INVALID_PARAMETER = 2
    INVALID_RESULT = 3
    FATAL = 4
    NOT_IMPLEMENTED = 5
    TIME_OUT = 6
    ABORTED = 8
    SHUT_DOWN = 12
    SYSTEM_BUSY = 13
    HARDWARE_FAILURE = 14
    LOW_POWER = 16
    BATTERY_EMPTY = 18
    OUT_OF_TEMPERATURE = 21
    INSTRUMENT_TILT = 22
    SLEEP_MODE = 25
    NOT_AVAILABLE = 27
    ATR_NO_TARGETS = 517
    NO_FULL_CORRECTION = 1283
    ACCURACY_NOT_GUARANTEED = 1284
    ANGLES_ONLY = 1285
    ANGLES_ONLY_NO_FULL_CORRECTION = 1288
    ANGLES_ONLY_ACCURACY_NOT_GUARANTEED = 1289
    ANGLE_ERROR = 1290
    DISTANCE_PPM = 1291
    DISTANCE_ERROR = 1292
    TMC_BUSY = 1293
    SIGNAL_ERROR = 1294
    MOTOR_BUSY = 1793
    MOTOR_NOT_LOCKED = 1799
    COM_CANNOT_DECODE = 3074
    COM_WRONG_FORMAT = 3078
    COM_CANNOT_DECODE_REQUEST = 3080
    COM_UNKNOWN_PROCEDURE = 3081
    COM_SERVER_CHECKSUM = 3101
    COM_CONSULT = 3107
    COM_SLEEPING = 3108
    COM_OFF = 3109
    AUT_TIMEOUT = 8704
    AUT_DETENT_ERROR = 8705
    AUT_ANGLE_ERROR = 8706
    AUT_MOTOR_ERROR = 8707
    AUT_INACCURATE = 8708
    AUT_DEVIATION_ERROR = 8709
    AUT_NO_TARGET = 8710
    AUT_MULTIPLE_TARGETS = 8711
    AUT_BAD_ENVIRONMENT = 8712
    AUT_DETECTOR_ERROR = 8713
    AUT_NOT_ENABLED = 8714
    AUT_ACCURACY = 8716
    AUT_NO_LOCK = 8725


DELIVERED = frozenset({Result.OK, Result.NO_FULL_CORRECTION, Result.ACCURACY_NOT_GUARANTEED})
"""Coordinates came with these; the last two are warnings."""


class Program(IntEnum):
    """Program that TMC_DoMeasure is to run."""

    STOP = 0
    DISTANCE = 1
    CLEAR = 3


class TargetType(IntEnum):
    """Target of the distance meter."""

    REFLECTOR = 0
    DIRECT = 1


class LockStatus(IntEnum):
    """Whether the telescope follows a prism."""

    NONE = 0
    LOCKED = 1
    PREDICTING = 2


class Capability(IntEnum):
    """Bits of the second value of CSV_GetDeviceConfig."""

    MOTORISED = 0x4
    TARGET_RECOGNITION = 0x8


FACE_1, FACE_2 = 0, 1
"""Faces as TMC_GetFace tells them."""
EDM_SINGLE_STANDARD = 2
"""Mode of the distance meter, of several the one that we use."""


INCLINATION_AUTO = 1
"""Angles are corrected by the inclination, which is measured where it has to be."""
PRISMS = range(13)
"""Prism types."""
USER_PRISM = 9
"""The prism type that is told apart by its name."""
USER_PRISMS = frozenset({4, 5, 6, USER_PRISM})
"""Prisms told apart by their names; GeoCOM cannot list them."""


def result_text(code: int) -> str:
    """`GeoCOM 8710 (aut no target)`; a bare number when it is not in the table."""
    try:
        words = Result(code).name.replace("_", " ").lower()
    except ValueError:
        return f"GeoCOM {code}"
    return f"GeoCOM {code} ({words})"


def procedure_text(rpc: int) -> str:
    """`TMC_GET_COORDINATE`, or `procedure 4711`."""
    try:
        return Rpc(rpc).name
    except ValueError:
        return f"procedure {rpc}"
