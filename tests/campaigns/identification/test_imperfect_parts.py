"""Unequal rods that the usual parameters cannot say: named, and found when asked."""

from dataclasses import replace

import numpy as np
from identified_cases import NOMINAL, TRACKER_FROM_BASE, TRUTH, noisy, simulated
from par4_space import SKEW_NAMES, SPACE

from campaigns.evaluation.diagnostics import LACK
from campaigns.identification.identify import identify
from campaigns.identification.parameter_selection import ParameterSelection
from campaigns.mechanisms.mechanism import Kinematics

SKEWS_RAD = np.array([5e-4, -6e-4, 7e-4, -4e-4])
"""Rods of 80 mm distance that differ by 0.03 to 0.06 mm."""


def shots_of(skews_rad, seed):
    p = TRUTH.p.copy()
    p[SPACE.places(SKEW_NAMES)] = skews_rad
    data = simulated(60, 20, seed)
    robot = Kinematics(NOMINAL.mechanism, p)
    points = robot.forward(data.joints).values_or_raise()[:, :3]
    return noisy(replace(data, points_in_tracker_mm=TRACKER_FROM_BASE.apply(points)), seed)


def lack_in(found):
    return next((each for each in found.doubts if each.name == LACK), None)


def test_rods_that_differ_by_a_twentieth_of_a_millimetre_are_named():
    shots = shots_of(SKEWS_RAD, seed=0)
    found = identify(NOMINAL, shots, ParameterSelection(SPACE.free_by_default))
    assert found.verdict == "not decided"
    assert "--model full" in lack_in(found).says
    whole = identify(NOMINAL, shots, ParameterSelection(SPACE.free_in_full))
    assert lack_in(whole) is None
    assert whole.verdict == "pass"
    for name, skew_rad in zip(SKEW_NAMES, SKEWS_RAD, strict=True):
        skew = whole.parameters[name]
        assert abs(skew.value - np.degrees(skew_rad)) < 4.5 * skew.std


def test_perfect_parts_are_not_doubted():
    shots = shots_of(np.zeros(4), seed=0)
    found = identify(NOMINAL, shots, ParameterSelection(SPACE.free_by_default))
    assert lack_in(found) is None
    assert found.verdict == "pass"
