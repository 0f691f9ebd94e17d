"""Larger models: kept only where pairs that they never saw, and their price, speak for them."""

import json
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from identified_cases import NOMINAL, TRACKER_FROM_BASE, TRUTH, noisy, simulated
from par4_space import AXIS_TILT_NAMES, SKEW_NAMES, SPACE, par4, par4_of

from campaigns.errors import OptionsInvalid
from campaigns.estimation.estimators import Estimator, Model
from campaigns.estimation.residuals import PositionModel
from campaigns.identification import change
from campaigns.identification.candidates import Candidate, bic, objection_to
from campaigns.identification.identify import identify
from campaigns.identification.model_selection import (
    FULL,
    STANDARD,
    asked_of,
    candidate_models,
    select_model,
    terms_to_add,
)
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.parameter_selection import ParameterSelection, select_parameters
from campaigns.identification.term_selection import _needed
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.shots.shot_sets import ShotSet

MODELS = candidate_models(SPACE, Model.EXTENDED)
USUAL = select_parameters(SPACE)
AZIMUTHS = SPACE.places([f"arm{arm}.azimuth_deg" for arm in range(4)])
BACKLASHES = SPACE.places(SPACE.backlashes)
NO_BACKLASH = np.zeros(4)
BACKLASH_RAD = np.radians(np.array([1.0, 0.8, 1.2, 0.6]) / 60.0)


def tilted():
    """Table I's robot, whose axes point a little elsewhere too."""
    p = TRUTH.p.copy()
    p[AZIMUTHS] += [0.0, 1e-3, -8e-4, 6e-4]
    p[SPACE.places(AXIS_TILT_NAMES)] = [1e-3, -8e-4, 6e-4, -1e-3]
    return par4_of(p)


TILTED = tilted()


def shots(truth: Kinematics, backlash_rad=NO_BACKLASH, seed=1, unseen=20):
    """Of a robot with or without backlash, whose joints come from either side."""
    data = simulated(60, unseen, seed)
    approach = np.random.default_rng(seed).choice([-1.0, 1.0], data.joints.shape)
    model = PositionModel(truth, BACKLASHES, data.joints, approach=approach)
    points = TRACKER_FROM_BASE.apply(model.positions_mm(backlash_rad))
    return noisy(replace(data, points_in_tracker_mm=points, approach=approach), seed)


def geared(nominal: Kinematics = NOMINAL, *, seed=1, **terms):
    """Shots of Table I's robot whose joints have such terms, by the stems of their fields."""
    data = simulated(60, 30, seed)
    rng = np.random.default_rng(seed)
    approach = rng.choice([-1.0, 1.0], data.joints.shape)
    values = {
        f"arm{arm}.{stem}": size * rng.uniform(0.5, 1.0) * rng.choice([-1.0, 1.0])
        for stem, size in terms.items()
        for arm in range(4)
    }
    names = tuple(values)
    mechanism = nominal.mechanism
    model = PositionModel(
        replace(TRUTH, mechanism=mechanism), SPACE.places(names), data.joints, approach=approach
    )
    x = np.array([*values.values()]) * SPACE.units(names)
    points = TRACKER_FROM_BASE.apply(model.positions_mm(x))
    return noisy(replace(data, points_in_tracker_mm=points, approach=approach), seed), values


LARGER = ("rods", "full")
"""Models that a test of added terms need not try."""


def of_auto(data, nominal: Kinematics = NOMINAL, fixed=(), priors=(), without=()):
    """Choice of --model auto."""
    terms = terms_to_add(SPACE, Model.AUTO, (), fixed, priors)
    models = candidate_models(SPACE, Model.AUTO, (), fixed, priors)
    models = {name: known for name, known in models.items() if name not in without}
    return select_model(nominal, data, models, terms=terms)


def alone(nominal, **terms):
    """Terms that the case of all has too."""
    return pytest.param(nominal, terms, (), marks=pytest.mark.long)


