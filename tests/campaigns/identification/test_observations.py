"""Observations of shots: noise by part, frames of sessions, order and time, what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from rod_campaigns import rod_campaign

from campaigns.errors import ShotsInvalid, ShotsMissing
from campaigns.fit.effects import Walk
from campaigns.fit.tracker_noise import covariance_by_direction_mm2
from campaigns.identification.observations import (
    asked_shots,
    error_model,
    fitted_sessions,
    observations_of,
)
from campaigns.identification.options import IdentificationOptions
from campaigns.shots.shot_sets import ShotSet

OPTIONS = IdentificationOptions()


@pytest.fixture(scope="module")
def campaign():
    return rod_campaign("delta", shots=12, pairs=2, seed=1)


@pytest.fixture(scope="module")
def shots(campaign):
    return campaign.shots


def observe(shots, sessions=None, options=OPTIONS):
    return observations_of(shots, shots.commanded, options, sessions)


def test_shots_without_a_stated_covariance_have_the_data_sheets_by_direction(shots):
    stated = shots.stated_covariance_mm2.copy()
    stated[[2, 5]] = np.nan
    observations = observe(replace(shots, stated_covariance_mm2=stated))
    along, across = covariance_by_direction_mm2(shots.points_in_tracker_mm, OPTIONS.instrument)
    is_unstated = np.isin(np.arange(16), [2, 5])[:, None, None]
    assert list(observations.noise) == ["stated", "along", "across"]
    assert observations.noise["stated"] == pytest.approx(
        np.where(is_unstated, 0.0, 1e-4 * np.eye(3))
    )
    assert observations.noise["along"] == pytest.approx(np.where(is_unstated, along, 0.0))
    assert observations.noise["across"] == pytest.approx(np.where(is_unstated, across, 0.0))
    assert list(observe(shots).noise) == ["stated"]
    nothing = replace(shots, stated_covariance_mm2=np.full((16, 3, 3), np.nan))
    assert list(observe(nothing).noise) == ["along", "across"]


@pytest.mark.parametrize("least", [0.0, -1e-6])
def test_a_covariance_that_is_not_positive_definite_is_refused_by_its_shot(shots, least):
    stated = shots.stated_covariance_mm2.copy()
    stated[7] = np.diag([1e-4, least, 1e-4])
    stated[3] = np.nan
    with pytest.raises(ShotsInvalid, match="shot 7"):
        observe(replace(shots, stated_covariance_mm2=stated))


def test_each_session_has_its_frame_and_shots_of_others_have_none(shots):
    session = np.array([4] * 5 + [9] * 5 + [7] * 2 + [11] * 4)
    observations = observe(replace(shots, session=session), np.array([4, 9]))
    assert observations.frame.tolist() == [0] * 5 + [1] * 5 + [-1] * 6
    assert not observe(replace(shots, session=session)).frame.any()


def test_moments_and_the_shot_before_follow_the_order_of_time(shots):
    rng = np.random.default_rng(1)
    records = tuple(rng.permutation(16).tolist())
    observations = observe(replace(shots, records=records))
    assert observations.moment.tolist() == list(records)
    by_record = dict(zip(records, shots.joints, strict=True))
    for row, record in enumerate(records):
        before = by_record.get(record - 1, shots.joints[row])
        assert np.array_equal(observations.former[row], before)


def test_time_runs_from_zero_to_one_in_each_session_by_the_clock_or_by_order(shots):
    session = np.repeat([0, 1], 8)
    by_order = observe(replace(shots, session=session), np.array([0, 1])).time
    assert by_order == pytest.approx(np.tile(np.linspace(0.0, 1.0, 8), 2))
    minutes = np.r_[0, 1, 2, 3, 4, 5, 6, 10, 20, 21, 22, 23, 24, 25, 26, 40]
    times = tuple(f"2026-01-01T00:{minute:02d}:00Z" for minute in minutes)
    timed = replace(shots, session=session, measured_utc=times)
    by_clock = observe(timed, np.array([0, 1])).time
    assert by_clock[:8] == pytest.approx(minutes[:8] / 10.0)
    assert by_clock[8:] == pytest.approx((minutes[8:] - 20.0) / 20.0)
    alone = observe(replace(shots, session=np.r_[np.zeros(15, dtype=int), 1]), np.array([0, 1]))
    assert alone.time[-1] == 0.5


def test_warmth_is_beyond_the_reference_and_zero_where_it_is_unknown(shots):
    temperature = np.linspace(20.0, 35.0, 16)
    temperature[4] = np.nan
    options = IdentificationOptions(reference_degC=22.0)
    warm = replace(shots, part_temperature_degC=temperature)
    expected = temperature - 22.0
    expected[4] = 0.0
    assert observe(warm, options=options).warmth == pytest.approx(expected)
    assert not observe(shots).warmth.any()


def test_the_model_has_what_options_and_shots_give(campaign, shots):
    nominal = campaign.robot.kinematics
    options = IdentificationOptions(fix=("arm1.*", "rods"), prior=("arm2.arm_mm=0.001",))
    model = error_model(nominal, shots, options, sessions=2)
    assert model.effects == (Walk(0), Walk(1))
    assert not [name for name in model.names if name.startswith("arm1.")]
    assert "rods" not in model.groups
    assert model.tolerance[model.names.index("arm2.arm_mm")] == pytest.approx(0.001)
    assert model.tolerance[model.names.index("scale")] == options.instrument.common["scale"]
    assert not model.with_growth
    warm = replace(shots, part_temperature_degC=np.r_[25.0, np.full(15, np.nan)])
    assert error_model(nominal, warm, OPTIONS).with_growth
    assert not error_model(nominal, None, OPTIONS).with_growth
    tolerances = IdentificationOptions(tolerances={"rods_deg": 1e-5, "scale": 1.0})
    of_file = error_model(nominal, shots, tolerances)
    assert of_file.tolerance[of_file.groups.index("rods")] == 1e-5
    assert of_file.tolerance[of_file.names.index("scale")] == OPTIONS.instrument.common["scale"]


def test_sessions_of_fewer_than_four_shots_place_no_frame(shots):
    every = np.ones(16, dtype=bool)
    by_session = IdentificationOptions(sessions=True)
    session = np.r_[np.full(8, 3), np.full(4, 5), np.full(4, 9)]
    two = replace(shots, session=session)
    # validation shots of a session of their own need no frame
    assert fitted_sessions(two, every, by_session).tolist() == [3, 5]
    assert fitted_sessions(two, every, OPTIONS).tolist() == [0]
    one_lost = every & (np.arange(16) != 9)
    with pytest.raises(ShotsMissing, match=r"a session has 3 shots .*1 left out"):
        fitted_sessions(two, one_lost, by_session)
    four = every & (np.arange(16) < 4)
    assert fitted_sessions(two, four, OPTIONS).tolist() == [0]
    with pytest.raises(ShotsMissing, match="there are 3 shots"):
        fitted_sessions(two, every & (np.arange(16) < 3), OPTIONS)
    alone = replace(shots, session=np.full(16, 3))
    with pytest.raises(ShotsMissing, match="there are 3 shots"):
        fitted_sessions(alone, every & (np.arange(16) < 3), by_session)
    with pytest.raises(ShotsMissing, match="there are 0 shots"):
        fitted_sessions(shots.of_set(ShotSet.VALIDATION), every[:4], OPTIONS)


def test_asked_shots_are_of_the_range_with_a_share_of_pairs_held_out(campaign, shots):
    axes = campaign.robot.mechanism.joints
    options = IdentificationOptions(shots=(2, 9), hold_out=0.5)
    asked = asked_shots(shots, axes, options)
    # validation shots stay whatever their numbers are
    assert asked.numbers == (*range(2, 10), *range(12, 16))
    fitted = [kind for kind in asked.purposes if kind is ShotSet.IDENTIFICATION]
    assert len(fitted) == 4
    assert asked_shots(shots, axes, options).purposes == asked.purposes
    assert asked_shots(shots, axes, OPTIONS).purposes == shots.purposes
