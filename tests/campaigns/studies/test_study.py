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
from campaigns.studies.study import CampaignRow, StudySetup, planned_shots, simulate_campaigns
from campaigns.studies.summary import chance, normal_scores, summarise
from campaigns.studies.table import MOST_LINE_BYTES, StudyTable
from drivers.values import Pose

pytestmark = pytest.mark.slow

COUNT = 30


@pytest.fixture(scope="module")
def setup():
    """60 shots of the prototype."""
    robot = find_robot("par4-prototype").robot
    view = View((2500.0, 0.0, -500.0), (2500.0, 0.0, 75.0), np.radians(25.0))
    request = PlanRequest(60, 5, 2, Pose(0.0, 0.0, -575.0, 0.0))
    return StudySetup(
        nominal=robot.kinematics,
        shots=planned_shots(make_plan(robot, view, request, np.random.default_rng(1))),
        options=IdentificationOptions(instrument=TrackerUncertainty(0.009, 0.0, 0.009, 0.0)),
        tracker_from_base=from_paper_angles(
            np.array([0.02, -0.03, 2.1]), np.array([2500.0, 400.0, 0.0])
        ),
        workspace=sample_workspace(robot, 60),
        seed=3,
    )


@pytest.fixture(scope="module")
def outcomes(setup):
    return tuple(simulate_campaigns(setup, range(COUNT)))


def names(setup):
    return setup.model().parameters


def test_numbers_depend_on_the_seed_and_not_on_how_campaigns_are_divided(setup, outcomes):
    again = tuple(simulate_campaigns(setup, [4, 2]))
    assert again == (outcomes[4], outcomes[2])
    other = next(iter(simulate_campaigns(replace(setup, seed=4), [2])))
    assert other != outcomes[2]


def test_stated_deviations_of_parameters_and_positions_are_true(setup, outcomes):
    summary = summarise(names(setup), outcomes)
    assert summary.failed == 0
    assert not summary.too_sure
    ratios = [parameter.ratio for parameter in summary.parameters]
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.1)
    assert np.mean([parameter.covered for parameter in summary.parameters]) > 0.9
    assert summary.position_mm == pytest.approx(summary.stated_mm, rel=0.25)
    # tails are heavier than normal ones, because the sizes of groups are estimated too
    assert np.median(np.abs(normal_scores(outcomes))) == pytest.approx(0.6745, abs=0.1)
    estimates = [row.estimate for row in outcomes]
    halved = [
        replace(row, estimate=replace(estimate, std=tuple(0.5 * s for s in estimate.std)))
        for row, estimate in zip(outcomes, estimates, strict=True)
    ]
    assert summarise(names(setup), halved).too_sure


def test_an_instrument_of_ones_own_measures_in_the_trackers_place(setup, outcomes):
    noisy = replace(setup, noise=lambda points_mm, rng: rng.normal(0.0, 0.1, points_mm.shape))
    loud = np.mean([row.estimate.position_mm for row in simulate_campaigns(noisy, range(2))])
    assert loud > 2.0 * np.mean([row.estimate.position_mm for row in outcomes[:2]])


def test_held_parameters_are_neither_drawn_nor_found(setup):
    held = replace(setup, options=replace(setup.options, fix=("rods", "bars", "sag")))
    assert not [name for name in names(held) if "skew" in name or "bar_turn" in name]
    (row,) = simulate_campaigns(held, [0])
    assert len(row.estimate.errors) == len(names(held))


def test_campaign_that_cannot_be_measured_is_an_outcome_and_spoils_no_other(setup, outcomes):
    broken = replace(setup, spread=(400.0, 40.0))
    rows = tuple(simulate_campaigns(broken, range(3)))
    assert all(row.failure or row.estimate for row in rows)
    assert any(row.failure for row in rows)


def test_plan_of_too_few_shots_is_refused():
    with pytest.raises(PlanInvalid, match="0 shots to identify from are too few"):
        planned_shots([])


def test_study_of_failures_is_refused_with_their_reason(setup):
    failures = [CampaignRow(number, failure="the mechanism broke") for number in range(3)]
    with pytest.raises(ShotsMissing, match=r"0 of 3 campaigns.*the mechanism broke"):
        summarise(names(setup), failures)


def test_chance_gets_narrower_with_more_campaigns():
    few, many = chance(22, 50), chance(22, 5000)
    assert few["ratio"][0] < many["ratio"][0] < 1.0 < many["ratio"][1] < few["ratio"][1]
    assert few["covered_95"][0] < many["covered_95"][0] < 0.95


def begin(table):
    """As a study begins, or goes on: what is there, taken up by a new process."""
    fresh = replace(table, by_number={})
    fresh.read()
    fresh.write()
    return fresh


def head(study="0123456789ab", names=("a", "b")):
    return {"schema": "pkmcal/study-table/3", "study": study, "parameters": list(names)}


@pytest.fixture
def table(tmp_path):
    return begin(StudyTable(tmp_path / "study.jsonl", head()))


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


def test_line_without_end_is_not_read(table):
    table.path.write_bytes(table.path.read_bytes() + b" " * MOST_LINE_BYTES)
    with pytest.raises(OutputExists, match="a line has more than 1 MB"):
        begin(table)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (json.dumps(head(study="ba9876543210")), r"study\.jsonl: belongs to another study"),
        (json.dumps(head(names=("a",))), r"a study of other parameters .* another folder"),
        ("", "is no table of `pkmcal study`"),
        ("[" * 99_999 + "\n", "is no table of `pkmcal study`"),
        ("mine", "is no table of `pkmcal study`"),
    ],
)
def test_any_other_file_is_refused_and_left_alone(table, text, said):
    table.path.write_text(text, encoding="utf-8")
    with pytest.raises(OutputExists, match=said):
        begin(table)
    assert table.path.read_text(encoding="utf-8") == text


@pytest.mark.parametrize("line", ["", '{"campaign": "one"}'])
def test_foreign_line_is_refused_with_its_number(table, outcomes, line):
    table.add(outcomes[:1])
    table.path.write_text(table.path.read_text() + line + "\n")
    with pytest.raises(OutputExists, match=r"study\.jsonl:3: is no result of `pkmcal study`"):
        begin(table)


def test_table_that_cannot_be_written_says_so(table, outcomes):
    table.path.unlink()
    table.path.mkdir()
    with pytest.raises(WriteFailed, match="cannot be written"):
        table.add(outcomes[:1])
