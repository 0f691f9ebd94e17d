"""Identification by distances: the reference's parameters, honest deviations, refusals."""

from dataclasses import replace

import identified_cases
import numpy as np
import pytest
from fake_cell import NOMINAL
from family_cases import flat_in
from par4_space import par4

from campaigns.errors import ShotsMissing
from campaigns.estimation.estimators import Estimator, Model
from campaigns.identification.result import IdentificationResult
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots

CASES = ("table1-exact", "table1-tracker-noise", "table2-repeatability")


def by_distances(data: Shots, **options) -> IdentificationResult:
    return identified_cases.identified(data, Estimator.DISTANCES, **options)


@pytest.mark.parametrize("case", CASES)
def test_parameters_are_those_of_the_reference(case: str) -> None:
    found = by_distances(identified_cases.measured(case))
    expected = flat_in(identified_cases.reference(case)["least_squares_distances"])
    for name, value in identified_cases.values(found).items():
        limit = 1e-6 if name.endswith("_deg") else 1e-4
        assert value == pytest.approx(expected[name], abs=limit), name
    assert found.converged
    assert (found.rank, found.dof) == (22, 38)
    assert (
        found.residuals_mm.after.rms
        <= identified_cases.reference(case)["cost_rms_mm"] * (1 + 1e-6) + 1e-9
    )


def test_errors_before_and_after_are_those_of_the_reference() -> None:
    residuals = by_distances(identified_cases.measured("table2-repeatability")).residuals_mm
    expected = identified_cases.reference("table2-repeatability")
    for spread, key in ((residuals.before, "before_abs_mm"), (residuals.after, "after_abs_mm")):
        assert spread.mean_abs == pytest.approx(expected[key]["mean"], abs=1e-6)
        assert spread.max_abs == pytest.approx(expected[key]["max"], abs=1e-6)


def test_unseen_pairs_decide_and_without_them_nothing_does() -> None:
    found = by_distances(identified_cases.measured("table1-tracker-noise"))
    assert found.unseen_mm is None
    assert found.unseen is None
    assert found.verdict == "not decided"
    assert found.reasons[0].startswith("no validation pairs")
    found = by_distances(identified_cases.noisy(identified_cases.simulated(60, 20, seed=1), seed=2))
    assert found.verdict == "pass"
    assert found.unseen_mm.before.max_abs > 1.0
    assert found.unseen_mm.after.rms < 3 * identified_cases.NOISE_MM
    assert found.excluded == ()
    assert found.reasons[0].startswith("hold-out pairs: mean")


def test_fit_that_makes_unseen_pairs_worse_fails() -> None:
    """The hold-out pairs come from the nominal robot, the fitted ones from another."""
    data = identified_cases.simulated(60, 20, seed=1)
    nominal = identified_cases.simulated(60, 20, seed=1, truth=NOMINAL)
    points = np.vstack([data.points_in_tracker_mm[:120], nominal.points_in_tracker_mm[120:]])
    found = by_distances(replace(data, points_in_tracker_mm=points))
    assert found.verdict == "fail"
    assert any(each.startswith("hold-out pairs got worse: rms 0.0000 → ") for each in found.reasons)


def test_robot_that_is_as_its_nominal_parameters_say_has_nothing_to_correct_and_passes() -> None:
    """What the fit makes of noise costs hold-out pairs a little: no more than chance explains."""
    found = by_distances(
        identified_cases.noisy(identified_cases.simulated(60, 20, seed=3, truth=NOMINAL), seed=4)
    )
    assert found.unseen_mm.after.rms > found.unseen_mm.before.rms
    assert found.verdict == "pass"
    assert found.reasons[0].endswith("(no change shown)")


def test_too_few_pairs_are_refused_and_just_enough_give_no_deviations() -> None:
    with pytest.raises(ShotsMissing, match="21 pairs cannot give 22 parameters"):
        by_distances(identified_cases.simulated(21, 5, seed=1))
    found = by_distances(identified_cases.simulated(22, 5, seed=3), model=Model.PAPER)
    assert found.dof == 0
    assert set(identified_cases.deviations(found).values()) == {None}


def test_held_parameters_stay_as_they_were() -> None:
    truth = par4(identified_cases.TRUTH.parameters | {"plate_mm": NOMINAL.parameters["plate_mm"]})
    found = by_distances(identified_cases.simulated(60, 20, seed=1, truth=truth), fix=["plate_mm"])
    plate = found.parameters["plate_mm"]
    assert (plate.free, plate.delta, plate.std) == (False, 0.0, None)
    assert plate.value == NOMINAL.parameters["plate_mm"]
    assert len(found.free) == 21


def test_half_pairs_are_left_out_by_name() -> None:
    data = identified_cases.simulated(60, 20, seed=1)
    purposes = tuple(
        ShotSet.ROTATION if row in (7, 121) else kind for row, kind in enumerate(data.purposes)
    )
    pairs = tuple(None if row in (7, 121) else pair for row, pair in enumerate(data.pairs))
    found = by_distances(replace(data, purposes=purposes, pairs=pairs))
    assert [(left.pair, left.reason) for left in found.excluded] == [
        (3, "shot 6 has no partner"),
        (60, "shot 120 has no partner"),
    ]
    assert found.dof == 59 - 22
    assert found.verdict == "pass"


def test_shots_that_no_robot_could_take_are_left_out_by_name() -> None:
    data = identified_cases.simulated(60, 20, seed=1)
    joints = data.joints.copy()
    joints[[5, 130]] = identified_cases.IMPOSSIBLE_RAD
    found = by_distances(replace(data, joints=joints))
    assert [left.pair for left in found.excluded] == [2, 65]
    assert found.excluded[0].reason == (
        "the nominal robot cannot be assembled at the joints of shot 5"
    )
    assert found.verdict == "pass"


def test_unseen_shot_that_the_identified_robot_cannot_take_fails() -> None:
    """Forearms 20 mm too short for joints at which the nominal robot is nearly stretched."""
    data = identified_cases.simulated(60, 20, seed=1, truth=identified_cases.shortened(20.0))
    tried = np.random.default_rng(0).uniform(-2.0, 2.0, (500, 4))
    lost = NOMINAL.forward(tried).found & ~identified_cases.shortened(20.0).forward(tried).found
    joints = data.joints.copy()
    joints[121] = tried[lost][0]
    found = by_distances(replace(data, joints=joints))
    reason = "the identified robot cannot be assembled at the joints of shot 121"
    assert [(left.pair, left.reason) for left in found.excluded] == [(60, reason)]
    assert found.verdict == "fail"
    assert f"hold-out pair 60: {reason}" in found.reasons
    assert found.unseen_mm.after.rms < 1e-6


@pytest.mark.long
def test_solver_that_stops_at_the_edge_of_the_model_has_not_converged() -> None:
    """Forearms 110 mm shorter: on its way there the solver meets robots that do not assemble."""
    data = identified_cases.simulated(60, 20, seed=1, truth=identified_cases.shortened(110.0))
    found = by_distances(data, model=Model.PAPER)
    assert not found.converged
    assert found.verdict == "fail"
    assert found.reasons[0].startswith("not converged")
    assert found.message == found.reasons[0]


@pytest.mark.long
def test_distances_begin_where_the_coordinates_beside_them_end() -> None:
    """Which keeps them off the edge of the model, on the other side of which the robot is."""
    truth = identified_cases.shortened(110.0)
    found = by_distances(identified_cases.simulated(60, 20, seed=1, truth=truth))
    assert found.converged
    assert found.flat() == pytest.approx(truth.parameters, abs=1e-6)
    assert found.verdict == "fail"
