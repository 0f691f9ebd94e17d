"""Events: Bayes factors against dense matrices, and what truly happened to drawn campaigns."""

from dataclasses import replace

import numpy as np
import pytest
from small_fits import STATED_MM, log_bayes_factor, model_of, observed, with_columns, with_points

from campaigns.fit import events
from campaigns.fit.effects import ENCODER_RAD, STEP_MM, Lag, Step, Walk
from campaigns.fit.fit import Prior, fit_model, log_evidence, refit

GROUPS = ("offsets", "lengths", "axes", "sag")
MODEL = model_of("delta", *GROUPS)
STAND = MODEL.with_effects((Walk(0),))
SIZES = (1.0, 5.0, 25.0, 125.0)


def place_of(name):
    return MODEL.names.index(name)


def encoder_moved(arm, since, rad, until=10**9):
    """A change of an encoder over the shots from `since` to `until`."""
    place = place_of(f"arm{arm}.joint_offset_deg")

    def change(row, x, joints):
        moved = x.copy()
        moved[place] += rad / MODEL.tolerance[place] * (since <= row < until)
        return moved, joints

    return change


def shifted(observations, rows, shift_mm):
    points = observations.points.copy()
    points[rows] += shift_mm
    return with_points(observations, points)


def gross(observations, row, shift_mm):
    return shifted(observations, slice(row, row + 1), shift_mm)


def kinds(fit):
    return [event.kind for event in events.events_of(fit)]


@pytest.fixture(scope="module")
def noisy():
    """A fit with a stand, a shot of half weight and one that is left out."""
    observations = gross(observed(MODEL, 24, noise_mm=0.02), 5, [0.3, 0.0, 0.0])
    fit = fit_model(STAND, observations)
    good = fit.good.copy()
    good[[5, 11]] = [0.01, 0.5]
    return replace(fit, good=good)


# Bayes factors


def test_the_scan_over_spans_has_the_exact_bayes_factors_of_the_linear_model(noisy):
    spans = np.array([[3, 24], [8, 24], [10, 17]])
    parts = events.candidate_parts(noisy.model)
    chosen = ("frame", "encoder 0", "forearm 2")
    assert {*parts} == {"frame"} | {
        f"{part} {arm}" for part in ("encoder", "arm", "forearm") for arm in range(3)
    }
    result = events.scan(noisy, dict.fromkeys(chosen, spans))
    assert {*result} == {*chosen}
    for part in chosen:
        exact = []
        for since, until in spans.tolist():
            step = replace(parts[part], since=since, until=until if until < 24 else np.inf)
            of_sizes = [log_bayes_factor(noisy, step, {step.name: size}) for size in SIZES]
            exact.append(np.logaddexp.reduce(of_sizes) - np.log(4.0))
        assert result[part].log_factors == pytest.approx(exact, abs=1e-4)
        assert np.array_equal(result[part].spans, spans)


def test_a_change_that_all_shots_show_and_a_lag_have_their_exact_factors_too(noisy):
    lag = Lag(3)
    exact = [log_bayes_factor(noisy, lag, {"lag": size}) for size in SIZES]
    columns = noisy.at.columns_of(lag, noisy.observations)
    expected = np.logaddexp.reduce(exact) - np.log(4.0)
    assert events.whole_log_factor(noisy, columns) == pytest.approx(expected, abs=1e-4)
    since_prior = events.log_factors_since_prior(noisy)
    assert "frame" not in since_prior
    assert len(since_prior) == 9
    step = events.candidate_parts(noisy.model)["arm 1"]
    exact = [log_bayes_factor(noisy, step, {step.name: size}) for size in SIZES]
    expected = np.logaddexp.reduce(exact) - np.log(4.0)
    assert since_prior["arm 1"] == pytest.approx(expected, abs=1e-4)


def test_parts_within_four_of_the_best_are_named_the_best_first():
    evidence = {"arm 0": 3.0, "encoder 1": 10.0, "mount 2": 6.1, "frame": 6.0}
    assert events.likely_parts(evidence) == ("encoder 1", "mount 2")


# Truth


def test_nothing_happened_to_a_robot_that_did_not_change():
    for seed in range(4):
        fit = events.explain(STAND, observed(MODEL, 30, seed=seed, noise_mm=0.02))
        assert fit.model.effects == (Walk(0),)
        assert events.events_of(fit) == ()


