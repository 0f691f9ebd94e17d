"""Hold-out pairs: errors and covariance of distances by sums, and what is not counted."""

from dataclasses import replace

import numpy as np
import pytest
import scipy
from rod_campaigns import rod_campaign

from campaigns.fit.effects import Layer
from campaigns.fit.error_model import Observations
from campaigns.fit.fit import fit_model, noise_parts, refit
from campaigns.identification.findings import HoldOut
from campaigns.identification.hold_out import UnseenPairs, distance_errors, unseen_pairs
from campaigns.identification.observations import error_model, observations_of
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.result import ResidualTable
from campaigns.shots.shot_sets import ShotSet

SHOTS, PAIRS = 30, 6


class Judged:
    """A small campaign with its fit, and the robots by which its pairs are judged."""

    def __init__(self, seed=1):
        campaign = rod_campaign("delta", shots=SHOTS, pairs=PAIRS, seed=seed)
        self.shots, nominal = campaign.shots, campaign.robot.kinematics
        options = IdentificationOptions()
        self.at_nominal = nominal.forward(self.shots.joints, approach=self.shots.approach)
        self.observations = observations_of(self.shots, self.at_nominal.values, options)
        model = error_model(nominal, self.shots, options)
        rows = self.shots.rows_of(ShotSet.IDENTIFICATION)
        self.fit = fit_model(model, self.observations.rows(rows))
        robot = model.kinematics(self.fit.x)
        self.identified = robot.forward(
            self.shots.joints, self.at_nominal.values, approach=self.shots.approach
        )

    def judge(self, left_out=(), **changed):
        values = {
            "fit": self.fit, "shots": self.shots, "at_nominal": self.at_nominal,
            "identified": self.identified, "observations": self.observations,
        } | changed  # fmt: skip
        return unseen_pairs(**values, left_out=left_out)


@pytest.fixture(scope="module")
def judged():
    return Judged()


def test_errors_and_chi2_are_those_of_distances_between_the_predicted_points(judged):
    pairs, fit = judged.judge(), judged.fit
    assert pairs.rows.tolist() == [[SHOTS + 2 * n, SHOTS + 2 * n + 1] for n in range(PAIRS)]
    every = judged.observations
    at = fit.model.predict(fit.at.x, fit.at.frames, every, every.near)
    noise = noise_parts(fit.model, every, at.by_joint)
    total = sum(fit.factors[part] * covariance for part, covariance in noise.items())
    errors, by_unknowns, variances = [], [], []
    for first, second in pairs.rows.tolist():
        apart = every.points[second] - every.points[first]
        along = apart / np.linalg.norm(apart)
        errors.append(along @ (at.residual[second] - at.residual[first]))
        by_unknowns.append(along @ (at.jacobian[second] - at.jacobian[first]))
        variances.append(along @ (total[first] + total[second]) @ along)
    errors, by_unknowns = np.array(errors), np.array(by_unknowns)
    covariance = by_unknowns @ fit.covariance @ by_unknowns.T + np.diag(variances)
    assert pairs.test.pairs == PAIRS
    assert pairs.test.chi2 == pytest.approx(errors @ np.linalg.solve(covariance, errors))
    expected = np.sqrt((errors**2).sum() / np.trace(covariance))
    assert pairs.test.ratio == pytest.approx(expected)
    assert pairs.errors.after[:, 0] == pytest.approx(errors, abs=5e-3)
    assert pairs.test.p == pytest.approx(scipy.stats.chi2(PAIRS).sf(pairs.test.chi2), abs=1e-3)


def test_where_scatter_was_estimated_from_few_shots_a_large_chi2_has_a_larger_probability(judged):
    fit = judged.fit
    scattered = replace(
        fit, factors={**fit.factors, "stated": 1e-6, "points": 0.01, "joints": 1e-6}
    )
    points = judged.shots.points_in_tracker_mm.copy()
    points[SHOTS:] += 0.1 * np.random.default_rng(2).standard_normal((2 * PAIRS, 3))
    test = judged.judge(
        fit=scattered, observations=replace(judged.observations, points=points)
    ).test
    known = scipy.stats.chi2(PAIRS).sf(test.chi2)
    few = scipy.stats.f(PAIRS, scattered.freedom).sf(test.chi2 / PAIRS)
    assert known + 0.2 * (few - known) < test.p <= few


def test_a_good_fit_is_confirmed_by_its_pairs_and_gains(judged):
    pairs = judged.judge()
    assert pairs.test.believable
    assert pairs.test.applied_ratio == 1.0
    assert not pairs.got_worse
    assert np.abs(pairs.errors.after).max() < 0.1 * np.abs(pairs.errors.before).max()
    assert pairs.lost == ()


def test_real_errors_beyond_the_stated_ones_widen_sigma_by_their_ratio(judged):
    points = judged.shots.points_in_tracker_mm.copy()
    rng = np.random.default_rng(2)
    points[SHOTS:] += 0.2 * rng.standard_normal((2 * PAIRS, 3))
    pairs = judged.judge(
        shots=replace(judged.shots, points_in_tracker_mm=points),
        observations=replace(judged.observations, points=points),
    )
    assert not pairs.test.believable
    assert pairs.test.applied_ratio == pairs.test.ratio > 5.0
    assert HoldOut(6, 100.0, 1e-9, 0.7).applied_ratio == 1.0
    assert HoldOut(6, 100.0, 1e-9, 3.0).applied_ratio == 3.0
    assert HoldOut(6, 6.0, 0.5, 3.0).applied_ratio == 1.0


