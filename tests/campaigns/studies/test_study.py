"""Simulated campaigns: the same numbers wherever they are computed, kept and judged honestly."""

from dataclasses import replace

import numpy as np
import pytest
from drawn_study import FREE, NOMINAL, TRACKER, plan, robots, setup_of
from par4_space import SPACE, par4_of

from campaigns.errors import OptionsInvalid, OutputExists, ShotsMissing, WriteFailed
from campaigns.estimation.estimators import Model
from campaigns.estimation.rigid_transforms import small_rotation
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.identification.identify import identify
from campaigns.studies.study import (
    CampaignRow,
    indistinguishable,
    simulate_campaigns,
    studied_parameters,
)
from campaigns.studies.summary import chance, normal_scores, summarise
from campaigns.studies.table import MOST_LINE_BYTES, StudyTable

pytestmark = pytest.mark.slow

NOISE_MM = 0.015 / 3**0.5
COUNT = 100


@pytest.fixture(scope="module")
def setup():
    return setup_of(plan(), TrackerUncertainty(NOISE_MM, 0.0, NOISE_MM, 0.0))


def run(setup, numbers, truths):
    return tuple(simulate_campaigns(setup, tuple(numbers), truths))


@pytest.fixture(scope="module")
def outcomes(setup):
    return run(setup, range(COUNT), robots(COUNT))


def flat(outcomes):
    """All numbers of all outcomes."""
    rows = []
    for outcome in outcomes:
        found = outcome.estimate
        rows.append([*found.errors, *found.std, *found.bound, found.position_mm, found.stated_mm])
    return np.array(rows)


def test_without_noise_the_truth_is_found(setup):
    silent = TrackerUncertainty(1e-9, 0.0, 1e-9, 0.0)
    (outcome,) = run(replace(setup, instrument=silent), [0], robots(1))
    assert np.abs(outcome.estimate.errors).max() < 1e-5
    assert outcome.estimate.position_mm < 1e-5


def test_numbers_depend_on_the_seed_and_not_on_how_campaigns_are_divided(setup, outcomes):
    truths = robots(COUNT)
    again = run(setup, [7, 3], truths[[7, 3]])
    np.testing.assert_array_equal(flat(again), flat([outcomes[7], outcomes[3]]))
    (other,) = run(replace(setup, seed=4), [0], robots(COUNT)[:1])
    assert not np.array_equal(other.estimate.errors, outcomes[0].estimate.errors)


def test_stated_deviations_of_parameters_and_positions_are_true(setup, outcomes):
    summary = summarise(setup.free, outcomes)
    ratios = np.array([parameter.ratio for parameter in summary.parameters])
    assert 0.95 < ratios.mean() < 1.05
    covered = np.mean([parameter.covered for parameter in summary.parameters])
    assert 0.93 < covered < 0.97
    assert 0.95 < summary.position_mm / summary.stated_mm < 1.05
    assert np.mean(normal_scores(outcomes) ** 2) == pytest.approx(1.0, abs=0.1)


def test_estimator_leaves_little_of_what_its_data_hold(setup, outcomes):
    summary = summarise(setup.free, outcomes)
    parts = [parameter.variance_over_bound for parameter in summary.parameters]
    low, high = summary.chance.variance_over_bound
    assert low < min(parts)
    assert max(parts) < high


@pytest.mark.parametrize("louder", [1.0, 3.0])
def test_study_states_what_identification_states_of_the_same_shots(setup, louder):
    """`louder`: by so much the noise exceeds what the tracker states."""
    measured = []

    def noise(points_mm, rng):
        errors_mm = rng.normal(0.0, louder * NOISE_MM, points_mm.shape)
        measured.append(points_mm + errors_mm)
        return errors_mm

    (studied,) = run(replace(setup, noise=noise), [0], robots(1))
    inputs = setup.inputs(measured[0])
    found = identify(NOMINAL, inputs.shots, inputs.selection, inputs.options)
    stated = [found.parameters[name].std for name in setup.free]
    np.testing.assert_allclose(studied.estimate.std, stated, rtol=1e-6)
    values = np.array([found.parameters[name].value for name in setup.free])
    true = robots(1)[0, FREE] / SPACE.file_unit[FREE]
    np.testing.assert_allclose(studied.estimate.errors, values - true, atol=1e-9)
    assert found.chi2.believable == (louder == 1.0)