def test_what_is_being_done_is_told():
    said = []
    change = encoder_moved(1, 22, 1e-3)
    events.explain(STAND, observed(MODEL, 40, change=change), tell=said.append)
    assert said[0] == "fitting all sources of error"
    looking, testing = "looking for changes and periods: step", "testing whether the shots need all"
    assert [f"{looking} 1", f"{looking} 2"] == [words for words in said if looking in words][:2]
    assert any(testing in words for words in said)
    assert said[-1] == "looking for errors by place and by angle"


def test_a_trial_ends_early_only_if_it_cannot_have_the_evidence():
    fit = events.explain(STAND, observed(MODEL, 40, change=encoder_moved(1, 22, 1e-3)))
    whole = refit(fit, fit.model.with_effects((Walk(0),)))
    evidence, least = log_evidence(whole), log_evidence(fit)
    short = refit(fit, whole.model, least_evidence=least)
    assert short.rounds < whole.rounds
    assert log_evidence(short) < least
    near = refit(fit, whole.model, least_evidence=evidence + 1.0)
    assert near.rounds == whole.rounds
    assert log_evidence(near) == evidence


@pytest.mark.slow
@pytest.mark.parametrize(("arm", "since", "mrad"), [(1, 22, 1.0), (0, 3, -2.0), (2, 37, 2.0)])
def test_a_moved_encoder_is_one_event_with_its_part_shots_and_size(arm, since, mrad):
    change = encoder_moved(arm, since, 1e-3 * mrad)
    fit = events.explain(STAND, observed(MODEL, 40, change=change))
    (event,) = events.events_of(fit)
    assert (event.kind, event.first, event.last) == ("change", since, 39)
    assert event.parts[0] == f"encoder {arm}"
    assert abs(event.size - 1e-3 * mrad) < 3.0 * event.std
    assert event.std < 1e-4
    assert event.is_lasting
    assert not event.leaves_out
    step = events.steps_of(fit)[0]
    assert fit.model.effects == (Walk(0), step)
    spans, intervals = 10 * 35, (35 * 36 - 2 * 35) // 2
    assert step.log_odds == pytest.approx(np.log(0.01 / (spans + intervals)), abs=0.2)


def test_a_changed_forearm_has_its_size_in_mm():
    place = place_of("arm1.forearm_mm")

    def change(row, x, joints):
        moved = x.copy()
        moved[place] += 0.3 / MODEL.tolerance[place] * (row >= 18)
        return moved, joints

    (event,) = events.events_of(events.explain(STAND, observed(MODEL, 40, change=change)))
    assert (event.first, event.parts[0]) == (18, "forearm 1")
    assert event.size == pytest.approx(0.3, abs=3.0 * event.std)
    assert event.std < 0.05


def test_a_bump_that_was_put_right_is_an_interval_of_the_frame_with_the_motion_of_its_points():
    observations = shifted(observed(MODEL, 40), slice(12, 25), [0.15, -0.1, 0.0])
    (event,) = events.events_of(events.explain(STAND, observations))
    assert (event.kind, event.first, event.last, event.parts) == ("change", 12, 24, ("frame",))
    assert abs(abs(event.size) - 0.15) < 3.0 * event.std + 0.03
    assert 0.0 < event.std < 0.05
    assert not event.is_lasting


def test_a_large_late_change_is_no_set_of_wrong_shots():
    """Its shots had no weight before it: a change with none to be estimated from stayed 0."""
    fit = events.explain(STAND, observed(MODEL, 40, change=encoder_moved(0, 33, 0.03)))
    (event,) = events.events_of(fit)
    assert (event.kind, event.parts[0], event.first) == ("change", "encoder 0", 33)
    assert abs(event.size - 0.03) < 2.0 * event.std + 1e-6


def test_a_change_that_looks_like_wrong_shots_is_a_change():
    observations = observed(MODEL, 40, change=encoder_moved(0, 33, 0.01))
    first = fit_model(STAND, observations)
    assert np.flatnonzero(~first.kept).tolist() == list(range(33, 40))
    (event,) = events.events_of(events.explain(STAND, observations))
    assert (event.kind, event.first, event.last) == ("change", 33, 39)
    assert event.parts[0] == "encoder 0"
    assert event.size == pytest.approx(0.01, abs=4.0 * event.std)


