"""The tracker: locks, loses, finds again, and scatters exactly as its covariance says."""

import math

import numpy as np
import pytest

from sim.beam import Beam, Target
from sim.draws import Attempts, WorkedTime
from sim.driven_robot import SeenReflector
from sim.faults import Counted, Fault, FaultScript
from sim.optics import (
    IsotropicNoise,
    Limit,
    SphericalNoise,
    Station,
    angle_between_rad,
    direction_of,
)
from sim.rotations import rotation
from sim.tracker import Air, SimulatedReflector, SimulatedTracker, TrackerSettings

STATION = Station(np.array([2000.0, -1500.0, -200.0]), rotation(-0.04, 0.07, 2.4))
REFLECTORS = (
    SimulatedReflector(1, "CCR-1.5in", 1, 19.05),
    SimulatedReflector(3, "CCR-75mm", 1, 37.5),
)
QUIET = IsotropicNoise(0.0)
SPHERICAL = SphericalNoise(Limit(10.0, 0.3), Limit(15.0, 6.0), Limit(20.0, 7.0))
STANDING_MM = np.array([600.0, 300.0, -400.0])


class Stage:
    """A reflector that a test moves and turns."""

    def __init__(self):
        self.point_mm = np.array([0.0, 0.0, -600.0])
        self.facing = STATION.origin_in_base_mm - self.point_mm
        self.still = True
        self.target = (30_000_000, 30_000_000, 20_000_000, 20_000_000)

    def robot_reflector(self, now_s):
        return SeenReflector(self.point_mm, self.facing / np.linalg.norm(self.facing))

    def robot_is_still(self, now_s):
        return self.still

    def robot_target(self):
        return self.target


def tracker(stage, *, noise=QUIET, faults=(), seed=1, locked=True, worked=None, **settings):
    defaults = {"initialise_s": 20.0, "warm_up_s": 0.0, "initialised": True, "selected": 1}
    air = Air(20.0, 1013.0, 50.0, drift_degC_per_h=0.5)
    return SimulatedTracker(
        TrackerSettings("390001", REFLECTORS, noise, air, **(defaults | settings)),
        stage,
        Beam(
            stage,
            STATION,
            standing_in_base_mm=STANDING_MM,
            acceptance_rad=math.radians(30.0),
            locked_on=Target.ROBOT if locked else None,
        ),
        seed=seed,
        faults=FaultScript(faults, {}),
        worked=worked or WorkedTime(0.0),
        attempts=Attempts({}),
    )


def measured(instrument, now_s=0.0):
    end_s = instrument.begin_measurement(1.0, now_s)
    return None if end_s is None else instrument.finish_measurement(end_s)


def seen_mm(point_in_base_mm):
    return tuple(STATION.to_tracker_mm(point_in_base_mm))


def test_a_shot_is_the_reflector_in_the_trackers_own_frame():
    stage = Stage()
    point_mm = measured(tracker(stage)).point_in_tracker_mm
    assert np.linalg.norm(point_mm) == pytest.approx(
        np.linalg.norm(stage.point_mm - STATION.origin_in_base_mm)
    )
    back_mm = STATION.base_from_tracker @ point_mm + STATION.origin_in_base_mm
    assert back_mm == pytest.approx(stage.point_mm, abs=1e-9)


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


def test_a_limit_becomes_a_standard_uncertainty():
    assert Limit(15.0, 6.0).sigma_mm(2500.0) == pytest.approx(0.030 / math.sqrt(3.0))


def test_straight_up_has_a_covariance_too():
    spread = SPHERICAL.spread_mm(np.array([0.0, 0.0, 1000.0]))
    assert np.linalg.matrix_rank(spread) == 3


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


def test_a_broken_beam_is_found_again_only_after_the_break():
    stage = Stage()
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


def test_go_to_finds_within_the_search_radius_only():
    stage = Stage()
    instrument = tracker(stage, locked=False)
    instrument.search_radius_mm = 20.0
    for miss_mm, found in ((19.0, True), (21.0, False)):
        takes_s = instrument.go_to(seen_mm(stage.point_mm + np.array([0.0, 0.0, miss_mm])), 0.0)
        assert instrument.busy(0.5 * takes_s)
        assert instrument.beam_locked(takes_s) is found


