"""CESAPI, an unmodified third-party emScon client, in a session with the simulated tracker.

It has no own notion of several answers to one command: the further packets of a list are read from
its stream. It looks at its socket five times a second, so each packet takes 0.2 s.
"""

import time
from contextlib import closing
from urllib.parse import urlsplit

import CESAPI.packet as cesapi
import numpy as np
import pytest
from CESAPI.command import CommandSync
from CESAPI.connection import Connection

from sim.cell import Cell
from sim.clock import ScaledClock
from sim.embedded import EmbeddedCell
from sim.scenarios.scenario import load_scenario

pytestmark = pytest.mark.peer

SPEED_UP = 100.0
MM_PER_INCH = 25.4
SOON_S = 5.0
NEAR_MM = np.array([10.0, -5.0, 5.0])


class TheirClient:
    """CESAPI connected to a tracker, and what a session does with it."""

    def __init__(self, tracker_url):
        self.connection = Connection()
        address = urlsplit(tracker_url)
        self.stream = self.connection.connect(host=address.hostname, port=address.port)
        self.command = CommandSync(self.connection)

    def close(self):
        self.connection.disconnect()
        assert not self.stream.is_alive()

    def set_length_unit(self, unit):
        units = cesapi.SystemUnitsDataT()
        units.lenUnitType = unit
        units.angUnitType = cesapi.ES_AU_Degree
        units.pressUnitType = cesapi.ES_PU_HPascal
        self.command.SetUnits(units)

    def processor_status(self):
        return self.command.GetSystemStatus().trackerProcessorStatus

    def reflectors(self):
        first = self.command.GetReflectors()
        rest = [self._next_entry() for _ in range(first.iTotalReflectors - 1)]
        return {_name(entry): entry.iInternalReflectorId for entry in [first, *rest]}

    def set_measuring(self, time_ms):
        mode = cesapi.StationaryModeDataT()
        mode.lMeasTime, mode.bUseADM = time_ms, 1
        self.command.SetMeasurementMode(cesapi.ES_MM_Stationary)
        self.command.SetStationaryModeParams(mode)

    def measure(self):
        return self.command.StartMeasurement()

    def _next_entry(self):
        give_up_s = time.monotonic() + SOON_S
        while time.monotonic() < give_up_s:
            packet = self.stream.read()
            if isinstance(packet, cesapi.GetReflectorsRT):
                return packet
            time.sleep(0.005)
        raise AssertionError("the list of reflectors broke off")


def _name(entry):
    return entry.cReflectorName.decode("utf-16-le").rstrip("\0")


def point_of(result):
    return np.array([result.dVal1, result.dVal2, result.dVal3])


@pytest.fixture
def cell():
    """A cell whose tracker has just been switched on and is on no reflector."""
    scenario = load_scenario("realistic")
    switched_on = scenario.tracker.model_copy(update={"initialised": False, "beam_locked": False})
    with EmbeddedCell(
        Cell(scenario.model_copy(update={"tracker": switched_on})), ScaledClock(SPEED_UP)
    ) as served:
        yield served


@pytest.fixture
def client(cell):
    connected = TheirClient(cell.tracker_url)
    yield connected
    connected.close()


def test_session_from_switching_on_to_a_measured_point(cell, client):
    place_mm = cell.cell.station.to_tracker_mm(cell.cell.true_reflector_mm(0.0))
    client.set_length_unit(cesapi.ES_LU_Millimeter)
    assert client.processor_status() != cesapi.ES_TPS_Initialized
    client.command.Initialize()
    assert client.processor_status() == cesapi.ES_TPS_Initialized
    reflectors = client.reflectors()
    assert reflectors == {"CCR-1.5in": 1, "CCR-75mm": 3}
    client.command.SetReflector(reflectors["CCR-1.5in"])
    client.command.SetCoordinateSystemType(cesapi.ES_CS_RHR)
    client.set_measuring(time_ms=500)
    client.command.GoPosition(1, *(place_mm + NEAR_MM))
    measured = client.measure()
    assert isinstance(measured, cesapi.SingleMeasResultT)
    assert point_of(measured) == pytest.approx(place_mm, abs=0.1)
    assert 0.0 < measured.dStdTotal < 0.1
    assert measured.dPressure == pytest.approx(1008.0)
    assert_measures_in_inches_with_covariances(client, place_mm)
    assert_finding_nothing_is_an_error(client)


def assert_measures_in_inches_with_covariances(client, place_mm):
    client.set_length_unit(cesapi.ES_LU_Inch)
    client.command.SetStatisticMode(
        continuousMeasurements=cesapi.ES_SM_Standard, stationaryMeasurements=cesapi.ES_SM_Extended
    )
    measured = client.measure()
    assert isinstance(measured, cesapi.SingleMeasResult2T)
    assert point_of(measured) * MM_PER_INCH == pytest.approx(place_mm, abs=0.1)
    assert measured.dCovar12 != 0.0


def assert_finding_nothing_is_an_error(client):
    with pytest.raises(Exception, match="Command 55 failed with status 36"):
        client.command.GoPosition(1, 0.0, 0.0, 200.0)
    with pytest.raises(Exception, match="Command 49 failed with status 10004"):
        client.measure()


def test_second_client_is_refused(cell, client):
    second = TheirClient(cell.tracker_url)
    with closing(second), pytest.raises(Exception, match="failed with status 10011"):
        second.command.Initialize()
