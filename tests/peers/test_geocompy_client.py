"""geocompy, unmodified and on its own connections, in a session with the simulated total station.

It sleeps for a second whenever it is connected.
"""

import inspect
import math
from contextlib import contextmanager
from datetime import UTC, datetime
from urllib.parse import urlsplit

import pytest
from geocompy.communication import open_serial, open_socket
from geocompy.data import Coordinate
from geocompy.geo import GeoCom, gcdata
from geocompy.geo.gcdata import ATR, ATRLock, Measurement, Position, Prism, Program
from geocompy.geo.gctypes import GeoComCode

from sim.cell import Cell
from sim.clock import ScaledClock
from sim.embedded import tracker_sessions
from sim.faults import FaultScript
from sim.scenarios.scenario import load_scenario
from sim.servers.server import CellServer

pytestmark = pytest.mark.peer

SPEED_UP = 100.0
PATIENCE_S = 5


@contextmanager
def served(wire):
    """A cell whose tracker answers GeoCOM; gives the cell and the tracker's URL."""
    scenario = load_scenario("realistic")
    seen_by_none = scenario.tracker.model_copy(update={"beam_locked": False})
    cell = Cell(scenario.model_copy(update={"tracker": seen_by_none}))
    server = CellServer(ScaledClock(SPEED_UP), FaultScript((), {}))
    serve = server.serve_pty if wire == "pty" else server.serve_tcp
    url = serve(tracker_sessions(cell, "geocom"), "tracker")
    with server:
        yield cell, url


def their_connection(url):
    address = urlsplit(url)
    if address.scheme == "serial":
        return open_serial(address.path, timeout=PATIENCE_S)
    return open_socket(address.hostname, address.port, "tcp", timeout=PATIENCE_S)


@pytest.mark.parametrize(("wire", "checksum"), [("tcp", True), ("pty", False)])
def test_whole_session(wire, checksum):
    with served(wire) as (cell, url), their_connection(url) as connection:
        geocom = GeoCom(connection, checksum=checksum)
        assert geocom.csv.get_instrument_name().params == "SIM-TS"
        assert geocom.csv.get_serial_number().params == 390001
        aim(geocom, cell)
        measure(geocom, cell)
        refuse(geocom)


def aim(geocom, cell):
    x, y, z = cell.station.to_tracker_mm(cell.true_reflector_mm(0.0))
    hz, v = math.atan2(x, y) % math.tau, math.acos(z / math.hypot(x, y, z))
    assert geocom.bap.set_prism_type_name(Prism.USER, "CCR-1.5in")
    assert geocom.bap.get_prism_type_name().params == (Prism.USER, "CCR-1.5in")
    assert geocom.aut.turn_to(hz, v).error is GeoComCode.OK
    assert geocom.aut.fine_adjust(0.05, 0.05).error is GeoComCode.AUT_NOT_ENABLED
    assert geocom.aus.switch_user_atr(True)
    assert geocom.aus.switch_user_lock(True)
    assert geocom.aut.turn_to(hz + 0.004, v, Position.PRECISE, ATR.TARGET)
    assert geocom.mot.get_lockon_status().params is ATRLock.NONE
    assert geocom.aut.lock_in()
    assert geocom.mot.get_lockon_status().params is ATRLock.LOCK


def measure(geocom, cell):
    expected = pytest.approx(
        cell.station.to_tracker_mm(cell.true_reflector_mm(0.0)) / 1e3, abs=1e-4
    )
    station = geocom.tmc.get_station().params[0]
    assert geocom.tmc.set_target_height(1.55)  # as high as the instrument
    assert geocom.tmc.do_measurement(Measurement.DISTANCE)
    place, _time_ms, again, _ = geocom.tmc.get_coordinate().params
    assert list(place - station) == expected
    assert list(again - station) == expected
    assert list(geocom.tmc.get_simple_coordinate().params - station) == expected
    hz, v, distance = geocom.tmc.get_simple_measurement().params
    assert list(type(place).from_polar(hz, v, distance)) == expected
    assert geocom.bap.measure_distance_angle(Program.DISTANCE).params[2] == pytest.approx(
        distance, abs=1e-4
    )
    assert geocom.tmc.do_measurement(Measurement.CLEAR)
    assert geocom.tmc.get_simple_coordinate().error is GeoComCode.TMC_ANGLE_OK
    without = geocom.tmc.get_coordinate()  # whole-number times, else it cannot be decoded
    assert without.error is GeoComCode.TMC_ANGLE_OK
    assert without.params[1] == without.params[3] == 0


def refuse(geocom):
    """What it doesn't know it refuses in words that the client knows, and goes on."""
    assert geocom.csv.get_voltage_battery().error is GeoComCode.COM_PROC_UNAVAIL
    assert geocom.bap.set_prism_type(Prism.TAPE).error is GeoComCode.IVPARAM
    assert not geocom.abort().error.name.startswith("COM")
    assert geocom.com.nullprocess()


FITTING = {
    "bool": True,
    "float": 1.0,
    "int": 1,
    "SupportsFloat": 1.0,
    "str": "x",
    "datetime": datetime(2026, 1, 1, tzinfo=UTC),
    "Coordinate": Coordinate(0.0, 0.0, 0.0),
}
OLD_MODES = {"get_edm_mode_v1", "set_edm_mode_v1"}
"""geocompy's own for instruments that number modes otherwise; it cannot write them at all."""


def calls_of(geocom):
    """Every call of every subsystem, with parameters that fit its signature."""
    for system in vars(geocom).values():
        if not type(system).__module__.startswith("geocompy.geo."):
            continue
        for name, call in inspect.getmembers(system, inspect.ismethod):
            wanted = [
                each
                for each in inspect.signature(call).parameters.values()
                if each.default is each.empty
            ]
            if not name.startswith("_") and name not in OLD_MODES:
                yield name, call, {each.name: fitting(each.annotation) for each in wanted}


def fitting(annotation):
    if annotation in FITTING:
        return FITTING[annotation]
    return next(iter(getattr(gcdata, annotation.split(" | ")[0])))


@pytest.mark.slow
def test_every_call_of_theirs_is_answered_or_refused_and_the_session_goes_on(monkeypatch):
    monkeypatch.setattr("geocompy.geo.sleep", lambda _s: None)
    answered = set()
    with served("tcp") as (_cell, url), their_connection(url) as connection:
        geocom = GeoCom(connection)
        for name, call, parameters in calls_of(geocom):
            error = call(**parameters).error
            assert error is GeoComCode.COM_PROC_UNAVAIL or not error.name.startswith("COM"), name
            assert geocom.com.nullprocess().error is GeoComCode.OK, name
            if error is not GeoComCode.COM_PROC_UNAVAIL:
                answered.add(name)
    assert {"do_measurement", "get_coordinate", "turn_to", "search", "change_face"} < answered
    assert len(answered) == 51
