"""How large a set of errors is said to be."""

import numpy as np
import pytest

from campaigns.evaluation.summary import summary


def test_a_summary_is_of_absolute_values_or_lengths():
    errors = summary(np.array([-1.0, 1.0, -3.0, 3.0]))
    assert (errors.mean, errors.max, errors.p95) == pytest.approx((2.0, 3.0, 3.0))
    assert errors.mean_plus_3_sigma == pytest.approx(2.0 + 3.0 * np.sqrt(4.0 / 3.0))
    assert summary(np.array([-2.0])).mean_plus_3_sigma is None
    errors = summary(np.array([[3.0, 0.0, -4.0], [0.0, -1.0, 0.0]]))
    assert (errors.n, errors.mean, errors.max) == (2, 3.0, 5.0)