def test_chance_gets_narrower_with_more_campaigns():
    few, many = chance(len(FREE), 100), chance(len(FREE), 10_000)
    assert few.ratio[1] - 1.0 == pytest.approx(10.0 * (many.ratio[1] - 1.0))
    assert few.covered[0] < many.covered[0] < 0.95 < many.covered[1] < few.covered[1]


def test_models_that_are_chosen_in_each_campaign_are_refused():
    for model in (Model.AUTO, Model.EXTENDED):
        with pytest.raises(OptionsInvalid, match="finds other parameters in each campaign"):
            studied_parameters(SPACE, model, (), ())


def positions_and_frame(setup, vector, small):
    """Points in the tracker's frame as a function of all unknowns, (3 N,)."""
    near = NOMINAL.forward(setup.shots.joints).values_or_raise()
    poses = par4_of(vector).forward(setup.shots.joints, near).values_or_raise()
    turn, _ = small_rotation(small[:3])
    return (poses[:, :3] @ turn.T @ TRACKER.rotation.T + TRACKER.translation_mm + small[3:]).ravel()


def by_differences(setup, true, step=1e-4):
    """The Jacobian by parameters, then by the frame, from differences of the model alone."""
    columns = []
    for place in FREE:
        aside = np.zeros_like(true)
        aside[place] = step
        ends = [positions_and_frame(setup, true + sign * aside, np.zeros(6)) for sign in (1, -1)]
        columns.append((ends[0] - ends[1]) / (2.0 * step))
    for aside in step * np.eye(6):
        ends = [positions_and_frame(setup, true, sign * aside) for sign in (1, -1)]
        columns.append((ends[0] - ends[1]) / (2.0 * step))
    return np.column_stack(columns)


def test_bound_is_the_information_of_the_coordinates_at_the_truth(setup, outcomes):
    jacobian = by_differences(setup, robots(COUNT)[3])
    information = jacobian.T @ jacobian / NOISE_MM**2
    expected = np.sqrt(np.diag(np.linalg.inv(information))[: len(FREE)]) / SPACE.file_unit[FREE]
    np.testing.assert_allclose(outcomes[3].estimate.bound, expected, rtol=1e-4)


def test_bound_knows_along_the_beam_from_across(setup):
    blind_along = TrackerUncertainty(1.0, 0.0, NOISE_MM, 0.0)
    blind_across = TrackerUncertainty(NOISE_MM, 0.0, 1.0, 0.0)
    for uncertainty in (blind_along, blind_across):
        (outcome,) = run(replace(setup, instrument=uncertainty), [0], robots(1))
        np.testing.assert_allclose(outcome.estimate.std, outcome.estimate.bound, rtol=0.05)


def test_honest_study_seldom_looks_wrong_and_a_wrong_one_always(setup):
    rng = np.random.default_rng(7)
    errors = rng.standard_normal((5_000, len(FREE)))
    (like,) = run(setup, [0], robots(1))

    def made_up(std):
        one = replace(like.estimate, bound=(1.0,) * len(FREE), std=(std,) * len(FREE))
        found = [
            CampaignRow(n, estimate=replace(one, errors=tuple(e))) for n, e in enumerate(errors)
        ]
        return summarise(setup.free, found)

    honest = made_up(1.0)
    assert honest.too_sure == honest.too_unsure == ()
    assert len(made_up(0.94).too_sure) == len(made_up(1.06).too_unsure) == len(FREE)


def test_parameters_that_no_shot_tells_apart_are_named(setup):
    assert indistinguishable(setup) == []
    free = tuple(name for name in SPACE.names if name in {*SPACE.free_by_default, "arm0.x_mm"})
    (together,) = indistinguishable(replace(setup, free=free))
    assert together == tuple(f"arm{arm}.x_mm" for arm in range(4))


