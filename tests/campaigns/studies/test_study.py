"""Simulated campaigns: the same numbers wherever they are computed, kept and judged honestly."""

import sys
import tracemalloc
from dataclasses import astuple, replace
from importlib.machinery import ModuleSpec
from types import ModuleType

import numpy as np
import pytest
from drawn_study import FREE, NOMINAL, TRACKER, robots, setup_of
from drawn_study import plan as planned
from par4_space import SPACE, par4_of

from campaigns.errors import OutputExists, ShotsMissing, WriteFailed
from campaigns.estimation import residual_stacks
from campaigns.estimation.estimators import Estimator, Outliers, Weights
from campaigns.estimation.rigid_transforms import small_rotation
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.identification.identify import identify
from campaigns.identification.parameter_selection import ParameterSelection
from campaigns.shots.shot_sets import ShotSet
from campaigns.studies import engine
from campaigns.studies.engine import MOST_LINE_BYTES, ResultTable, run_task
from campaigns.studies.estimates import estimates, true_robot, true_robots
from campaigns.studies.study import CampaignRow, StudyTask, indistinguishable, planned_shots
from campaigns.studies.summary import chance, interval_factor, normal_scores, summarise

pytestmark = pytest.mark.slow

NOISE_MM = 0.015 / 3**0.5
COUNT = 100


@pytest.fixture(scope="module")
def plan():
    return planned(unseen_pairs=5)


@pytest.fixture(scope="module")
def setup(plan):
    return setup_of(plan, instrument=TrackerUncertainty(NOISE_MM, 0.0, NOISE_MM, 0.0))


def with_options(setup, **changes):
    """The study with other options of identification."""
    return replace(setup, options=replace(setup.options, **changes))


def run(setup, numbers, truths):
    return run_task(StudyTask(setup, tuple(numbers), truths))


@pytest.fixture(scope="module")
def outcomes(setup):
    return run(setup, range(COUNT), robots(COUNT))


def flat(outcomes):
    """All numbers of all outcomes."""
    rows = []
    for outcome in outcomes:
        found = outcome.estimate
        rows.append(
            [*found.errors, *found.std, *found.bound, found.unseen_mean_mm, found.unseen_max_mm]
        )
    return np.array(rows)


@pytest.mark.parametrize("estimator", list(Estimator))
def test_without_noise_the_truth_is_found(setup, estimator):
    silent = TrackerUncertainty(1e-9, 0.0, 1e-9, 0.0)
    (outcome,) = run(with_options(setup, instrument=silent, estimator=estimator), [0], robots(1))
    assert np.abs(outcome.estimate.errors).max() < 1e-5
    assert outcome.estimate.unseen_max_mm < 1e-5


def test_only_studies_of_many_campaigns_load_compiled_loops(monkeypatch, setup):
    asked = []
    monkeypatch.setattr(engine, "closure_kernel", asked.append)
    run(setup, [0], robots(1))
    assert not asked
    run(replace(setup, is_long=True), [0], robots(1))
    assert asked == [NOMINAL]


@pytest.mark.parametrize("why", [ImportError("numba needs another NumPy"), RuntimeError("no room")])
def test_without_a_numba_that_works_there_are_no_compiled_loops(monkeypatch, why):
    def broken(name):
        raise why

    monkeypatch.setattr(residual_stacks, "find_spec", lambda name: object())
    monkeypatch.setattr(residual_stacks, "import_module", broken)
    assert residual_stacks.closure_kernel(NOMINAL) is None


def test_folder_named_numba_is_no_numba(monkeypatch):
    folder = ModuleType("numba")
    folder.__spec__ = ModuleSpec("numba", None, is_package=True)
    monkeypatch.setitem(sys.modules, "numba", folder)
    monkeypatch.delitem(sys.modules, "campaigns.estimation.compiled", raising=False)
    assert residual_stacks.closure_kernel(NOMINAL) is None


