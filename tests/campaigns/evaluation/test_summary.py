"""How large a set of errors is said to be."""

import numpy as np
import pytest

from campaigns.evaluation.summary import summary


def test_a_summary_of_one_error_has_no_deviation() -> None:
    found = summary(np.array([-2.0]))
    assert (found.n, found.mean, found.max, found.sigma) == (1, 2.0, 2.0, None)
    assert found.mean_plus_3_sigma is None


def test_a_summary_is_of_absolute_values() -> None:
    found = summary(np.array([-1.0, 1.0, -3.0, 3.0]))
    assert (found.mean, found.max) == (2.0, 3.0)
    assert found.sigma == pytest.approx(np.sqrt(4.0 / 3.0))
    assert found.mean_plus_3_sigma == pytest.approx(2.0 + 3.0 * np.sqrt(4.0 / 3.0))
    assert found.p95 == pytest.approx(3.0)


def test_vectors_are_as_large_as_they_are_long() -> None:
    found = summary(np.array([[3.0, 0.0, -4.0], [0.0, -1.0, 0.0]]))
    assert (found.n, found.mean, found.max) == (2, 3.0, 5.0)


def test_nothing_cannot_be_summarised() -> None:
    with pytest.raises(ValueError, match="no errors"):
        summary(np.array([]))
