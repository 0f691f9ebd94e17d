"""A change during a campaign is named by its cause and its place, and chance is not."""

from dataclasses import replace

import numpy as np
import pytest
from identified_cases import (
    NOISE_MM,
    NOMINAL,
    TRACKER_FROM_BASE,
    TRUTH,
    identified,
    moved,
    noisy,
    simulated,
)
from par4_space import SPACE
from scipy.spatial.transform import Rotation

from campaigns.errors import ShotsMissing
from campaigns.estimation.estimators import Estimator
from campaigns.estimation.rigid_transforms import Transform
from campaigns.identification.change import isolated
from campaigns.identification.identify import identify
from campaigns.identification.observations import Inputs, point_observations
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.parameter_selection import select_parameters
from campaigns.mechanisms.mechanism import Kinematics

CHANGED_AT = 70


def changed(seed, *, offset_deg=0.0, arm_mm=0.0, frame_mm=0.0, arm=2):
    """Shots 0 to 119 for the fit, the robot or the stand changing before shot `CHANGED_AT`."""
    data = simulated(60, 20, seed=seed, truth=TRUTH)
    space, p = TRUTH.mechanism.parameters, TRUTH.p.copy()
    p[space.offsets[arm]] += np.radians(offset_deg)
    p[space.places(space.arm_lengths)[arm]] += arm_mm
    later = Kinematics(TRUTH.mechanism, p)
    rows = np.arange(len(data)) >= CHANGED_AT
    old, new = (
        TRACKER_FROM_BASE.apply(each.forward(data.joints).values_or_raise()[:, :3])
        for each in (TRUTH, later)
    )
    step = new - old + frame_mm * np.array([0.6, -0.8, 0.0])
    points = data.points_in_tracker_mm + np.where(rows[:, None], step, 0.0)
    return noisy(replace(data, points_in_tracker_mm=points), seed=seed)


def doubt_of(data, estimator=Estimator.POINTS):
    found = identified(data, estimator)
    (doubt,) = [each for each in found.doubts if each.name == "change-during-campaign"]
    assert found.verdict == "fail"
    assert doubt.says in found.reasons
    return doubt


@pytest.mark.parametrize("estimator", list(Estimator))
def test_a_slipped_encoder_is_named_with_arm_place_and_size(estimator):
    doubt = doubt_of(changed(3, offset_deg=0.05), estimator)
    assert doubt.numbers["cause"] == "arm2.joint_offset_deg"
    assert doubt.numbers["size"] == pytest.approx(0.05, abs=0.003)
    assert abs(doubt.numbers["before_shot"] - CHANGED_AT) <= 1
    assert "arm 2's encoder changed by +0.0" in doubt.says


def test_an_arm_that_grew_and_a_stand_that_was_bumped_are_named():
    doubt = doubt_of(changed(4, arm_mm=0.3, arm=1))
    assert doubt.numbers["cause"] == "arm1.arm_mm"
    assert doubt.numbers["size"] == pytest.approx(0.3, abs=0.05)
    doubt = doubt_of(changed(5, frame_mm=0.57))
    assert doubt.numbers["kind"] == "frame"
    assert abs(doubt.numbers["before_shot"] - CHANGED_AT) <= 1
    assert "the tracker or the robot's base moved by 0.5" in doubt.says


@pytest.mark.parametrize("std_mm", [NOISE_MM, 20.0 * NOISE_MM])
def test_a_campaign_without_change_has_none(std_mm):
    found = identified(noisy(simulated(40, 10, seed=2), 2, std_mm), Estimator.POINTS)
    assert found.doubts == ()
    assert found.verdict == "pass"


def test_single_gross_errors_are_no_change():
    data = moved(noisy(simulated(60, 20, seed=1), 1), (3, 60, 118), 5.0)
    found = identified(data, Estimator.POINTS)
    assert [each.shot for each in found.excluded] == [3, 60, 118]
    assert found.doubts == ()


@pytest.mark.parametrize(
    ("is_last", "across", "verdict"),
    [(True, False, "not decided"), (True, True, "pass"), (False, False, "pass")],
)
def test_a_shot_that_may_be_the_first_after_a_step_is_not_decided(is_last, across, verdict):
    """The last one, off as an encoder's step has it; not across that, nor where others follow."""
    data, p, row = noisy(simulated(60, 20, seed=1), 1), NOMINAL.p.copy(), 80
    records = [1000 if is_last and each == row + 1 else each for each in range(1, len(data) + 1)]
    p[NOMINAL.mechanism.parameters.offsets[2]] += np.radians(0.05)
    robots = (NOMINAL, Kinematics(NOMINAL.mechanism, p))
    old, new = (robot.forward(data.joints[[row]]).values[0, :3] for robot in robots)
    step = TRACKER_FROM_BASE.rotation @ (new - old)
    points = data.points_in_tracker_mm.copy()
    points[row] += np.cross(step, [0.6, 0.0, 0.8]) if across else step
    data = replace(data, points_in_tracker_mm=points, records=tuple(records))
    found = identified(data, Estimator.POINTS)
    assert found.verdict == verdict
    assert [each.numbers["cause"] for each in found.doubts] == (
        ["arm2.joint_offset_deg"] if verdict == "not decided" else []
    )


