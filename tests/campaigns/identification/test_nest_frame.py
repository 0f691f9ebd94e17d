"""Nests tell the tracker's drift from the robot's."""

from dataclasses import replace

import numpy as np
import pytest
from identified_cases import NOISE_MM, NOMINAL, TRACKER_FROM_BASE, TRUTH, noisy, simulated
from par4_space import SPACE

from campaigns.estimation.rigid_transforms import frame_jacobian
from campaigns.identification.identify import identify
from campaigns.identification.parameter_selection import select_parameters
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import COLUMNS, Shots

PLACES = {"A": [900.0, 800.0, -900.0], "B": [-700.0, 900.0, -950.0], "C": [200.0, -900.0, -300.0]}
EPOCHS = (0, 40, 80, 120, 160)
"""Of 160 shots, before which the nests and a drift shot are measured."""
GAVE_WAY_MM = 0.3
AWAY = np.array([2e-5, -5e-5, 6e-5, 0.6 * GAVE_WAY_MM, -0.8 * GAVE_WAY_MM, 0.0])
"""What the nests do as the tracker's stand gives way: a turn about the robot's middle, a shift."""


def campaign(seed, *, stand=0.0, names="ABC", loose_mm=0.0, robot_mm=0.0):
    """Shots with nests between them, while the stand gives way evenly by a part of `AWAY`.

    Or while nest A gives way, or what the robot does at its drift pose.
    """
    robot = simulated(60, 20, seed=seed, truth=TRUTH)
    count = len(robot)
    drift = TRACKER_FROM_BASE.apply(NOMINAL.forward(robot.joints[:1]).values[:, :3])
    fixed = TRACKER_FROM_BASE.apply(np.array([PLACES[name] for name in names]).reshape(-1, 3))
    each = len(names) + 1
    rows = np.zeros(each * len(EPOCHS), dtype=int)
    more = replace(
        robot.rows(rows),
        numbers=tuple(range(count, count + len(rows))),
        purposes=(ShotSet.DRIFT, *[ShotSet.NEST] * len(names)) * len(EPOCHS),
        pairs=(None,) * len(rows),
        points_in_tracker_mm=np.tile(np.vstack([drift, fixed]), (len(EPOCHS), 1)),
        nests=("", *names) * len(EPOCHS),
    )
    at = np.repeat(EPOCHS, each)
    ways_mm = np.array([robot_mm, loose_mm, 0.0, 0.0])[:each]
    more.points_in_tracker_mm[:] += (np.outer(EPOCHS, ways_mm) / count).reshape(-1, 1)
    robot = replace(robot, nests=("",) * count)
    both = [(getattr(robot, name), getattr(more, name)) for name in COLUMNS]
    data = Shots(
        **{
            name: np.concatenate(two) if isinstance(two[0], np.ndarray) else two[0] + two[1]
            for name, two in zip(COLUMNS, both, strict=True)
        }
    )
    when = np.concatenate([np.arange(count) + 0.5, at])
    points, middle = data.points_in_tracker_mm, robot.points_in_tracker_mm.mean(axis=0)
    gone = frame_jacobian(points - middle) @ AWAY * (stand * when / count)[:, None]
    order = 1 + np.argsort(np.argsort(when, kind="stable"))
    moved = replace(data, points_in_tracker_mm=points + gone, records=tuple(order.tolist()))
    return noisy(moved, seed)


def found_of(data):
    return identify(NOMINAL, data, select_parameters(SPACE))


def told(found):
    return [(doubt.name, doubt.numbers.get("kind")) for doubt in found.doubts]


@pytest.mark.slow
def test_a_stand_that_gives_way_is_told_and_nothing_is_corrected():
    found, still = found_of(campaign(3, stand=1.0)), found_of(campaign(3))
    assert told(found) == [("change-during-campaign", "drift"), ("nests", "stand")]
    assert found.verdict == "fail"
    doubt = found.doubts[1]
    std_mm = doubt.numbers["std_mm"]
    assert 0.2 * NOISE_MM < std_mm < 3.0 * NOISE_MM
    assert doubt.numbers["moved_mm"] == pytest.approx(GAVE_WAY_MM, abs=4.0 * std_mm)
    assert "measure again, or --sessions" in doubt.says
    assert still.doubts == ()


@pytest.mark.slow
def test_without_nests_or_with_two_it_stays_a_doubt():
    for names in ("", "AB"):
        found = found_of(campaign(3, stand=1.0, names=names))
        assert told(found) == [("change-during-campaign", "drift")]
        assert found.verdict == "fail"


def test_a_loose_nest_is_no_motion_of_the_stand():
    found = found_of(campaign(4, loose_mm=GAVE_WAY_MM))
    assert told(found) == [("nests", "loose")]


def test_a_robot_that_drifts_before_still_nests_is_named():
    found = found_of(campaign(5, robot_mm=GAVE_WAY_MM))
    assert told(found) == [("nests", "robot")]
    assert "the robot, not the tracker" in found.doubts[0].says
