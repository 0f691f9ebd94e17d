"""The tracker's beam: follows, is lost, is found again, and sometimes on a wrong target."""

import math

import numpy as np
import pytest
from tracker_stage import STANDING_MM, Stage, measured, seen_mm, tracker

from sim.faults import Counted, Fault
from sim.robot.rods import rotation
from sim.tracker.optics import direction_of


@pytest.fixture
def stage():
    return Stage()


def test_without_a_lock_nothing_is_measured():
    assert tracker(Stage(), locked=False).begin_measurement(1.0, 0.0) is None


def test_a_beam_break_spoils_the_measurement_and_all_after_it():
    instrument = tracker(Stage(), faults=[Fault(Counted.MEASUREMENT, 2, "beam_break", 3.0)])
    assert measured(instrument, 0.0) is not None
    assert instrument.next_event_s() is None
    end_s = instrument.begin_measurement(1.0, 10.0)
    assert instrument.next_event_s() == 10.5
    assert instrument.finish_measurement(end_s) is None
    assert instrument.events() == ["beam_lost"]
    assert not instrument.beam_locked(100.0)
    assert instrument.begin_measurement(1.0, 100.0) is None


def test_a_break_that_nobody_watched_still_loses_the_lock():
    instrument = tracker(Stage(), faults=[Fault(Counted.MEASUREMENT, 1, "beam_break", 3.0)])
    instrument.begin_measurement(1.0, 0.0)
    assert not instrument.beam_locked(60.0)


def test_a_broken_beam_is_found_again_only_after_the_break(stage):
    instrument = tracker(stage, faults=[Fault(Counted.MEASUREMENT, 1, "beam_break", 30.0)])
    measured(instrument)
    instrument.events()
    takes_s = instrument.go_to(seen_mm(stage.point_mm), 2.0)
    assert takes_s >= instrument.search_timeout_s
    assert not instrument.beam_locked(2.0 + takes_s)
    takes_s = instrument.find(2500.0, 40.0)
    assert not instrument.beam_locked(40.0 + 0.9 * takes_s)
    assert instrument.beam_locked(40.0 + takes_s)
    assert instrument.events() == ["beam_found"]
    assert measured(instrument, 50.0) is not None


def test_go_to_finds_within_the_search_radius_only(stage):
    instrument = tracker(stage, locked=False)
    instrument.search_radius_mm = 20.0
    for miss_mm, found in ((19.0, True), (21.0, False)):
        takes_s = instrument.go_to(seen_mm(stage.point_mm + np.array([0.0, 0.0, miss_mm])), 0.0)
        assert instrument.busy(0.5 * takes_s)
        assert instrument.beam_locked(takes_s) is found


def test_the_beam_follows_the_robot(stage):
    instrument = tracker(stage)
    stage.point_mm = stage.point_mm + np.array([120.0, -40.0, 60.0])
    stage.still = False
    assert instrument.live_point(1.0) == pytest.approx(seen_mm(stage.point_mm))
    assert instrument.direction(1.0) == pytest.approx(
        direction_of(np.array(seen_mm(stage.point_mm)))
    )


def test_a_reflector_turned_away_loses_the_beam_when_the_robot_rests(stage):
    instrument = tracker(stage)
    stage.facing = rotation(0.0, 0.0, math.radians(31.0)) @ stage.facing
    stage.still = False
    assert instrument.beam_locked(0.0)
    stage.still = True
    assert not instrument.beam_locked(1.0)
    takes_s = instrument.go_to(seen_mm(stage.point_mm), 2.0)
    assert not instrument.beam_locked(2.0 + takes_s)
    assert instrument.live_point(2.0 + takes_s) is None


def test_a_wrong_target_is_measured_until_the_robots_is_sought(stage):
    instrument = tracker(stage, faults=[Fault(Counted.MEASUREMENT, 2, "wrong_target", None)])
    assert measured(instrument).point_in_tracker_mm == pytest.approx(seen_mm(stage.point_mm))
    for now_s in (10.0, 20.0):
        wrong = measured(instrument, now_s).point_in_tracker_mm
        assert wrong == pytest.approx(seen_mm(STANDING_MM))
    takes_s = instrument.go_to(seen_mm(stage.point_mm), 30.0)
    right = measured(instrument, 30.0 + takes_s).point_in_tracker_mm
    assert right == pytest.approx(seen_mm(stage.point_mm))
