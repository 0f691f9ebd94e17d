"""The drivers of trackers at the simulated ones: in memory, over a socket, over a serial line."""

from contextlib import ExitStack, closing, contextmanager, suppress
from itertools import product

import numpy as np
import pytest

from drivers.declaration import Surroundings
from drivers.emscon.tracker import EmsconTracker
from drivers.errors import BeamBroken, DriverError
from drivers.pointline import PointlineTracker
from drivers.ports import SystemClock
from drivers.transport import opener_of
from sim.cell import Cell
from sim.clock import EventClock, ScaledClock
from sim.in_process import InProcessCell
from sim.scenarios.scenario import load_scenario
from sim.scenarios.schema import FaultSection
from sim.servers.server import CellServer
from sim.sessions import tracker_sessions

CCR = "CCR-1.5in"
SCENARIO = load_scenario("realistic")
FAULTS_AT = {"emscon": (50, 51, 103, 104, 156, 157), "pointline": (5, 9)}
"""Two of an emScon in a row: one of them alone may be an event, which nobody waits for."""
DRIVERS = {"emscon": EmsconTracker, "pointline": PointlineTracker}
both = pytest.mark.parametrize("speaks", DRIVERS)


def cell_of(faults=(), **tracker):
    section = SCENARIO.tracker.model_copy(update=tracker)
    return Cell(SCENARIO.model_copy(update={"tracker": section, "faults": tuple(faults)}))


@contextmanager
def at(cell, make, given):
    """Gives the cell, and what connects a further driver to it."""
    with ExitStack() as drivers:

        def connected():
            drivers.enter_context(closing(driver := make(given)))
            driver.connect()
            return driver

        yield cell, connected


@contextmanager
def in_memory(speaks, faults=(), **tracker):
    cell = cell_of(faults, **tracker)
    clock = InProcessCell(cell, EventClock(), tracker_speaks=speaks)
    given = Surroundings(
        open_transport=lambda **_: clock.connect("tracker", "sim://cell/tracker"),
        clock=clock,
        in_process=True,
    )
    with at(cell, DRIVERS[speaks], given) as connected:
        yield connected


@contextmanager
def served(speaks, wire, **tracker):
    cell, clock = cell_of(**tracker), ScaledClock(500.0)
    server = CellServer(clock, cell.faults)
    serve = server.serve_pty if wire == "pty" else server.serve_tcp
    url = serve(tracker_sessions(cell, speaks), "tracker")
    given = Surroundings(open_transport=opener_of(url), clock=SystemClock())
    with server, at(cell, DRIVERS[speaks], given) as connected:
        yield connected


def place_mm(cell):
    return cell.station.to_tracker_mm(cell.true_reflector_mm(0.0))


@pytest.mark.parametrize(
    ("speaks", "wire"), [("emscon", "tcp"), ("pointline", "tcp"), ("pointline", "pty")]
)
def test_tracker_is_brought_up_aimed_and_measures(speaks, wire):
    states = {"initialised": False, "beam_locked": False}
    with served(speaks, wire, **states) as (cell, connected):
        tracker, place = connected(), place_mm(cell)
        assert not tracker.state().beam_locked
        tracker.prepare(CCR, 0.5)
        tracker.go_to(tuple(place + 5.0))
        measurement = tracker.measure()
        assert measurement.point_in_tracker_mm == pytest.approx(place, abs=0.1)
        least_std_mm = np.linalg.eigvalsh(measurement.covariance_mm2)[0] ** 0.5
        assert least_std_mm == pytest.approx(0.010 / 3**0.5, rel=0.1)
        assert measurement.weather.humidity_percent == pytest.approx(45.0, abs=5.0)
        assert tracker.direction() == pytest.approx(tuple(place / np.linalg.norm(place)), abs=1e-4)
        assert tracker.state().beam_locked
        assert tracker.state().reflector == CCR


@both
def test_reflector_that_is_not_there_is_a_broken_beam_until_it_is_found(speaks):
    with in_memory(speaks) as (cell, connected):
        tracker = connected()
        tracker.prepare(CCR, 0.5)
        x, y, z = place_mm(cell)
        with pytest.raises(BeamBroken):
            tracker.go_to((-x, -y, z))
        with pytest.raises(BeamBroken):
            tracker.measure()
        tracker.go_to((x, y, z))
        assert tracker.measure()


@both
def test_driver_comes_back_to_the_state_that_it_left(speaks):
    """Also while its old connection is still being closed."""
    with in_memory(speaks) as (_, connected):
        tracker = connected()
        tracker.prepare(CCR, 0.5)
        for _ in range(3):
            tracker.reconnect()
            assert tracker.measure()


@pytest.mark.parametrize(
    ("speaks", "kind"), [*product(DRIVERS, ("late", "silent", "torn", "garbage", "close"))]
)
def test_whatever_the_wire_does_no_wrong_point_is_believed(speaks, kind):
    faults = [FaultSection(device="tracker", at_answer=n, kind=kind) for n in FAULTS_AT[speaks]]
    broken = 0
    with in_memory(speaks, faults) as (cell, connected):
        tracker = connected()
        tracker.prepare(CCR, 0.5)
        for _ in range(12):
            try:
                point_mm = tracker.measure().point_in_tracker_mm
            except DriverError:
                broken += 1
                recover(tracker)
            else:
                assert point_mm == pytest.approx(place_mm(cell), abs=0.1)
    assert 1 <= broken <= 6


def recover(tracker):
    """Recovering may meet the next fault."""
    for _ in range(5):
        with suppress(DriverError):
            return tracker.reconnect()
    raise AssertionError("the tracker could not be prepared again")