def test_numbers_depend_on_the_seed_and_not_on_how_campaigns_are_divided(setup, outcomes):
    truths = robots(COUNT)
    again = run(setup, [7, 3], truths[[7, 3]])
    np.testing.assert_array_equal(flat(again), flat([outcomes[7], outcomes[3]]))
    (other,) = run(replace(setup, seed=4), [0], robots(COUNT)[:1])
    assert not np.array_equal(other.estimate.errors, outcomes[0].estimate.errors)


def test_stated_deviations_are_true_for_points(setup, outcomes):
    summary = summarise(setup, outcomes)
    ratios = np.array([parameter.ratio for parameter in summary.parameters])
    assert 0.95 < ratios.mean() < 1.05
    covered = np.mean([parameter.covered for parameter in summary.parameters])
    assert 0.93 < covered < 0.97


@pytest.fixture(scope="module")
def by_distances(setup):
    return with_options(setup, estimator=Estimator.DISTANCES, weights=Weights.EQUAL)


@pytest.fixture(scope="module")
def distance_outcomes(by_distances):
    return run(by_distances, range(COUNT), robots(COUNT))


def test_stated_deviations_are_true_for_distances(by_distances, distance_outcomes):
    summary = summarise(by_distances, distance_outcomes)
    covered = np.mean([parameter.covered for parameter in summary.parameters])
    assert 0.93 < covered < 0.97
    assert interval_factor(by_distances) == pytest.approx(2.042, abs=1e-3), "18 and 12 stated"


def test_neither_estimator_leaves_much_of_what_its_data_hold(
    setup, outcomes, by_distances, distance_outcomes
):
    for studied, found in ((setup, outcomes), (by_distances, distance_outcomes)):
        summary = summarise(studied, found)
        parts = np.array([parameter.variance_over_bound for parameter in summary.parameters])
        low, high = summary.chance.variance_over_bound
        assert low < parts.min()
        assert parts.max() < high
        assert 0.95 < parts.mean() < 1.05


def positions_and_frame(setup, vector, small):
    """Points in the tracker's frame as a function of all unknowns, (3 N,)."""
    near = NOMINAL.forward(setup.fitted.joints).values_or_raise()
    poses = par4_of(vector).forward(setup.fitted.joints, near).values_or_raise()
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


def test_bound_of_distances_is_the_information_of_the_distances_alone(setup, distance_outcomes):
    true = robots(COUNT)[3]
    points = positions_and_frame(setup, true, np.zeros(6)).reshape(-1, 3)
    first, second = setup.fitted.whole_pairs(ShotSet.IDENTIFICATION).rows.T
    apart = points[second] - points[first]
    towards = apart / np.linalg.norm(apart, axis=1)[:, None]
    by_point = by_differences(setup, true)[:, : len(FREE)].reshape(-1, 3, len(FREE))
    jacobian = np.einsum("mk,mkf->mf", towards, by_point[second] - by_point[first])
    information = jacobian.T @ jacobian / (2.0 * NOISE_MM**2)
    expected = np.sqrt(np.diag(np.linalg.inv(information))) / SPACE.file_unit[FREE]
    np.testing.assert_allclose(distance_outcomes[3].estimate.bound, expected, rtol=1e-3)


def test_bound_knows_along_the_beam_from_across(setup):
    blind_along = TrackerUncertainty(1.0, 0.0, NOISE_MM, 0.0)
    blind_across = TrackerUncertainty(NOISE_MM, 0.0, 1.0, 0.0)
    for uncertainty in (blind_along, blind_across):
        (outcome,) = run(with_options(setup, instrument=uncertainty), [0], robots(1))
        np.testing.assert_allclose(outcome.estimate.std, outcome.estimate.bound, rtol=0.05)


def test_chance_gets_narrower_with_more_campaigns(setup, by_distances):
    few, many = chance(setup, 100), chance(setup, 10_000)
    assert few.ratio[1] - 1.0 == pytest.approx(10.0 * (many.ratio[1] - 1.0))
    assert few.covered[0] < many.covered[0] < 0.95 < many.covered[1] < few.covered[1]
    assert chance(by_distances, 100).ratio[1] > few.ratio[1], "stated σ scatter too"


