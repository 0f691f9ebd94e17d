"""When hold-out pairs that are farther off after the fit stand against it."""

import numpy as np
import pytest

from campaigns.estimation.information import HoldOut
from campaigns.evaluation.identification import worse_beyond_chance

BEFORE_MM = np.array([0.010, -0.012, 0.009, 0.011, -0.010, 0.008])
AS_SIGMA_SAY, FARTHER_OFF = HoldOut(6, 6.0, 0.4, 1.0), HoldOut(6, 60.0, 1e-10, 3.2)


@pytest.mark.parametrize(
    ("after_mm", "tested", "worse"),
    [
        (3.0 * BEFORE_MM, FARTHER_OFF, True),
        (3.0 * BEFORE_MM, None, True),
        (3.0 * BEFORE_MM, AS_SIGMA_SAY, False),
        (BEFORE_MM + 0.004, FARTHER_OFF, False),  # some grew, some shrank
        (0.3 * BEFORE_MM, FARTHER_OFF, False),
    ],
)
def test_pairs_are_worse_where_neither_their_scatter_nor_sigma_explain_it(after_mm, tested, worse):
    assert worse_beyond_chance(BEFORE_MM, after_mm, tested) is worse


def test_of_two_pairs_the_mean_counts():
    few = BEFORE_MM[:2]
    assert worse_beyond_chance(few, 1.01 * few, FARTHER_OFF)
    assert not worse_beyond_chance(few, 0.99 * few, FARTHER_OFF)