def test_wrong_noise_model_shows_in_the_coverage(setup, outcomes):
    halved = [
        replace(
            outcome,
            estimate=replace(outcome.estimate, std=tuple(0.5 * s for s in outcome.estimate.std)),
        )
        for outcome in outcomes
    ]
    summary = summarise(setup.free, halved)
    assert np.mean([parameter.covered for parameter in summary.parameters]) < 0.8
    assert np.mean([parameter.ratio for parameter in summary.parameters]) > 1.8


def test_campaign_that_cannot_be_measured_is_an_outcome_and_spoils_no_other(setup, outcomes):
    truths = robots(COUNT)[:3]
    truths[1, SPACE.names.index("arm0.forearm_mm")] = 100.0
    first, failed, third = run(setup, [0, 1, 2], truths)
    assert failed.estimate is None
    assert "no assembly" in failed.failure
    np.testing.assert_array_equal(flat([first, third]), flat([outcomes[0], outcomes[2]]))
    summary = summarise(setup.free, [first, failed, third])
    assert (summary.campaigns, summary.failed) == (2, 1)


def test_an_instrument_of_ones_own_measures_in_the_trackers_place(setup):
    own = replace(
        setup, noise=lambda points_mm, rng: rng.normal(0.0, 0.5 * NOISE_MM, points_mm.shape)
    )
    both = [run(each, range(12), robots(12)) for each in (setup, own)]
    stated, quieter = (
        np.mean([row.ratio for row in summarise(setup.free, rows).parameters]) for rows in both
    )
    assert 0.4 < quieter / stated < 0.6


def test_study_of_failures_is_refused_with_their_reason(setup):
    failures = [CampaignRow(number, failure="the mechanism broke") for number in range(3)]
    with pytest.raises(ShotsMissing, match=r"0 of 3 campaigns.*the mechanism broke"):
        summarise(setup.free, failures)


def begin(table):
    """As a study begins, or goes on: what is there, taken up by a new process."""
    fresh = replace(table, by_number={})
    fresh.read()
    fresh.write()
    return fresh


def head(study="0123456789ab", free=SPACE.free_by_default):
    return {"schema": "pkmcal/study-table/1", "study": study, "parameters": list(free)}


@pytest.fixture
def table(tmp_path):
    return begin(StudyTable(tmp_path / "study.jsonl", head()))


def test_table_gives_back_what_was_written(table, outcomes):
    failed = CampaignRow(151, failure="no assembly for row 3 of 80")
    table.add([outcomes[4], failed])
    table.add([outcomes[2]])
    again = begin(table)
    assert again.by_number == {151: failed, 2: outcomes[2], 4: outcomes[4]}


def test_table_is_the_same_in_whatever_order_rows_came(table, outcomes):
    table.add(outcomes[:5])
    table.write()
    one = table.path.read_bytes()
    table.path.unlink()
    other = begin(table)
    for outcome in reversed(outcomes[:5]):
        other.add([outcome])
    other.write()
    assert table.path.read_bytes() == one


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
    ("other", "said"),
    [
        (head(study="ba9876543210"), r"study\.jsonl: belongs to another study"),
        (head(free=SPACE.free_by_default[:-1]), r"a study of other parameters .* another folder"),
        (head() | {"schema": "pkmcal/study-table/9"}, "is no table of `pkmcal study`"),
    ],
)
def test_table_of_another_study_is_refused_and_left_alone(table, outcomes, other, said):
    table.add(outcomes[:2])
    before = table.path.read_bytes()
    with pytest.raises(OutputExists, match=said):
        begin(replace(table, head=other))
    assert table.path.read_bytes() == before


@pytest.mark.parametrize("text", ["", "x,y\n1,2\n", "[" * 99_999 + "\n", "mine"])
def test_any_other_file_is_refused_and_left_alone(table, text):
    table.path.write_text(text, encoding="utf-8")
    with pytest.raises(OutputExists, match="is no table of `pkmcal study`"):
        begin(table)
    assert table.path.read_text(encoding="utf-8") == text


@pytest.mark.parametrize("line", ["", "{}", "not json", '{"campaign": "one"}', "\x00"])
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
