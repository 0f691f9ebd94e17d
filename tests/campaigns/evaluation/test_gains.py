"""Gains: what is a difference, and what is within its uncertainty."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from paper_campaign import PaperCampaign, new_campaign
from par4_space import with_values

from campaigns.assessment import Evaluation, evaluate
from campaigns.evaluation.measured_lengths import MeasuredLength
from campaigns.evaluation.summary import BeforeAfter, Spread
from campaigns.evaluation.validation import DistanceTest, ValidationResult
from campaigns.evaluation.verdict import Gain, gained_in_words
from campaigns.fit.error_sources import SCATTER_TOLERANCE_MM
from campaigns.shots.shot_sets import ShotSet
from campaigns.workflow.validation import record_validation

BY_MODEL = BeforeAfter(Spread(3.0, 3.0, 9.0), Spread(0.3, 0.3, 0.9))


def gain(before_mm: float, after_mm: float) -> Gain:
    """Each with a standard uncertainty of 0.03 and 0.04 mm: U of the difference is 0.1 mm."""
    return Gain("rotation", MeasuredLength(before_mm, 0.03), MeasuredLength(after_mm, 0.04))


@pytest.mark.parametrize(
    ("after_mm", "shown"), [(1.099, False), (1.101, True), (0.901, False), (0.899, True)]
)
def test_a_difference_within_its_uncertainty_is_no_change(after_mm: float, shown: bool) -> None:
    found = gain(1.0, after_mm)
    assert found.expanded_uncertainty_mm == pytest.approx(0.1)
    assert found.shown is shown


def test_without_a_measurement_before_the_gain_is_that_of_the_model() -> None:
    measured_once = Gain("rotation", None, MeasuredLength(1.0, 0.1))
    assert (measured_once.shown, measured_once.expanded_uncertainty_mm) == (None, None)
    by_robot = gained_in_words((gain(2.0, 0.5),), BY_MODEL)
    assert by_robot == "Measured before and after: rotation 2.000 → 0.500 mm."
    by_model = gained_in_words((measured_once,), BY_MODEL)
    assert by_model.startswith("By the model, not yet by the commanded robot")
    assert gained_in_words((), None) == ""


def test_the_robots_scatter_is_in_the_uncertainty_of_a_comparison(whole: PaperCampaign) -> None:
    found = evaluate(whole.campaign)
    assert found.scatter.source == "identification"
    after, noise = found.after, found.evidence.identification.uncertainty.scatter
    assert found.scatter.point_mm == noise.point_mm
    assert found.scatter.joint == np.radians(noise.joint)
    plain, compared = after.figures()["rotation"], after.comparable_figures()["rotation"]
    assert compared == plain
    assert plain.robot_mm > np.sqrt(2.0) * noise.point_mm  # the joints' scatter comes on top


def test_without_an_identification_the_scatter_is_that_of_the_repeated_visits(whole) -> None:
    evidence = replace(evaluate(whole.campaign).evidence, identification=None)
    after = Evaluation(evidence).after
    away = after.repeatability.away_mm
    assert after.scatter.source == "repeated visits"
    scatter_mm = np.sqrt(np.sum(away**2) / (3 * (len(away) - 1)))
    assert after.scatter.point_mm == pytest.approx(scatter_mm)
    assert after.scatter.dof == 3 * (len(away) - 1)
    moved = after.figures()["rotation"]
    assert moved.robot_mm == pytest.approx(np.sqrt(2.0) * after.scatter.point_mm)


def test_unknown_scatter_is_stated_and_compared_by_its_bound() -> None:
    test = DistanceTest((1, 2), np.zeros(2), np.ones(2), np.full(2, 0.01), np.zeros(2))
    unknown = ValidationResult(test, None, None, (), None)
    assert unknown.scatter.says.startswith("U is of the instrument alone")
    name = "distances, mean error"
    assert unknown.figures()[name].robot_mm == 0.0
    assert unknown.comparable_figures()[name].robot_mm == pytest.approx(SCATTER_TOLERANCE_MM)


@pytest.fixture(scope="module")
def in_parts(tmp_path_factory: pytest.TempPathFactory) -> PaperCampaign:
    """Before calibration the tests were measured one by one."""
    paper = new_campaign(tmp_path_factory.mktemp("parts") / "x")
    paper.validate("before", frozenset({ShotSet.VALIDATION}))
    paper.validate("before", frozenset({ShotSet.ROTATION}))
    paper.run(pairs=20, unseen=4)
    paper.identify()
    paper.export_and_load()
    paper.validate("after")
    return paper


def test_of_several_validations_the_latest_of_each_test_counts_for_all_who_ask(in_parts) -> None:
    found = evaluate(in_parts.campaign)
    before = {each.name: each.before for each in found.gains}
    assert before["distances, mean error"].value_mm > 1.0
    assert before["rotation"] is not None
    assert before["repeatability, radius of the sphere"] is None
    assert found.before.series == {"distances": 1, "rotation": 2}
    with in_parts.journal() as journal:
        told = record_validation(in_parts.campaign, journal, 4, "after")
    assert [each.name for each in told.evaluation.gains] == [each.name for each in found.gains]
    assert told.verdict == found.validated("after")


def test_what_was_measured_with_other_parameters_is_of_no_use(tmp_path: Path) -> None:
    paper = new_campaign(tmp_path / "x")
    paper.validate("before", frozenset({ShotSet.VALIDATION}))
    held = paper.campaign.robot
    paper.controller = with_values(held, {"plate_mm": held.parameters["plate_mm"] + 1.0}).kinematics
    paper.validate("before", frozenset({ShotSet.ROTATION}))
    assert evaluate(paper.campaign).before.series == {"rotation": 2}
