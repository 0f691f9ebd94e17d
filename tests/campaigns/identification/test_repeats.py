"""Visits of one pose: whether the scatter of a fit is the robot's, or an error that repeats."""

from dataclasses import replace

import numpy as np
import pytest
import scipy
from rod_campaigns import SMALL, rod_campaign

from campaigns.api import identify, sample_workspace
from campaigns.fit.fit import fit_model, noise_parts
from campaigns.identification.observations import error_model, observations_of
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.repeats import LEVEL, planned_visits, repeating_share
from campaigns.shots.shot_sets import ShotSet

VISITS = 10


def with_visits(campaign, scatter_mm, visit_mm, seed=3):
    """The campaign's shots scattered, and visits of one pose that scatter otherwise."""
    rng = np.random.default_rng(seed)
    shots = campaign.shots
    row = int(shots.rows_of(ShotSet.IDENTIFICATION)[20])
    rows = np.concatenate([np.arange(len(shots)), np.full(VISITS, row)])
    more = shots.rows(rows)
    noise = scatter_mm * rng.standard_normal((len(more), 3))
    noise[-VISITS:] = visit_mm * rng.standard_normal((VISITS, 3))
    return replace(
        more,
        numbers=tuple(range(len(more))),
        purposes=(*shots.purposes, *(ShotSet.REPEATABILITY,) * VISITS),
        pairs=(*shots.pairs, *(None,) * VISITS),
        points_in_tracker_mm=more.points_in_tracker_mm + noise,
    )


@pytest.fixture(scope="module")
def campaign():
    return rod_campaign("linear-delta", SMALL, shots=60, seed=6)


def stated(campaign, shots):
    options = {"workspace": sample_workspace(campaign.robot, 30)}
    return identify(shots, campaign.robot, options=options)


def test_scatter_that_visits_do_not_show_is_an_error_of_every_position(campaign):
    repeats = stated(campaign, with_visits(campaign, 0.05, 0.003))
    scatters = stated(campaign, with_visits(campaign, 0.05, 0.05))
    rows = {share.source: share.mm for share in repeats.uncertainty.budget}
    assert rows["repeating"] == pytest.approx(0.05 * 3**0.5, rel=0.25)
    assert "repeating" not in {share.source for share in scatters.uncertainty.budget}
    total_mm = sum(share.mm**2 for share in repeats.uncertainty.budget) ** 0.5
    assert repeats.uncertainty.position_std_mm.rms == pytest.approx(total_mm, rel=1e-3)
    assert repeats.uncertainty.position_std_mm.rms > 1.5 * scatters.uncertainty.position_std_mm.rms


# Algebra


class Visited:
    """A fit of a small campaign, and visits of some of its poses with given residuals."""

    def __init__(self, seed=1):
        campaign = rod_campaign("delta", shots=30, pairs=1, seed=seed)
        self.shots, nominal = campaign.shots, campaign.robot.kinematics
        self.near = nominal.forward(self.shots.joints, approach=self.shots.approach).values
        rows = self.shots.rows_of(ShotSet.IDENTIFICATION)
        model = error_model(nominal, self.shots, IdentificationOptions())
        fit = fit_model(model, self.observe(self.shots, self.near).rows(rows))
        self.fit = replace(fit, factors={"stated": 1.5, "points": 0.01, "joints": 0.02})

    @staticmethod
    def observe(shots, near):
        return observations_of(shots, near, IdentificationOptions())

    def visit(self, *poses, kind=ShotSet.DRIFT, shift=0.0):
        """All shots and visits of poses (row, residuals (k, 3)); joints are read with a shift."""
        rows = np.concatenate([np.full(len(residuals), row) for row, residuals in poses])
        every, count = np.r_[np.arange(len(self.shots)), rows], len(rows)
        shots = self.shots.rows(every)
        shots = replace(
            shots,
            numbers=tuple(range(len(every))),
            purposes=(*self.shots.purposes, *(kind,) * count),
            pairs=(*self.shots.pairs, *(None,) * count),
        )
        observations = self.observe(shots, self.near[every])
        joints = observations.joints.copy()
        joints[-count:] += shift * np.linspace(-1.0, 1.0, count)[:, None]
        observations = replace(observations, joints=joints)
        points = observations.points.copy()
        predicted = self.predict(observations).residual + points
        points[-count:] = predicted[-count:] - np.concatenate([of_pose for _, of_pose in poses])
        return shots, replace(observations, points=points)

    def predict(self, observations):
        fit = self.fit
        return fit.model.predict(fit.at.x, fit.at.frames, observations, observations.near)

    def covariances(self, row):
        """Covariances of a shot at a pose: the tracker's, and the robot's as the fit has it."""
        observations = self.observe(self.shots, self.near)
        parts = noise_parts(self.fit.model, observations, self.predict(observations).by_joint)
        stated, point, joint = (
            self.fit.factors[part] * parts[part][row] for part in ("stated", "points", "joints")
        )
        return stated, point + joint

    def drawn(self, row, count, share, seed=1):
        """Residuals (k, 3) of visits whose scatter is a share of the fit's."""
        stated, scatter = self.covariances(row)
        root = np.linalg.cholesky(stated + share * scatter)
        return 0.3 + np.random.default_rng([seed, row]).standard_normal((count, 3)) @ root.T

    def share(self, *poses, **settings):
        return repeating_share(self.fit, *self.visit(*poses, **settings))

    def likeliest(self, *poses):
        """Share of the largest density of what the means of poses leave of their visits."""
        grid = np.linspace(0.0, 1.0, 51)
        values = np.zeros(len(grid))
        for row, residuals in poses:
            stated, scatter = self.covariances(row)
            contrasts = scipy.linalg.null_space(np.ones((1, len(residuals)))).T @ residuals
            for number, share in enumerate(grid):
                normal = scipy.stats.multivariate_normal(np.zeros(3), stated + share * scatter)
                values[number] += normal.logpdf(contrasts).sum()
        return grid[values.argmax()]


