"""How large a set of errors is said to be."""

import numpy as np
import pytest

from campaigns.evaluation.summary import summary


def test_one_error_has_no_deviation_and_none_no_summary() -> None:
    found = summary(np.array([-2.0]))
    assert (found.n, found.mean, found.max, found.sigma) == (1, 2.0, 2.0, None)
    assert found.mean_plus_3_sigma is None
    with pytest.raises(ValueError, match="no errors"):
        summary(np.array([]))


def test_a_summary_is_of_absolute_values_or_lengths() -> None:
    found = summary(np.array([-1.0, 1.0, -3.0, 3.0]))
    assert (found.mean, found.max) == (2.0, 3.0)
    assert found.sigma == pytest.approx(np.sqrt(4.0 / 3.0))
    assert found.mean_plus_3_sigma == pytest.approx(2.0 + 3.0 * np.sqrt(4.0 / 3.0))
    assert found.p95 == pytest.approx(3.0)
    found = summary(np.array([[3.0, 0.0, -4.0], [0.0, -1.0, 0.0]]))
    assert (found.n, found.mean, found.max) == (2, 3.0, 5.0)