RIPPLING = replace(NOMINAL, mechanism=NOMINAL.mechanism.with_ripples(30.0))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("nominal", "terms", "without"),
    [
        alone(NOMINAL, backlash_deg=1.0 / 60.0),
        alone(NOMINAL, eccentricity_sin_deg=0.02, eccentricity_cos_deg=0.02),
        alone(NOMINAL, encoder_gain_ppm=800.0),
        alone(RIPPLING, ripple_sin_deg=0.006, ripple_cos_deg=0.006),
        (
            RIPPLING,
            {
                "eccentricity_cos_deg": 0.02,
                "ripple_sin_deg": 0.006,
                "backlash_deg": 0.01,
                "encoder_gain_ppm": 800.0,
            },
            LARGER,
        ),
    ],
    ids=["backlash", "eccentricity", "ratio", "ripple", "all"],
)
def test_what_gears_and_encoders_do_is_found_by_its_cause_and_fitted(nominal, terms, without):
    data, values = geared(nominal, **terms)
    choice = of_auto(data, nominal, without=without)
    assert [doubt.name for doubt in choice.doubts if doubt.affects_verdict] == []
    found = choice.parameters
    free = [name for name in values if name in found]
    assert len(free) >= len(values) - 1
    off = [abs(found[name].value - values[name]) / found[name].std for name in free]
    assert max(off) < 4.5
    assert choice.unseen_mm.after.rms < 0.02, "the tracker's noise of a distance"


@pytest.mark.slow
def test_backlash_is_kept_by_distances_too_whose_weights_take_it_for_the_robots_scatter():
    data, values = geared(seed=2, backlash_deg=1.0 / 60.0)
    by_distances = IdentificationOptions(estimator=Estimator.DISTANCES)
    terms = terms_to_add(SPACE, Model.AUTO)
    models = {name: MODELS[name] for name in (STANDARD, "axes")}
    choice = select_model(NOMINAL, data, models, by_distances, terms=terms)
    assert kept(choice) == "standard+backlash"
    found = choice.parameters
    assert max(abs(found[name].value - values[name]) / found[name].std for name in values) < 4.5


@pytest.mark.slow
def test_what_is_known_of_a_term_before_counts_where_the_term_is_added_and_one_may_be_held():
    data, values = geared(backlash_deg=1.0 / 60.0)
    tight, held = "arm1.backlash_deg", "arm3.backlash_deg"
    choice = of_auto(
        data, fixed=[held], priors=[f"{tight}=0.0001", "arm*.encoder_gain_ppm=50"], without=LARGER
    )
    assert choice.priors == {tight: 0.0001}
    assert held not in choice.parameters
    assert abs(choice.parameters[tight].value) < 0.1 * abs(values[tight])
    assert any(f"prior of {tight}" in reason for reason in choice.reasons)


def test_a_prior_on_what_a_model_cannot_end_with_is_refused():
    assert terms_to_add(SPACE, Model.FULL) == ParameterSelection(())
    with pytest.raises(OptionsInvalid, match=r"backlash_deg.* held at the nominal value"):
        candidate_models(SPACE, Model.FULL, priors=["arm*.backlash_deg=0.01"])


def test_terms_that_are_fixed_are_not_added():
    data, _ = geared(backlash_deg=1.0 / 60.0)
    choice = of_auto(data, fixed=["arm*.backlash_deg"], without=LARGER)
    assert not any(name in SPACE.backlashes for name in choice.free)
    assert not any("backlash" in each.name for each in choice.models)
    assert any(doubt.numbers.get("cause") == "backlash" for doubt in choice.doubts)


@pytest.mark.slow
def test_a_robot_without_gears_errors_gets_no_term_of_them():
    named = [kept(of_auto(geared(seed=seed)[0])) for seed in range(2)]
    assert not any("+" in name for name in named)


def test_of_several_causes_the_one_that_gains_most_is_told_first_and_none_that_is_not_needed():
    data, _ = geared(encoder_gain_ppm=800.0, eccentricity_cos_deg=0.05)
    terms, options = terms_to_add(SPACE, Model.AUTO), IdentificationOptions()
    standard = Candidate("", USUAL, NOMINAL, data, options).instead(STANDARD, USUAL)
    tried = []

    def of(stem):
        return {name for name in terms.free if stem in name}

    before = standard.adding("backlash", of("backlash"), terms).adding("ratio", of("gain"), terms)
    best = _needed(before.adding("eccentricity", of("eccentricity"), terms), before, tried)
    assert best.name == "standard+eccentricity+ratio"
    assert not {*best.known.free} & {*SPACE.backlashes}
    assert {*best.known.free} >= of("gain") | of("eccentricity")
    assert [each.name for each in tried][-1] == "standard+ratio+eccentricity"


def test_a_cause_that_is_but_possible_is_tried_and_is_no_doubt_of_what_is_kept():
    data, _ = geared(seed=2, encoder_gain_ppm=80.0)
    choice = of_auto(data, without=LARGER)
    assert "standard+ratio" in outcomes(choice)
    assert kept(choice) == STANDARD
    assert choice.doubts == ()


