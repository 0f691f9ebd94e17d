"""The simulated total station's distance meter: points, their time, their frame."""

import math

import pytest
from geocom_client_stub import Client

from drivers.wire.geocom import parse_number, words_of
from drivers.wire.geocom_constants import Result, Rpc
from sim.faults import Counted, Fault

MEASURE = words_of(1, 1)
CLEAR = words_of(3, 1)
WAIT = words_of(5000, 1)


@pytest.fixture
def client():
    """Its telescope follows the reflector."""
    return Client().robotic().follow()


def test_point_is_the_reflectors(client):
    assert client.ask(Rpc.TMC_DO_MEASURE, *MEASURE).result == Result.OK
    values = client.values(Rpc.TMC_GET_COORDINATE, *WAIT)
    assert [1000.0 * value for value in values[:3]] == pytest.approx(client.place_mm(), abs=0.1)
    assert values[4:7] == values[:3]


def test_distance_takes_its_time(client):
    client.ask(Rpc.TMC_DO_MEASURE, *MEASURE)
    started_s = client.now_s
    assert client.begin(Rpc.TMC_GET_COORDINATE, *WAIT) == []
    assert client.later(1.4) == []
    assert client.later(0.2)[0].result == Result.OK
    assert client.now_s - started_s == pytest.approx(1.6)


def test_nobody_waits_longer_than_was_asked_for(client):
    client.ask(Rpc.TMC_DO_MEASURE, *MEASURE)
    reply = client.ask(Rpc.TMC_GET_COORDINATE, *words_of(100, 1))
    assert reply.result == Result.ANGLES_ONLY
    assert [parse_number(word) for word in reply.parameters] == [0.0] * 8


def test_polar_and_cartesian_are_one_point(client):
    client.ask(Rpc.TMC_DO_MEASURE, *MEASURE)
    east, north, up, *_ = client.values(Rpc.TMC_GET_COORDINATE, *WAIT)
    assert client.values(Rpc.TMC_GET_SIMPLE_COORD, *WAIT) == [east, north, up]
    hz, v, distance = client.values(Rpc.TMC_GET_SIMPLE_MEA, *WAIT)
    assert distance == pytest.approx(math.hypot(east, north, up))
    assert client.values(Rpc.TMC_GET_ANGLE_5, "1") == pytest.approx([hz, v])
    assert distance * math.sin(v) * math.sin(hz) == pytest.approx(east, abs=1e-4)
    assert distance * math.sin(v) * math.cos(hz) == pytest.approx(north, abs=1e-4)


def test_one_call_measures_and_answers(client):
    hz, v, distance, mode = client.values(Rpc.BAP_MEAS_DISTANCE_ANGLE, "2")
    assert (hz, v, 1000.0 * distance) == pytest.approx(client.polar(), abs=0.1)
    assert mode == 2


def test_cleared_distance_is_gone(client):
    client.ask(Rpc.TMC_DO_MEASURE, *MEASURE)
    client.ask(Rpc.TMC_GET_COORDINATE, *WAIT)
    client.ask(Rpc.TMC_DO_MEASURE, *CLEAR)
    assert client.ask(Rpc.TMC_GET_COORDINATE, *WAIT).result == Result.ANGLES_ONLY


def test_station_heights_and_orientation_move_the_coordinates(client):
    client.ask(Rpc.TMC_DO_MEASURE, *MEASURE)
    east, north, up, *_ = client.values(Rpc.TMC_GET_COORDINATE, *WAIT)
    hz, v = client.values(Rpc.TMC_GET_ANGLE_5, "1")
    client.ask(Rpc.TMC_SET_STATION, *words_of(100.0, 200.0, 10.0, 1.5))
    client.ask(Rpc.TMC_SET_HEIGHT, *words_of(0.5))
    client.ask(Rpc.TMC_SET_ORIENTATION, *words_of(hz + 0.5 * math.pi))
    moved = client.values(Rpc.TMC_GET_COORDINATE, *WAIT)[:3]
    assert moved == pytest.approx([100.0 + north, 200.0 - east, 11.0 + up], abs=1e-6)
    turned = client.values(Rpc.TMC_GET_ANGLE_5, "1")
    assert turned == pytest.approx([(hz + 0.5 * math.pi) % math.tau, v], abs=1e-9)


def test_prism_lost_meanwhile_gives_no_distance():
    client = Client(Fault(Counted.MEASUREMENT, 1, "beam_break", 3.0)).robotic().follow()
    client.ask(Rpc.TMC_DO_MEASURE, *MEASURE)
    assert client.ask(Rpc.TMC_GET_COORDINATE, *WAIT).result == Result.DISTANCE_ERROR
    assert client.values(Rpc.MOT_READ_LOCK_STATUS) == [0]


def test_no_prism_gives_no_distance():
    client = Client(beam_locked=False).robotic()
    client.ask(Rpc.TMC_DO_MEASURE, *MEASURE)
    assert client.ask(Rpc.TMC_GET_COORDINATE, *WAIT).result == Result.DISTANCE_ERROR
