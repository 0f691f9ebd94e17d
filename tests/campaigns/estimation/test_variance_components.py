"""The robot's own scatter is found where there is some, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest

from campaigns.estimation import variance_components
from campaigns.estimation.variance_components import (
    NONE,
    LinearizedShots,
    VarianceComponents,
    estimate_components,
)

SHOTS, UNKNOWNS, JOINTS = 100, 12, 4


def shots(seed, point_mm=0.0, joint=0.0, stated_mm=0.01):
    """Linear shots with known scatter, their residuals being those of a plain fit."""
    rng = np.random.default_rng(seed)
    jacobian = rng.standard_normal((SHOTS, 3, UNKNOWNS))
    by_joints = 300.0 * rng.standard_normal((SHOTS, 3, JOINTS))
    stated = np.einsum("nij,nkj->nik", *2 * [stated_mm * rng.standard_normal((SHOTS, 3, 5))])
    true = VarianceComponents(point_mm, joint).covariance_mm2(stated, by_joints)
    noise = np.einsum("nij,nj->ni", np.linalg.cholesky(true), rng.standard_normal((SHOTS, 3)))
    fitted = np.linalg.lstsq(jacobian.reshape(-1, UNKNOWNS), noise.ravel(), rcond=None)[0]
    return LinearizedShots(noise - jacobian @ fitted, jacobian, stated, by_joints)


def found(count, **scatter):
    return [estimate_components(shots(seed, **scatter)) for seed in range(count)]


def test_what_scatters_as_stated_has_no_components():
    assert sum(each.any for each in found(40)) <= 2


def test_scatter_is_told_as_the_points_or_the_joints_or_both():
    each = found(20, point_mm=0.1)
    values = np.array([one.point_mm for one in each])
    assert values.mean() == pytest.approx(0.1, rel=0.03)
    assert values.std() == pytest.approx(np.mean([one.point_mm_std for one in each]), rel=0.5)
    assert sum(one.joint > 0.0 for one in each) <= 1
    each = found(20, joint=2e-4)
    assert np.mean([one.joint for one in each]) == pytest.approx(2e-4, rel=0.05)
    assert sum(one.point_mm > 0.0 for one in each) <= 1
    each = found(10, point_mm=0.1, joint=3e-4)
    assert np.mean([one.point_mm for one in each]) == pytest.approx(0.1, rel=0.15)
    assert np.mean([one.joint for one in each]) == pytest.approx(3e-4, rel=0.15)


@pytest.mark.parametrize("apart", [0.0, 1e-4, 10.0])
def test_squares_tell_the_components_that_a_qr_tells(monkeypatch, apart):
    many = shots(3, point_mm=0.01, joint=3e-5)
    many.jacobian[:, :, 1] = many.jacobian[:, :, 0] * (1.0 + 0.1 * apart)
    many.jacobian[0, 0, 1] += apart
    found = estimate_components(many)
    monkeypatch.setattr(variance_components, "LEAST_PIVOT", np.inf)
    by_qr = estimate_components(many)
    assert by_qr.any
    for name in ("point_mm", "joint", "point_mm_std", "joint_std"):
        assert getattr(found, name) == pytest.approx(getattr(by_qr, name), rel=1e-7)


def few_shots(seed, scatter_mm=0.015, stated_mm=(0.02, 0.02, 0.003)):
    """Fourteen shots by a tracker that knows distances better than directions, after their fit."""
    rng = np.random.default_rng(seed)
    jacobian, by_joints = (rng.standard_normal((14, 3, columns)) for columns in (28, JOINTS))
    whitening = 1.0 / np.array(stated_mm)
    noise = np.hypot(stated_mm, scatter_mm) * rng.standard_normal((14, 3))
    weighed = (whitening[:, None] * jacobian).reshape(-1, 28)
    fitted = np.linalg.lstsq(weighed, (whitening * noise).ravel(), rcond=None)[0]
    stated = np.tile(np.diag(np.square(stated_mm)), (14, 1, 1))
    return LinearizedShots(noise - jacobian @ fitted, jacobian, stated, 300.0 * by_joints)


def test_few_shots_show_scatter_whose_score_promises_little(monkeypatch):
    few = [few_shots(seed) for seed in range(40)]
    asked = [estimate_components(each) for each in few]
    monkeypatch.setattr(variance_components, "_scores", lambda shots: np.full(2, np.inf))
    unasked = [estimate_components(each) for each in few]
    assert asked == unasked
    assert any(each.any for each in unasked)


def test_too_few_shots_tell_nothing_and_parts_sum():
    assert estimate_components(shots(1, point_mm=0.1).rows(np.arange(4))) is NONE
    by_joints = np.array([[[2.0], [0.0], [0.0]]])
    total = VarianceComponents(0.3, 0.5).covariance_mm2(0.04 * np.eye(3)[None], by_joints)
    assert np.diag(total[0]) == pytest.approx([0.04 + 0.09 + 1.0, 0.13, 0.13])


def test_components_stay_where_another_fit_hardly_moves_them():
    some = shots(3, point_mm=0.1)
    first = estimate_components(some)
    near = replace(some, residual_mm=some.residual_mm + 1e-3 * some.jacobian[:, :, 0])
    assert estimate_components(near, before=first) is first
    wider = replace(some, residual_mm=1.05 * some.residual_mm)
    again = estimate_components(wider, before=first)
    assert again == estimate_components(wider)
    assert again.point_mm == pytest.approx(1.05 * first.point_mm, rel=0.01)
    for other in (shots(3), shots(3, joint=2e-4), shots(3, point_mm=0.1, joint=4e-4)):
        assert estimate_components(other, before=first) == estimate_components(other)
