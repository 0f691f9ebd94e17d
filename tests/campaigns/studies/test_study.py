"""Simulated campaigns: the same numbers wherever they are computed, kept and judged honestly."""

import json
from dataclasses import replace

import numpy as np
import pytest

from campaigns.api import sample_workspace
from campaigns.errors import OutputExists, PlanInvalid, ShotsMissing, WriteFailed
from campaigns.fit.rigid_transforms import from_paper_angles
from campaigns.fit.tracker_noise import TrackerUncertainty
from campaigns.identification.options import IdentificationOptions
from campaigns.planning.plans import PlanRequest, View, make_plan
from campaigns.robots.robot import find_robot
from campaigns.studies.study import (
    CampaignEstimate,
    CampaignRow,
    StudySetup,
    planned_shots,
    simulate_campaigns,
)
from campaigns.studies.summary import normal_scores, summarise
from campaigns.studies.table import MOST_LINE_BYTES, StudyTable
from drivers.values import Pose

pytestmark = pytest.mark.slow

COUNT = 16


@pytest.fixture(scope="module")
def setup():
    """40 shots of the prototype."""
    robot = find_robot("par4-prototype").robot
    view = View((2500.0, 0.0, -500.0), (2500.0, 0.0, 75.0), np.radians(25.0))
    request = PlanRequest(40, 5, 2, Pose(0.0, 0.0, -575.0, 0.0))
    return StudySetup(
        nominal=robot.kinematics,
        shots=planned_shots(make_plan(robot, view, request, np.random.default_rng(1))),
        options=IdentificationOptions(instrument=TrackerUncertainty(0.009, 0.0, 0.009, 0.0)),
        tracker_from_base=from_paper_angles(np.array([0.0, 0.0, 2.1]), np.array([2500.0, 400, 0])),
        workspace=sample_workspace(robot, 30),
        seed=3,
    )


@pytest.fixture(scope="module")
def outcomes(setup):
    return tuple(simulate_campaigns(setup, range(COUNT)))


def test_numbers_depend_on_the_seed_and_not_on_how_campaigns_are_divided(setup, outcomes):
    again = tuple(simulate_campaigns(setup, [4, 2]))
    assert again == (outcomes[4], outcomes[2])
    other = next(iter(simulate_campaigns(replace(setup, seed=4), [2])))
    assert other != outcomes[2]


def test_stated_deviations_of_parameters_and_positions_are_true(setup, outcomes):
    names = setup.model.parameters
    summary = summarise(names, outcomes)
    assert summary.failed == 0
    assert not summary.too_sure
    ratios = [parameter.ratio for parameter in summary.parameters]
    # σ is averaged over the sizes that the groups may have: wider than that of robots of which
    # every group has the size 1
    assert 0.8 < np.mean(ratios) < 1.05
    assert np.mean([parameter.covered for parameter in summary.parameters]) > 0.9
    assert summary.position_mm == pytest.approx(summary.stated_mm, rel=0.25)
    # tails are heavier than normal ones, because the sizes of groups are estimated too
    assert np.median(np.abs(normal_scores(outcomes))) == pytest.approx(0.6745, abs=0.1)
    halved = [
        replace(row, estimate=replace(row.estimate, std=tuple(0.5 * s for s in row.estimate.std)))
        for row in outcomes
    ]
    assert summarise(names, halved).too_sure


def test_an_instrument_of_ones_own_measures_in_the_trackers_place(setup, outcomes):
    noisy = replace(setup, noise=lambda points_mm, rng: rng.normal(0.0, 0.1, points_mm.shape))
    loud = np.mean([row.estimate.position_mm for row in simulate_campaigns(noisy, range(2))])
    assert loud > 2.0 * np.mean([row.estimate.position_mm for row in outcomes[:2]])


