"""The fit while measuring: its predictions, and the faults that it shows."""

from functools import cache

import numpy as np
import pytest
from par4_cases import (
    NOMINAL,
    TABLE1,
    TRACKER_FROM_BASE,
    TRACKER_STD_MM,
    measured_points,
    reachable_joints,
)
from par4_space import SPACE

from campaigns.estimation import running_fit
from campaigns.estimation.running_fit import RunningFit, next_size

JOINTS = reachable_joints(TABLE1, 60, seed=81)
EXACT_MM = measured_points(TABLE1, JOINTS)
MEASURED_MM = measured_points(TABLE1, JOINTS, TRACKER_STD_MM, seed=1)
TORN_APART = np.radians([90.0, -90.0, 90.0, -90.0])


@cache
def known_after(shots):
    """The same for all who only ask it."""
    return after(shots)


def after(shots, joints=JOINTS, points_mm=MEASURED_MM):
    running = RunningFit(NOMINAL, SPACE.free_by_default)
    for row in range(shots):
        running.add(joints[row], points_mm[row])
    return running


def missed_mm(running, row):
    return float(np.linalg.norm(running.predict(JOINTS[row])[0] - EXACT_MM[row]))


@pytest.mark.parametrize("shots", range(4))
def test_before_four_shots_no_point_is_predicted(shots):
    assert after(shots).predict(JOINTS[10]) is None


def test_predictions_become_surer_from_millimetres_to_the_trackers_noise():
    assert missed_mm(known_after(4), 10) < 10.0
    running = known_after(29)
    _, std_mm = running.predict(JOINTS[29])
    assert missed_mm(running, 29) < 0.2
    assert std_mm < 0.3
    stds = [known_after(shots).predict(JOINTS[50])[1] for shots in (4, 10, 40)]
    assert sorted(stds, reverse=True) == stds
    assert stds[0] > 10.0 * stds[-1]


@pytest.mark.parametrize("shots", [10, 40])
def test_a_prediction_is_as_good_as_it_claims(shots):
    running = known_after(shots)
    for row in range(shots, 60):
        assert missed_mm(running, row) < 4.0 * running.predict(JOINTS[row])[1]


def test_a_wrong_target_shows_in_distances_before_the_frame_is_known_and_then_in_its_point():
    assert after(0).max_distance_innovation_mm(JOINTS[0], MEASURED_MM[0]) == 0.0
    running = after(2)
    assert running.max_distance_innovation_mm(JOINTS[2], MEASURED_MM[2]) < 12.0
    along = MEASURED_MM[2] - MEASURED_MM[0]
    wrong_mm = MEASURED_MM[2] + 50.0 * along / np.linalg.norm(along)
    assert running.max_distance_innovation_mm(JOINTS[2], wrong_mm) > 38.0
    point_mm, _ = known_after(29).predict(JOINTS[29])
    wrong_mm = MEASURED_MM[29] + [50.0, 0.0, 0.0]
    assert np.linalg.norm(wrong_mm - point_mm) > 49.0


@pytest.mark.parametrize("shots", [0, 29])
def test_joints_without_an_assembly_are_an_infinite_fault_and_predict_nothing(shots):
    running = known_after(shots)
    assert running.max_distance_innovation_mm(TORN_APART, MEASURED_MM[0]) == np.inf
    assert running.predict(TORN_APART) is None


def test_a_shot_without_an_assembly_leaves_the_knowledge_as_it_was():
    running = after(10)
    before_mm, _ = running.predict(JOINTS[40])
    running.add(TORN_APART, MEASURED_MM[0])
    assert (running.predict(JOINTS[40])[0] == before_mm).all()


def test_shots_at_one_place_fix_no_frame():
    """Drift shots alone, however many, tell nothing of the frame."""
    running = after(8, np.repeat(JOINTS[:1], 8, axis=0), np.repeat(MEASURED_MM[:1], 8, axis=0))
    assert running.predict(JOINTS[10]) is None


def test_with_all_shots_the_frame_is_the_tracker_s():
    running = after(60, points_mm=EXACT_MM)
    assert missed_mm(running, 5) < 0.02
    centre, _ = running.predict(JOINTS[0])
    assert TRACKER_FROM_BASE.inverted().apply(centre[None])[0, 2] < 0.0


def test_shots_taken_at_once_tell_what_they_tell_one_by_one():
    asked = after(0)
    for row in range(20):
        asked.predict(JOINTS[row])
        asked.add(JOINTS[row], MEASURED_MM[row])
    at_once = after(7)
    at_once.restart(JOINTS[:20], MEASURED_MM[:20])
    ours, theirs = (running.predict(JOINTS[30]) for running in (at_once, asked))
    assert ours[0] == pytest.approx(theirs[0], abs=1e-6)
    assert ours[1] == pytest.approx(theirs[1], rel=1e-3)


def test_fits_of_all_shots_become_rarer_so_that_their_cost_a_shot_does_not_grow(monkeypatch):
    due, sizes = 4, []
    for shots in range(1, 10_001):
        if shots == due:
            sizes.append(shots)
            due = next_size(shots)
    assert sizes[:97] == [*range(4, 101)]
    assert sum(sizes) / 10_000 < 60.0
    fitted, solve = [], running_fit.solve

    def counted(problem, **options):
        fitted.append(problem.blocks)
        return solve(problem, **options)

    monkeypatch.setattr(running_fit, "solve", counted)
    running = after(0)
    for row in range(120):
        running.add(JOINTS[row % 60], MEASURED_MM[row % 60])
        running.predict(JOINTS[0])
    assert fitted == [size for size in sizes if size <= 120]
