"""Raw answers that records keep beside what was parsed from them: read anew, by grammar alone."""

from drivers.emscon.tracker import measurement_of
from drivers.errors import WireError
from drivers.geocom.measuring import MM_PER_M
from drivers.robotline.robot import inner_units
from drivers.values import Matrix3, Vector3, vector
from drivers.wire.emscon import FromServerFramer
from drivers.wire.emscon_messages import SingleResult, SingleResult2
from drivers.wire.geocom import decode_reply as decode_geocom
from drivers.wire.geocom import parse_number
from drivers.wire.linuxcncrsh import Value, read_message, read_numbers
from drivers.wire.robotline import ControllerStatus, RobotLayout
from drivers.wire.robotline import decode_reply as decode_robotline

ANSWERS_OF_A_STATE = "; "
"""What the driver for LinuxCNC puts between the answers that make a state."""


def joints_said(driver: str, raw: str, layout: RobotLayout) -> tuple[float, ...]:
    """Joint values of a controller's state, rad or mm; raises `WireError`."""
    if driver == "linuxcnc":
        return _joints_of_linuxcnc(raw, layout)
    status = decode_robotline(_bytes(raw), layout).outcome
    if not isinstance(status, ControllerStatus):
        raise WireError(f"no state of a controller: {raw!r:.80}")
    return inner_units(layout.joints, status.joints)


def measurement_said(driver: str, raw: str) -> tuple[Vector3, Matrix3 | None]:
    """Point of a tracker's measurement, mm, and its covariance, mm², where it states one.

    Raises `DriverError`.
    """
    if driver == "geocom":
        return _point_of_geocom_mm(raw), None
    measured = measurement_of("the tracker", _result_of_emscon(raw))
    return measured.point_in_tracker_mm, measured.covariance_mm2


def _joints_of_linuxcnc(raw: str, layout: RobotLayout) -> tuple[float, ...]:
    answer = read_message(_bytes(raw.split(ANSWERS_OF_A_STATE)[0]))
    if not isinstance(answer, Value):
        raise WireError(f"no joints of LinuxCNC: {raw!r:.80}")
    return inner_units(layout.joints, read_numbers(answer)[: len(layout.joints)])


def _result_of_emscon(raw: str) -> SingleResult | SingleResult2:
    try:
        packet = bytes.fromhex(raw)
    except ValueError as error:
        raise WireError(f"no packet in hexadecimal digits: {raw!r:.80}") from error
    found = FromServerFramer().feed(packet)
    if len(found) != 1 or not isinstance(found[0], SingleResult | SingleResult2):
        raise WireError(f"no single measurement: {raw!r:.80}")
    return found[0]


def _point_of_geocom_mm(raw: str) -> Vector3:
    parameters = decode_geocom(_bytes(raw)).parameters
    if len(parameters) < 3:
        raise WireError(f"no coordinates: {raw!r:.80}")
    return vector(MM_PER_M * parse_number(word) for word in parameters[:3])


def _bytes(raw: str) -> bytes:
    try:
        return raw.encode("ascii")
    except UnicodeEncodeError as error:
        raise WireError(f"not a word of a device's: {raw!r:.80}") from error