def test_a_head_on_its_way_is_on_no_reflector():
    stage = Stage()
    instrument = tracker(stage)
    takes_s = instrument.go_to(seen_mm(stage.point_mm), 0.0)
    assert not instrument.beam_locked(0.9 * takes_s)
    assert instrument.begin_measurement(1.0, 0.9 * takes_s) is None
    assert instrument.beam_locked(takes_s)


def test_find_does_not_care_about_the_distance():
    stage = Stage()
    instrument = tracker(stage, locked=False)
    takes_s = instrument.go_to(tuple(2.0 * np.array(seen_mm(stage.point_mm))), 0.0)
    assert not instrument.beam_locked(takes_s)
    assert instrument.beam_locked(30.0 + instrument.find(1.0, 30.0))


def test_find_does_not_look_behind():
    stage = Stage()
    instrument = tracker(stage, locked=False)
    takes_s = instrument.go_to(tuple(-1.0 * np.array(seen_mm(stage.point_mm))), 0.0)
    assert not instrument.beam_locked(60.0 + instrument.find(2500.0, 10.0 + takes_s))


def test_a_place_that_is_no_place_is_pointed_at_without_harm():
    instrument = tracker(Stage())
    for nowhere in ((0.0, 0.0, 0.0), (math.nan, 0.0, 0.0)):
        takes_s = instrument.go_to(nowhere, 0.0)
        assert math.isfinite(takes_s)
        assert not instrument.beam_locked(takes_s)
        assert all(map(math.isfinite, instrument.direction(takes_s)))


def test_the_beam_follows_the_robot():
    stage = Stage()
    instrument = tracker(stage)
    stage.point_mm = stage.point_mm + np.array([120.0, -40.0, 60.0])
    stage.still = False
    assert instrument.live_point(1.0) == pytest.approx(seen_mm(stage.point_mm))
    assert instrument.direction(1.0) == pytest.approx(
        direction_of(np.array(seen_mm(stage.point_mm)))
    )


def test_a_reflector_turned_away_loses_the_beam_when_the_robot_rests():
    stage = Stage()
    instrument = tracker(stage)
    stage.facing = rotation(0.0, 0.0, math.radians(31.0)) @ stage.facing
    stage.still = False
    assert instrument.beam_locked(0.0)
    stage.still = True
    assert not instrument.beam_locked(1.0)
    takes_s = instrument.go_to(seen_mm(stage.point_mm), 2.0)
    assert not instrument.beam_locked(2.0 + takes_s)
    assert instrument.live_point(2.0 + takes_s) is None


def test_a_wrong_target_is_measured_until_the_robots_is_sought():
    stage = Stage()
    instrument = tracker(stage, faults=[Fault(Counted.MEASUREMENT, 2, "wrong_target", None)])
    assert measured(instrument).point_in_tracker_mm == pytest.approx(seen_mm(stage.point_mm))
    for now_s in (10.0, 20.0):
        wrong = measured(instrument, now_s).point_in_tracker_mm
        assert wrong == pytest.approx(seen_mm(STANDING_MM))
    takes_s = instrument.go_to(seen_mm(stage.point_mm), 30.0)
    right = measured(instrument, 30.0 + takes_s).point_in_tracker_mm
    assert right == pytest.approx(seen_mm(stage.point_mm))


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


def test_only_known_reflectors_can_be_selected():
    instrument = tracker(Stage())
    assert instrument.select_reflector(3)
    assert not instrument.select_reflector(2)
    assert instrument.selected == 3


def test_the_weather_drifts_with_worked_time():
    worked = WorkedTime(0.0)
    instrument = tracker(Stage(), worked=worked)
    worked.add(7200.0)
    assert instrument.weather(0.0) == (21.0, 1013.0, 50.0)


def test_a_measurement_counts_as_worked_time_only_when_it_is_delivered():
    worked = WorkedTime(0.0)
    instrument = tracker(
        Stage(), worked=worked, faults=[Fault(Counted.MEASUREMENT, 2, "beam_break", 1.0)]
    )
    measured(instrument)
    measured(instrument, 10.0)
    assert worked.seconds == 1.0


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-6, 1e-3, 0.5, 2.0, math.pi])
def test_angles_between_directions_are_exact_in_every_decade(angle):
    other = np.array([math.cos(angle), math.sin(angle), 0.0])
    assert angle_between_rad(np.array([2.0, 0.0, 0.0]), other) == pytest.approx(angle, rel=1e-12)