def test_honest_study_seldom_looks_wrong_and_a_wrong_one_always(setup):
    rng = np.random.default_rng(7)
    errors = rng.standard_normal((5_000, len(FREE)))
    (like,) = run(setup, [0], robots(1))

    def made_up(std):
        one = replace(like.estimate, bound=(1.0,) * len(FREE), std=(std,) * len(FREE))
        found = [
            CampaignRow(n, estimate=replace(one, errors=tuple(e))) for n, e in enumerate(errors)
        ]
        return summarise(setup, found)

    honest = made_up(1.0)
    assert honest.too_sure == honest.too_unsure == ()
    assert len(made_up(0.94).too_sure) == len(made_up(1.06).too_unsure) == len(FREE)


def test_normal_scores_are_standard_normal_for_either_estimator(
    setup, outcomes, by_distances, distance_outcomes
):
    for studied, found in ((setup, outcomes), (by_distances, distance_outcomes)):
        scores = normal_scores(studied, found)
        assert scores.shape == (COUNT, len(FREE))
        assert np.mean(scores**2) == pytest.approx(1.0, abs=0.1)
    raw = np.array([np.divide(o.estimate.errors, o.estimate.std) for o in distance_outcomes])
    assert (np.abs(scores) < np.abs(raw)).all(), "Student's tails are the longer ones"
    assert (np.sign(scores) == np.sign(raw)).all()


def test_parameters_that_no_shot_tells_apart_are_named(setup):
    assert indistinguishable(setup) == []
    free = tuple(name for name in SPACE.names if name in {*SPACE.free_by_default, "arm0.x_mm"})
    (together,) = indistinguishable(replace(setup, free=free))
    assert together == tuple(f"arm{arm}.x_mm" for arm in range(4))


@pytest.mark.parametrize("estimator", list(Estimator))
@pytest.mark.parametrize("louder", [1.0, 3.0])
def test_study_states_what_identification_states_of_the_same_shots(setup, estimator, louder):
    """`louder`: by so much the noise exceeds what the tracker states."""
    quiet = with_options(setup, estimator=estimator)
    loud = TrackerUncertainty(louder * NOISE_MM, 0.0, louder * NOISE_MM, 0.0)
    at_nominal = NOMINAL.forward(setup.shots.joints)
    near = at_nominal.values_or_raise()
    robot = true_robot(with_options(quiet, instrument=loud), near, tuple(robots(1)[0]))
    points_mm = robot.measured_mm(np.random.default_rng(1))
    (studied,) = estimates(quiet, [robot], [points_mm], at_nominal)
    shots = replace(setup.shots, points_in_tracker_mm=points_mm)
    found = identify(NOMINAL, shots, ParameterSelection(setup.free), quiet.options)
    stated = [found.parameters[name].std for name in setup.free]
    np.testing.assert_allclose(studied.std, stated, rtol=1e-6)
    values = np.array([found.parameters[name].value for name in setup.free])
    true = robots(1)[0, FREE] / SPACE.file_unit[FREE]
    np.testing.assert_allclose(studied.errors, values - true, atol=1e-9)
    if estimator is Estimator.POINTS:
        assert found.chi2.believable == (louder == 1.0)


BY_NUMPY, COMPILED = lambda _: None, residual_stacks.closure_kernel


