"""Nests tell the tracker's drift from the robot's, and get places of their own."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from identified_cases import NOISE_MM, NOMINAL, TRACKER_FROM_BASE, TRUTH, noisy, simulated
from par4_space import SPACE

from campaigns.estimation.rigid_transforms import Transform, frame_jacobian
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.evaluation.base_motion import base_motion
from campaigns.identification.checking import StoredCalibration, check_calibration, repaired
from campaigns.identification.identify import identify
from campaigns.identification.parameter_selection import select_parameters
from campaigns.identification.result import RecordedIdentification
from campaigns.mechanisms.mechanism import Kinematics
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


@pytest.mark.slow
def test_nests_have_places_in_the_base_frame_within_their_deviations():
    off = []
    for seed in range(4):
        for name, nest in found_of(campaign(seed)).nests.items():
            away = np.array([nest.x_mm, nest.y_mm, nest.z_mm]) - PLACES[name]
            off.append(float(away @ away) / nest.std_mm**2)
    assert 0.1 < np.mean(off) < 3.0


def test_a_loose_nest_is_no_motion_of_the_stand():
    found = found_of(campaign(4, loose_mm=GAVE_WAY_MM))
    assert told(found) == [("nests", "loose")]


def test_a_robot_that_drifts_before_still_nests_is_named():
    found = found_of(campaign(5, robot_mm=GAVE_WAY_MM))
    assert told(found) == [("nests", "robot")]
    assert "the robot, not the tracker" in found.doubts[0].says


ELSEWHERE = Transform(TRACKER_FROM_BASE.rotation.T, np.array([2500.0, -700.0, 300.0]))
"""Where the tracker stands in checks: not where it stood in the campaign."""


@cache
def stored(seed):
    digests = dict.fromkeys(("robot_digest", "plan_digest", "journal_digest", "at_utc"), "")
    found = RecordedIdentification.of(
        found_of(campaign(seed)), series=1, journal_records=0, **digests
    )
    return StoredCalibration(NOMINAL, found)


def base_of_check(seed, **changes):
    return check_calibration(stored(seed), shots_of_check(seed, **changes), TrackerUncertainty())


def shots_of_check(seed, *, by_mm=0.0, loose_mm=0.0, offset_deg=0.0):
    """A check of another day, after a campaign: the base moved `by_mm` in some direction."""
    rng = np.random.default_rng(seed)
    way = rng.standard_normal(3)
    robot = simulated(8, 0, seed=seed + 500, truth=TRUTH)
    values = TRUTH.parameters | {
        "arm2.joint_offset_deg": TRUTH.parameters["arm2.joint_offset_deg"] + offset_deg
    }
    moved = Kinematics.of(TRUTH.mechanism, values).forward(robot.joints).values_or_raise()[:, :3]
    nests = np.array([*PLACES.values()])
    nests[0, 0] += loose_mm
    points = np.vstack([moved + by_mm * way / np.linalg.norm(way), nests])
    count = len(robot)
    rows = robot.rows(np.r_[np.arange(count), np.zeros(3, dtype=int)])
    shots = replace(
        rows,
        numbers=tuple(range(count + 3)),
        purposes=(ShotSet.CHECK,) * count + (ShotSet.NEST,) * 3,
        pairs=(None,) * (count + 3),
        nests=("",) * count + tuple(PLACES),
        records=(),
        points_in_tracker_mm=ELSEWHERE.apply(points),
    )
    return noisy(shots, seed + 1000)


def test_a_base_that_moved_since_the_campaign_is_told_from_a_robot_that_changed():
    stayed, moved, changed = (
        base_of_check(1, **changes) for changes in ({}, {"by_mm": 0.3}, {"offset_deg": 0.05})
    )
    for judged, decisions in (
        (stayed, ("pass", "pass")),
        (moved, ("pass", "fail")),
        (changed, ("fail", "pass")),
    ):
        assert (judged.decision, judged.base.decision) == decisions
        assert judged.says.endswith(judged.base.says)
        by_mm = 0.3 * (judged is moved)
        assert abs(judged.base.moved_mm - by_mm) < judged.base.moved_u_mm + (by_mm == 0.0) * 0.05
    assert base_of_check(1, loose_mm=0.3).base.decision == "not decided"


def test_what_errors_of_the_parameters_do_to_both_frames_cancels_in_the_bases_motion():
    corners, own = np.diag([500.0, 400.0, 300.0]), 0.01**2 * np.eye(9)
    common = 0.03**2 * np.eye(9)
    of_both = tuple(PLACES), corners, own + common
    alone = tuple(PLACES), corners, own
    apart, shared = (base_motion(of_both, of_both, np.zeros(3), by) for by in (None, common))
    assert shared.moved_u_mm == base_motion(alone, alone, np.zeros(3)).moved_u_mm
    assert apart.moved_u_mm > 3.0 * shared.moved_u_mm
    stayed = [base_of_check(seed).base for seed in range(1, 5)]
    assert max(each.moved_u_mm for each in stayed) < 0.02
    assert min(each.p for each in stayed) > 0.05


def test_a_repair_places_the_nests_of_its_check_anew_and_takes_none_for_a_shot_of_the_robot():
    shots = replace(shots_of_check(1, offset_deg=0.05), session=np.full(19, 7))
    judged = check_calibration(stored(1), shots, TrackerUncertainty())
    found = repaired(stored(1), judged.of_robot, shots, TrackerUncertainty(), None, (7, 8))
    assert (found.verdict, found.pedigree.shots) == ("pass", 16)
    assert list(found.nests) == list(PLACES)
    for name, nest in found.nests.items():
        away_mm = np.linalg.norm(np.array([nest.x_mm, nest.y_mm, nest.z_mm]) - PLACES[name])
        assert away_mm < 4.0 * nest.std_mm < 0.2
    assert found.nest_places() is not None


@pytest.mark.long
@pytest.mark.timeout(600)
def test_of_a_hundred_bases_nearly_all_are_called_rightly(record_property):
    seeds = range(1, 101)
    for name, changes, decision in (
        ("stayed", {}, "pass"),
        ("moved", {"by_mm": 0.3}, "fail"),
        ("stayed, an encoder changed", {"offset_deg": 0.05}, "pass"),
    ):
        found = [base_of_check(seed, **changes) for seed in seeds]
        rightly = sum(each.base.decision == decision for each in found)
        record_property(name, rightly)
        assert rightly >= 95
        if not changes:
            assert 0.4 < np.mean([each.base.p for each in found]) < 0.6
        sizes = np.array([(each.base.moved_mm, each.base.moved_u_mm) for each in found])
        if "by_mm" in changes:
            assert np.sum(np.abs(sizes[:, 0] - 0.3) < sizes[:, 1]) >= 90
