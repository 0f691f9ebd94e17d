"""Simulated campaigns: the same numbers wherever they are computed, kept and judged honestly."""

from dataclasses import replace

import numpy as np
import pytest

from campaigns.errors import OutputExists, ShotsMissing, WriteFailed
from campaigns.numerics.frames import Transform, small_rotation
from campaigns.numerics.geometry import FREE_BY_DEFAULT, IS_ANGLE, NAMES, indices
from campaigns.numerics.instrument import TrackerUncertainty
from campaigns.planning import (
    PlanRequest,
    View,
    joints_of,
    make_plan,
    numeric_geometry,
    pairs_of,
)
from campaigns.robot import find_robot
from campaigns.shot_sets import ShotSet
from campaigns.study import CampaignOutcome, PairedShots, StudySetup, StudyTask, run_task
from campaigns.study_summary import interval_factor, summarise
from campaigns.study_table import StudyTable
from drivers.values import Pose

ROBOT = find_robot("par4-prototype").robot
NOMINAL = numeric_geometry(ROBOT)
FREE = indices(FREE_BY_DEFAULT)
NOISE_MM = 0.015 / 3**0.5
TRACKER = Transform(small_rotation(np.array([2.1, 0.02, -0.03]))[0], np.array([2500.0, 400.0, 0.0]))


@pytest.fixture(scope="module")
def setup():
    view = View((2500.0, 0.0, -500.0), (2500.0, 0.0, 75.0), np.radians(25.0))
    request = PlanRequest(80, 5, 2, Pose(0.0, 0.0, -575.0, 0.0))
    plan = make_plan(ROBOT, view, request, np.random.default_rng(1))

    def paired(purpose):
        shots = [shot for shot in plan if shot.purpose is purpose]
        return PairedShots(joints_of(shots), pairs_of(shots, purpose))

    fitted, unseen = paired(ShotSet.IDENTIFICATION), paired(ShotSet.VALIDATION)
    noise = TrackerUncertainty(NOISE_MM, 0.0, NOISE_MM, 0.0)
    return StudySetup(NOMINAL, FREE_BY_DEFAULT, "points", fitted, unseen, TRACKER, noise, seed=3)


def robots(count, seed=5):
    std = np.zeros(29)
    std[FREE] = np.where(IS_ANGLE[FREE], np.radians(0.1), 0.5)
    return NOMINAL.vector() + std * np.random.default_rng(seed).standard_normal((count, 29))


def run(setup, numbers, truths):
    return run_task(StudyTask(setup, tuple(numbers), truths))


@pytest.fixture(scope="module")
def outcomes(setup):
    return run(setup, range(150), robots(150))


def flat(outcomes):
    """All numbers of all outcomes."""
    rows = []
    for outcome in outcomes:
        found = outcome.estimate
        rows.append([*found.errors, *found.std, found.unseen_mean_mm, found.unseen_max_mm])
    return np.array(rows)


@pytest.mark.parametrize("estimator", ["points", "distances"])
def test_without_noise_the_truth_is_found(setup, estimator):
    silent = TrackerUncertainty(1e-9, 0.0, 1e-9, 0.0)
    (outcome,) = run(replace(setup, uncertainty=silent, estimator=estimator), [0], robots(1))
    assert np.abs(outcome.estimate.errors).max() < 1e-5
    assert outcome.estimate.unseen_max_mm < 1e-5


def test_numbers_do_not_depend_on_how_campaigns_are_divided(setup, outcomes):
    truths = robots(150)
    again = run(setup, [7, 3], truths[[7, 3]])
    np.testing.assert_array_equal(flat(again), flat([outcomes[7], outcomes[3]]))


def test_another_seed_gives_other_numbers(setup, outcomes):
    (other,) = run(replace(setup, seed=4), [0], robots(150)[:1])
    assert not np.array_equal(other.estimate.errors, outcomes[0].estimate.errors)


def test_stated_deviations_are_true_for_points(setup, outcomes):
    summary = summarise(setup, outcomes)
    ratios = np.array([parameter.ratio for parameter in summary.parameters])
    assert 0.95 < ratios.mean() < 1.05
    covered = np.mean([parameter.covered for parameter in summary.parameters])
    assert 0.93 < covered < 0.97


def test_stated_deviations_are_true_for_distances(setup):
    by_distances = replace(setup, estimator="distances")
    summary = summarise(by_distances, run(by_distances, range(150), robots(150)))
    covered = np.mean([parameter.covered for parameter in summary.parameters])
    assert 0.93 < covered < 0.97
    assert interval_factor(by_distances) == pytest.approx(2.101, abs=1e-3), "18 left over"


