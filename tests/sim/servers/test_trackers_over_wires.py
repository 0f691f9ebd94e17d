"""The drivers of trackers and the simulated ones, over a real socket and a pseudo-terminal."""

from contextlib import ExitStack, closing, contextmanager, suppress
from itertools import product

import numpy as np
import pytest

from drivers.declaration import Surroundings
from drivers.emscon.client import EmsconDeadlines
from drivers.emscon.tracker import EmsconTracker
from drivers.errors import BeamBroken, DeviceNotReady, DeviceRefused, DriverError
from drivers.pointline import PointlineDeadlines, PointlineTracker
from drivers.ports import SystemClock
from drivers.transport import opener_of
from sim.cell import Cell
from sim.clock import ScaledClock
from sim.embedded import tracker_sessions
from sim.faults import Counted, Fault, FaultScript
from sim.scenarios.scenario import load_scenario
from sim.servers.server import CellServer

CCR = "CCR-1.5in"
IMPATIENT = {
    "emscon": EmsconDeadlines(answer_s=0.25, measuring_margin_s=0.0),
    "pointline": PointlineDeadlines(answer_s=0.4, greeting_s=0.4, measuring_margin_s=0.0),
}
FAULTS_AT = {"emscon": (50, 51, 103, 104, 156, 157), "pointline": (5, 9)}
"""Two of an emScon in a row: one of them alone may be an event, which nobody waits for."""
both = pytest.mark.parametrize("speaks", ["emscon", "pointline"])


@contextmanager
def served(speaks, wire="tcp", faults=(), speed_up=500.0, **tracker):
    """A cell with such a tracker; gives it and what connects a further driver to it."""
    scenario = load_scenario("realistic")
    changed = scenario.tracker.model_copy(update=tracker)
    cell = Cell(scenario.model_copy(update={"tracker": changed}))
    clock = ScaledClock(speed_up)
    server = CellServer(clock, FaultScript(faults, {}))
    serve = server.serve_pty if wire == "pty" else server.serve_tcp
    url = serve(tracker_sessions(cell, speaks), "tracker")
    make = {"emscon": EmsconTracker, "pointline": PointlineTracker}[speaks]

    def connected(*deadlines):
        given = Surroundings(
            open_transport=opener_of(url), clock=SystemClock(), instrument_clock=clock
        )
        driver = make(given, *deadlines)
        drivers.enter_context(closing(driver))
        driver.connect()
        return driver

    with server, ExitStack() as drivers:
        yield cell, connected


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
    with served(speaks) as (cell, connected):
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
def test_nothing_is_measured_or_moved_before_it_is_prepared(speaks):
    with served(speaks) as (cell, connected):
        tracker = connected()
        for call in (
            tracker.measure,
            lambda: tracker.go_to(tuple(place_mm(cell))),
            lambda: tracker.find_reflector(2000.0),
        ):
            with pytest.raises(DeviceNotReady, match="not prepared"):
                call()
        assert not cell.tracker.taken


@both
def test_driver_comes_back_to_the_state_that_it_left(speaks):
    """Also while its old connection is still being closed."""
    with served(speaks) as (_, connected):
        tracker = connected()
        tracker.prepare(CCR, 0.5)
        for _ in range(3):
            tracker.reconnect()
            assert tracker.measure()


def test_second_driver_is_refused_and_the_first_goes_on():
    with served("emscon") as (_, connected):
        tracker = connected()
        with pytest.raises(DeviceRefused, match="end the other program"):
            connected()
        tracker.prepare(CCR, 0.5)
        assert tracker.measure()


def test_cold_tracker_is_refused_without_moving():
    cold = {"initialised": False, "beam_locked": False, "warm_up_s": 1e6}
    with (
        served("emscon", speed_up=1.0, **cold) as (_, connected),
        pytest.raises(DeviceNotReady, match="heating up"),
    ):
        connected().prepare(CCR, 0.5)


KINDS = ("late", "silent", "torn", "garbage", "close")
BRIEF = {
    *(("emscon", "late"), ("emscon", "torn"), ("emscon", "silent")),
    *(("pointline", "garbage"), ("pointline", "close"), ("pointline", "torn")),
}
"""Every kind, and three of each protocol."""
FAULTY_WIRES = [
    pytest.param(
        *(speaks, wire, kind),
        marks=[] if wire == "tcp" and (speaks, kind) in BRIEF else pytest.mark.long,
    )
    for speaks, wire, kind in (
        *product(IMPATIENT, ["tcp"], KINDS),
        *product(["pointline"], ["pty"], ("late", "torn")),
    )
]


@pytest.mark.slow
@pytest.mark.parametrize(("speaks", "wire", "kind"), FAULTY_WIRES)
def test_whatever_the_wire_does_no_wrong_point_is_believed(speaks, wire, kind):
    faults = [Fault(Counted.TRACKER_ANSWER, at, kind, None) for at in FAULTS_AT[speaks]]
    measured, broken = 0, 0
    with served(speaks, wire, faults) as (cell, connected):
        tracker = connected(IMPATIENT[speaks])
        tracker.prepare(CCR, 0.5)
        # So many find the faults; more where a served cell waits too long for a processor.
        for tried in range(24):
            if tried >= 12 and measured >= 6:
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
    raise AssertionError("the tracker could not be prepared again")