@pytest.mark.parametrize("way", [BY_NUMPY, pytest.param(COMPILED, marks=pytest.mark.peer)])
@pytest.mark.parametrize("estimator", list(Estimator))
def test_true_robots_are_the_same_in_any_company(setup, estimator, way):
    if (kernel := way(NOMINAL)) is None and way is COMPILED:
        pytest.skip("numba is not installed: pip install -e '.[fast]'")
    own = with_options(setup, estimator=estimator)
    near, truths = NOMINAL.forward(setup.shots.joints).values_or_raise(), robots(3)
    truths[1, [SPACE.names.index(f"arm{arm}.forearm_mm") for arm in range(4)]] = 1.0
    first, impossible, last = true_robots(own, near, truths, kernel)
    assert impossible.startswith("no assembly")
    for robot, truth in ((first, truths[0]), (last, truths[2])):
        (alone,) = true_robots(own, near, truth[None], kernel)
        by_one = true_robot(own, near, tuple(truth))
        for found in ("points_mm", "scatter_mm", "bound", "poses"):
            np.testing.assert_array_equal(getattr(robot, found), getattr(alone, found))
            np.testing.assert_allclose(getattr(robot, found), getattr(by_one, found), atol=1e-9)


def test_wrong_noise_model_shows_in_the_coverage(setup, outcomes):
    halved = [
        replace(
            outcome,
            estimate=replace(outcome.estimate, std=tuple(0.5 * s for s in outcome.estimate.std)),
        )
        for outcome in outcomes
    ]
    summary = summarise(setup, halved)
    assert np.mean([parameter.covered for parameter in summary.parameters]) < 0.8
    assert np.mean([parameter.ratio for parameter in summary.parameters]) > 1.8


def test_campaign_that_cannot_be_measured_is_an_outcome_and_spoils_no_other(setup, outcomes):
    truths = robots(COUNT)[:3]
    truths[1, SPACE.names.index("arm0.forearm_mm")] = 100.0
    first, failed, third = run(setup, [0, 1, 2], truths)
    assert failed.estimate is None
    assert "no assembly" in failed.failure
    np.testing.assert_array_equal(flat([first, third]), flat([outcomes[0], outcomes[2]]))
    summary = summarise(setup, [first, failed, third])
    assert (summary.campaigns, summary.failed) == (2, 1)


def test_an_instrument_of_ones_own_measures_in_the_trackers_place(setup):
    own = replace(
        setup, noise=lambda points_mm, rng: rng.normal(0.0, 0.5 * NOISE_MM, points_mm.shape)
    )
    both = [(each, run(each, range(12), robots(12))) for each in (setup, own)]
    stated, quieter = (
        np.mean([row.ratio for row in summarise(each, rows).parameters]) for each, rows in both
    )
    assert 0.4 < quieter / stated < 0.6


def test_summary_is_the_same_by_parts(setup, outcomes, monkeypatch):
    at_once = summarise(setup, outcomes)
    monkeypatch.setattr("campaigns.studies.summary.CHUNK", 7)
    by_parts = summarise(setup, iter(outcomes))
    assert by_parts.unseen_mean_mm == at_once.unseen_mean_mm
    for one, other in zip(by_parts.parameters, at_once.parameters, strict=True):
        assert astuple(one)[1:] == pytest.approx(astuple(other)[1:], rel=1e-12)


def test_study_of_failures_is_refused_with_their_reason(setup):
    failures = [CampaignRow(number, failure="the mechanism broke") for number in range(3)]
    with pytest.raises(ShotsMissing, match=r"0 of 3 campaigns.*the mechanism broke"):
        summarise(setup, failures)


def test_study_without_unseen_pairs_says_nothing_of_them(setup):
    blind = replace(setup, shots=setup.fitted)
    summary = summarise(blind, run(blind, range(3), robots(3)))
    assert summary.unseen_mean_mm is None
    assert summary.unseen_max_mm is None