def test_wrong_noise_model_shows_in_the_coverage(setup, outcomes):
    halved = [
        replace(outcome, estimate=replace(outcome.estimate, std=0.5 * outcome.estimate.std))
        for outcome in outcomes
    ]
    summary = summarise(setup, halved)
    assert np.mean([parameter.covered for parameter in summary.parameters]) < 0.8
    assert np.mean([parameter.ratio for parameter in summary.parameters]) > 1.8


def test_campaign_that_cannot_be_measured_is_an_outcome_and_spoils_no_other(setup, outcomes):
    truths = robots(150)[:3]
    truths[1, NAMES.index("arm0.forearm_mm")] = 100.0
    first, failed, third = run(setup, [0, 1, 2], truths)
    assert failed.estimate is None
    assert "no assembly" in failed.failure
    np.testing.assert_array_equal(flat([first, third]), flat([outcomes[0], outcomes[2]]))
    summary = summarise(setup, [first, failed, third])
    assert (summary.campaigns, summary.failed) == (2, 1)


def test_study_of_failures_is_refused_with_their_reason(setup):
    failures = [CampaignOutcome(number, None, "the mechanism broke") for number in range(3)]
    with pytest.raises(ShotsMissing, match=r"0 of 3 campaigns.*the mechanism broke"):
        summarise(setup, failures)


def test_study_without_unseen_pairs_says_nothing_of_them(setup):
    nothing = PairedShots(np.empty((0, 4)), np.empty((0, 2), dtype=np.intp))
    blind = replace(setup, unseen=nothing)
    summary = summarise(blind, run(blind, range(3), robots(3)))
    assert summary.unseen_mean_mm is None
    assert summary.unseen_max_mm is None


def test_digest_tells_studies_apart(setup):
    others = [
        setup.digest("other robots"),
        replace(setup, seed=4).digest("robots"),
        replace(setup, estimator="distances").digest("robots"),
        replace(setup, unseen=setup.fitted).digest("robots"),
        replace(setup, free=FREE_BY_DEFAULT[1:]).digest("robots"),
        replace(setup, uncertainty=TrackerUncertainty()).digest("robots"),
    ]
    assert len({setup.digest("robots"), *others}) == 7
    assert setup.digest("robots") == replace(setup).digest("robots")


def begin(table):
    """As a study begins, or goes on."""
    known = table.read()
    table.write(known)
    return known


@pytest.fixture
def table(tmp_path):
    return StudyTable(tmp_path / "study.csv", "0123456789ab", FREE_BY_DEFAULT)


def test_table_gives_back_what_was_written(table, outcomes):
    begin(table)
    failed = CampaignOutcome(151, None, "no assembly for row 3 of 80")
    table.append([outcomes[4], failed])
    table.append([outcomes[2]])
    known = begin(table)
    assert sorted(known) == [2, 4, 151]
    assert known[151].failure == failed.failure
    assert known[151].estimate is None
    kept = flat([known[4], known[2]])
    np.testing.assert_array_equal(kept, flat([outcomes[4], outcomes[2]]))


def test_table_is_the_same_in_whatever_order_rows_came(table, outcomes):
    begin(table)
    table.append(outcomes[:5])
    begin(table)
    one = table.path.read_bytes()
    table.path.unlink()
    begin(table)
    for outcome in reversed(outcomes[:5]):
        table.append([outcome])
    begin(table)
    assert table.path.read_bytes() == one


def test_row_that_was_cut_off_is_computed_again(table, outcomes):
    begin(table)
    table.append(outcomes[:3])
    whole = table.path.read_text(encoding="utf-8")
    table.path.write_text(whole[:-40], encoding="utf-8")
    assert list(begin(table)) == [0, 1]
    table.append([outcomes[2]])
    assert table.path.read_text(encoding="utf-8") == whole


def test_table_of_another_study_is_refused_and_left_alone(table, outcomes):
    begin(table)
    table.append(outcomes[:2])
    before = table.path.read_bytes()
    other = replace(table, study="ba9876543210")
    with pytest.raises(OutputExists, match=r"study\.csv:2: belongs to another study"):
        begin(other)
    assert table.path.read_bytes() == before


def test_any_other_file_is_refused_and_left_alone(table):
    table.path.write_text("x,y\n1,2\n", encoding="utf-8")
    with pytest.raises(OutputExists, match="unknown column 'x'"):
        begin(table)
    assert table.path.read_text(encoding="utf-8") == "x,y\n1,2\n"


def test_table_that_cannot_be_written_says_so(table, outcomes):
    table.path.mkdir()
    with pytest.raises(WriteFailed, match="cannot be written"):
        table.append(outcomes[:1])
