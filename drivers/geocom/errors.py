"""From a GeoCOM return code to an error that tells the operator what to do next."""

from collections.abc import Mapping

from drivers.errors import BeamBroken, DeviceNotReady, DeviceRefused
from drivers.wire.geocom_constants import Result, result_text

LEVEL = "level the instrument and let it stand still, then try again"
MOTORS = "check that nothing blocks the telescope, then try again"
WAIT = "wait until the instrument has finished, then try again"
WAKE = "switch the instrument on, leave it in GeoCOM mode and keep it awake, then try again"

NOT_READY: Mapping[int, str] = {
    Result.SYSTEM_BUSY: WAIT,
    Result.TMC_BUSY: WAIT,
    Result.MOTOR_BUSY: WAIT,
    Result.SHUT_DOWN: WAKE,
    Result.SLEEP_MODE: WAKE,
    Result.COM_CONSULT: WAKE,
    Result.COM_SLEEPING: WAKE,
    Result.COM_OFF: WAKE,
    Result.LOW_POWER: "charge or change the battery, then try again",
    Result.BATTERY_EMPTY: "charge or change the battery, then try again",
    Result.OUT_OF_TEMPERATURE: "bring the instrument to a temperature it works at",
    Result.HARDWARE_FAILURE: "restart the instrument; if it comes back, have it serviced",
    Result.INSTRUMENT_TILT: LEVEL,
    Result.ANGLE_ERROR: LEVEL,
    Result.AUT_ANGLE_ERROR: LEVEL,
    Result.AUT_TIMEOUT: MOTORS,
    Result.AUT_MOTOR_ERROR: MOTORS,
    Result.AUT_DETENT_ERROR: MOTORS,
    Result.AUT_NOT_ENABLED: "prepare the tracker again, which switches target recognition on",
    Result.AUT_NO_LOCK: "prepare the tracker again, which switches lock mode on",
    Result.DISTANCE_PPM: "check the instrument's distance meter settings (ppm, mm)",
    Result.NOT_AVAILABLE: "have the instrument licensed for GeoCOM robotic functions",
}

BEAM_LOST: frozenset[int] = frozenset(
    {
        Result.ATR_NO_TARGETS,
        Result.ANGLES_ONLY,
        Result.ANGLES_ONLY_NO_FULL_CORRECTION,
        Result.ANGLES_ONLY_ACCURACY_NOT_GUARANTEED,
        Result.DISTANCE_ERROR,
        Result.SIGNAL_ERROR,
        Result.MOTOR_NOT_LOCKED,
        Result.AUT_INACCURATE,
        Result.AUT_DEVIATION_ERROR,
        Result.AUT_NO_TARGET,
        Result.AUT_MULTIPLE_TARGETS,
        Result.AUT_BAD_ENVIRONMENT,
        Result.AUT_DETECTOR_ERROR,
        Result.AUT_ACCURACY,
    }
)
"""No prism, no distance to it, or not settled on it."""

BUSY: frozenset[int] = frozenset({Result.SYSTEM_BUSY, Result.TMC_BUSY, Result.MOTOR_BUSY})
"""Worth asking again."""

BEAM_REMEDY = "clear the line of sight, let one prism face the instrument, and aim at it"
REFUSAL_REMEDY = "see docs/geocom.md, section Errors, and the instrument's own display"


def refused(where: str, doing: str, code: int) -> DeviceRefused:
    """Return the error for a return code other than OK."""
    problem = f"{where}: {doing} failed: {result_text(code)}"
    if code in BEAM_LOST:
        return BeamBroken(problem, remedy=BEAM_REMEDY, code=str(code))
    if remedy := NOT_READY.get(code):
        return DeviceNotReady(problem, remedy=remedy, code=str(code))
    return DeviceRefused(problem, remedy=REFUSAL_REMEDY, code=str(code))


def not_locked(where: str, doing: str) -> BeamBroken:
    """Return the error for a telescope that doesn't follow a prism."""
    return BeamBroken(f"{where}: {doing}: not locked on a prism", remedy=BEAM_REMEDY)
