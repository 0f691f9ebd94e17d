"""The simulated emScon instrument's settings and readings, in the client's units."""

import math

import numpy as np
import pytest
from emscon_client import MILLIMETRES, Client
from tracker_stage import SPHERICAL

from drivers.wire.emscon_constants import Command
from drivers.wire.emscon_messages import (
    ApproximateDistance,
    BeamTarget,
    Code,
    Direction,
    Environment,
    SearchParams,
    SingleResult2,
    StationaryMode,
    StatisticMode,
    SystemSettings,
    Units,
)
from sim.servers.emscon_instrument import EmsconInstrument


@pytest.fixture
def client():
    return Client()


REFUSED = [
    ("SET_UNITS", Units(6, 0, 0, 0, 0), 4),
    ("SET_UNITS", Units(0, 0, 0, 7, 0), 7),
    ("SET_COORDINATE_SYSTEM_TYPE", Code(6), 2),
    ("SET_MEASUREMENT_MODE", Code(1), 2),
    ("SET_STATIONARY_MODE_PARAMS", StationaryMode(0, 1), 4),
    ("SET_STATISTIC_MODE", StatisticMode(0, 2), 5),
    ("SET_REFLECTOR", Code(2), 4),
    ("SET_SEARCH_PARAMS", SearchParams(math.nan, 1), 4),
    ("SET_SEARCH_PARAMS", SearchParams(1.0, 0), 5),
    ("SET_SYSTEM_SETTINGS", SystemSettings(2, 1, 0, 1, 1, 0, 0, 0, 0), 2),
    ("GO_POSITION", BeamTarget((0.0, math.inf, 0.0), 1), 4),
    ("GO_POSITION", BeamTarget((0.0, 1e308, 0.0), 1), 4),
    ("GO_POSITION", BeamTarget((0.0, 201.0, 0.0), 1), 4),
    ("FIND_REFLECTOR", ApproximateDistance(math.nan), 4),
]


@pytest.mark.parametrize(("command", "body", "status"), REFUSED)
def test_what_cannot_be_set_is_refused(command, body, status):
    assert Client().status(Command[command], body) == status


def test_settings_outlive_a_connection_and_are_those_of_power_on_in_another_instrument():
    tracker = Client().tracker
    instrument = EmsconInstrument(tracker)
    client = Client(tracker, instrument=instrument)
    client.send(Command.SET_UNITS, MILLIMETRES)
    client.send(Command.SET_STATIONARY_MODE_PARAMS, StationaryMode(2500, 1))
    client.session.closed(client.now_s)
    after, other = Client(tracker, instrument=instrument), Client(tracker)
    assert after.ask(Command.GET_UNITS).body == MILLIMETRES
    assert after.ask(Command.GET_STATIONARY_MODE_PARAMS).body == StationaryMode(2500, 1)
    assert other.ask(Command.GET_UNITS).body == Units(0, 0, 0, 0, 0)


def test_reflectors_come_one_packet_each_in_the_clients_unit(client):
    client.send(Command.SET_UNITS, Units(5, 0, 0, 0, 0))
    entries = [answer.body for answer in client.send(Command.GET_REFLECTORS)]
    assert [(e.total, e.identifier, e.name) for e in entries] == [
        (2, 1, "CCR-1.5in"),
        (2, 3, "CCR-75mm"),
    ]
    assert [e.surface_offset for e in entries] == pytest.approx([0.75, 37.5 / 25.4])


def covariance_mm2(client):
    """The covariance of a shot at the reflector's place."""
    spread_mm = SPHERICAL.spread_mm(np.array(client.place_mm))
    return spread_mm @ spread_mm.T


def test_result_is_in_the_clients_units():
    client = Client(noise=SPHERICAL)
    client.send(Command.SET_UNITS, Units(5, 2, 1, 2, 0))
    result = client.measure()[2]
    (shot,) = client.tracker.taken
    assert np.array(result.point) * 25.4 == pytest.approx(shot.point_in_tracker_mm)
    variances_mm2 = np.diag(covariance_mm2(client))
    assert np.array(result.std) * 25.4 == pytest.approx(np.sqrt(variances_mm2))
    assert (result.temperature, result.pressure) == pytest.approx((68.0, 101.3))


def test_result_has_covariances_only_with_extended_statistics():
    client = Client(noise=SPHERICAL)
    client.send(Command.SET_UNITS, MILLIMETRES)
    client.send(Command.SET_STATISTIC_MODE, StatisticMode(1, 0))
    result = client.measure()[2]
    assert isinstance(result, SingleResult2)
    (_, xy, xz), (_, _, yz), _ = covariance = covariance_mm2(client)
    assert result.covariance == result.apriori_covariance == pytest.approx((xy, xz, yz))
    assert result.std_total == pytest.approx(math.sqrt(np.trace(covariance)))


def test_readings_are_in_the_clients_units(client):
    client.send(Command.SET_UNITS, Units(1, 2, 0, 3, 0))
    assert client.ask(Command.GET_ENVIRONMENT_PARAMS).body == Environment(
        20.0, pytest.approx(1013.0 / 1.33322), 50.0
    )
    x, y, z = client.place_mm
    horizontal, zenith = math.atan2(y, x), math.acos(z / math.hypot(x, y, z))
    assert client.ask(Command.GET_DIRECTION).body == Direction(
        pytest.approx(horizontal * 200 / math.pi), pytest.approx(zenith * 200 / math.pi)
    )
