"""Samples of one stop are averaged into one shot; visits of a pose are not."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from remembered import remembered
from rod_campaigns import rod_campaign

from campaigns.api import identify, sample_workspace
from campaigns.errors import ShotsInvalid
from campaigns.fit.tracker_noise import TrackerUncertainty
from campaigns.robots.robot import find_robot
from campaigns.shots.import_export import refuse_copies
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots, held_out, rows_of_shots, shots_of_rows
from campaigns.shots.shots_csv import parse_shots, shots_text
from campaigns.shots.stops import averaged_in_words, by_stops

IDENTIFY = remembered(identify)
ROBOTS = {name: find_robot(name).robot for name in ("delta", "linear-delta")}
DELTA = ROBOTS["delta"].mechanism.joints
SAMPLE_S, MOVE_S = 0.1, 4.0
NEVER_AVERAGED = sorted({purpose.value for purpose in ShotSet} - {"identification", "validation"})


def shots_at(joints_deg, sets="identification", *, pairs=None, times=None, noise_mm=0.01):
    """Shots of a delta at joints (N, 3), with covariances and points of their own."""
    joints = np.radians(np.asarray(joints_deg, dtype=float))
    rng, count = np.random.default_rng(5), len(joints)
    points = 1000.0 + rng.normal(size=(count, 3))
    return Shots.of(
        joints, points, ROBOTS["delta"], sets=sets, pairs=pairs, times=times,
        covariance_mm2=noise_mm**2 * np.eye(3),
    )  # fmt: skip


def sampled(shots, counts, jitter=0.0, rng=None):
    """The same stops with so many samples of each, paired as they follow each other in the file."""
    rng = rng or np.random.default_rng(1)
    raw = shots.rows(np.repeat(np.arange(len(shots)), counts))
    noise = np.linalg.cholesky(raw.stated_covariance_mm2) @ rng.normal(size=(len(raw), 3, 1))
    return replace(
        raw,
        numbers=tuple(range(len(raw))),
        pairs=paired(raw.purposes),
        joints=raw.joints + jitter * rng.normal(size=raw.joints.shape),
        points_in_tracker_mm=raw.points_in_tracker_mm + noise[..., 0],
    )


def paired(purposes):
    """Each two of a set are a pair, a last one alone."""
    pairs, seen = [], dict.fromkeys(purposes, 0)
    for purpose in purposes:
        number = seen[purpose] // 2
        whole = 2 * number + 1 < purposes.count(purpose)
        pairs.append(number + 1000 * (purpose is ShotSet.VALIDATION) if whole else None)
        seen[purpose] += 1
    return tuple(pairs)


distinct_poses = st.lists(
    st.tuples(*[st.integers(-40, 40)] * 3), min_size=2, max_size=8, unique=True
)


@given(st.data(), distinct_poses)
def test_samples_of_a_stop_are_its_mean_whatever_their_number(data, poses):
    samples = st.integers(1, 12)
    counts = data.draw(st.lists(samples, min_size=len(poses), max_size=len(poses)))
    raw = sampled(shots_at(poses), counts)
    stops = by_stops(raw, DELTA)
    parts = np.split(np.arange(len(raw)), np.cumsum(counts)[:-1])
    assert stops.numbers == tuple(part[0] for part in parts)
    for row, part in enumerate(parts):
        mean_mm = raw.points_in_tracker_mm[part].mean(axis=0)
        assert stops.points_in_tracker_mm[row] == pytest.approx(mean_mm)
        assert stops.joints[row] == pytest.approx(np.radians(poses[row]))
        assert stops.stated_covariance_mm2[row] == pytest.approx(1e-4 * np.eye(3) / len(part))
    assert by_stops(stops, DELTA) is stops, "averaged once, averaged for good"


@given(st.data(), distinct_poses)
def test_pairs_are_of_two_stops_of_one_set_each(data, poses):
    some_counts = st.lists(st.integers(1, 5), min_size=len(poses), max_size=len(poses))
    sets = [data.draw(st.sampled_from(["identification", "validation"])) for _ in poses]
    raw = sampled(shots_at(poses, sets), data.draw(some_counts))
    stops = by_stops(raw, DELTA)
    for purpose in (ShotSet.IDENTIFICATION, ShotSet.VALIDATION):
        whole = stops.whole_pairs(purpose)
        assert whole.halves == ()
        assert len(np.unique(whole.rows)) == whole.rows.size, "each stop is of one pair"
        assert len(stops.rows_of(purpose)) - whole.rows.size <= 2, "those without a second one"
    numbers = [pair for pair in stops.pairs if pair is not None]
    assert all(numbers.count(pair) == 2 for pair in numbers), "of one set"


@given(distinct_poses, st.booleans())
def test_shots_of_different_poses_stay_as_they_are_bit_for_bit(poses, back):
    visited = [*poses, *poses] if back else poses
    shots = shots_at(visited, pairs=paired((ShotSet.IDENTIFICATION,) * len(visited)))
    assert by_stops(shots, DELTA) is shots
    assert averaged_in_words(shots, DELTA) == ""


def test_pairs_of_the_file_between_two_stops_keep_their_numbers():
    poses = np.repeat([[0, 0, 0], [20, 0, 0], [0, 20, 0], [20, 20, 0]], 3, axis=0)
    numbered = shots_at(poses, pairs=[7, 8, 9, 7, 8, 9, 4, 5, 6, 4, 5, 6])
    assert by_stops(numbered, DELTA).pairs == (7, 7, 4, 4)
    alone = shots_at(poses)
    assert by_stops(alone, DELTA).pairs == (None,) * 4, "what had no pair gets none"
    half = shots_at(poses, pairs=[1, 1, None, 2, 2, None, 3, None, None, 9, 9, None])
    assert by_stops(half, DELTA).pairs == (10, 10, 3, None), "the other shot was not measured"


def test_noise_of_the_data_sheet_is_not_divided():
    raw = shots_at([[0, 0, 0]] * 3 + [[20, 0, 0]] * 3)
    stated = raw.stated_covariance_mm2.copy()
    stated[1] = np.nan
    stops = by_stops(replace(raw, stated_covariance_mm2=stated), DELTA)
    assert np.isnan(stops.stated_covariance_mm2).all(axis=(1, 2)).tolist() == [True, False]
    model = TrackerUncertainty()
    single = replace(raw, stated_covariance_mm2=np.full((6, 3, 3), np.nan)).covariance_mm2(model)
    assert stops.covariance_mm2(model)[0] == pytest.approx(single[0], rel=1e-2)


@pytest.mark.parametrize("purpose", NEVER_AVERAGED)
def test_visits_that_show_how_the_robot_comes_back_are_never_averaged(purpose):
    shots = shots_at([[10, 10, 10]] * 6, purpose)
    assert by_stops(shots, DELTA) is shots


def test_only_neighbours_of_one_set_session_and_side_are_one_stop():
    shots = shots_at([[10, 10, 10]] * 4)
    assert len(by_stops(shots, DELTA)) == 1
    other_set = (ShotSet.IDENTIFICATION,) * 2 + (ShotSet.VALIDATION,) * 2
    assert len(by_stops(replace(shots, purposes=other_set), DELTA)) == 2
    assert len(by_stops(replace(shots, session=np.array([1, 1, 2, 2])), DELTA)) == 2
    sides = np.ones((4, 3))
    sides[2:, 1] = -1.0
    assert len(by_stops(replace(shots, approach=sides), DELTA)) == 2
    drift = (ShotSet.IDENTIFICATION, ShotSet.DRIFT, *[ShotSet.IDENTIFICATION] * 2)
    assert by_stops(replace(shots, purposes=drift), DELTA).numbers == (0, 1, 2)
    moved = shots_at([[10, 10, 10], [10, 10, 40], [10, 10, 10], [10, 10, 10]])
    assert by_stops(moved, DELTA).numbers == (0, 1, 2)


@pytest.mark.parametrize(
    ("step_deg", "decimals", "stops"),
    [
        (0.001, 3, 1),  # a last digit
        (0.002, 3, 1),  # readings off by one last digit each, to both sides
        (0.01, 2, 1),
        (0.03, 2, 2),
        (0.004, 5, 1),  # within what a joint at rest reads
        (0.03, 5, 2),
        (0.1, 1, 2),  # digits as coarse as motions are no jitter
        (1.0, 0, 2),
    ],
)
def test_joints_are_equal_within_their_own_last_digit(step_deg, decimals, stops):
    far = np.round([[-30.123456, 5.654321, 17.222222]], decimals)
    near = np.round([[10.123456, 20.654321, 30.111111]], decimals)
    shots = shots_at(np.vstack([far, near, near + np.array([step_deg, 0.0, 0.0])]))
    assert len(by_stops(shots, DELTA)) == 1 + stops


def test_slow_motion_is_no_stop_however_small_its_steps():
    course = [[0.004 * step, 0.0, 0.0] for step in range(50)]
    assert len(by_stops(shots_at(course), DELTA)) > 10


def visits(gaps_s, poses):
    times = np.cumsum([0.0, *gaps_s])
    return shots_at(poses, times=[f"{time:.1f}" for time in times])


def test_a_pause_in_which_the_robot_may_have_left_is_another_visit():
    stop, other = [10, 10, 10], [30, 10, 10]
    samples = [SAMPLE_S] * 3
    again = visits([*samples, MOVE_S, *samples, 20.0, *samples], [stop] * 4 + [other] * 8)
    assert by_stops(again, DELTA).numbers == (0, 4, 8)
    # measurements of seconds are no pauses while moves take longer
    slow = visits([4.0, 4.0, 30.0, 4.0, 9.0], [stop] * 3 + [other] * 3)
    assert by_stops(slow, DELTA).numbers == (0, 3)
    # each visit measured once: the time between them is that of moves
    single = visits([20.0] * 7, [stop, other, stop, *[other] * 5])
    assert len(by_stops(single, DELTA)) == 8
    # without moves to compare with, the samples' own time decides
    alone = visits([*samples, 20.0, *samples], [stop] * 8)
    assert by_stops(alone, DELTA).numbers == (0, 4)


def test_times_that_cannot_be_compared_cut_no_stop():
    shots = visits([0.1, 60.0, 0.1], [[10, 10, 10]] * 4)
    assert len(by_stops(shots, DELTA)) == 2
    back = replace(shots, measured_utc=("0", "60", "59", "61"), records=(1, 2, 3, 4))
    lacking = replace(shots, measured_utc=("0", "", "60", "61"))
    assert [len(by_stops(each, DELTA)) for each in (back, lacking)] == [1, 1]
    minutes = visits([0, 0, 60, 0, 0, 0], [[10, 10, 10]] * 3 + [[30, 10, 10]] * 4)
    assert len(by_stops(minutes, DELTA)) == 2, "full minutes"


def test_stops_are_held_out_whole():
    raw = sampled(shots_at([[5 * k, 2 * k, 0] for k in range(-6, 6)]), 6)
    unseen = held_out(by_stops(raw, DELTA), 0.34, np.random.default_rng(1))
    rows = unseen.whole_pairs(ShotSet.VALIDATION).rows
    assert len(rows) == 2
    assert (unseen.measured_distances_mm(rows) > 0.1).all()


def test_samples_that_agree_to_the_last_digit_are_no_copies():
    stop, other = (0.1, 0.2, 0.3), (0.4, 0.2, 0.3)
    shots = shots_at(np.degrees([stop] * 4 + [other] * 4), pairs=[0, 0, 1, 1, 2, 2, 3, 3])
    points = np.repeat(shots.points_in_tracker_mm[[0, 4]], 4, axis=0)
    rows = rows_of_shots(replace(shots, points_in_tracker_mm=points))
    refuse_copies(rows, (), "f.csv")
    with pytest.raises(ShotsInvalid, match="shot 8 is a copy of shot 0"):
        refuse_copies([*rows, *rows[:2]], (), "f.csv")


def one_error_a_stop(name, jitter):
    """The shots of a robot that repeats within 0.05 mm, and twelve samples of each in a file."""
    campaign = rod_campaign(name, shots=40, pairs=10, seed=3, noise_mm=0.004)
    repeats_mm = 0.05 * np.random.default_rng(4).normal(size=(60, 3))
    shots = replace(
        campaign.shots, points_in_tracker_mm=campaign.shots.points_in_tracker_mm + repeats_mm
    )
    raw, mechanism = sampled(shots, 12, jitter), campaign.robot.mechanism
    text = shots_text(rows_of_shots(raw), mechanism)
    rows = parse_shots(text, "f.csv", mechanism)
    return campaign, shots, shots_of_rows(rows, campaign.robot.kinematics)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "jitter"),
    [("delta", 0.0), ("delta", np.radians(0.001)), ("linear-delta", 0.0), ("linear-delta", 0.003)],
)
def test_raw_samples_identify_a_robot_as_well_as_one_point_a_stop(name, jitter):
    campaign, shots, raw = one_error_a_stop(name, jitter)
    options = {"workspace": sample_workspace(campaign.robot, 30)}
    result, once = (IDENTIFY(each, campaign.robot, options=options) for each in (raw, shots))
    assert (len(raw), len(result.residuals.fitted.numbers)) == (
        720,
        len(once.residuals.fitted.numbers),
    )
    assert (result.judgement.verdict, result.judgement.excluded) == ("pass", ()), (
        result.judgement.reasons
    )
    assert [finding for finding in result.judgement.findings if finding.affects_verdict] == []
    assert campaign.position_error_mm(result) < 1.2 * campaign.position_error_mm(once)
