"""Checks of a calibration: unchanged robots are good, and what changed is named."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from fake_cell import CENTRE, NOMINAL, ROBOT
from identified_cases import TRACKER_FROM_BASE, dataset, select_parameters, simulated
from par4_space import SPACE
from small_plans import VIEW

from campaigns.estimation.change_detection import Cause
from campaigns.estimation.f_test import FittedShots
from campaigns.estimation.tracker_noise import TrackerUncertainty, point_covariance_mm2
from campaigns.evaluation.calibration_check import judge_check
from campaigns.identification.checking import StoredCalibration, check_calibration
from campaigns.identification.identify import identify
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.mechanisms.par4 import PAR4
from campaigns.planning.plans import PlanRequest, make_plan, spread_shots
from campaigns.robots.robot import find_robot, pose_of
from campaigns.shots.shot_sets import ShotSet

TRACKER = TrackerUncertainty()
MOVED_MM = 0.3
RAIL = np.array([0.6, 0.0, 0.8])


@cache
def stored():
    return StoredCalibration(
        NOMINAL, identify(NOMINAL, simulated(120, 40, 1), select_parameters(SPACE))
    )


@cache
def planned(count=10, seed=1):
    request = PlanRequest(120, 20, 3, pose_of(CENTRE))
    plan = make_plan(ROBOT, VIEW, request, np.random.default_rng(seed))
    return spread_shots(plan, stored().kinematics, count)


def robot(rng, **changed):
    """A robot as the identification believes it may be, and what of it has changed since."""
    names, flat = stored().known.names, stored().found.flat()
    away = np.linalg.cholesky(stored().known.array) @ rng.standard_normal(len(names))
    flat = flat | {n: flat[n] + by for n, by in zip(names, away, strict=True)}
    return Kinematics.of(PAR4, flat | {n: flat[n] + by for n, by in changed.items()})


def measured(plan, of, rng, moved_from=99, by_mm=0.0):
    joints = np.array([shot.joints for shot in plan])
    points = TRACKER_FROM_BASE.apply(of.forward(joints).values_or_raise()[:, :3])
    points[moved_from:] += by_mm
    noise = np.linalg.cholesky(point_covariance_mm2(points, TRACKER))
    points = points + np.einsum("nij,nj->ni", noise, rng.standard_normal(points.shape))
    return dataset(joints, points, [None] * len(plan), [ShotSet.CHECK] * len(plan))


def checked(rng, moved_from=99, by_mm=0.0, seed=1, **changed):
    shots = measured(planned(10, seed), robot(rng, **changed), rng, moved_from, by_mm)
    return check_calibration(stored(), shots, TRACKER)


def named(judged):
    """The only part that is named."""
    alone = len(judged.changed) == 1 and not judged.as_likely
    return judged.changed[0] if alone else SimpleNamespace(kind="", name="")


def good(count, seed=1):
    rng = np.random.default_rng(5)
    return sum(checked(rng, seed=seed).decision == "pass" for _ in range(count))


def parts_named(field, by, count, seed=1):
    rng = np.random.default_rng(6)
    names = [f"arm{place % 4}.{field}" for place in range(count)]
    return sum(named(checked(rng, seed=seed, **{each: by})).name == each for each in names)


def stands_named(count, seed=1):
    rng, found = np.random.default_rng(7), 0
    for place in range(count):
        way = rng.standard_normal(3)
        by_mm = MOVED_MM * way / np.linalg.norm(way)
        found += named(checked(rng, 1 + place % 9, by_mm, seed)).kind == "frame"
    return found


def test_an_unchanged_robot_is_good():
    assert good(8) == 8


def test_the_encoder_the_arm_and_the_stand_that_moved_are_named():
    assert parts_named("joint_offset_deg", 0.05, 4) == 4
    assert parts_named("arm_mm", -0.1, 4) == 4
    assert stands_named(4) == 4


def test_a_change_is_told_with_its_uncertainty():
    rng, judged = np.random.default_rng(2), []
    for _ in range(12):
        judged.append(checked(rng, **{"arm2.joint_offset_deg": 0.05}))
    parts = [each.changed[0] for each in judged]
    assert {each.decision for each in judged} == {"fail"}
    assert sum(abs(each.size - 0.05) < each.expanded_uncertainty for each in parts) >= 10
    assert judged[0].says.startswith("not good: arm 2's encoder by +0.0")


def of_a_rail(rng, moved_mm):
    """Check of a robot on rails whose first mount, (3,), moved: along (0.6, 0, 0.8) its encoder."""
    std_mm, rails = 0.01, find_robot("linear-delta").robot.mechanism.parameters
    frame, mount = rng.standard_normal((8, 3, 6)), rng.standard_normal((8, 3, 3))
    seen_mm = mount @ moved_mm + std_mm * rng.standard_normal((8, 3))
    fit = FittedShots.of(seen_mm[:, :, None] / std_mm, frame)
    causes = [
        Cause("joint", "arm0.joint_offset_mm", mount @ RAIL[:, None] / std_mm),
        Cause("mount", "arm0.x_mm", mount / std_mm),
        Cause("mount", "arm1.x_mm", rng.standard_normal((8, 3, 3)) / std_mm),
    ]
    return judge_check(fit, causes, rails, 0.1, 0.01)


def test_a_rails_encoder_is_named_though_its_mount_along_the_rail_would_do_the_same():
    rng = np.random.default_rng(4)
    judged = [of_a_rail(rng, 0.26 * RAIL) for _ in range(150)]
    assert {(each.decision, each.as_likely) for each in judged} == {("fail", ())}
    assert [named(each).name for each in judged] == ["arm0.joint_offset_mm"] * 150
    assert judged[0].says.startswith("not good: arm 0's encoder by +0.2")


def test_a_rails_mount_that_moved_across_the_rail_too_is_named():
    rng, across = np.random.default_rng(4), np.array([0.0, 1.0, 0.0])
    judged = [of_a_rail(rng, 0.26 * RAIL + 0.05 * across) for _ in range(30)]
    assert [named(each).name for each in judged] == ["arm0.x_mm"] * 30


@pytest.mark.long
@pytest.mark.timeout(600)
@pytest.mark.parametrize("seed", [1, 2, 3, 5, 8])
def test_of_a_hundred_robots_nearly_all_are_called_rightly(record_property, seed):
    found = {
        "unchanged": good(300, seed) / 3.0,
        "encoder": parts_named("joint_offset_deg", 0.05, 100, seed),
        "arm": parts_named("arm_mm", 0.1, 100, seed),
        "stand": stands_named(100, seed),
    }
    for name, share in found.items():
        record_property(name, share)
    assert found["unchanged"] >= 99
    assert found["encoder"] >= 85, "which other parts hide by some spreads of shots"
    assert min(found["arm"], found["stand"]) >= 95, found
