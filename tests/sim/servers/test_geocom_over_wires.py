"""The GeoCOM driver and the simulated total station, over a real socket and a pseudo-terminal."""

from contextlib import closing, contextmanager, suppress
from functools import partial

import numpy as np
import pytest

from drivers.errors import BeamBroken, DriverError, NoReflector
from drivers.geocom.client import GeocomDeadlines
from drivers.geocom.tracker import GeocomTracker
from drivers.ports import SystemClock
from drivers.transport import open_transport
from sim.cell import Cell
from sim.clock import ScaledClock
from sim.faults import Counted, Fault, FaultScript
from sim.scenarios.scenario import load_scenario
from sim.servers.geocom_server import GeocomSession
from sim.servers.geocom_station import GeocomStation
from sim.servers.server import CellServer

SPEED_UP = 500.0
PATIENT = GeocomDeadlines()
IMPATIENT = GeocomDeadlines(answer_s=0.4, greeting_s=0.4, distance_s=2)
CCR = "CCR-1.5in"


@contextmanager
def served(wire="tcp", faults=(), **tracker):
    """A cell whose tracker answers GeoCOM; gives the cell and the tracker's URL."""
    scenario = load_scenario("realistic")
    changed = scenario.tracker.model_copy(update=tracker)
    cell = Cell(scenario.model_copy(update={"tracker": changed}))
    station = GeocomStation(cell.tracker)
    server = CellServer(ScaledClock(SPEED_UP), FaultScript(faults, {}))
    serve = server.serve_pty if wire == "pty" else server.serve_tcp
    url = serve(lambda send, _already_open: GeocomSession(station, send), "tracker")
    with server:
        yield cell, url


def driver_for(url, deadlines=PATIENT):
    return GeocomTracker(
        partial(open_transport, url, timeout_s=1.0),
        clock=SystemClock(),
        first_transaction=20_000,
        deadlines=deadlines,
    )


def place_mm(cell):
    return cell.station.to_tracker_mm(cell.true_reflector_mm(0.0))


@pytest.mark.parametrize("wire", ["tcp", "pty"])
def test_instrument_is_prepared_aimed_and_measures(wire):
    with served(wire, beam_locked=False) as (cell, url), closing(driver_for(url)) as tracker:
        tracker.connect()
        assert not tracker.state().beam_locked
        tracker.prepare(CCR, 1.0)
        tracker.go_to(tuple(place_mm(cell) + 20.0))
        measurement = tracker.measure()
        assert measurement.point_in_tracker_mm == pytest.approx(place_mm(cell), abs=0.1)
        assert np.linalg.eigvalsh(measurement.covariance_mm2)[0] > 0.3**2
        assert measurement.weather.humidity_percent == pytest.approx(45.0, abs=5.0)
        place = place_mm(cell)
        assert tracker.direction() == pytest.approx(tuple(place / np.linalg.norm(place)), abs=1e-4)
        assert tracker.state().beam_locked
        assert tracker.state().reflector == CCR


def test_prism_in_view_is_followed_from_the_preparation_on():
    with served() as (cell, url), closing(driver_for(url)) as tracker:
        tracker.connect()
        tracker.prepare(CCR, 1.0)
        assert tracker.measure().point_in_tracker_mm == pytest.approx(place_mm(cell), abs=0.1)


def test_prism_that_is_not_there_is_a_broken_beam_until_it_is_found():
    with served() as (cell, url), closing(driver_for(url)) as tracker:
        tracker.connect()
        tracker.prepare(CCR, 1.0)
        x, y, z = place_mm(cell)
        with pytest.raises(BeamBroken, match="searching"):
            tracker.go_to((-x, -y, z))
        with pytest.raises(NoReflector):
            tracker.measure()
        tracker.go_to((x, y, z))
        assert tracker.measure()


def test_driver_comes_back_to_the_state_that_it_left():
    with served() as (_, url), closing(driver_for(url)) as tracker:
        tracker.connect()
        tracker.prepare(CCR, 1.0)
        for _ in range(3):
            tracker.reconnect()
            assert tracker.measure()


FAULTS = [(kind, "tcp") for kind in ("late", "silent", "torn", "garbage", "close")]


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "wire"), [*FAULTS, ("late", "pty"), ("torn", "pty")])
def test_whatever_the_wire_does_no_wrong_point_is_believed(kind, wire):
    lasts_s = 300.0 if kind == "late" else None
    faults = [Fault(Counted.TRACKER_ANSWER, at, kind, lasts_s) for at in (70, 140)]
    measured, broken = 0, 0
    with served(wire, faults) as (cell, url), closing(driver_for(url, IMPATIENT)) as tracker:
        tracker.connect()
        tracker.prepare(CCR, 1.0)
        # Eight find both faults; more where a served cell waits too long for a processor.
        for tried in range(24):
            if tried >= 8 and measured >= 6:
                break
            try:
                point_mm = tracker.measure().point_in_tracker_mm
            except DriverError:
                broken += 1
                recover(tracker)
            else:
                measured += 1
                assert point_mm == pytest.approx(place_mm(cell), abs=0.1)
    assert measured >= 6
    assert broken >= 1


def recover(tracker):
    """Recovering may meet the next fault."""
    for _ in range(5):
        with suppress(DriverError):
            return tracker.reconnect()
    raise AssertionError("the instrument could not be prepared again")
