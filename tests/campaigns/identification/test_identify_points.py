"""Identification by points: every coordinate counts, wrong shots are named, σ are honest."""

from dataclasses import replace

import numpy as np
import pytest
from identified_cases import (
    IMPOSSIBLE_RAD,
    NOISE_MM,
    TRACKER_FROM_BASE,
    TRUTH,
    dataset,
    deviations,
    identified,
    moved,
    noisy,
    simulated,
    stating,
    values,
    workspace,
)
from par4_space import SPACE

from campaigns.errors import ShotsInvalid, ShotsMissing
from campaigns.estimation.estimators import Estimator, Outliers
from campaigns.identification.result import IdentificationResult
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots

WRONG = (7, 50, 99)
CLEAN = noisy(simulated(60, 20, seed=1), seed=2)
SPOILT = moved(CLEAN, WRONG, by_mm=2.0)
WILD = noisy(simulated(60, 20, seed=1), seed=2, std_mm=4.0 * NOISE_MM)


def by_points(data: Shots, **options) -> IdentificationResult:
    return identified(data, Estimator.POINTS, **options)


def missed(found: IdentificationResult) -> float:
    """Largest distance of a free parameter from the truth, mm or deg."""
    truth = TRUTH.parameters
    return max(abs(value - truth[name]) for name, value in values(found).items())


def test_exact_points_give_the_robot_and_the_trackers_place() -> None:
    found = by_points(stating(simulated(60, 20, seed=1)))
    assert missed(found) < 1e-6
    frame = found.frame.tracker_from_base
    assert np.abs(frame.rotation - TRACKER_FROM_BASE.rotation).max() < 1e-9
    assert np.abs(frame.translation_mm - TRACKER_FROM_BASE.translation_mm).max() < 1e-6
    assert found.residuals_mm.before.max_abs > 1.0 > 1e-6 > found.residuals_mm.after.max_abs
    assert (found.rank, found.dof) == (22, 3 * 120 - 22 - 6)


def test_points_know_parameters_better_than_distances_and_positions_best() -> None:
    points, pairs = deviations(by_points(CLEAN)), deviations(identified(CLEAN, Estimator.DISTANCES))
    assert all(points[name] < 0.5 * pairs[name] for name in SPACE.names if points[name])
    assert missed(by_points(CLEAN)) < missed(identified(CLEAN, Estimator.DISTANCES))
    found = by_points(CLEAN, poses=workspace())
    assert 0.002 < found.position_std_mm.mean < found.position_std_mm.max < 0.03
    assert found.position_std_mm.mean < deviations(found)["plate_mm"]
    assert by_points(CLEAN).position_std_mm is None


def test_unseen_errors_are_those_of_distances_whatever_was_fitted() -> None:
    points, pairs = by_points(CLEAN), identified(CLEAN, Estimator.DISTANCES)
    assert points.unseen_mm.before == pairs.unseen_mm.before
    assert points.unseen.after.shape == (20, 1)
    assert points.verdict == "pass"
    assert points.reasons[1].startswith("fitted shots: rms ")


def test_shots_without_a_partner_count_too() -> None:
    """Every identification shot is a measurement of its own; half a validation pair is none."""
    gone = (7, 121)
    purposes = [ShotSet.DRIFT if n in gone else p for n, p in enumerate(CLEAN.purposes)]
    pairs = [None if n in gone else p for n, p in enumerate(CLEAN.pairs)]
    found = by_points(replace(CLEAN, purposes=tuple(purposes), pairs=tuple(pairs)))
    assert len(found.fitted.after_mm) == 119
    assert [(left.pair, left.reason) for left in found.excluded] == [
        (60, "shot 120 has no partner")
    ]


