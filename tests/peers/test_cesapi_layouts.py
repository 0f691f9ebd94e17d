"""Our emScon packets against those of CESAPI, an independent client: sizes, fields, constants."""

from dataclasses import astuple

import CESAPI.packet as cesapi
import pytest

from drivers.emscon import setup
from drivers.wire import emscon_constants as ours
from drivers.wire import emscon_messages
from drivers.wire.emscon import REQUESTS, EmsconRequest, encode
from drivers.wire.emscon_constants import Command, DataType, ResultStatus
from sim.servers import emscon_units

pytestmark = pytest.mark.peer

THEIR_CHANGES = {
    "LIGHT_NOT_READY": "MeasStatus_NotReady",
    "LIGHT_BUSY": "MeasStatus_Busy",
    "LIGHT_READY": "MeasStatus_Ready",
}
THEIR_STATUSES = {
    "NO_TRACKER_PROCESSOR_FOUND": "NoTPFound",
    "NO_TEMPERATURE_FROM_WEATHER_MONITOR": "NoTemperatureFromWM",
    "NO_PRESSURE_FROM_WEATHER_MONITOR": "NoPressureFromWM",
    "NO_HUMIDITY_FROM_WEATHER_MONITOR": "NoHumidityFromWM",
    "NO_SENSOR_BATTERY": "No_Sensor_Battery",
}
NOT_THEIRS = {
    ResultStatus.EXTERNAL_CONTROL,
    ResultStatus.IN_COMPENSATION_MODE,
    ResultStatus.INTERNAL_PROCESS_ACTIVE,
    ResultStatus.SENSOR_NOT_WARMED_UP,
}
"""Statuses that CESAPI has no name for."""
THEIR_UNITS = {
    "ES_LU_": (["Meter", "Millimeter", "Micron", "Foot", "Yard", "Inch"], emscon_units.MM_PER_UNIT),
    "ES_AU_": (["Radian", "Degree", "Gon"], emscon_units.RAD_PER_UNIT),
    "ES_TU_": (["Celsius", "Fahrenheit"], (0, emscon_units.FAHRENHEIT)),
    "ES_PU_": (
        ["Mbar", "HPascal", "KPascal", "MmHg", "Psi", "InH2O", "InHg"],
        emscon_units.HPA_PER_UNIT,
    ),
}


def example(kind):
    """A body in which no two fields are alike."""
    values = []
    for number, form in enumerate(emscon_messages.annotations_of(kind), start=1):
        triple = (number + 0.25, number + 0.5, number + 0.75)
        forms = {int: number, float: number + 0.125, emscon_messages.Triple: triple}
        values.append(f"text {number}" if form is str else forms[form])
    return kind(*values)


def flat(value):
    """The leaves of a body."""
    if isinstance(value, tuple):
        return [leaf for part in value for leaf in flat(part)]
    return [value]


def their_leaves(packet):
    """The values of one of CESAPI's packets in the order in which it declares them."""
    leaves = []
    for name, value in vars(packet).items():
        if name in {"packet", "packetInfo", "packetHeader"} or name.startswith("_"):
            continue
        is_part = hasattr(value, "unpack")
        leaves += their_leaves(value) if is_part else [_text(value)]
    return leaves


def _text(value):
    return value.decode("utf-16-le").rstrip("\0") if isinstance(value, bytes) else value


def assert_read_alike(message, body, theirs):
    data = encode(message)
    theirs.unpack(data)
    assert their_leaves(theirs) == flat(astuple(body))
    assert theirs.pack() == data
    assert len(type(theirs)().pack()) == len(data)


@pytest.mark.parametrize("command", Command)
def test_request_is_theirs(command):
    body = example(REQUESTS.get(command, emscon_messages.Nothing))
    assert_read_alike(EmsconRequest(command, body), body, getattr(cesapi, f"{command.title}CT")())


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        (emscon_messages.SingleResult, "SingleMeasResultT"),
        (emscon_messages.SingleResult2, "SingleMeasResult2T"),
        (emscon_messages.ReflectorPosition, "ReflectorPosResultT"),
    ],
)
def test_result_is_theirs(kind, name):
    body, theirs = example(kind), getattr(cesapi, name)()
    data = encode(body)
    theirs.unpack(data)
    assert [theirs.packetInfo.status, *their_leaves(theirs)] == flat(astuple(body))
    assert theirs.pack() == data


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        (emscon_messages.StatusChange, "SystemStatusChangeT"),
        (emscon_messages.ErrorResponse, "ErrorResponseT"),
    ],
)
def test_what_comes_unasked_is_theirs(kind, name):
    body = example(kind)
    assert_read_alike(body, body, getattr(cesapi, name)())


@pytest.mark.parametrize("status", [s for s in ResultStatus if s not in NOT_THEIRS])
def test_status_number_is_theirs(status):
    name = THEIR_STATUSES.get(status.name, status.name.replace("_", ""))
    theirs = {
        key.removeprefix("ES_RS_").lower(): value
        for key, value in vars(cesapi).items()
        if key.startswith("ES_RS_")
    }
    assert theirs[name.lower()] == status


@pytest.mark.parametrize(
    "change", [c for c in ours.SystemChange if c != ours.SystemChange.LASER_WARMED_UP]
)
def test_change_number_is_theirs(change):
    words = change.name.replace("_", " ").title().replace(" ", "")
    name = THEIR_CHANGES.get(change.name, f"{words}Changed")
    if change is ours.SystemChange.INITIALIZATION:
        assert cesapi.ES_SCC_InitializationStatusChanged == change
    else:
        assert getattr(cesapi, f"ES_SSC_{name}") == change


@pytest.mark.parametrize("prefix", THEIR_UNITS)
def test_unit_numbers_are_theirs(prefix):
    names, ours_by_number = THEIR_UNITS[prefix]
    numbers = list(range(len(ours_by_number)))
    assert [getattr(cesapi, prefix + name) for name in names] == numbers


def test_packet_types_and_states_are_theirs():
    assert cesapi.ES_DT_SingleMeasResult2 == DataType.SINGLE_RESULT_2
    assert cesapi.ES_TPS_Initialized == ours.ProcessorStatus.INITIALIZED
    assert cesapi.ES_LPS_LaserReady == ours.LaserStatus.READY
    assert cesapi.ES_TS_Ready == ours.TrackerLight.READY
    assert setup.UNITS.humidity == cesapi.ES_HU_RH
    assert cesapi.ES_CS_RHR == ours.RIGHT_HANDED_RECTANGULAR
    assert cesapi.ES_SM_Extended == ours.Statistics.EXTENDED
    assert cesapi.ES_MSI_ReflectorFound == ours.StatusBit.REFLECTOR_FOUND
    assert cesapi.ES_MSI_Initialized == ours.StatusBit.INITIALIZED
