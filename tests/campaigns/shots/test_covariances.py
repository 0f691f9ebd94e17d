"""What can be the covariance of a point, and what cannot."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.values import is_positive_definite


def nested(matrix):
    return tuple(map(tuple, np.asarray(matrix, dtype=float).tolist()))


@given(st.integers(0, 2**32 - 1), st.sampled_from([1e-12, 1.0, 1e12]))
def test_squares_of_regular_matrices_can_be_covariances_in_any_unit(seed, unit):
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    std = rng.uniform(5e-3, 1.0, 3)
    assert is_positive_definite(nested(unit * turn @ np.diag(std**2) @ turn.T))


@pytest.mark.parametrize(
    "matrix",
    [
        np.ones((3, 3)),
        np.diag([1.0, 1.0, -1.0]),
        np.diag([1.0, np.nan, 1.0]),
        [[1.0, 0.0, np.nan], [0.0, 1.0, 0.0], [np.nan, 0.0, 1.0]],
        [[1.0, 0.9, 0.9], [0.9, 1.0, -0.9], [0.9, -0.9, 1.0]],
        np.ones((3, 3)) + 1e-13 * np.eye(3),
    ],
)
def test_what_has_no_finite_whitening_is_none(matrix):
    assert not is_positive_definite(nested(matrix))