def test_campaign_that_cannot_be_measured_is_an_outcome(setup):
    broken = replace(setup, spread=(400.0, 40.0))
    rows = tuple(simulate_campaigns(broken, range(2)))
    assert all(row.failure or row.estimate for row in rows)
    assert any(row.failure for row in rows)


def test_study_of_too_few_shots_or_of_failures_is_refused_with_the_reason():
    with pytest.raises(PlanInvalid, match="0 shots"):
        planned_shots([])
    failures = [CampaignRow(number, failure="the mechanism broke") for number in range(3)]
    with pytest.raises(ShotsMissing, match="the mechanism broke"):
        summarise(["plate_mm"], failures)


def rows_of(errors, stated):
    """Campaigns with these errors and stated σ, (C, F), of as many parameters."""
    return [
        CampaignRow(number, estimate=CampaignEstimate(errors=e, std=s, position_mm=1, stated_mm=1))
        for number, (e, s) in enumerate(zip(errors.tolist(), stated.tolist(), strict=True))
    ]


def test_parameter_that_never_moved_has_no_figures():
    errors = np.random.default_rng(1).normal(size=(50, 3))
    stated = np.ones((50, 3))
    errors[:, 1], stated[:, 1] = 3e-18, 1e-17
    rows = rows_of(errors, stated)
    summary = summarise(["a", "backlash", "b"], rows)
    assert summary.unseen == ("backlash",)
    assert [parameter.name for parameter in summary.parameters] == ["a", "b"]
    assert not summary.too_unsure
    assert normal_scores(rows) == pytest.approx(errors[:, [0, 2]])


def begin(table):
    """As a study begins, or goes on: what is there, taken up by a new process."""
    fresh = replace(table, by_number={})
    fresh.read()
    fresh.write()
    return fresh


HEAD = {"schema": "pkmcal/study-table/3", "study": "0123456789ab", "parameters": ["a", "b"]}


@pytest.fixture
def table(tmp_path):
    return begin(StudyTable(tmp_path / "study.jsonl", HEAD))


def test_table_gives_back_its_rows_and_is_the_same_in_whatever_order_they_came(table, outcomes):
    failed = CampaignRow(151, failure="no assembly for row 3 of 80")
    table.add([failed, outcomes[4]])
    table.add([outcomes[2]])
    again = begin(table)
    assert again.by_number == {151: failed, 2: outcomes[2], 4: outcomes[4]}
    in_order = table.path.read_bytes()
    table.path.unlink()
    other = begin(table)
    other.add([outcomes[2], outcomes[4], failed])
    assert table.path.read_bytes() == in_order


def test_row_that_was_cut_off_is_computed_again(table, outcomes):
    table.add(outcomes[:3])
    whole = table.path.read_text(encoding="utf-8")
    table.path.write_text(whole[:-40], encoding="utf-8")
    again = begin(table)
    assert list(again.by_number) == [0, 1]
    again.add([outcomes[2]])
    assert table.path.read_text(encoding="utf-8") == whole


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (json.dumps(HEAD | {"study": "ba9876543210"}), "another study"),
        (json.dumps(HEAD | {"parameters": ["a"]}), "a study of other parameters"),
        ("", "is no table"),
        ("[" * 99_999 + "\n", "is no table"),
        (json.dumps(HEAD) + "\n" + " " * MOST_LINE_BYTES, "a line has more than 1 MB"),
        (json.dumps(HEAD) + '\n{"campaign": "one"}\n', r"study\.jsonl:2: is no result"),
    ],
)
def test_any_other_file_is_refused_and_left_alone(table, text, said):
    table.path.write_text(text, encoding="utf-8")
    with pytest.raises(OutputExists, match=said):
        begin(table)
    assert table.path.read_text(encoding="utf-8") == text


def test_table_that_cannot_be_written_says_so(table, outcomes):
    table.path.unlink()
    table.path.mkdir()
    with pytest.raises(WriteFailed, match="cannot be written"):
        table.add(outcomes[:1])