@pytest.mark.slow
def test_tilted_axes_that_backlash_hides_are_found_beside_it():
    choice = of_auto(shots(TILTED, 3.0 * BACKLASH_RAD, seed=2), without=LARGER)
    assert kept(choice) == "axes+backlash"
    assert "standard+backlash" in outcomes(choice), "chosen first, by hold-out pairs that scatter"
    assert choice.verdict == "pass"


def chosen(data, names=tuple(MODELS)):
    return select_model(NOMINAL, data, {name: MODELS[name] for name in names})


def kept(found):
    [name] = [each.name for each in found.models if each.kept]
    return name


def outcomes(choice):
    return {each.name: each.outcome for each in choice.models}


def test_tilted_axes_and_backlash_are_found_and_kept():
    choice = chosen(shots(TILTED, BACKLASH_RAD))
    assert kept(choice) == "axes+backlash"
    found = choice.parameters
    for name, true_rad in zip(SPACE.backlashes, BACKLASH_RAD, strict=True):
        assert abs(found[name].value - np.degrees(true_rad)) < 4.0 * found[name].std
    standard = choice.models[0]
    assert choice.unseen_mm.after.rms < 0.5 * standard.unseen_rms_mm
    assert standard.outcome == "another model is better"


def test_of_two_models_that_know_as_much_the_smaller_is_kept():
    choice = chosen(shots(TRUTH, BACKLASH_RAD))
    assert kept(choice) == "backlash"
    assert outcomes(choice)["axes"] != "kept"


def test_a_robot_that_22_parameters_describe_keeps_them_as_they_are_without_a_choice(monkeypatch):
    data, tests = shots(TRUTH), Mock(wraps=change.tested)
    monkeypatch.setattr("campaigns.identification.identify.tested", tests)
    choice = chosen(data)
    assert tests.call_count == 1, "for causes, which a model that is not kept needs not"
    assert choice.flat() == identify(NOMINAL, data, USUAL).flat()
    assert kept(choice) == STANDARD
    assert choice.models[0].outcome == "kept"
    assert all("no better" in why or "BIC" in why for why in list(outcomes(choice).values())[1:])


def test_unequal_rods_are_found_and_no_more_kept_than_they_need():
    p = TRUTH.p.copy()
    p[SPACE.places(SKEW_NAMES)] = [6e-4, -9e-4, 1e-3, 4e-4]
    choice = select_model(NOMINAL, shots(par4_of(p)), candidate_models(SPACE, Model.AUTO))
    assert kept(choice) == "rods"
    found = choice.parameters
    for name in SKEW_NAMES:
        assert abs(found[name].value - par4_of(p).parameters[name]) < 4.0 * found[name].std


def test_a_model_that_is_asked_for_is_kept_whatever_speaks_against_it():
    models = candidate_models(SPACE, Model.FULL)
    choice = select_model(NOMINAL, shots(TRUTH), models, asked=asked_of(Model.FULL))
    assert kept(choice) == FULL
    assert set(SKEW_NAMES) <= {*choice.free}
    assert [each.name for each in choice.models] == [STANDARD, "rods", FULL]
    only = candidate_models(SPACE, Model.PAPER)
    assert list(only) == [STANDARD]
    assert asked_of(Model.AUTO) is None


def test_one_model_alone_is_no_choice():
    data = shots(TRUTH)
    only = candidate_models(SPACE, Model.STANDARD)
    assert list(only) == [STANDARD]
    assert only[STANDARD] == USUAL
    assert select_model(NOMINAL, data, only).models == ()


def test_unseen_pairs_that_are_no_better_outweigh_the_fitted_ones():
    data = shots(TILTED, BACKLASH_RAD)
    standard = identify(NOMINAL, data, USUAL)
    held = np.array([purpose is ShotSet.VALIDATION for purpose in data.purposes])
    told = par4(standard.flat()).forward(data.joints[held]).values_or_raise()[:, :3]
    points = data.points_in_tracker_mm.copy()
    points[held] = TRACKER_FROM_BASE.apply(told)
    choice = chosen(replace(data, points_in_tracker_mm=points), (STANDARD, "axes+backlash"))
    assert kept(choice) == STANDARD
    outcome = "hold-out pairs are worse with it, beyond chance"
    assert outcomes(choice)["axes+backlash"] == outcome
    assert choice.models[-1].bic < choice.models[0].bic


