"""Perturbed campaigns and verdicts: what is drawn is true, a false acceptance is seen."""

import tracemalloc
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from drawn_study import FREE, NOMINAL, ROBOT, STD, plan, setup_of

from app.study.rods import misread, rod_robot
from campaigns.design.pose_sampling import workspace_poses
from campaigns.estimation.datum import DatumSample
from campaigns.evaluation.diagnostics import EXTRAPOLATION, KNOWN_LENGTH
from campaigns.identification.parameter_selection import ParameterSelection
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.studies.engine import ResultTable, run_task
from campaigns.studies.perturbations import PERTURBATIONS, Perturbation, perturbation_of, sizes_of
from campaigns.studies.perturbed import perturbed_campaign
from campaigns.studies.study import CampaignRow, CampaignVerdict, StudyTask
from campaigns.studies.summary import verdict_statistics
from campaigns.studies.verdicts import judge, position_error_mm
from sim.scenarios.scenario import load_scenario

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def setup():
    rng, centre = np.random.default_rng(1), ROBOT.workspace_centre
    workspace = workspace_poses(NOMINAL, ROBOT.limits, centre, 60, rng)
    robots = partial(rod_robot, load_scenario("realistic").robot, DatumSample(NOMINAL))
    return replace(
        setup_of(plan(unseen_pairs=10), workspace=workspace), beyond_model=robots, misread=misread
    )


def truth_of(seed):
    p = NOMINAL.p.copy()
    p[FREE] += STD * np.random.default_rng(seed).standard_normal(len(FREE))
    return p


def perturbed(setup, perturbation, seed=1):
    rng = np.random.default_rng([5, seed])
    return perturbed_campaign(setup, perturbation, truth_of(seed), rng)


def judged(setup, perturbation):
    return judge(setup, perturbed(setup, perturbation))


def one(**told):
    values = {
        "verdict": "pass",
        "model": "standard",
        "doubts": (),
        "known": 22,
        "worst_sigmas": 3.0,
        "square_over_variance": 1.0,
        "covered": 0.95,
        "square_over_least": 1.0,
        "position_mm": 0.01,
        "stated_mm": 0.01,
        "change": "",
        "signal": 0.0,
        "missing": 0,
        "too_many": 0,
        "named": True,
        "false_alarm": False,
    }
    return CampaignVerdict(**{**values, **told})


def test_a_pass_is_wrong_with_parameters_or_positions_beyond_what_is_stated():
    assert not one(worst_sigmas=3.9).falsely_accepted
    assert one(worst_sigmas=4.1).falsely_accepted
    assert not one(worst_sigmas=4.1, verdict="not decided").falsely_accepted
    assert not one(position_mm=0.019).falsely_accepted
    assert one(position_mm=0.021).falsely_accepted
    assert not one(position_mm=0.021, whole_mm=0.02).falsely_accepted
    assert not one(position_mm=1.0, stated_mm=None).falsely_accepted


def test_false_acceptances_are_counted_once_however_wrong():
    both = one(worst_sigmas=9.0, position_mm=1.0)
    rows = [CampaignRow(n, "none", verdict=each) for n, each in enumerate([both, one()])]
    found = verdict_statistics([*rows, CampaignRow(2, "none", "no robot")])
    assert (found.campaigns, found.failed, found.passed) == (2, 1, 2)
    assert (found.off, found.worse, found.wrong) == (1, 1, 1)
    assert found.false_acceptance_rate == 0.5
    assert found.errors_over_sigma == pytest.approx(1.0)


def test_verdicts_are_counted_as_they_are_read_and_not_kept():
    count, kinds = 3000, ("one", "other")
    rows = (CampaignRow(n, kinds[n % 2], verdict=one(covered=n % 2)) for n in range(count))
    tracemalloc.start()
    found = verdict_statistics(rows)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert (found.campaigns, found.covered) == (count, 0.5)
    assert peak < 100 * count  # a row has ten times as much


