"""Lack of fit: what has a cause is told from what scatters, by the cause's own columns."""

import numpy as np
import pytest

from campaigns.estimation import lack_of_fit
from campaigns.estimation.error_columns import harmonic, of_joints, smooth
from campaigns.estimation.f_test import FittedShots, log_p
from campaigns.estimation.information import SIGNIFICANCE

SHOTS, UNKNOWNS, ARMS = 100, 15, np.arange(4)


def drawn(seed):
    """Joints, ∂point/∂joints, the fit's columns and noise, all whitened."""
    rng = np.random.default_rng(seed)
    joints = rng.uniform(-0.5, 1.0, (SHOTS, 4))
    by_joints = rng.standard_normal((SHOTS, 3, 4))
    jacobian = np.concatenate([by_joints, rng.standard_normal((SHOTS, 3, UNKNOWNS))], axis=2)
    return joints, by_joints, jacobian, rng.standard_normal((SHOTS, 3))


def groups_of(joints, by_joints):
    return (
        lack_of_fit.Group("eccentricity", harmonic(by_joints, joints), np.repeat(ARMS, 2)),
        lack_of_fit.Group("ratio", of_joints(by_joints, joints), ARMS),
        lack_of_fit.Group("joints", smooth(joints)),
    )


def lacks_with(seed, effect):
    """Lacks of shots whose points are where the model lacks `effect` of joints and J."""
    joints, by_joints, jacobian, noise = drawn(seed)
    shots = FittedShots.of(noise - effect(joints, by_joints), jacobian)
    return tuple(lack_of_fit.lacks_of_fit(shots, groups_of(joints, by_joints)))


def nothing(joints, by_joints):
    return np.zeros(by_joints.shape[:2])


def one_ratio(joints, by_joints):
    return 3.0 * by_joints[:, :, 2] * joints[:, 2:3]


def eccentric(joints, by_joints):
    return 4.0 * np.einsum("nki,ni->nk", by_joints, np.sin(joints + np.arange(4)))


def bending(joints, by_joints):
    across = (joints[:, 0] - 0.25) * (joints[:, 2] - 0.25) / 0.06
    return across[:, None] * np.array([0.0, 1.0, 0.0])


def test_scatter_alone_seldom_has_a_cause():
    assert sum(bool(lacks_with(seed, nothing)) for seed in range(100)) <= 1


def test_a_cause_that_is_not_significant_is_given_alone_where_it_is_worth_a_trial():
    found = [
        lacks_with(7, lambda joints, by_joints, size=size: size * one_ratio(joints, by_joints))
        for size in np.linspace(0.0, 0.5, 51)
    ]
    possible = [each for each in found if each and not each[0].significant]
    assert possible
    assert {len(each) for each in possible} == {1}
    assert all(SIGNIFICANCE <= each.p < lack_of_fit.POSSIBLE for (each,) in possible)
    assert not found[0]
    assert found[-1][0].significant


def test_a_direction_of_which_the_fit_leaves_but_a_trace_has_no_size():
    *_, jacobian, noise = drawn(3)
    columns = np.random.default_rng(4).standard_normal((SHOTS, 3, 3))
    trace = 1e-3 * columns[:, :, 2]
    columns[:, :, 2] = jacobian[:, :, -1] - columns[:, :, :2].sum(axis=2) + trace
    shots = FittedShots.of(noise - columns @ [1.0, -1.0, 0.0] - 300.0 * trace, jacobian)
    (found,) = lack_of_fit.lacks_of_fit(
        shots, [lack_of_fit.Group("azimuths", columns, np.arange(3))]
    )
    assert found.part.tolist() == [0, 1, 2]
    assert found.size == pytest.approx([1.0, -1.0, 0.0], abs=0.3)


@pytest.mark.parametrize("seed", range(4))
def test_a_gears_ratio_is_named_with_its_arm_and_size_and_nothing_beside_it(seed):
    (found,) = lacks_with(seed, one_ratio)
    assert (found.name, found.arms) == ("ratio", (2,))
    assert found.size[0] == pytest.approx(3.0, abs=4.0 * found.std[0])
    assert found.p < 1e-6


@pytest.mark.parametrize("seed", range(4))
def test_eccentric_encoders_are_not_taken_for_what_else_follows_the_joints(seed):
    (found,) = lacks_with(seed, eccentric)
    assert found.name == "eccentricity"


@pytest.mark.parametrize("seed", range(4))
def test_what_has_no_group_of_its_own_follows_the_joints(seed):
    assert lacks_with(seed, bending)[0].name == "joints"


def test_two_causes_are_told_each_beside_the_other():
    both = lacks_with(1, lambda q, j: one_ratio(q, j) + 2.0 * bending(q, j))
    assert {each.name for each in both} == {"ratio", "joints"}


def test_what_the_fit_has_itself_is_no_lack():
    _, by_joints, jacobian, noise = drawn(1)
    shots = FittedShots.of(noise, jacobian)
    own = lack_of_fit.Group("ratio", by_joints, ARMS)
    assert np.abs(shots.beside(by_joints)).max() == 0.0
    assert tuple(lack_of_fit.lacks_of_fit(shots, (own,))) == ()


def test_few_shots_tell_nothing():
    rng = np.random.default_rng(1)
    columns = smooth(rng.standard_normal((20, 4)))
    shots = FittedShots.of(np.ones((20, 3)), rng.standard_normal((20, 3, 10)))
    assert tuple(lack_of_fit.lacks_of_fit(shots, (lack_of_fit.Group("joints", columns),))) == ()


def test_chances_below_the_least_double_keep_their_order():
    gains = np.array([100.0, 299.0, 299.9, 299.999])
    found = log_p(2, 300.0, gains, 300.0)
    assert np.all(np.diff(found) < 0.0)
    assert np.isfinite(found).all()
    # two columns of 300: p = (rest / χ²)^149
    assert found == pytest.approx(149.0 * np.log(1.0 - gains / 300.0), rel=1e-9)