def test_what_a_layer_may_be_between_the_shots_makes_pairs_less_sure(judged):
    fit, angles = judged.fit, tuple(joint[:, None] for joint in judged.fit.observations.joints.T)
    layer = Layer.over("arms", angles, 0.02, 1e-4)
    with_layer = refit(fit, fit.model.with_effects((layer,)))
    held = replace(with_layer, sizes={**with_layer.sizes, layer.name: 1e-6})
    wide = replace(held, sizes={**held.sizes, layer.name: 10.0})
    ratios = [judged.judge(fit=changed).test.ratio for changed in (held, wide)]
    assert ratios[1] < 0.5 * ratios[0]


def test_pairs_with_a_wrong_shot_or_of_two_frames_or_none_are_not_counted(judged):
    wrong = judged.judge(left_out=[SHOTS + 3])
    assert wrong.rows[:, 0].tolist() == [SHOTS, *range(SHOTS + 4, SHOTS + 2 * PAIRS, 2)]
    frame = judged.observations.frame.copy()
    frame[[SHOTS + 2, SHOTS + 3]] = -1
    frame[SHOTS + 7] = 1
    pairs = judged.judge(observations=replace(judged.observations, frame=frame))
    assert pairs.rows[:, 0].tolist() == [SHOTS, SHOTS + 4, SHOTS + 8, SHOTS + 10]
    assert (wrong.lost, pairs.lost) == ((), ())


def unsolved(solution, row):
    is_solved = solution.is_solved.copy()
    is_solved[row] = False
    return replace(solution, is_solved=is_solved)


def test_pairs_that_the_identified_robot_cannot_take_are_lost_and_no_others(judged):
    pairs = judged.judge(identified=unsolved(judged.identified, SHOTS + 4))
    assert [excluded.pair for excluded in pairs.lost] == [judged.shots.pairs[SHOTS + 4]]
    assert len(pairs.rows) == PAIRS - 1
    both = judged.judge(
        at_nominal=unsolved(judged.at_nominal, SHOTS + 5),
        identified=unsolved(judged.identified, SHOTS + 4),
    )
    assert both.lost == ()
    assert len(both.rows) == PAIRS - 1


def test_without_pairs_there_is_no_test(judged):
    pairs = judged.judge(left_out=range(SHOTS, SHOTS + 2 * PAIRS))
    assert (len(pairs.rows), pairs.errors, pairs.test, pairs.got_worse) == (0, None, None, False)


def grown(before, after):
    table = ResidualTable.from_arrays(
        "pairs", range(len(before)), np.array(before)[:, None], np.array(after)[:, None]
    )
    return UnseenPairs(np.zeros((0, 2), dtype=int), table, None, ())


def test_errors_got_worse_only_beyond_chance():
    assert grown([0.1, 0.12, 0.11, 0.1], [0.2, 0.22, 0.21, -0.2]).got_worse
    assert not grown([0.2, 0.22, 0.21, 0.2], [0.1, 0.12, 0.11, 0.1]).got_worse
    assert not grown([0.1, 0.2, 0.1, 0.2], [0.2, 0.1, 0.21, 0.1]).got_worse
    assert grown([0.1, 0.1], [0.2, 0.1]).got_worse
    # of three pairs the scatter is known, and a mean within it is chance
    assert not grown([0.1, 0.1, 0.1], [0.3, 0.1, 0.09]).got_worse
    assert not grown([0.1, 0.1], [0.1, 0.1]).got_worse


def test_growth_counts_beyond_the_limit_of_students_t():
    rng = np.random.default_rng(1)
    deviation = rng.standard_normal(16)
    deviation = (deviation - deviation.mean()) / deviation.std(ddof=1)
    limit = scipy.stats.t(15).ppf(0.975) / 4.0
    for share, is_worse in ((1.03, True), (0.97, False)):
        growth = share * limit + deviation
        before = np.full(16, 3.0)
        assert grown(before, np.sqrt(before**2 + growth)).got_worse == is_worse


def test_limits_are_met_where_the_mean_and_the_largest_error_with_u_are_below(judged):
    pairs = judged.judge()
    reach, after = pairs.test.reach_mm, np.abs(pairs.errors.after[:, 0])
    assert reach["max"] > after.max()
    assert reach["mean"] > np.abs(pairs.errors.after.mean())
    assert reach["max"] < after.max() + 0.2
    assert pairs.test.meets({"mean": 1.01 * reach["mean"], "max": 1.01 * reach["max"]})
    assert not pairs.test.meets({"mean": 1.01 * reach["mean"], "max": 0.99 * reach["max"]})
    assert not pairs.test.meets({"mean": 0.99 * reach["mean"], "max": 1.01 * reach["max"]})
    off = judged.identified.values.copy()
    off[:, :3] *= 1.001
    larger = judged.judge(identified=replace(judged.identified, values=off))
    growth = np.abs(larger.errors.after).max() - after.max()
    assert larger.test.reach_mm["max"] - reach["max"] == pytest.approx(growth, rel=0.05)


def test_errors_of_distances_are_modelled_less_measured(judged):
    rows, near = np.array([[0, 3], [5, 1]]), judged.at_nominal.values
    table = distance_errors(judged.shots, rows, near, 2.0 * near)
    points = judged.shots.points_in_tracker_mm
    for number, (first, second) in enumerate(rows.tolist()):
        measured = np.linalg.norm(points[second] - points[first])
        modelled = np.linalg.norm(near[second, :3] - near[first, :3])
        assert table.before[number, 0] == pytest.approx(modelled - measured)
        assert table.after[number, 0] == pytest.approx(2.0 * modelled - measured)
    assert table.numbers == tuple(judged.shots.pairs[row] or 0 for row in (0, 5))
    assert isinstance(judged.observations, Observations)
