"""The whole cell without wires: repeatable, restartable, as good or bad as its scenario says."""

import json
import math

import numpy as np
import pytest

from sim.cell import Cell
from sim.errors import SimError
from sim.scenarios.scenario import load_scenario

CENTRE = (0.0, 0.0, -575.0, 0.0)


def visited(cell, poses, now_s=0.0):
    """Move to each pose and measure; the shots, and the time when all is done."""
    shots = []
    for pose in poses:
        now_s += cell.controller.move_pose(*pose, 1.0, now_s)
        end_s = cell.tracker.begin_measurement(0.5, now_s)
        shots.append(np.array(cell.tracker.finish_measurement(end_s).point_in_tracker_mm))
        now_s = end_s
    return np.array(shots), now_s


def around(count, seed):
    draw = np.random.default_rng(seed)
    steps = draw.standard_normal((count, 3))
    steps *= 60.0 / np.linalg.norm(steps, axis=1)[:, None]
    return [(*(np.array(CENTRE[:3]) + step), draw.uniform(-0.3, 0.3)) for step in steps]


def approaches(cell, seed):
    """28 shots at the centre, each reached from another direction."""
    poses = [pose for other in around(28, seed) for pose in (other, CENTRE)]
    shots, _ = visited(cell, poses)
    return shots[1::2]


def radius_mm(shots):
    return np.linalg.norm(shots - shots.mean(axis=0), axis=1).max()


@pytest.mark.parametrize(
    ("scenario", "seed", "least_mm", "most_mm"),
    [
        ("paper-prototype", 0, 0.3, 0.5),
        ("paper-simulation", 1, 0.0, 5 * 0.015 / math.sqrt(3)),
        ("realistic", 1, 0.02, 0.2),
    ],
)
def test_a_robot_repeats_as_well_as_its_scenario_says(scenario, seed, least_mm, most_mm):
    cell = Cell(load_scenario(scenario), seed=seed)
    assert least_mm < radius_mm(approaches(cell, seed)) < most_mm


def test_how_long_somebody_waits_does_not_change_what_is_measured():
    scenario, poses = load_scenario("realistic"), around(6, seed=4)
    quick, slow = Cell(scenario), Cell(scenario)
    first, _ = visited(quick, poses)
    second, now_s = [], 0.0
    for pose in poses:
        now_s += 7.7 + slow.controller.move_pose(*pose, 1.0, now_s)
        slow.tracker.live_point(now_s - 7.9)
        end_s = slow.tracker.begin_measurement(0.5, now_s)
        now_s = end_s + 3.3
        second.append(np.array(slow.tracker.finish_measurement(now_s).point_in_tracker_mm))
    assert np.array_equal(first, second)


def test_a_restart_goes_on_as_if_nothing_had_happened():
    scenario, poses = load_scenario("realistic"), around(8, seed=9)
    unbroken, _ = visited(Cell(scenario, seed=4), poses)
    before = Cell(scenario, seed=4)
    first, _ = visited(before, poses[:5])
    after = Cell(scenario, memory=json.loads(json.dumps(before.memory())))
    assert after.memory() == before.memory()
    assert after.seed == 4
    second, _ = visited(after, poses[5:])
    assert np.array_equal(unbroken, [*first, *second])


def test_a_new_cell_after_another_is_the_same_robot_with_noise_of_its_own():
    scenario, poses = load_scenario("realistic"), around(3, seed=9)
    first, _ = visited(Cell(scenario), poses)
    later = Cell(scenario, attempts_before=12)
    others, now_s = visited(later, poses)
    assert later.true_geometry == Cell(scenario).true_geometry
    assert np.abs(np.subtract(first, others)).max() < 0.2
    assert not set(np.ravel(first)) & set(np.ravel(others))
    assert np.array_equal(others, visited(Cell(scenario, attempts_before=12), poses)[0])
    resumed = Cell(scenario, memory=json.loads(json.dumps(later.memory())))
    more, _ = visited(resumed, poses, now_s)
    assert np.array_equal(more, visited(later, poses, now_s)[0])


def test_the_record_of_truth_says_of_which_reflector_each_shot_was_and_outlives_a_restart():
    scenario = load_scenario("hostile")
    cell = Cell(scenario)
    (right,), now_s = visited(cell, [CENTRE])
    cell.tracker.beam.confuse()
    end_s = cell.tracker.begin_measurement(0.5, now_s)
    cell.tracker.finish_measurement(end_s)
    after = Cell(scenario, memory=json.loads(json.dumps(cell.memory())))
    first, second = after.tracker.taken
    assert (first.on, second.on) == ("robot", "standing")
    assert first.point_in_tracker_mm == tuple(right)
    encoders_deg = np.degrees(cell.controller.state(now_s).joints)
    assert np.allclose(first.robot_target, encoders_deg * 1e6, atol=1.0)
    true_mm = cell.station.to_tracker_mm(cell.true_reflector_mm(now_s))
    assert first.true_in_tracker_mm == pytest.approx(true_mm, abs=1e-4)
    assert 1e-3 < np.abs(np.array(right) - true_mm).max() < 0.1
    assert 0.0 < first.worked_s < second.worked_s


def test_with_the_true_parameters_loaded_the_robot_goes_where_it_is_told():
    cell = Cell(load_scenario("paper-simulation"))
    cell.controller.replace_geometry(cell.true_geometry, 0.0)
    again = Cell(load_scenario("paper-simulation"), memory=cell.memory())
    assert again.controller.geometry() == cell.true_geometry, "over a restart too"
    poses = [(100.0, 0.0, -575.0, 0.0), (-150.0, 60.0, -700.0, 0.3), (0.0, -200.0, -500.0, -0.5)]
    shots, _ = visited(cell, poses)
    gaps = np.linalg.norm(np.diff(shots, axis=0), axis=1)
    wanted = np.linalg.norm(np.diff(np.array(poses)[:, :3], axis=0), axis=1)
    assert gaps == pytest.approx(wanted, abs=0.06)


def test_a_fault_that_has_happened_does_not_happen_again_after_a_restart():
    scenario = load_scenario("hostile")
    cell = Cell(scenario)
    now_s = 0.0
    for _ in range(12):
        end_s = cell.tracker.begin_measurement(0.5, now_s)
        lost = cell.tracker.finish_measurement(end_s) is None
        now_s = end_s
    assert lost
    after = Cell(scenario, memory=cell.memory())
    assert not after.tracker.beam_locked(0.0)
    assert after.tracker.beam_locked(10.0 + after.tracker.find(2500.0, 0.0))
    end_s = after.tracker.begin_measurement(0.5, 20.0)
    assert after.tracker.finish_measurement(end_s) is not None


def remembered(**changes):
    return Cell(load_scenario("realistic")).memory() | changes


@pytest.mark.parametrize(
    "memory",
    [
        {},
        remembered(schema="pkmcal/cell-memory/9"),
        remembered(worked_s="long"),
        remembered(encoders_rad=[0.0, 0.0, 0.0]),
        remembered(geometry={"plate_mm": 100.0}),
        remembered(plate=[0.0, 0.0, 5000.0, 0.0, 0.0, 0.0, 0.0]),
        remembered(scenario="paper-simulation"),
        remembered(unknown=1),
        remembered(worked_s=math.nan),
    ],
)
def test_a_damaged_memory_is_refused(memory):
    with pytest.raises(SimError, match="delete the simulated cell's memory"):
        Cell(load_scenario("realistic"), memory=memory)
