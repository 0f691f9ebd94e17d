"""Lack of fit: what follows the joints is told from what scatters."""

import numpy as np
import pytest

from campaigns.estimation.lack_of_fit import enough_shots, lack_of_fit, smooth_columns

SHOTS, UNKNOWNS = 100, 15


def found_of(seed, bend=0.0):
    rng = np.random.default_rng(seed)
    joints = rng.uniform(-0.5, 1.0, (SHOTS, 4))
    jacobian = rng.standard_normal((SHOTS, 3, UNKNOWNS))
    residual = rng.standard_normal((SHOTS, 3))
    residual[:, 1] += bend * (joints[:, 0] - 0.25) * (joints[:, 2] - 0.25) / 0.19
    return lack_of_fit(residual, jacobian, smooth_columns(joints), "joints")


def test_scatter_alone_seldom_looks_like_it():
    p = np.array([found_of(seed).p for seed in range(150)])
    assert np.mean(p < 0.05) < 0.05 + 3.0 * np.sqrt(0.05 / len(p))
    assert np.mean(p < 1e-3) <= 0.01


@pytest.mark.parametrize("seed", range(5))
def test_what_follows_the_joints_is_found(seed):
    found = found_of(seed, bend=1.5)
    assert found.significant
    assert found.share > 0.1


def test_few_shots_tell_nothing():
    assert not enough_shots(20, 28, 42)
    rng = np.random.default_rng(1)
    smooth = smooth_columns(rng.standard_normal((20, 4)))
    assert lack_of_fit(np.ones((20, 3)), rng.standard_normal((20, 3, 10)), smooth, "joints") is None
