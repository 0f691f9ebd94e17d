"""Numbers of the report against numbers found another way."""

from dataclasses import replace

import numpy as np
import pytest
from paper_campaign import ERRORS, NOISE_MM, NOMINAL, PaperCampaign, new_campaign

from app.report.collect import collect
from app.report.contents import Contents, contents_of
from app.report.explained import ResidualBudget, correlations_of
from app.report.iso_table import iso_rows
from app.report.statistics import summary
from campaigns.controllers.export import latest_identification
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.evaluation.validation import evaluate_validation
from campaigns.shots.shot_sets import ShotSet

INSTRUMENT = TrackerUncertainty()


@pytest.fixture(scope="module")
def contents(whole: PaperCampaign) -> Contents:
    return contents_of(collect(whole.campaign), INSTRUMENT)


def told_by(paper: PaperCampaign) -> dict[str, object]:
    with paper.journal() as journal:
        return latest_identification(journal)


@pytest.mark.parametrize("estimator", ["points", "distances"])
def test_errors_are_those_that_the_identification_told(
    whole: PaperCampaign, by_distances: PaperCampaign, estimator: str
) -> None:
    paper = whole if estimator == "points" else by_distances
    errors, told = contents_of(collect(paper.campaign), INSTRUMENT).errors, told_by(paper)
    fitted = errors.shots if estimator == "points" else errors.fitted
    assert (errors.shots is None) == (estimator == "distances")
    for group, name in ((fitted, "residuals_mm"), (errors.unseen, "unseen_mm")):
        for values, stage in ((group.before_mm, "before"), (group.after_mm, "after")):
            found = summary(np.linalg.norm(values.reshape(len(values), -1), axis=1))
            assert found.mean == pytest.approx(told[name][stage]["mean_abs"], rel=1e-6)
            assert found.max == pytest.approx(told[name][stage]["max_abs"], rel=1e-6)


@pytest.mark.parametrize("stage", ["before", "after"])
def test_traces_say_what_the_validation_says(contents: Contents, stage: str) -> None:
    view = getattr(contents, stage)
    found = evaluate_validation(view.measured.shots)
    assert summary(view.distances.errors_mm).max == pytest.approx(found.distances.max_abs)
    assert view.turn.moved.value_mm == pytest.approx(found.rotation_mm)
    assert view.cloud.radius.value_mm == pytest.approx(found.repeatability.radius_mm)
    assert summary(view.absolute_mm).max == pytest.approx(found.frame.max)
    for axis in ("x", "y", "z"):
        straight = view.line(axis).straightness.value_mm
        assert straight == pytest.approx(found.straightness_mm[axis])


def test_repeatability_is_the_iso_figure_of_the_same_points(contents: Contents) -> None:
    found = evaluate_validation(contents.after.measured.shots).repeatability
    row = next(row for row in iso_rows(contents.after) if row.symbol == "RP")
    assert row.figure.value_mm == pytest.approx(found.rp_mm)
    assert row.figure.n == found.approaches


def test_symbols_whose_tests_were_not_made_have_no_figure(contents: Contents) -> None:
    without = {row.symbol for row in iso_rows(contents.after) if row.figure is None}
    assert without == {"vAP", "RD"}


def test_the_truth_lies_within_the_stated_deviations(contents: Contents) -> None:
    parameters = contents.evidence.identification.parameters
    true = NOMINAL.robot.geometry_flat()
    misses = [
        (each.value - true[name] - ERRORS.get(name, 0.0)) / each.std
        for name, each in parameters.items()
        if each.free
    ]
    assert np.abs(misses).max() < 4.5
    assert 0.4 < np.sqrt(np.mean(np.square(misses))) < 1.8


def test_residuals_of_a_perfect_robot_are_the_trackers_noise(
    contents: Contents, by_distances: PaperCampaign
) -> None:
    of_pairs = contents_of(collect(by_distances.campaign), INSTRUMENT).remainder
    assert (contents.remainder.of, of_pairs.of) == ("coordinate", "distance")
    for left, noise_mm in ((contents.remainder, NOISE_MM), (of_pairs, np.sqrt(2.0) * NOISE_MM)):
        assert left.chi == pytest.approx(1.0, abs=0.4)
        assert left.residual_mm == pytest.approx(noise_mm, rel=0.4)
        assert left.instrument_mm == pytest.approx(noise_mm)
        assert left.repeatability_mm == pytest.approx(noise_mm, rel=0.4)