def test_rows_left_out_alone_are_isolated_and_runs_are_not():
    kept = np.array([True, False, True, False, False, True, False])
    assert np.flatnonzero(isolated(kept)).tolist() == [1, 6]


def test_place_of_a_step_is_told_by_records_when_the_clock_was_set_back():
    """Set back by an hour before shot 100, times would have the last shots come first."""
    data = changed(3, offset_deg=0.05)
    times = tuple(
        f"2026-03-02T{8 if row < 100 else 7:02d}:{row // 60:02d}:{row % 60:02d}.000+00:00"
        for row in range(len(data))
    )
    data = replace(data, measured_utc=times, records=tuple(range(1, len(data) + 1)))
    doubt = doubt_of(data)
    assert doubt.numbers["cause"] == "arm2.joint_offset_deg"
    assert abs(doubt.numbers["before_shot"] - CHANGED_AT) <= 1


def test_a_shot_measured_again_at_the_end_comes_last():
    """As a skipped pose does, which keeps its number."""
    data = changed(3, offset_deg=0.05)
    late = (10, 20, 30)
    records = tuple(row + 1000 * (row in late) for row in range(1, len(data) + 1))
    rows = replace(data, records=records).order_of_time().tolist()
    assert rows[-3:] == [row - 1 for row in late]
    assert rows[:-3] == sorted(rows[:-3])


class TestSessions:
    """A stand that was moved between sessions costs six unknowns and nothing else."""

    def moved_stand(self, by):
        data = noisy(simulated(60, 20, seed=6, truth=TRUTH), seed=6)
        rows = np.arange(len(data)) >= CHANGED_AT
        points = np.where(
            rows[:, None], by.apply(data.points_in_tracker_mm), data.points_in_tracker_mm
        )
        return replace(data, points_in_tracker_mm=points, session=rows.astype(int))

    BUMPED = Transform(Rotation.from_euler("z", 0.02, degrees=True).as_matrix(), np.full(3, 0.4))
    ELSEWHERE = Transform(
        Rotation.from_euler("zyx", [70.0, 3.0, -2.0], degrees=True).as_matrix(),
        np.array([900.0, -2000.0, 40.0]),
    )

    @pytest.mark.parametrize("by", [BUMPED, ELSEWHERE])
    def test_frames_of_their_own_bring_back_what_one_frame_would_give(self, by):
        options = IdentificationOptions(sessions=True)
        found = identify(NOMINAL, self.moved_stand(by), select_parameters(SPACE), options)
        calm = identified(noisy(simulated(60, 20, seed=6, truth=TRUTH), seed=6), Estimator.POINTS)
        assert found.verdict == "pass"
        assert found.doubts == ()
        assert found.dof == calm.dof - 6
        for name, each in found.parameters.items():
            if each.std is not None:
                assert each.value == pytest.approx(calm.parameters[name].value, abs=2.0 * each.std)
                assert each.std < 1.5 * calm.parameters[name].std

    def test_a_bump_without_them_is_no_pass(self):
        assert doubt_of(self.moved_stand(self.BUMPED)).numbers["kind"] == "frame"

    def test_derivatives_are_those_of_the_residuals(self):
        data = self.moved_stand(self.ELSEWHERE)
        options = IdentificationOptions(sessions=True)
        inputs = Inputs.of(NOMINAL, data, select_parameters(SPACE), options)
        problem = point_observations(inputs).residuals
        x = problem.start() + 1e-3 * np.random.default_rng(1).standard_normal(len(problem.start()))
        step = 1e-6
        for place in range(len(x)):
            ahead, behind = x.copy(), x.copy()
            ahead[place] += step
            behind[place] -= step
            slope = (problem.residual(ahead) - problem.residual(behind)) / (2.0 * step)
            scale = max(1.0, np.abs(slope).max())
            assert np.abs(problem.jacobian(x)[:, place] - slope).max() < 1e-5 * scale

    def test_a_session_of_too_few_shots_is_refused(self):
        options = IdentificationOptions(sessions=True)
        data = self.moved_stand(self.BUMPED)
        data = replace(data, session=np.array([1, 1] + [0] * (len(data) - 2)))
        with pytest.raises(ShotsMissing, match="a session has 2 shots"):
            identify(NOMINAL, data, select_parameters(SPACE), options)
