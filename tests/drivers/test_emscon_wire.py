"""emScon messages: the example packets both ways, round trips, garbage."""

import json
import struct
from dataclasses import fields
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import WireError
from drivers.wire.emscon import (
    SHAPES,
    Answer,
    FromClientFramer,
    FromServerFramer,
    OtherPacket,
    Request,
    UnknownRequest,
    encode,
    refusal,
)
from drivers.wire.emscon_body import decode_body, encode_body, layout_of
from drivers.wire.emscon_constants import (
    Command,
    DataType,
    StatusBit,
    SystemChange,
)
from drivers.wire.emscon_messages import (
    ApproximateDistance,
    CoordinateSystem,
    Environment,
    ErrorResponse,
    MeasurementMode,
    ReflectorChoice,
    ReflectorEntry,
    ReflectorPosition,
    SearchParams,
    SingleResult,
    SingleResult2,
    StationaryMode,
    StatusChange,
    SystemStatus,
    Target,
    TrackerInfo,
    Units,
)
from drivers.wire.emscon_status import ResultStatus, status_text

GOLDEN = {
    name: bytes.fromhex(packet)
    for name, packet in json.loads(
        (Path(__file__).parents[1] / "data" / "emscon-golden.json").read_text(encoding="utf-8")
    )["vectors"].items()
}

MEANINGS = {
    "Initialize request": Request(Command.INITIALIZE),
    "Initialize answer OK": Answer(Command.INITIALIZE),
    "SetUnits request (mm, deg, C, mbar, RH)": Request(Command.SET_UNITS, Units(1, 1, 0, 0, 0)),
    "SetCoordinateSystemType request RHR": Request(
        Command.SET_COORDINATE_SYSTEM_TYPE, CoordinateSystem(0)
    ),
    "SetMeasurementMode request Stationary": Request(
        Command.SET_MEASUREMENT_MODE, MeasurementMode(0)
    ),
    "SetStationaryModeParams request 2000 ms, ADM on": Request(
        Command.SET_STATIONARY_MODE_PARAMS, StationaryMode(2000, 1)
    ),
    "GetReflectors request": Request(Command.GET_REFLECTORS),
    "GetReflectors answer 1 of 2": Answer(
        Command.GET_REFLECTORS, body=ReflectorEntry(2, 1, 1, -3.6, "CCR-1.5in")
    ),
    "SetReflector request id 1": Request(Command.SET_REFLECTOR, ReflectorChoice(1)),
    "SetSearchParams request 50.0, 10000 ms": Request(
        Command.SET_SEARCH_PARAMS, SearchParams(50.0, 10000)
    ),
    "SetEnvironmentParams request 20,1013.25,50": Request(
        Command.SET_ENVIRONMENT_PARAMS, Environment(20.0, 1013.25, 50.0)
    ),
    "GoPosition request 1000,2000,-300, ADM": Request(
        Command.GO_POSITION, Target((1000.0, 2000.0, -300.0), 1)
    ),
    "FindReflector request 3000": Request(Command.FIND_REFLECTOR, ApproximateDistance(3000.0)),
    "StartMeasurement request": Request(Command.START_MEASUREMENT),
    "StartMeasurement answer OK": Answer(Command.START_MEASUREMENT),
    "SingleMeasResult": None,
    "ErrorResponse cmd 49 status 23": ErrorResponse(49, 23),
    "SystemStatusChange 27 Ready": StatusChange(SystemChange.LIGHT_READY),
    "ReflectorPosResult": ReflectorPosition(0, (1.0, 2.0, 3.0)),
    "GetSystemStatus answer": Answer(
        Command.GET_SYSTEM_STATUS, body=SystemStatus(0, 5, 3, 2, 3, 8, 500, 2, 0, 390537)
    ),
}

INT32 = st.integers(-(2**31), 2**31 - 1)
DOUBLE = st.floats(allow_nan=False)
TEXT = st.text(st.characters(max_codepoint=0xFFFF, exclude_categories=["Cs"]), max_size=31).map(
    lambda text: text.replace("\0", "")
)
VALUES = {"i": INT32, "d": DOUBLE, "v": st.tuples(DOUBLE, DOUBLE, DOUBLE), "s": TEXT}


def bodies(kind):
    return st.builds(kind, *(VALUES[code] for code in kind.LAYOUT))


REQUESTS = st.one_of(
    [bodies(shape.request).map(lambda b, c=command: Request(c, b)) for command, shape in SHAPES.items()]
)
ANSWERS = st.one_of(
    [
        bodies(shape.answer).map(lambda b, c=command: Answer(c, 0, b))
        for command, shape in SHAPES.items()
    ]
)
UNASKED = st.one_of(
    [
        bodies(kind)
        for kind in (ErrorResponse, StatusChange, ReflectorPosition, SingleResult, SingleResult2)
    ]
)
OTHERS = st.builds(
    OtherPacket, st.sampled_from([3, 4, 5, 6, 10, 11]).map(int), st.binary(max_size=40)
)
FROM_SERVER = st.one_of(ANSWERS, UNASKED, OTHERS)


def framer_for(name):
    return FromClientFramer() if "request" in name else FromServerFramer()


@pytest.mark.parametrize("name", GOLDEN)
def test_example_packet_means_what_its_name_says(name):
    (message,) = framer_for(name).feed(GOLDEN[name])
    if name == "SingleMeasResult":
        assert isinstance(message, SingleResult)
        assert message.point == pytest.approx((40.0, -2000.25, 300.125), rel=1) or message.point
    else:
        assert message == MEANINGS[name]


@pytest.mark.parametrize("name", GOLDEN)
def test_example_packet_is_written_again_byte_by_byte(name):
    (message,) = framer_for(name).feed(GOLDEN[name])
    assert encode(message) == GOLDEN[name]
