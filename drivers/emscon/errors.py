"""From an emScon status to an error that tells the operator what to do next."""

from collections.abc import Mapping

from drivers.errors import BeamBroken, DeviceNotReady, DeviceRefused
from drivers.wire.emscon_status import ResultStatus, status_text

NOT_READY: Mapping[int, str] = {
    ResultStatus.SERVER_BUSY: "wait until the tracker has finished, then try again",
    ResultStatus.WRONG_CURRENT_REFLECTOR: "prepare the tracker with the reflector that is mounted",
    ResultStatus.NO_TRACKER_PROCESSOR_FOUND: "check the cable between controller and tracker head",
    ResultStatus.NO_ADM: "this tracker has no absolute distance meter, which measuring needs",
    ResultStatus.NO_TRACKER_CONNECTED: "check the cable between controller and tracker head",
    ResultStatus.TRACKER_NOT_INITIALIZED: "prepare the tracker again, which initialises it",
    ResultStatus.EXTERNAL_CONTROL: "end the other program that controls the tracker",
    ResultStatus.IN_COMPENSATION_MODE: "end the tracker's compensation, then try again",
    ResultStatus.INTERNAL_PROCESS_ACTIVE: "wait until the tracker has finished, then try again",
    ResultStatus.NO_VALID_ADM_COMPENSATION: "have the tracker's distance meter compensated",
    ResultStatus.ADM_START_UP_BUSY: "wait until the distance meter has started, then try again",
    ResultStatus.SENSOR_NOT_LEVELED: "level the tracker, then try again",
    ResultStatus.SENSOR_NOT_WARMED_UP: "wait until the tracker is warm, then try again",
    ResultStatus.SENSOR_NOT_STABLE: "check the tracker's stand, let it settle, then try again",
    ResultStatus.SYSTEM_NOT_READY_FOR_MEASUREMENT: "see the tracker's own status, then try again",
    ResultStatus.COMMUNICATION_WITH_SENSOR_FAILED: "check the cable to the tracker head",
    ResultStatus.NOT_LEVELED_FOR_INITIALIZATION: "level the tracker, then try again",
    ResultStatus.ADM_HARDWARE_PROBLEM: "have the tracker's distance meter serviced",
    ResultStatus.ATR_HARDWARE_PROBLEM: "have the tracker's target camera serviced",
}

BEAM_LOST: frozenset[int] = frozenset(
    {
        ResultStatus.UNKNOWN,
        ResultStatus.NO_DISTANCE_SET,
        ResultStatus.MEASUREMENT_STATUS_NOT_READY,
        ResultStatus.NO_STATIONARY_RESULT,
    }
)
"""No public source has a number for a broken beam; these can mean one while a beam is needed."""

BEAM_REMEDY = "clear the line of sight and put the beam back on the reflector"
OTHER_CLIENT_REMEDY = "end the other program that is connected to the tracker, then try again"
REFUSAL_REMEDY = "see docs/emscon.md, section Errors, and the tracker's own status"


def refused(where: str, doing: str, status: int) -> DeviceRefused:
    """Return the error for a refused command."""
    problem = f"{where}: {doing} was refused: {status_text(status)}"
    if remedy := NOT_READY.get(status):
        return DeviceNotReady(problem, remedy=remedy, code=str(status))
    if status == ResultStatus.MULTI_CONNECTIONS_NOT_ALLOWED:
        return DeviceRefused(problem, remedy=OTHER_CLIENT_REMEDY, code=str(status))
    return DeviceRefused(problem, remedy=REFUSAL_REMEDY, code=str(status))


def failed_with_beam(where: str, doing: str, status: int, *, beam_lost: bool) -> DeviceRefused:
    """Return the error for something that needs the beam: `BeamBroken` when that was it.

    `beam_lost` is what the tracker's traffic light says after the failure. It decides for the
    numbers that are in no public table, which a tracker's controller passes on.
    """
    error = refused(where, doing, status)
    if status in BEAM_LOST or (beam_lost and status not in set(ResultStatus)):
        return BeamBroken(
            f"{where}: the beam is lost: {doing} failed: {status_text(status)}",
            remedy=BEAM_REMEDY,
            code=str(status),
        )
    return error


def beam_not_locked(where: str, doing: str) -> BeamBroken:
    """Return the error for a search that ended well but found nothing."""
    return BeamBroken(f"{where}: {doing} found no reflector", remedy=BEAM_REMEDY)