def test_clean_points_scatter_as_stated_about_the_true_robot_and_show_nothing(setup):
    made = perturbed(setup, Perturbation())
    frame = setup.tracker_from_base
    exact_mm = frame.apply(made.forward(made.shots.joints))
    off = made.shots.points_in_tracker_mm - exact_mm
    size2 = np.linalg.solve(made.shots.stated_covariance_mm2, off[:, :, None])[:, :, 0] * off
    assert 0.8 < size2.sum() / off.size < 1.2
    made = perturbed(setup, Perturbation())
    assert position_error_mm(setup.options.workspace, made.forward, made.true) < 1e-9
    assert position_error_mm(setup.options.workspace, made.forward, NOMINAL) > 0.1
    assert perturbed(setup, Perturbation()).signal() == 0.0


def test_eight_rods_without_faults_are_the_contracted_robot(setup):
    made = perturbed(setup, Perturbation(rods_mm=1e-9))
    assert position_error_mm(setup.options.workspace, made.forward, made.true) < 1e-6


@pytest.mark.parametrize(("size", "sure"), [(0.5, True), (0.005, False)])
def test_signal_tells_a_step_that_can_be_found_from_one_that_cannot(setup, size, sure):
    made = perturbed(setup, Perturbation(step="length", size=size), seed=4)
    assert (made.signal() > 7.0) is sure


def test_encoder_step_is_named_with_cause_arm_and_place(setup):
    found = judged(setup, Perturbation(step="joint", size=0.3))
    assert (found.change, found.named, found.passed) == ("right", True, False)


def test_gross_errors_and_a_scale_are_named(setup):
    found = judged(setup, Perturbation(gross=3, size=2.0))
    assert (found.missing, found.too_many, found.named) == (0, 0, True)
    found = judged(setup, Perturbation(scale=1.01))
    assert found.named
    assert not found.passed


def test_a_step_that_is_no_step_of_that_arm_is_not_named(setup):
    made = perturbed(setup, Perturbation(step="joint", size=0.3))
    found = judge(setup, replace(made, arm=(made.arm + 1) % 4))
    assert (found.change, found.named) == ("cause", False)


def test_change_in_a_clean_campaign_is_a_false_alarm(setup):
    made = perturbed(setup, Perturbation(step="joint", size=0.3))
    assert not judge(setup, made).false_alarm
    assert judge(setup, replace(made, perturbation=Perturbation())).false_alarm


def test_sizes_of_a_perturbation_are_taken_in_turn():
    sizes = PERTURBATIONS["bumped-stand"]
    assert [perturbation_of("bumped-stand", n) for n in range(4)] == [*sizes, sizes[0]]


def test_sizes_of_ones_own_are_taken_in_turn_instead():
    own = [perturbation_of("warmth=60,180", n).warmth_ppm for n in range(3)]
    assert own == [60.0, 180.0, 60.0]
    late = Perturbation(step="joint", size=0.1, late=True)
    assert perturbation_of("late-encoder-step=0.1", 0) == late
    for wrong in ("warmth=", "warmth=0", "warmth=nan", "clean=1", "tracker-scale=50"):
        with pytest.raises(ValueError):
            sizes_of(wrong)


def test_rows_do_not_depend_on_how_campaigns_are_divided_and_are_kept(setup, tmp_path):
    wrong = replace(setup, perturbation="gross-errors")
    truths = np.array([truth_of(seed) for seed in (0, 1)])
    both = run_task(StudyTask(wrong, (0, 1), truths))
    (second,) = run_task(StudyTask(wrong, (1,), truths[1:]))
    assert both[1] == second
    table = ResultTable(tmp_path / "effect.jsonl", CampaignRow, "pkmcal study")
    told = one(doubts=("hold-out", "lack-of-fit"), stated_mm=None, change="place")
    rows = (*both, CampaignRow(2, verdict=told), CampaignRow(3, failure="no robot, at all"))
    table.add(rows)
    table.places.clear()
    assert (*table.rows(table.read()),) == rows