@pytest.fixture(scope="module")
def visited():
    return Visited()


@pytest.mark.parametrize("true_share", [0.0, 0.07, 0.17, 0.25])
def test_the_share_is_that_of_the_largest_density_of_what_the_means_leave(visited, true_share):
    poses = [(row, visited.drawn(row, 12, true_share)) for row in (3, 17)]
    best = visited.likeliest(*poses)
    assert visited.share(*poses) == pytest.approx(1.0 - best)
    assert abs(best - true_share) < 0.15
    of_repeatability = visited.share(*poses, kind=ShotSet.REPEATABILITY)
    assert of_repeatability == pytest.approx(1.0 - best)
    moved = visited.share(*poses, shift=1e-3)
    assert moved == pytest.approx(1.0 - best, abs=0.021)


@pytest.mark.parametrize(("factor", "is_shown"), [(0.98, True), (1.02, False)])
def test_visits_contradict_the_scatter_of_a_fit_below_the_limit_of_fishers_f(
    visited, factor, is_shown
):
    residuals = visited.drawn(5, 8, 0.5)
    deviations = residuals - residuals.mean(axis=0)
    weights = np.linalg.inv(sum(visited.covariances(5)))
    chi2 = np.einsum("ni,ij,nj->", deviations, weights, deviations)
    limit = 21.0 * scipy.stats.f(21, visited.fit.freedom).ppf(0.05)
    at_limit = deviations * np.sqrt(factor * limit / chi2)
    assert (visited.share((5, at_limit)) > 0.0) == is_shown


def test_poses_of_one_visit_other_sessions_and_shots_without_a_place_do_not_count(visited):
    first, second = ((row, visited.drawn(row, 8, 0.1)) for row in (3, 17))
    far = visited.drawn(9, 8, 400.0)
    alone = visited.share(first, second)
    assert 0.5 < alone < 1.0
    assert visited.share(first, second, (9, far[:1])) == pytest.approx(alone)
    assert visited.share((9, far[:1]), (11, far[1:2])) == 0.0
    assert visited.share((9, far)) == 0.0
    assert (
        repeating_share(visited.fit, visited.shots, visited.observe(visited.shots, visited.near))
        == 0.0
    )
    shots, observations = visited.visit(first, second, (9, far))
    assert repeating_share(visited.fit, shots, observations) == 0.0
    frame, near = observations.frame.copy(), observations.near.copy()
    frame[-8:] = -1
    assert repeating_share(visited.fit, shots, replace(observations, frame=frame)) == pytest.approx(
        alone
    )
    near[-8:, 1] = np.nan
    assert repeating_share(visited.fit, shots, replace(observations, near=near)) == pytest.approx(
        alone
    )


def test_visits_of_one_pose_in_two_sessions_have_a_mean_each(visited):
    residuals = visited.drawn(3, 16, 0.1)
    apart = residuals + np.repeat([[0.0], [5.0]], 8, axis=0)
    fit = replace(visited.fit, at=replace(visited.fit.at, frames=visited.fit.at.frames * 2))
    shots, observations = visited.visit((3, apart))
    assert repeating_share(fit, shots, observations) == 0.0
    frame = observations.frame.copy()
    frame[-8:] = 1
    of_two = repeating_share(fit, shots, replace(observations, frame=frame))
    best = visited.likeliest((3, residuals[:8]), (3, residuals[8:]))
    assert of_two == pytest.approx(1.0 - best)


def drawn_variances(visits, count, seed):
    """Variances of so many visits of one pose that scatter by 1 an axis, of `count` campaigns."""
    points = np.random.default_rng(seed).standard_normal((count, visits, 3))
    deviations = points - points.mean(axis=1, keepdims=True)
    return (deviations**2).sum(axis=(1, 2)) / (3 * (visits - 1))


@pytest.mark.parametrize("visits", [3, 6, 10])
def test_planned_visits_show_the_scatter_as_drawn_ones_do(visits):
    freedom, count = 120, 4000
    planned = planned_visits(visits, freedom)
    variances = drawn_variances(visits, count, seed=visits)
    assert planned.scatter_std == pytest.approx(np.sqrt(variances).std(), rel=0.08)
    # the fit's scatter is 1, of which a share repeats and is not in the visits
    of_fit = np.random.default_rng(9).chisquare(freedom, count) / freedom

    def shown(share):
        ratios = (1.0 - share) * variances / of_fit
        return (scipy.stats.f(3 * (visits - 1), freedom).cdf(ratios) < LEVEL).mean()

    assert shown(0.0) == pytest.approx(LEVEL, abs=0.015)
    assert shown(planned.shown_share) == pytest.approx(0.5, abs=0.03)


def test_more_visits_show_more():
    shares = [planned_visits(visits, 120.0).shown_share for visits in (3, 5, 10)]
    assert shares == pytest.approx([0.70, 0.55, 0.41], abs=0.01)