def test_digest_tells_studies_apart(setup):
    shots = setup.shots
    sets = tuple(ShotSet.IDENTIFICATION for _ in shots.purposes)
    others = [
        setup.digest("other robots"),
        replace(setup, seed=4).digest("robots"),
        with_options(setup, estimator=Estimator.DISTANCES).digest("robots"),
        with_options(setup, outliers=Outliers.KEEP).digest("robots"),
        replace(setup, shots=setup.fitted).digest("robots"),
        replace(setup, shots=replace(shots, purposes=sets)).digest("robots"),
        replace(setup, shots=replace(shots, joints=shots.joints[::-1])).digest("robots"),
        replace(setup, shots=replace(shots, pairs=shots.pairs[::-1])).digest("robots"),
        replace(setup, free=SPACE.free_by_default[1:]).digest("robots"),
        with_options(setup, instrument=TrackerUncertainty()).digest("robots"),
    ]
    assert len({setup.digest("robots"), *others}) == 1 + len(others)
    assert setup.digest("robots") == replace(setup).digest("robots")


def test_digest_tells_the_reflectors_half_apart_and_of_imperfect_parts_the_plate(setup):
    nominal, chain = setup.nominal, setup.nominal.mechanism
    plate = replace(chain.plate, reflector_mm=(0.0, 0.0, 30.0))
    full = replace(setup, free=chain.parameters.free_in_full)

    def digest(setup, chain):
        return replace(setup, nominal=replace(nominal, mechanism=chain)).digest("robots")

    assert digest(setup, chain.seen_from(2)) != digest(setup, chain)
    assert digest(setup, chain.with_plate(plate)) == digest(setup, chain.seen_from(1))
    assert digest(full, chain.with_plate(plate)) != digest(full, chain)
    assert digest(setup, chain.with_ripples(15.0)) != digest(setup, chain)


def test_pairs_of_two_plans_with_the_same_numbers_stay_apart(plan):
    fitted = [shot for shot in plan if shot.purpose is ShotSet.IDENTIFICATION]
    taken = {shot.pair for shot in fitted}
    numbers = dict(zip({shot.pair for shot in plan} - taken, sorted(taken), strict=False))
    unseen = [
        replace(shot, pair=numbers[shot.pair])
        for shot in plan
        if shot.purpose is ShotSet.VALIDATION
    ]
    shots = planned_shots([*fitted, *unseen])
    assert len(set(shots.pairs)) == (len(fitted) + len(unseen)) // 2
    assert len(shots.whole_pairs(ShotSet.VALIDATION).rows) == len(unseen) // 2
    assert np.isnan(shots.points_in_tracker_mm).all(), "nothing has been measured"


def begin(table):
    """As a study begins, or goes on: what is there, taken up by a new process."""
    fresh = replace(table, places={})
    fresh.read()
    fresh.write()
    return fresh


def head(study="0123456789ab", free=SPACE.free_by_default):
    return {"schema": "pkmcal/study-table/1", "study": study, "parameters": list(free)}


@pytest.fixture
def table(tmp_path):
    return begin(ResultTable(tmp_path / "study.jsonl", CampaignRow, "pkmcal study", head()))


def test_table_gives_back_what_was_written(table, outcomes):
    failed = CampaignRow(151, failure="no assembly for row 3 of 80")
    table.add([outcomes[4], failed])
    table.add([outcomes[2]])
    again = begin(table)
    assert [*again.rows([151, 2, 4])] == [failed, outcomes[2], outcomes[4]]
    assert {*again.places} == {2, 4, 151}


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
    assert list(again.places) == [0, 1]
    again.add([outcomes[2]])
    assert table.path.read_text(encoding="utf-8") == whole


def test_table_in_order_is_not_written_again(table, outcomes):
    table.add(outcomes[:3])
    before = table.path.stat().st_ino
    begin(table)
    assert table.path.stat().st_ino == before
    table.add(outcomes[4:2:-1])
    again = begin(table)
    assert table.path.stat().st_ino != before
    assert (*again.rows(range(5)),) == outcomes[:5]
    places = [again.places[number] for number in range(5)]
    assert places == sorted(places)


def test_memory_holds_no_table(table, outcomes):
    table.add(replace(outcomes[0], campaign=number) for number in reversed(range(1000)))
    tracemalloc.start()
    again = begin(table)
    assert sum(1 for _ in again.rows(range(1000))) == 1000
    largest = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert largest < 0.4 * table.path.stat().st_size


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
