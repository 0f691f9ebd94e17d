"""Plan, run, identification, correction and study state one uncertainty of the same shots."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from fake_cell import CENTRE, NOMINAL, ROBOT
from goal_plans import PLAN, TRACKER_MM
from small_plans import SETUP, work

from campaigns.api import study
from campaigns.controllers.corrected_targets import TargetCorrection
from campaigns.design.pose_sampling import sample_workspace
from campaigns.design.restricted_space import UNRESTRICTED
from campaigns.estimation.information import Uncertainty
from campaigns.estimation.tracker_noise import point_covariance_mm2
from campaigns.identification.identify import identify
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.parameter_selection import ParameterSelection
from campaigns.identification.result import IdentificationResult
from campaigns.journal.records import Outcome
from campaigns.measuring.run_state import ParameterUncertainty
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.planning.plans import joints_of, poses_of
from campaigns.planning.predicted_uncertainty import Forecast, judged_positions, plan_forecast
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import shots_of_outcomes

FREE = SETUP.free
POSES = sample_workspace(NOMINAL, ROBOT.limits, CENTRE)
BAD_MM = 0.5


def outcomes(unseen_off_mm: float = 0.0) -> list[Outcome]:
    """The plan's shots by a nominal robot, whose tracker states nothing; unseen ones may be off."""
    points = poses_of(PLAN)[:, :3] - TRACKER_MM
    root = np.linalg.cholesky(point_covariance_mm2(points, SETUP.uncertainty))
    noise = np.random.default_rng(4).standard_normal(points.shape)
    points = points + np.einsum("nij,nj->ni", root, noise)
    for row, shot in enumerate(PLAN):
        if shot.purpose is ShotSet.VALIDATION:
            points[row] *= 1.0 + unseen_off_mm * (-1) ** row / np.linalg.norm(points[row])
    measured = zip(PLAN, joints_of(PLAN).tolist(), points.tolist(), strict=True)
    return [
        Outcome(shot.shot, 1, tuple(joints), tuple(point), None, None, "", "", None)
        for shot, joints, point in measured
    ]


@dataclass(frozen=True)
class Told:
    run: ParameterUncertainty
    found: IdentificationResult


def told(unseen_off_mm: float = 0.0) -> Told:
    measured = outcomes(unseen_off_mm)
    shots = shots_of_outcomes(
        measured,
        ROBOT.mechanism,
        purposes=[shot.purpose for shot in PLAN],
        pairs=[shot.pair for shot in PLAN],
        targets=[shot.pose for shot in PLAN],
    )
    options = IdentificationOptions(instrument=SETUP.uncertainty, workspace=POSES)
    run = work(PLAN).uncertainty_monitor().fitted(measured)
    assert run is not None
    return Told(run, identify(NOMINAL, shots, ParameterSelection(FREE), options))


@pytest.fixture(scope="module")
def good() -> Told:
    return told()


@pytest.fixture(scope="module")
def doubtful() -> Told:
    """Of shots whose hold-out pairs are further off than their σ say."""
    return told(BAD_MM)


@pytest.fixture(scope="module")
def forecast() -> Forecast:
    sample = judged_positions(ROBOT, CENTRE, UNRESTRICTED, FREE, PLAN)
    return plan_forecast(PLAN, NOMINAL, np.array(TRACKER_MM), SETUP, sample)


def test_a_plan_foretells_what_is_identified(good: Told, forecast: Forecast) -> None:
    assert forecast.predicted.std() == pytest.approx(good.found.std(), rel=1e-3)
    assert forecast.position_std_mm.mean() == pytest.approx(
        good.found.position_std_mm.mean, rel=1e-3
    )
    assert forecast.position_std_mm.max() == pytest.approx(good.found.position_std_mm.max, rel=1e-3)


def test_a_plan_foretells_what_all_shots_have_in_common(good: Told, forecast: Forecast) -> None:
    found, total_mm = good.found.position_std_mm, forecast.total_position_std_mm
    assert total_mm.mean() == pytest.approx(found.total_mean, rel=0.1)
    assert total_mm.max() == pytest.approx(found.total_max, rel=0.1)
    assert total_mm.mean() > forecast.position_std_mm.mean()
    foreseen = work(PLAN).uncertainty_monitor().predicted(TRACKER_MM)
    assert foreseen.position_std_mm == pytest.approx(forecast.position_std_mm.mean(), rel=1e-9)
    assert foreseen.total_position_std_mm == pytest.approx(total_mm.mean(), rel=1e-9)