def test_shots_that_no_robot_could_take_are_left_out_by_name() -> None:
    joints = CLEAN.joints.copy()
    joints[[5, 130]] = IMPOSSIBLE_RAD
    found = by_points(replace(CLEAN, joints=joints))
    assert [(left.shot, left.pair) for left in found.excluded] == [(5, None), (None, 65)]
    assert found.excluded[0].reason == "the nominal robot cannot be assembled at its joints"
    assert found.verdict == "pass"


@pytest.mark.parametrize("estimator", list(Estimator))
def test_moved_shots_are_named_and_the_answer_is_as_good_as_the_clean_one(
    estimator: Estimator,
) -> None:
    found, clean = identified(SPOILT, estimator), identified(CLEAN, estimator)
    named = [left.shot if estimator is Estimator.POINTS else left.pair for left in found.excluded]
    assert named == (list(WRONG) if estimator is Estimator.POINTS else [3, 25, 49])
    assert clean.excluded == ()
    assert found.unseen_mm.after.rms <= 1.3 * clean.unseen_mm.after.rms
    assert found.unseen_mm.after.max_abs <= 1.3 * clean.unseen_mm.after.max_abs
    assert found.verdict == "pass"


def test_moved_shots_tell_size_and_limit() -> None:
    left = by_points(SPOILT).excluded[0]
    assert left.what == "shot 7"
    assert left.size_mm == pytest.approx(2.0, abs=0.1)
    assert left.size_sigma > 100.0 > left.limit_sigma > 3.0
    assert left.reason.startswith(f"{left.size_mm:.3f} mm off what the others say: ")


def test_shots_are_left_out_by_unequal_covariances() -> None:
    """Half of the shots five times worse, as their covariances say."""
    exact, rng = simulated(60, 20, seed=1), np.random.default_rng(5)
    std = np.where(np.arange(160) % 2, 5.0 * NOISE_MM, NOISE_MM)
    points = exact.points_in_tracker_mm + std[:, None] * rng.standard_normal((160, 3))
    stated = std[:, None, None] ** 2 * np.eye(3)
    data = replace(exact, points_in_tracker_mm=points, stated_covariance_mm2=stated)
    found = by_points(moved(data, WRONG, by_mm=2.0))
    assert [left.shot for left in found.excluded] == list(WRONG)
    alike = by_points(replace(data, stated_covariance_mm2=stating(data).stated_covariance_mm2))
    assert missed(found) < missed(alike)
    assert found.chi2.believable
    assert not alike.chi2.believable


def test_scatter_as_stated_is_believed_and_far_below_does_not_shrink_sigma() -> None:
    found = by_points(CLEAN)
    assert found.chi2.believable
    assert found.chi2.scale == 1.0
    assert "scatter as the tracker states" in found.chi2.says
    still = by_points(noisy(simulated(60, 20, seed=1), seed=2, std_mm=0.2 * NOISE_MM))
    assert not still.chi2.believable
    assert still.chi2.scale == 1.0
    assert "careful" in still.chi2.says
    assert deviations(still)["plate_mm"] == pytest.approx(
        deviations(by_points(CLEAN))["plate_mm"], rel=0.02
    )


def test_scatter_beyond_the_stated_one_is_the_robots_widens_sigma_and_is_said() -> None:
    calm = by_points(CLEAN)
    wild = by_points(WILD)
    assert not wild.chi2.believable
    assert np.sqrt(wild.chi2.value / wild.chi2.dof) == pytest.approx(4.0, rel=0.15)
    ratio = deviations(wild)["plate_mm"] / deviations(calm)["plate_mm"]
    assert ratio == pytest.approx(4.0, rel=0.15)
    own_mm = np.sqrt(4.0**2 - 1.0) * NOISE_MM
    assert wild.robot_scatter.point_mm == pytest.approx(own_mm, rel=0.15)
    assert calm.robot_scatter is None
    assert "times what the tracker states" in wild.chi2.says
    assert "the point scatters by" in wild.chi2.says
    assert wild.excluded == ()


