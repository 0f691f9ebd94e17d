"""Identification with what the user knows: priors, freed and fixed parameters, what is held."""

import pytest
from fake_cell import NOMINAL
from identified_cases import deviations, identified, moved, noisy, simulated, values, workspace

from campaigns.estimation.estimators import Estimator

SHIFT_ALONG_X = {f"arm{arm}.x_mm" for arm in range(4)}
CLEAN = noisy(simulated(60, 20, seed=1), seed=2)
BOTH = pytest.mark.parametrize("estimator", list(Estimator))


@BOTH
def test_what_moves_together_is_said_held_and_spoils_the_verdict(estimator) -> None:
    found = identified(CLEAN, estimator, free=["arm0.x_mm"])
    assert [set(names) for names in found.unobservable] == [SHIFT_ALONG_X]
    assert (found.verdict, found.rank, found.condition) == ("fail", 22, None)
    assert found.reasons[0].startswith("the data cannot tell apart: ")
    assert found.reasons[0].endswith("move together here: fixed at nominal along that combination")
    assert {name for name in SHIFT_ALONG_X if deviations(found)[name] is None} == SHIFT_ALONG_X
    assert found.unseen_mm.after.rms < 0.05 * found.unseen_mm.before.rms


@BOTH
def test_a_prior_covers_what_the_data_cannot_tell(estimator) -> None:
    found = identified(CLEAN, estimator, free=["arm0.x_mm"], prior=["arm0.x_mm=0.2"])
    assert found.unobservable == ()
    assert [set(names) for names in found.known_by_priors_alone] == [SHIFT_ALONG_X]
    assert found.verdict == "pass"
    assert deviations(found)["arm0.x_mm"] == pytest.approx(0.2, rel=0.01)
    assert values(found)["arm0.x_mm"] == pytest.approx(NOMINAL.parameters["arm0.x_mm"], abs=0.1)


@pytest.mark.parametrize("estimator", list(Estimator))
def test_priors_and_outliers_work_together(estimator) -> None:
    data = moved(CLEAN, (7, 50, 99), by_mm=2.0)
    options = {"free": ["arm0.x_mm"], "prior": ["arm0.x_mm=0.2", "arm*.arm_mm=5"]}
    found = identified(data, estimator, **options)
    named = [left.shot if estimator is Estimator.POINTS else left.pair for left in found.excluded]
    assert named == ([7, 50, 99] if estimator is Estimator.POINTS else [3, 25, 49])
    assert found.verdict == "pass"
    clean = identified(CLEAN, estimator, **options)
    assert found.unseen_mm.after.rms <= 1.3 * clean.unseen_mm.after.rms


def test_a_change_of_frame_does_not_make_positions_uncertain() -> None:
    plain = identified(CLEAN, Estimator.POINTS, poses=workspace())
    shifted = identified(CLEAN, Estimator.POINTS, free=["arm0.x_mm"], poses=workspace())
    assert shifted.position_std_mm.mean == pytest.approx(plain.position_std_mm.mean, rel=1e-3)


def test_positions_are_not_known_where_shots_are_too_few() -> None:
    """Eleven pairs leave combinations that do move the point: nothing is said of positions."""
    few = noisy(simulated(11, 5, seed=1), seed=1)
    found = identified(
        few,
        Estimator.DISTANCES,
        prior=["*.arm_mm=1000000", "*.forearm_mm=1000000", "arm*.y_mm=1000000"],
        poses=workspace(),
    )
    assert found.position_std_mm is None or found.position_std_mm.max > 1.0