def test_wrong_shots_are_named_with_their_sizes_and_shots_without_assembly_apart():
    observations = gross(observed(MODEL, 30), 4, [0.0, 0.5, 0.0])
    observations = gross(observations, 21, [30.0, 40.0, 0.0])
    joints = observations.joints.copy()
    joints[9] = [2.0, -2.0, 2.5]
    fit = events.explain(STAND, replace(observations, joints=joints))
    found = {event.first: event for event in events.events_of(fit)}
    assert [event.kind for event in found.values()] == ["wrong shot", "no assembly", "wrong shot"]
    assert list(found) == [4, 9, 21]
    assert all(event.last == event.first and event.leaves_out for event in found.values())
    assert found[4].size == pytest.approx(0.5, abs=3.0 * found[4].std)
    assert found[21].size == pytest.approx(50.0, abs=3.0 * found[21].std)
    residual, covariance = fit.cavity
    along = residual[4] / np.linalg.norm(residual[4])
    assert found[4].std == pytest.approx(np.sqrt(along @ covariance[4] @ along))
    assert found[9].of_shots(range(100, 130)) == events.Event("no assembly", 109, 109)


def step_of(part, since, until=np.inf, **settings):
    return replace(
        events.candidate_parts(MODEL)[part], since=since, until=until, parts=(part,), **settings
    )


def test_a_superfluous_change_is_taken_out_and_a_needed_one_stays():
    needed = step_of("encoder 1", 20.0, log_odds=-11.0)
    superfluous = step_of("arm 0", 9.0, log_odds=-11.0)
    model = MODEL.with_effects((superfluous, needed))
    fit = fit_model(model, observed(MODEL, 40, change=encoder_moved(1, 20, 1e-3)))
    simpler = events.add_steps(fit)
    assert [step.name for step in simpler.model.effects] == [needed.name]
    assert log_evidence(simpler) > log_evidence(fit)


def test_a_change_of_another_part_nearby_is_kept_beside_the_new_one():
    of_arm = encoder_moved(0, 21, 1e-3)
    of_both = encoder_moved(1, 20, 1e-3)
    observations = observed(MODEL, 40, change=lambda row, x, q: of_arm(row, *of_both(row, x, q)))
    first = fit_model(
        MODEL.with_effects((step_of("encoder 1", 20.0, log_odds=-11.0),)), observations
    )
    steps = events.steps_of(events.add_steps(first))
    assert [(step.part, step.since) for step in steps] == [("encoder 1", 20.0), ("encoder 0", 21.0)]


def test_a_change_found_beside_its_shot_is_moved_and_not_doubled():
    observations = observed(MODEL, 40, change=encoder_moved(1, 20, 1e-3))
    beside = fit_model(
        MODEL.with_effects((step_of("encoder 1", 23.0, log_odds=-11.0),)), observations
    )
    (step,) = events.steps_of(events.add_steps(beside))
    assert (step.part, step.since) == ("encoder 1", 20.0)


@pytest.mark.slow
def test_two_changes_of_one_part_are_two_events():
    first, second = encoder_moved(1, 12, 1e-3), encoder_moved(1, 28, 2e-3)
    observations = observed(MODEL, 40, change=lambda row, x, q: second(row, *first(row, x, q)))
    found = events.events_of(events.explain(STAND, observations))
    assert [(event.first, event.parts[0]) for event in found] == [
        (12, "encoder 1"),
        (28, "encoder 1"),
    ]
    assert [event.size for event in found] == pytest.approx([1e-3, 2e-3], abs=3e-4)


@pytest.mark.slow
def test_the_changes_of_all_shots_are_given_to_the_fit_of_some():
    observations = observed(MODEL, 40, change=encoder_moved(1, 20, 1e-3))
    whole = events.explain(STAND, observations)
    rows = np.arange(0, 40, 2)
    part = fit_model(STAND, observations.rows(rows))
    with_steps = events.with_steps_of(whole, part)
    assert events.steps_of(with_steps) == events.steps_of(whole)
    assert with_steps.model.effects[0] == Walk(0)
    assert events.with_steps_of(with_steps, with_steps) is with_steps
    assert events.with_steps_of(part, part) is part
    again = events.with_steps_of(part, with_steps)
    assert events.steps_of(again) == ()


def test_joints_read_too_early_are_a_lag():
    observations = observed(MODEL, 40)
    joints = observations.joints.copy()
    joints[1:] += 0.004 * (joints[:-1] - joints[1:])
    former = np.r_[joints[:1], joints[:-1]]
    fit = events.explain(STAND, replace(observations, joints=joints, former=former))
    assert [effect.name for effect in fit.model.effects] == ["stand", "lag"]
    assert fit.at.x[-3:] == pytest.approx(np.full(3, -4.0), abs=0.3)