@pytest.mark.parametrize("case", ["good", "doubtful"])
def test_a_run_states_what_is_identified(case: str, request: pytest.FixtureRequest) -> None:
    told: Told = request.getfixturevalue(case)
    run, found = told.run, told.found
    assert run.weakest_std == pytest.approx(found.std()[run.weakest], rel=1e-9)
    assert run.length_std_mm == pytest.approx(found.covariance.largest("mm"), rel=1e-9)
    assert run.position_std_mm == pytest.approx(found.position_std_mm.mean, rel=1e-9)
    assert run.total_position_std_mm == pytest.approx(found.position_std_mm.total_mean, rel=1e-9)
    assert found.chi2.scale == found.covariance.sigma0


def test_unseen_pairs_that_contradict_widen_positions_by_their_ratio(
    good: Told, doubtful: Told
) -> None:
    ratio = doubtful.found.hold_out.ratio
    assert good.found.covariance.hold_out_ratio == 1.0
    assert doubtful.found.covariance.hold_out_ratio == ratio > 3.0
    plain_mm = good.found.position_std_mm.mean
    assert doubtful.found.position_std_mm.mean == pytest.approx(ratio * plain_mm, rel=1e-9)


@pytest.mark.parametrize("case", ["good", "doubtful"])
def test_corrected_targets_are_as_sure_as_positions(
    case: str, request: pytest.FixtureRequest
) -> None:
    """In the frame of the very poses at which positions are judged."""
    found: IdentificationResult = request.getfixturevalue(case).found
    space, p = ROBOT.mechanism.parameters, NOMINAL.p.copy()
    p[space.places(FREE)] = [found.parameters[name].value for name in FREE] * space.units(FREE)
    correction = TargetCorrection(Kinematics(ROBOT.mechanism, p), NOMINAL, ROBOT.limits)
    known = replace(correction, uncertainty=found.covariance, measured=POSES)
    std_mm = known.std_mm(POSES)
    assert std_mm.mean() == pytest.approx(found.position_std_mm.total_mean, rel=1e-6)
    assert std_mm.max() == pytest.approx(found.position_std_mm.total_max, rel=1e-6)


def test_a_study_states_what_is_identified(good: Told) -> None:
    drawn = study(ROBOT, PLAN, TRACKER_MM, campaigns=2, free=FREE, spread=(0.0, 0.0), seed=2)
    stated = {row.name: row.stated_std for row in drawn.parameters}
    assert stated == pytest.approx(good.found.std(), rel=1e-2)


class TestUncertainty:
    names = ("arm1.x_mm", "plate_mm", "arm1.joint_offset_deg")
    units = np.array([1.0, 1.0, np.radians(1.0)])
    known = Uncertainty.of(
        names, units, np.array([[0.04, 0.03, 0.0], [0.03, 0.09, 0.0], [0.0, 0.0, 0.01]]), dof=4
    )

    def test_it_is_in_the_units_of_the_names_with_their_correlations(self) -> None:
        assert self.known.std() == pytest.approx(
            dict(zip(self.names, (0.2, 0.3, np.degrees(0.1)), strict=True))
        )
        assert self.known.largest("mm") == pytest.approx(0.3)
        assert self.known.largest("deg") == pytest.approx(np.degrees(0.1))
        assert self.known.only(self.names[:2]).largest("deg") == 0.0
        expected = [[1.0, 0.5, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 1.0]]
        assert self.known.correlations() == pytest.approx(np.array(expected))
        (strongest,) = self.known.strongest(1)
        assert (strongest.a, strongest.b) == self.names[:2]

    def test_intervals_are_students_where_the_variance_is_estimated(self) -> None:
        for dof, factor in ((4, 2.776), (None, 1.960)):
            half_mm = replace(self.known, dof=dof).interval()["plate_mm"]
            assert half_mm == pytest.approx(factor * 0.3, rel=1e-3)
