"""The tracker: measures as exactly as its covariance says, starts up, lives in the cell's air."""

import math

import numpy as np
import pytest
from tracker_stage import SPHERICAL, STATION, Stage, measured, seen_mm, tracker

from sim.faults import Counted, Fault
from sim.random_streams import WorkedTime


def test_a_shot_is_the_reflector_in_the_trackers_own_frame():
    stage = Stage()
    point_mm = measured(tracker(stage)).point_in_tracker_mm
    assert np.linalg.norm(point_mm) == pytest.approx(
        np.linalg.norm(stage.point_mm - STATION.origin_in_base_mm)
    )
    back_mm = STATION.base_from_tracker @ point_mm + STATION.origin_in_base_mm
    assert back_mm == pytest.approx(stage.point_mm, abs=1e-9)


@pytest.mark.slow
def test_shots_scatter_as_the_covariance_says():
    stage, worked = Stage(), WorkedTime(0.0)
    instrument = tracker(stage, noise=SPHERICAL, worked=worked)
    shots = [measured(instrument) for _ in range(2000)]
    errors = np.array([shot.point_in_tracker_mm for shot in shots]) - seen_mm(stage.point_mm)
    whitened = np.linalg.solve(np.linalg.cholesky(np.array(shots[0].covariance_mm2)), errors.T)
    assert np.cov(whitened) == pytest.approx(np.eye(3), abs=0.1)
    assert np.mean(whitened, axis=1) == pytest.approx(np.zeros(3), abs=0.09)


def test_the_covariance_is_that_of_a_spherical_instrument():
    x, y, z = point = np.array([1200.0, -900.0, 700.0])
    distance, level = np.linalg.norm(point), math.hypot(x, y)
    jacobian = np.array(  # of x, y, z by range, azimuth and elevation, written down directly
        [
            [x / distance, -y, -z * x / level],
            [y / distance, x, -z * y / level],
            [z / distance, 0.0, level],
        ]
    )
    along, azimuth, elevation = (
        limit.sigma_mm(distance)
        for limit in (SPHERICAL.along, SPHERICAL.azimuth, SPHERICAL.elevation)
    )
    angles = np.diag([along**2, (azimuth / level) ** 2, (elevation / distance) ** 2])
    spread = SPHERICAL.spread_mm(point)
    assert spread @ spread.T == pytest.approx(jacobian @ angles @ jacobian.T, rel=1e-12, abs=1e-15)


def test_a_shot_repeats_for_seed_target_and_attempt_only():
    def shots(seed, target=None):
        stage = Stage()
        stage.target = target or stage.target
        instrument = tracker(stage, noise=SPHERICAL, seed=seed)
        return [measured(instrument, now_s).point_in_tracker_mm for now_s in (0.0, 50.0)]

    assert shots(1) == shots(1)
    assert shots(1)[0] != shots(1)[1]
    assert shots(1) != shots(2)
    assert shots(1) != shots(1, target=(1, 2, 3, -4))


def test_initialising_takes_its_time_and_goes_back_to_the_reflector():
    instrument = tracker(Stage(), initialised=False)
    assert not instrument.initialised(0.0)
    assert instrument.initialise(0.0) == 20.0
    assert not instrument.initialised(19.9)
    assert not instrument.beam_locked(19.9)
    assert instrument.initialised(20.0)
    assert instrument.beam_locked(20.0)
    assert instrument.events() == ["initialised", "beam_found"]


def test_the_laser_warms_up():
    instrument = tracker(Stage(), warm_up_s=300.0)
    assert instrument.next_event_s() == 300.0
    assert not instrument.laser_warm(299.0)
    assert instrument.laser_warm(300.0)
    assert instrument.events() == ["warmed_up"]
    assert instrument.next_event_s() is None


def test_a_measurement_counts_as_worked_time_only_when_it_is_delivered():
    worked = WorkedTime(0.0)
    instrument = tracker(
        Stage(), worked=worked, faults=[Fault(Counted.MEASUREMENT, 2, "beam_break", 1.0)]
    )
    measured(instrument)
    measured(instrument, 10.0)
    assert worked.seconds == 1.0