@pytest.mark.parametrize("rad", [5e-5, 8e-5])
def test_sigma_has_how_far_the_robots_of_other_parts_are_by_their_evidence(rad):
    """A small change, which other parts explain as well or nearly as well."""
    named = ("encoder 1", "arm 1", "forearm 2", "mount 7")
    step = replace(step_of("encoder 1", 14.0, log_odds=-3.0), parts=named)
    observations = observed(MODEL, 30, change=encoder_moved(1, 14, rad))
    fit = fit_model(MODEL.with_effects((Walk(0), step)), observations)
    expected, total = np.zeros((len(MODEL.names), len(MODEL.names))), 1.0
    for part in ("arm 1", "forearm 2"):
        other = replace(step_of(part, 14.0, log_odds=-3.0), parts=named)
        of_other = fit_model(MODEL.with_effects((Walk(0), other)), observations)
        weight = np.exp(min(log_evidence(of_other) - log_evidence(fit), 0.0))
        away = of_other.model.of_today @ of_other.at.x - fit.model.of_today @ fit.at.x
        expected, total = expected + weight * np.outer(away, away), total + weight
    spread = events.spread_over_parts(fit)
    assert total > 1.5
    assert np.sqrt(np.diag(spread)) == pytest.approx(np.sqrt(np.diag(expected / total)), abs=0.01)
    largest = np.abs(expected / total).max()
    assert spread == pytest.approx(expected / total, abs=0.05 * largest)
    alone = replace(fit, model=MODEL.with_effects((Walk(0), replace(step, parts=named[:1]))))
    assert not events.spread_over_parts(alone).any()


# Since a former result


def since_former(change=None, count=10, seed=9):
    """A fit of new shots with a former result as prior, of the robot with a change or without."""
    former = fit_model(MODEL, observed(MODEL, 60))
    prior = Prior(former.x, np.linalg.inv(former.model_covariance), former.factors)
    return fit_model(MODEL, observed(MODEL, count, seed=seed, change=change), prior)


def test_a_part_that_changed_since_a_former_result_is_named_and_an_unchanged_robot_is_not():
    assert events.add_changes_since_prior(since_former()).model.effects == ()
    fit = events.add_changes_since_prior(since_former(encoder_moved(2, 0, 1e-3)))
    (step,) = events.steps_of(fit)
    assert step.parts[0] == "encoder 2"
    assert step.log_odds == pytest.approx(np.log(0.01 / 9.0))
    assert step.is_lasting
    assert fit.at.x[-1] * ENCODER_RAD == pytest.approx(1e-3, abs=1e-4)


def test_a_change_of_the_visible_size_would_have_been_found_and_one_of_half_of_it_not():
    fit = since_former()
    at = replace(fit.at, x=fit.prior.mean, residual=0.0 * fit.at.residual)
    fit = replace(fit, at=at)
    visible = events.visible_changes(fit)
    assert {*visible} == {("encoder", True), ("arm", False), ("forearm", False)}
    for (word, is_angle), size in visible.items():
        usual = ENCODER_RAD if is_angle else STEP_MM
        mean_factors = []
        for part, step in events.candidate_parts(fit.model).items():
            if part.split()[0] != word:
                continue
            column = fit.at.columns_of(step, fit.observations)[..., 0]
            means = []
            for share in (1.0, 0.5):
                moved = replace(fit, at=replace(at, residual=share * size / usual * column))
                factors = np.array(list(events.log_factors_since_prior(moved).values()))
                means.append(np.logaddexp.reduce(factors) - np.log(len(factors) / 0.01))
            mean_factors.append(means)
        whole, half = np.array(mean_factors).min(axis=0)
        assert whole > 0.0
        assert half < 0.0


def test_a_column_of_no_effect_changes_no_evidence_but_by_its_odds():
    fit = fit_model(MODEL, observed(MODEL, 20, noise_mm=STATED_MM))
    step = step_of("encoder 1", 8.0, log_odds=-7.0)
    still = with_columns(fit, step, np.zeros((20, 3, 1)))
    still = replace(still, sizes={**fit.sizes, step.name: 1.0})
    assert log_evidence(still) - log_evidence(fit) == pytest.approx(-7.0 - np.log(2.0))
    assert isinstance(step, Step)
