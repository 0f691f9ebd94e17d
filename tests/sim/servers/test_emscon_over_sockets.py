"""The emScon driver and the simulated tracker, over a real socket."""

from contextlib import closing, suppress

import numpy as np
import pytest

from drivers.emscon.client import EmsconDeadlines
from drivers.emscon.tracker import EmsconTracker
from drivers.errors import BeamBroken, DeviceNotReady, DeviceRefused, DriverError
from drivers.ports import SystemClock
from drivers.transport import open_transport
from sim.cell import Cell
from sim.clock import ScaledClock
from sim.embedded import EmbeddedCell
from sim.faults import Counted, Fault, FaultScript
from sim.scenarios.scenario import load_scenario

SPEED_UP = 500.0
PATIENT = EmsconDeadlines()
IMPATIENT = EmsconDeadlines(answer_s=0.25, measuring_margin_s=0.0)
NOT_UP = {"initialised": False, "beam_locked": False}


def cell_with(**tracker):
    scenario = load_scenario("realistic")
    changed = scenario.tracker.model_copy(update=tracker)
    return Cell(scenario.model_copy(update={"tracker": changed}))


def driver_for(served, deadlines=PATIENT, **options):
    return EmsconTracker(
        lambda: open_transport(served.tracker_url, timeout_s=1.0),
        clock=SystemClock(),
        deadlines=deadlines,
        **options,
    )


@pytest.fixture
def served():
    with EmbeddedCell(cell_with(**NOT_UP), ScaledClock(SPEED_UP)) as running:
        yield running


@pytest.fixture
def tracker(served):
    driver = driver_for(served)
    driver.connect()
    yield driver
    driver.close()


def place_mm(served):
    return served.cell.station.to_tracker_mm(served.cell.true_reflector_mm(0.0))


def test_tracker_is_brought_up_aimed_and_measures(served, tracker):
    assert not tracker.state().initialised
    tracker.prepare("CCR-1.5in", 0.5)
    tracker.go_to(tuple(place_mm(served) + 5.0))
    measurement = tracker.measure()
    assert measurement.point_in_tracker_mm == pytest.approx(place_mm(served), abs=0.1)
    covariance = np.array(measurement.covariance_mm2)
    noise = served.cell.scenario.tracker.noise.along.constant_um / 1000.0
    assert np.linalg.eigvalsh(covariance)[0] == pytest.approx((noise / 3**0.5) ** 2, rel=0.2)
    assert tracker.state().beam_locked
    assert tracker.state().reflector == "CCR-1.5in"


def test_direction_is_that_of_the_reflector_it_is_on(served, tracker):
    tracker.prepare("CCR-1.5in", 0.5)
    tracker.go_to(tuple(place_mm(served)))
    place = place_mm(served)
    assert tracker.direction() == pytest.approx(tuple(place / np.linalg.norm(place)), abs=1e-4)


def test_reflector_out_of_reach_of_the_search_is_a_broken_beam(served, tracker):
    tracker.prepare("CCR-1.5in", 0.5)
    with pytest.raises(BeamBroken):
        tracker.go_to((0.0, 0.0, 5000.0))
    with pytest.raises(BeamBroken):
        tracker.measure()
    tracker.go_to(tuple(place_mm(served)))
    assert tracker.measure()


def test_driver_reconnects_while_its_old_connection_is_still_being_closed(served, tracker):
    tracker.prepare("CCR-1.5in", 0.5)
    for _ in range(3):
        tracker.reconnect()
        assert tracker.measure()


def test_second_driver_is_refused_and_the_first_goes_on(served, tracker):
    with pytest.raises(DeviceRefused, match="end the other program"):
        driver_for(served).connect()
    tracker.prepare("CCR-1.5in", 0.5)
    assert tracker.measure()


def test_measuring_time_is_over_by_the_cells_own_clock_when_a_result_comes():
    with (
        EmbeddedCell(cell_with(), ScaledClock(SPEED_UP)) as served,
        closing(driver_for(served, instrument_clock=served.clock)) as tracker,
    ):
        tracker.connect()
        tracker.prepare("CCR-1.5in", 0.5)
        points_mm = [tracker.measure().point_in_tracker_mm for _ in range(3)]
        assert points_mm == [pytest.approx(place_mm(served), abs=0.1)] * 3


def test_cold_tracker_is_refused_without_moving():
    cell = cell_with(**NOT_UP, warm_up_s=1e6)
    with EmbeddedCell(cell, ScaledClock(1.0)) as served:
        driver = driver_for(served)
        driver.connect()
        with pytest.raises(DeviceNotReady, match="heating up"):
            driver.prepare("CCR-1.5in", 0.5)
        driver.close()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["late", "silent", "torn", "garbage", "close"])
def test_whatever_the_wire_does_no_wrong_point_is_believed(kind):
    cell = cell_with()
    # two in a row: one of them alone may be an event, which nobody waits for
    places = [at + next_one for at in range(50, 200, 53) for next_one in (0, 1)]
    faults = [Fault(Counted.TRACKER_ANSWER, at, kind, None) for at in places]
    cell.faults = FaultScript(faults, {})
    broken = 0
    with (
        EmbeddedCell(cell, ScaledClock(SPEED_UP)) as served,
        closing(driver_for(served, IMPATIENT)) as tracker,
    ):
        tracker.connect()
        tracker.prepare("CCR-1.5in", 0.5)
        for _ in range(15):
            try:
                point_mm = tracker.measure().point_in_tracker_mm
            except DriverError:
                broken += 1
                recover(tracker)
            else:
                assert point_mm == pytest.approx(place_mm(served), abs=0.1)
    assert broken >= 1


def recover(tracker):
    """Recovering may meet the next fault."""
    for _ in range(5):
        with suppress(DriverError):
            return tracker.reconnect()
    raise AssertionError("the tracker could not be prepared again")