def test_few_unseen_pairs_that_are_worse_within_chance_leave_the_choice_to_the_fitted_shots():
    data = shots(TRUTH, 0.2 * BACKLASH_RAD)
    told = par4(identify(NOMINAL, data, USUAL).flat()).forward(data.joints).values_or_raise()
    held = np.array([purpose is ShotSet.VALIDATION for purpose in data.purposes])
    points = data.points_in_tracker_mm.copy()
    points[held] = TRACKER_FROM_BASE.apply(told[held, :3])
    choice = chosen(replace(data, points_in_tracker_mm=points), (STANDARD, "backlash"))
    standard, backlash = choice.models
    assert backlash.unseen_rms_mm > 2.0 * standard.unseen_rms_mm
    assert kept(choice) == "backlash"


def test_unseen_pairs_that_are_worse_weigh_as_much_as_they_lose():
    data, options = shots(TRUTH, 0.037 * BACKLASH_RAD), IdentificationOptions()
    standard = Candidate("", USUAL, NOMINAL, data, options).instead(STANDARD, USUAL)
    larger = standard.instead("backlash", MODELS["backlash"])
    unseen = standard.found.unseen

    def times(factor):
        errors = factor * unseen.after
        table = type(unseen).from_arrays("pairs", unseen.numbers, unseen.before, errors)
        found = replace(larger.found, unseen=table, unseen_mm=table.summary())
        return replace(larger, found=found)

    assert 5.0 < standard.bic - larger.bic < 0.7 * larger.found.hold_out.chi2
    assert objection_to(times(1.001), standard) == ""
    assert objection_to(times(2.0), standard) == "hold-out pairs are no better with it"


def test_without_unseen_pairs_nothing_speaks_for_a_larger_model():
    choice = chosen(shots(TILTED, BACKLASH_RAD, unseen=0), (STANDARD, "axes+backlash"))
    assert kept(choice) == STANDARD
    assert outcomes(choice)["axes+backlash"] == "no hold-out pairs to support it"


def test_shots_that_do_not_say_how_joints_came_tell_no_backlash():
    data = shots(TILTED, BACKLASH_RAD)
    choice = chosen(replace(data, approach=np.zeros_like(data.approach)))
    assert kept(choice) == "axes"
    assert outcomes(choice)["backlash"] == "the shots do not say how their joints came"


def test_too_few_shots_for_a_larger_model_leave_the_standard_one():
    choice = chosen(noisy(simulated(7, 3, seed=1), 1), (STANDARD, "axes"))
    assert kept(choice) == STANDARD
    assert "too few" in outcomes(choice)["axes"]


def test_each_model_adds_its_parameters_to_what_the_user_frees_by_name():
    models = candidate_models(
        SPACE, Model.EXTENDED, freed=["arm0.x_mm"], fixed=["arm2.axis_tilt_deg"]
    )
    assert all("arm0.x_mm" in known.free for known in models.values())
    assert not any("arm2.axis_tilt_deg" in known.free for known in models.values())
    assert not {*AXIS_TILT_NAMES, *SPACE.backlashes} & {*models[STANDARD].free}
    assert {*SPACE.backlashes} <= {*models["backlash"].free}
    assert list(models["axes"].free) == sorted(models["axes"].free, key=SPACE.of_robot.index)
    models = candidate_models(SPACE, Model.EXTENDED, freed=["arm1.axis_tilt_deg"])
    assert "arm1.axis_tilt_deg" in models[STANDARD].free


def test_a_prior_counts_in_the_models_that_have_its_parameter():
    texts = ["arm2.axis_tilt_deg=0.03", "plate_mm=0.1"]
    models = candidate_models(SPACE, Model.EXTENDED, priors=texts)
    assert models["axes"].priors == {"plate_mm": 0.1, "arm2.axis_tilt_deg": 0.03}
    assert models[STANDARD].priors == {"plate_mm": 0.1}
    with pytest.raises(OptionsInvalid, match="is held"):
        candidate_models(SPACE, Model.EXTENDED, priors=["arm0.x_mm=0.1"])


def test_the_criterion_charges_a_parameter_the_logarithm_of_the_measurements():
    data = shots(TRUTH)
    found = identify(NOMINAL, data, USUAL)
    dearer = replace(found, rank=found.rank + 1)
    assert bic(dearer) - bic(found) == pytest.approx(np.log(3 * 120))
    assert len(SPACE.places(MODELS["axes+backlash"].free)) == 35


def test_a_ripple_of_unknown_rate_is_untold_and_every_number_of_the_result_finite():
    data, _ = geared()
    free = select_parameters(SPACE, ["arm*.ripple_*"], names=SPACE.of_robot)
    found = identify(NOMINAL, data, free)
    assert [f"arm{arm}.ripple_sin_deg" for arm in range(4)] == [
        name for (name,) in found.unobservable if "sin" in name
    ]
    assert json.dumps(found.document(), allow_nan=False)