def test_digest_tells_perturbations_apart(setup):
    one, other = (replace(setup, perturbation=name) for name in ("clean", "drift"))
    assert len({each.digest("robots") for each in (setup, one, other)}) == 3


@pytest.mark.parametrize("known", [False, True])
def test_a_trackers_scale_is_told_by_a_known_length_alone(setup, known):
    found = judged(setup, Perturbation(scale=1.0001, known_length=known))
    assert (KNOWN_LENGTH in found.doubts) == found.named == known
    assert found.passed == (not known)


def test_shots_in_a_quarter_of_each_range_are_no_pass(setup):
    found = judged(setup, Perturbation(measured=0.25))
    assert EXTRAPOLATION in found.doubts
    assert (found.named, found.passed) == (True, False)


@pytest.mark.parametrize(
    ("perturbation", "cause"),
    [
        (Perturbation(eccentric_deg=0.05), "eccentricity"),
        (Perturbation(ratio_ppm=2000.0), "ratio"),
        (Perturbation(sag_mm=0.2), "yielding"),
        (Perturbation(azimuths_mrad=3.0), "azimuths"),
        (Perturbation(reflector_mm=2.0), "reflector"),
        (Perturbation(transit_mrad=1.0), "transit axis"),
        (Perturbation(ripple_arcsec=60.0), "ripple"),
        (Perturbation(warmth_ppm=1000.0), "warmth"),
    ],
)
def test_causes_of_the_simulated_parts_are_named(setup, perturbation, cause):
    found = judged(setup, perturbation)
    assert found.causes[:1] == (cause,)
    assert found.named
    assert not found.passed


GEARS = [
    Perturbation(eccentric_deg=0.02),
    Perturbation(ratio_ppm=500.0),
    Perturbation(ripple_arcsec=30.0),
    Perturbation(warmth_ppm=500.0),
]


@pytest.mark.parametrize("perturbation", GEARS, ids=str)
def test_true_terms_are_those_of_the_simulated_gears_and_of_the_robot_when_warm(
    setup, perturbation
):
    rippling = Kinematics(NOMINAL.mechanism.with_ripples(30.0), NOMINAL.p)
    made = perturbed(replace(setup, nominal=rippling), perturbation)
    assert position_error_mm(setup.options.workspace, made.forward, made.true) < 3e-4, (
        "eccentricities squared"
    )
    assert position_error_mm(setup.options.workspace, made.forward, perturbed_clean(setup)) > 0.005


def perturbed_clean(setup):
    return perturbed(setup, Perturbation()).true


def test_shots_of_a_warming_robot_begin_cold(setup):
    made = perturbed(setup, Perturbation(warmth_ppm=2000.0))
    cold = perturbed(setup, Perturbation(rods_mm=1e-9)).forward(made.shots.joints)
    off = made.shots.points_in_tracker_mm - setup.tracker_from_base.apply(cold)
    sizes = np.linalg.norm(off, axis=1)
    assert sizes[0] < 0.05 < 0.2 < sizes[-10:].mean()


def test_terms_of_gears_that_were_fitted_count_for_positions(setup):
    eccentric = perturbed(setup, Perturbation(eccentric_deg=0.02))
    space = NOMINAL.mechanism.parameters
    names = space.of_field("eccentricity_sin_deg", "eccentricity_cos_deg")
    usual, wider = (
        judge(replace(setup, models={"standard": ParameterSelection(free)}), eccentric)
        for free in (setup.free, (*setup.free, *names))
    )
    assert wider.known == usual.known + len(names)
    assert wider.position_mm < 0.2 * usual.position_mm
    assert wider.worst_sigmas < 4.0


def test_late_steps_and_swapped_neighbours_are_named(setup):
    late = perturbed(setup, Perturbation(step="mount", size=2.0, late=True))
    after = late.shots.numbers.index(late.first_after)
    assert 3 <= len(late.shots) - after <= 8
    assert judge(setup, late).named
    swapped = judged(setup, Perturbation(swapped=True))
    assert swapped.named
    assert swapped.change == ""
