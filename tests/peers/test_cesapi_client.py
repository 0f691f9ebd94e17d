"""CESAPI, an unmodified third-party emScon client, in a session with the simulated tracker.

It has no own notion of several answers to one command: the further packets of a list are read from
its stream. It looks at its socket five times a second, so each packet takes 0.2 s.
"""

import inspect
import time
from types import SimpleNamespace
from urllib.parse import urlsplit

import CESAPI.packet as cesapi
import numpy as np
import pytest
from CESAPI.command import CommandSync
from CESAPI.connection import Connection
from served_cell import served

from sim.cell import Cell
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
    with served(Cell(scenario.model_copy(update={"tracker": switched_on})), SPEED_UP) as addresses:
        yield addresses


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


SET_AND_TOLD = {
    *("CoordinateSystemType", "EnvironmentParams", "MeasurementMode", "Reflector", "StatisticMode"),
    *("SearchParams", "StationaryModeParams", "SystemSettings", "Units"),
}
TOLD = {
    *("Direction", "MeasurementStatusInfo", "Reflectors", "SystemStatus", "TrackerInfo"),
    "TrackerStatus",
}
MEASURING = {
    *("FindReflector", "GoPosition", "Initialize", "StartMeasurement"),
    *(f"Set{name}" for name in SET_AND_TOLD),
    *(f"Get{name}" for name in SET_AND_TOLD | TOLD),
}
"""Commands that a client of stationary measurements uses; the others may be refused."""


@pytest.fixture
def quick_reader(monkeypatch):
    """Their reader without the fifth of a second that it sleeps at each packet."""
    nap = SimpleNamespace(sleep=lambda _s: None)
    monkeypatch.setattr("CESAPI.connection.time", nap)


@pytest.fixture
def measuring_cell():
    with served(Cell(load_scenario("realistic")), 1000.0) as addresses:
        yield addresses


def sensible(cell):
    """Parameters that a client would give, by command; for the others, CESAPI's own zeros."""
    place_mm = cell.cell.station.to_tracker_mm(cell.cell.true_reflector_mm(0.0))
    search = cesapi.SearchParamsDataT()
    search.dSearchRadius, search.lTimeOut = 0.05, 5000
    stationary = cesapi.StationaryModeDataT()
    stationary.lMeasTime, stationary.bUseADM = 500, 1
    return {
        "FindReflector": {"dAproxDistance": 3.0},
        "GoPosition": dict(zip(("dVal1", "dVal2", "dVal3"), place_mm / 1e3, strict=True)),
        "SetReflector": {"iInternalReflectorId": 1},
        "SetSearchParams": {"searchParams": search},
        "SetStationaryModeParams": {"stationaryModeData": stationary},
    }


def arguments_of(name, given):
    packet = getattr(cesapi, f"{name}CT")()
    wanted = list(inspect.signature(getattr(CommandSync, name)).parameters)[1:]
    return {each: given.get(each, getattr(packet, each)) for each in wanted}


@pytest.mark.slow
@pytest.mark.usefixtures("quick_reader")
def test_every_command_of_theirs_works_or_is_refused_and_their_reader_lives_on(measuring_cell):
    connected = TheirClient(measuring_cell.tracker_url)
    names = [name for name in vars(CommandSync) if name[0].isupper()]
    given, refused = sensible(measuring_cell), set()
    try:
        for name in names:
            arguments = arguments_of(name, given.get(name, {}))
            if is_refused(getattr(connected.command, name), arguments):
                refused.add(name)
            assert_reader_lives(connected, name)
    finally:
        connected.close()
    assert len(names) == 75
    assert refused & MEASURING == set()
    assert refused == set(names) - MEASURING


def is_refused(command, arguments):
    try:
        command(**arguments)
    except Exception as error:  # theirs has no class of its own
        if "failed with status" not in str(error):
            raise
        return True
    return False


def assert_reader_lives(connected, name):
    """Read what else may come, then ask for something of which the answer is known."""
    while connected.stream.unreadCount():
        connected.stream.read()
    connected.command.GetUnits()
    assert connected.stream.is_alive(), name
