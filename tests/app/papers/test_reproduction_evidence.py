"""Why ours differs from the paper, in numbers."""

import math

import numpy as np
import pytest
from made_up import result, results

from app.papers.corbel2006.evidence import PairLengths, evidence
from app.papers.corbel2006.experiments import PROTOTYPE, SIMULATION
from app.papers.corbel2006.floors import floors
from app.papers.corbel2006.geometry_alone import geometry_alone
from app.papers.corbel2006.misfit import grid_joints, misfit_in_words, reach_of
from app.papers.corbel2006.printed import LINES_MM, REPEATABILITY_MM
from campaigns.robots.robot import find_robot

QUARTER = math.pi / 4.0


@pytest.fixture(scope="module")
def as_printed():
    grid = grid_joints(find_robot("par4-table1").robot)
    return reach_of("as printed", grid, (-QUARTER, QUARTER))


@pytest.fixture(scope="module")
def prototype():
    robot = find_robot("par4-prototype").robot
    return reach_of("ours", grid_joints(robot), robot.limits.joint)


def test_robot_as_printed_reaches_nine_points_and_no_line(as_printed):
    assert len(as_printed.points_mm) == 9
    assert all(has < asked for has, asked in zip(as_printed.lines_mm, LINES_MM, strict=True))
    assert not as_printed.does_lines
    assert "reaches 9 points" in misfit_in_words(as_printed)


def test_our_reading_does_all_three_lines(prototype):
    assert len(prototype.points_mm) > 10_000
    assert prototype.does_lines


def test_noise_alone_leaves_more_in_the_rotation_test_than_the_paper_measured():
    rotation = next(f for f in floors(np.random.default_rng(7), 300) if f.name.startswith("rot"))
    assert rotation.left.low > rotation.paper[0].high
    assert rotation.draws_mm.max() < 2.0 * math.sqrt(3.0) * REPEATABILITY_MM, "the cube's diagonal"


def test_noise_alone_leaves_more_in_the_fit_than_the_paper_says():
    fitted = floors(np.random.default_rng(7), 300)[0]
    assert fitted.left.low > fitted.paper[0].high


def test_same_draws_give_the_same_floors():
    one, two = (floors(np.random.default_rng(7), 20) for _ in range(2))
    for left, right in zip(one, two, strict=True):
        assert (left.draws_mm == right.draws_mm).all()


def true_of(estimate):
    return estimate.model_copy(update={"estimated_error": estimate.true_error})


def test_true_parameters_leave_nothing_but_noise():
    one = result(PROTOTYPE, 1)
    exact = {name: true_of(estimate) for name, estimate in one.parameters.items()}
    found = geometry_alone([one.model_copy(update={"parameters": exact})], np.random.default_rng(1))
    assert [each.name for each in found] == [
        "rotation",
        "straightness x",
        "straightness y",
        "straightness z",
    ]
    assert max(each.after.high for each in found) < 1e-6
    assert min(each.noisy.median for each in found) > 0.2


def test_nominal_parameters_leave_what_the_reading_of_table_one_rests_on():
    found = geometry_alone([result(PROTOTYPE, 1)], np.random.default_rng(1))
    assert [round(each.before_mm, 2) for each in found] == [2.26, 5.63, 4.67, 0.64]


def test_paper_pairs_are_as_long_as_their_errors_say():
    one = result(PROTOTYPE, 1)
    lengths = np.linspace(200.0, 600.0, 20)
    stage = one.before.model_copy(
        update={
            "lengths_mm": tuple(lengths.tolist()),
            "errors_mm": tuple((-0.05 * lengths).tolist()),
        }
    )
    pairs = PairLengths.of([one.model_copy(update={"before": stage})])
    assert pairs.share == pytest.approx(0.05)
    assert "5.0 % of itself" in pairs.in_words()
    assert "about 146 and 304 mm" in pairs.in_words()


def test_without_the_prototype_there_is_the_rest(monkeypatch, as_printed):
    monkeypatch.setattr("app.papers.corbel2006.evidence.reaches", lambda: (as_printed,))
    found = evidence([r for r in results(1) if r.experiment == SIMULATION.name])
    assert found.pairs is None
    assert found.geometry_alone == ()
    assert found.reaches == (as_printed,)
    assert len(found.floors) == 7