def test_scatter_is_stated_also_where_outliers_are_kept() -> None:
    """Else χ² is whitened by what the result says is not there."""
    left_out, kept = (by_points(WILD, outliers=each) for each in (Outliers.EXCLUDE, Outliers.KEEP))
    assert kept.robot_scatter.point_mm == pytest.approx(left_out.robot_scatter.point_mm)
    assert kept.chi2.value == pytest.approx(left_out.chi2.value)
    assert kept.chi2.says == left_out.chi2.says


def test_shots_of_which_nothing_is_stated_get_the_instruments_uncertainty() -> None:
    silent = replace(CLEAN, stated_covariance_mm2=np.full((160, 3, 3), np.nan))
    assert deviations(by_points(silent))["plate_mm"] != deviations(by_points(CLEAN))["plate_mm"]
    assert missed(by_points(silent)) < 0.2


@pytest.mark.parametrize(
    "broken",
    [
        np.diag([1e-4, -1e-4, 1e-4]),
        np.full((3, 3), 1e-4),
        np.diag([1e-4, np.inf, 1e-4]),
        np.where(np.eye(3), np.nan, 1.0),
        np.zeros((3, 3)),
    ],
)
@pytest.mark.parametrize("estimator", list(Estimator))
def test_a_covariance_that_is_none_is_refused_by_the_shots_number(estimator, broken) -> None:
    stated = CLEAN.stated_covariance_mm2.copy()
    stated[17] = broken
    with pytest.raises(ShotsInvalid, match="shot 17: its covariance is not positive") as caught:
        identified(replace(CLEAN, stated_covariance_mm2=stated), estimator)
    assert "sxx … szz" in caught.value.remedy


def test_too_few_shots_or_shots_on_one_line_are_refused() -> None:
    with pytest.raises(ShotsMissing, match="12 shots are too few") as caught:
        by_points(simulated(6, 0, seed=1))
    assert "for 22 parameters and the tracker's frame" in caught.value.problem
    assert "at least 13 shots" in caught.value.remedy
    data = simulated(10, 0, seed=1)
    line = 1000.0 + np.outer(np.linspace(0.0, 1.0, 20), [300.0, 200.0, 100.0])
    with pytest.raises(ShotsMissing, match="20 shots fix no frame: points on one line"):
        by_points(replace(data, points_in_tracker_mm=line))


@pytest.mark.parametrize("estimator", list(Estimator))
def test_no_shots_at_all_are_refused(estimator: Estimator) -> None:
    with pytest.raises(ShotsMissing, match=r"^0 (shots|pairs)"):
        identified(dataset(np.empty((0, 4)), np.empty((0, 3)), [], []), estimator)


def test_thirteen_shots_or_ten_with_priors_tell_22_parameters() -> None:
    data = noisy(simulated(7, 5, seed=1), seed=1)
    one_less = (ShotSet.DRIFT, *data.purposes[1:])
    found = by_points(replace(data, purposes=one_less, pairs=(None, *data.pairs[1:])))
    assert (found.rank, found.dof) == (22, 39 - 28)
    assert found.unobservable == ()
    ten = noisy(simulated(5, 5, seed=1), seed=1)
    found = by_points(ten, prior=["arm*.arm_mm=0.5", "arm*.forearm_mm=0.5"])
    assert (found.rank, found.dof) == (22, 30 + 8 - 28)
    assert len(found.fitted.after_mm) == 10


def test_as_many_coordinates_as_unknowns_give_deviations_but_no_test_of_noise() -> None:
    six = noisy(simulated(3, 5, seed=3), seed=1)
    found = by_points(six, fix=["arm1.[xyz]_mm", "arm3.*", "plate_mm"])
    assert (found.rank, found.dof) == (12, 0)
    assert found.chi2.p is None
    assert found.chi2.believable is None
    assert "nothing shows" in found.chi2.says
    assert deviations(found)["arm2.x_mm"] > 0.0
