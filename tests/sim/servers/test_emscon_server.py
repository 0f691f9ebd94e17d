"""The simulated emScon server: what it answers, when, and in which units."""

import struct

import pytest
from emscon_client import BUSY, NOT_READY, READY, STREAMING, Client, ok, refused

from drivers.wire.emscon import UnknownRequest, encode
from drivers.wire.emscon_constants import Command, ResultStatus, SystemChange
from drivers.wire.emscon_messages import (
    ApproximateDistance,
    BeamTarget,
    ErrorResponse,
    ReflectorPosition,
    SingleResult,
    StationaryMode,
    StatusChange,
    SystemStatus,
)


@pytest.fixture
def client():
    return Client()


def test_unknown_command_is_not_implemented(client):
    for command in (0, 56):  # ExitApplication too: it does not end the server
        client.session.received(encode(UnknownRequest(command)), 0.0)
        (refusal,) = client.taken_bytes()
        assert refusal[8:16] == struct.pack("<ii", command, ResultStatus.NOT_IMPLEMENTED)


def test_system_status_climbs_the_ladder_with_initialise():
    client = Client(initialised=False)
    assert client.ask(Command.GET_SYSTEM_STATUS).body == SystemStatus(
        0, 3, 3, 2, 1, 0, 0, 2, 0, serial=390001
    )
    assert client.send(Command.INITIALIZE) == [BUSY]
    assert client.later(20.0) == [
        StatusChange(SystemChange.INITIALIZATION),
        ok(Command.INITIALIZE),
        READY,
    ]
    assert client.ask(Command.GET_SYSTEM_STATUS).body.processor_status == 5


NOT_UP, COLD, UNSEEN = {"initialised": False}, {"warm_up_s": 100.0}, {"locked": False}


@pytest.mark.parametrize(
    ("state", "command", "body", "status"),
    [
        (NOT_UP, "START_MEASUREMENT", (), "TRACKER_NOT_INITIALIZED"),
        (NOT_UP, "GO_POSITION", (BeamTarget((1.0, 0.0, 0.0), 1),), "TRACKER_NOT_INITIALIZED"),
        (NOT_UP, "FIND_REFLECTOR", (ApproximateDistance(1.0),), "TRACKER_NOT_INITIALIZED"),
        (COLD, "START_MEASUREMENT", (), "SENSOR_NOT_WARMED_UP"),
        (COLD, "INITIALIZE", (), "SENSOR_NOT_WARMED_UP"),
        (UNSEEN, "START_MEASUREMENT", (), "MEASUREMENT_STATUS_NOT_READY"),
    ],
)
def test_nothing_moves_or_measures_before_it_can(state, command, body, status):
    client = Client(**state)
    if state is COLD:
        assert client.ask(Command.GET_SYSTEM_STATUS).body.laser_status == 2
    assert client.status(Command[command], *body) == ResultStatus[status]
    assert not client.tracker.busy(0.0)
    assert client.later(30.0) == []
    assert not client.tracker.taken


def test_measurement_is_answered_at_once_and_its_result_comes_when_it_ends(client):
    client.send(Command.SET_STATIONARY_MODE_PARAMS, StationaryMode(2000, 1))
    assert client.send(Command.START_MEASUREMENT) == [ok(Command.START_MEASUREMENT), BUSY]
    assert client.session.next_due_s() == 2.0
    assert client.later(1.99) == []
    result, light = client.later(0.01)
    assert isinstance(result, SingleResult)
    assert light == READY


def test_beam_break_ends_the_measurement_with_an_error_instead_of_a_result(client):
    client.send(Command.START_MEASUREMENT)
    client.turn_the_reflector_away()
    assert client.later(0.1) == [
        NOT_READY,
        ErrorResponse(Command.START_MEASUREMENT, ResultStatus.NO_STATIONARY_RESULT),
    ]
    assert client.later(5.0) == []


def test_beam_break_between_measurements_is_told_unasked(client):
    client.send(Command.GET_UNITS)
    client.turn_the_reflector_away()
    assert client.later(1.0) == [NOT_READY, ErrorResponse(64, ResultStatus.NO_STATIONARY_RESULT)]


def test_one_command_at_a_time(client):
    client.send(Command.GO_POSITION, BeamTarget(client.place_m, 1))
    for command in (Command.GET_UNITS, Command.STOP_MEASUREMENT, Command.START_MEASUREMENT):
        assert client.status(command) == ResultStatus.SERVER_BUSY
    assert client.later(1.0) == [ok(Command.GO_POSITION), READY]
    assert client.status(Command.GET_UNITS) == ResultStatus.ALL_OK


def test_head_that_a_lost_client_left_moving_keeps_the_next_one_waiting():
    first = Client()
    first.send(Command.GO_POSITION, BeamTarget(first.place_m, 1))
    first.session.closed(0.1)
    second = Client(first.tracker)
    assert second.status(Command.GET_UNITS) == ResultStatus.SERVER_BUSY
    second.later(1.0)
    assert second.status(Command.GET_UNITS) == ResultStatus.ALL_OK


def test_go_position_is_in_the_clients_unit_and_answered_when_the_head_is_there(client):
    client.send(Command.GET_UNITS)
    x, y, z = client.place_m
    assert client.send(Command.GO_POSITION, BeamTarget((x, y, z + 0.03), 1)) == [BUSY]
    assert 0.5 < client.session.next_due_s() < 0.6
    assert client.later(0.4) == []
    assert client.later(0.2) == [ok(Command.GO_POSITION), READY]


def test_search_that_finds_nothing_is_answered_with_an_error(client):
    client.turn_the_reflector_away()
    client.later(0.1)
    client.send(Command.FIND_REFLECTOR, ApproximateDistance(3.0))
    assert client.later(10.0) == [refused(Command.FIND_REFLECTOR, ResultStatus.UNKNOWN), NOT_READY]


def test_live_positions_stream_while_wanted_and_locked(client):
    assert client.later(1.0) == []
    client.send(Command.SET_SYSTEM_SETTINGS, STREAMING)
    assert client.later(0.4) == [ReflectorPosition(0, client.place_m)]
    assert client.session.next_due_s() == pytest.approx(client.now_s + 1 / 3)
    assert client.later(0.1) == []
    client.turn_the_reflector_away()
    assert not any(isinstance(message, ReflectorPosition) for message in client.later(1.0))


def test_second_client_is_refused_every_command_and_disturbs_nothing():
    client = Client(is_second=True, warm_up_s=0.5)
    status = ResultStatus.MULTI_CONNECTIONS_NOT_ALLOWED
    for command in (Command.GET_UNITS, Command.INITIALIZE):
        assert client.send(command) == [refused(command, status)]
    assert client.later(1.0) == []
    assert client.session.next_due_s() is None
    client.tracker.advance(client.now_s)
    assert client.tracker.events() == ["warmed_up"]
