"""Arms that grow while they are measured: named, and never passed."""

from dataclasses import replace

import numpy as np
import pytest
from fake_cell import NOMINAL
from identified_cases import NOISE_MM, SPACE, TRACKER_FROM_BASE, TRUTH, simulated, stating

from campaigns.identification.identify import identify
from campaigns.identification.parameter_selection import select_parameters
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.shots.shots import Shots

EVENLY = np.linspace(0.0, 1.0, 160)
SLOWING = np.expm1(-3.0 * EVENLY) / np.expm1(-3.0)


def warming(growth_ppm: float, passed: np.ndarray) -> Shots:
    """Shots of a robot whose arms grow by so much to the last one, by the parts that passed."""
    rng, shots = np.random.default_rng(4), simulated(60, 20, 4)
    count = len(shots)
    shots = replace(shots.rows(rng.permutation(count)), numbers=tuple(range(count)))
    longer = TRUTH.p.copy()
    longer[SPACE.places(SPACE.arm_lengths)] *= 1.001
    cold, grown = (
        robot.forward(shots.joints).values_or_raise()[:, :3]
        for robot in (TRUTH, Kinematics(TRUTH.mechanism, longer))
    )
    moved = (1e-3 * growth_ppm * passed)[:, None] * (grown - cold)
    points = shots.points_in_tracker_mm + moved @ TRACKER_FROM_BASE.rotation.T
    points = points + NOISE_MM * rng.standard_normal(points.shape)
    return stating(replace(shots, points_in_tracker_mm=points))


@pytest.mark.parametrize("passed", [EVENLY, SLOWING], ids=["evenly", "slowing down"])
def test_arms_that_shrink_or_grow_are_a_drift_and_no_pass(passed) -> None:
    found = identify(NOMINAL, warming(-150.0, passed), select_parameters(SPACE))
    (doubt,) = (each for each in found.doubts if each.name == "change-during-campaign")
    numbers = doubt.numbers
    assert (numbers["kind"], numbers["cause"]) == ("drift", "lengths")
    assert abs(numbers["ppm"] + 150.0) < (3.0 * numbers["std_ppm"] if passed is EVENLY else 60.0)
    told = f"{-numbers['ppm']:.3g} ± {2.0 * numbers['std_ppm']:.2g}"
    assert doubt.says.startswith(f"arms shrank by {told} ppm over the run, {numbers['size']:+.2g}")
    assert "let the robot warm up first" in doubt.says
    assert found.verdict == "fail"