def test_what_neither_tracker_nor_repeatability_explains_is_left() -> None:
    left = ResidualBudget("distance", 0.5, 0.01, 0.3, 50.0, 38)
    assert left.unexplained_mm == pytest.approx(0.4)
    assert replace(left, repeatability_mm=0.6).unexplained_mm == 0.0
    unknown = replace(left, instrument_mm=0.3, repeatability_mm=None)
    assert unknown.unexplained_mm == pytest.approx(0.4)


def test_correlations_are_symmetric_with_ones_and_sorted_by_size(contents: Contents) -> None:
    found = contents.correlations
    assert np.allclose(found.matrix, found.matrix.T)
    assert np.allclose(np.diag(found.matrix), 1.0)
    strongest = [abs(each.value) for each in found.strongest(5)]
    assert strongest == sorted(strongest, reverse=True)
    above = np.abs(found.matrix[np.triu_indices(len(found.names), 1)])
    assert strongest[0] == pytest.approx(above.max())


def test_an_identification_of_older_software_has_no_correlations(whole: PaperCampaign) -> None:
    finding = collect(whole.campaign).identification
    older = finding.model_copy(update={"covariance": None})
    assert correlations_of(older) is None
    assert correlations_of(finding).names == finding.free


def test_pairs_that_were_left_out_are_not_counted(whole: PaperCampaign) -> None:
    from app.report.findings import ExcludedFinding
    from app.report.model_errors import model_errors, models_of
    from campaigns.robots.robot import numeric_geometry

    evidence = collect(whole.campaign)
    models = models_of(evidence.identification, numeric_geometry(NOMINAL.robot))
    excluded = (ExcludedFinding(reason="", pair=3), ExcludedFinding(reason="", shot=9))
    found = model_errors(evidence.run, models, excluded, INSTRUMENT)
    numbers = dict(zip(evidence.run.data.numbers, evidence.run.data.pairs, strict=True))
    assert 3 not in found.fitted.pairs
    assert numbers[9] not in found.fitted.pairs
    assert len(found.fitted.pairs) == 38


def test_errors_of_position_are_in_the_base_frame(contents: Contents) -> None:
    positions = contents.errors.positions
    after = np.linalg.norm(positions.after_mm, axis=1)
    assert after.max() < 10.0 * NOISE_MM
    assert np.linalg.norm(positions.before_mm, axis=1).max() > 1.0
    assert positions.fitted.sum() == 80


def test_drift_and_air_are_read_off_in_their_time(contents: Contents) -> None:
    run = next(course for course in contents.courses if course.name == "run")
    assert len(run.drift_mm) == 2
    assert run.drift_mm[0] == 0.0
    assert np.all(np.diff(run.temperature_s) > 0.0)
    assert run.temperature_degC[0] == pytest.approx(20.0)


def test_shots_without_a_stated_uncertainty_get_the_instruments(tmp_path) -> None:
    paper = new_campaign(tmp_path / "x")
    paper.validate("before", frozenset({ShotSet.ROTATION}))
    evidence = collect(paper.campaign)

    from campaigns.evaluation.validation import measured_test

    shots = evidence.before.shots
    bare = [replace(s, outcome=replace(s.outcome, covariance_mm2=None)) for s in shots]
    stated, assumed = (measured_test(s, INSTRUMENT).covariance_mm2 for s in (shots, bare))
    assert np.allclose(stated, NOISE_MM**2 * np.eye(3))
    assert assumed[0].trace() > stated[0].trace()


def test_a_summary_of_one_error_has_no_deviation() -> None:
    found = summary(np.array([-2.0]))
    assert (found.n, found.mean, found.max, found.sigma) == (1, 2.0, 2.0, None)
    assert found.mean_plus_3_sigma is None


def test_a_summary_is_of_absolute_values() -> None:
    found = summary(np.array([-1.0, 1.0, -3.0, 3.0]))
    assert (found.mean, found.max) == (2.0, 3.0)
    assert found.sigma == pytest.approx(np.sqrt(4.0 / 3.0))
    assert found.mean_plus_3_sigma == pytest.approx(2.0 + 3.0 * np.sqrt(4.0 / 3.0))
    assert found.p95 == pytest.approx(3.0)


def test_nothing_cannot_be_summarised() -> None:
    with pytest.raises(ValueError, match="no errors"):
        summary(np.array([]))
