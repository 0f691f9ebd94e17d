"""Model errors over several sessions: each shot by the frame of its own."""

from dataclasses import replace

import numpy as np
import pytest
from rod_campaigns import TRACKER_FROM_BASE, rod_campaign

from campaigns.api import sample_workspace
from campaigns.assessment import Evaluation
from campaigns.evaluation.model_errors import ModelErrors
from campaigns.evidence import Evidence, MeasuredSeries, gather
from campaigns.fit.rigid_transforms import from_paper_angles
from campaigns.identification.identify import identify
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.result import RecordedIdentification, read_identification
from campaigns.robots.robot import find_robot

ROBOT = find_robot("par4-prototype").robot
NOMINAL, WORKSPACE = ROBOT.kinematics, sample_workspace(ROBOT, 30)
NOISE_MM = 0.01
MOVED_AT = 70
ELSEWHERE = from_paper_angles(np.array([1.2, 0.05, -0.03]), np.array([900.0, -2000.0, 40.0]))


@pytest.fixture(scope="module")
def shots():
    """60 pairs to identify from and 20 unseen ones, the tracker elsewhere from shot 70 on."""
    data = rod_campaign("par4-prototype", shots=120, pairs=20, seed=6, noise_mm=NOISE_MM).shots
    later = np.array(data.numbers) >= MOVED_AT
    points = data.points_in_tracker_mm
    points = np.where(later[:, None], ELSEWHERE.apply(points), points)
    return replace(data, points_in_tracker_mm=points, session=later.astype(int))


def recorded(data, model):
    how = IdentificationOptions(model=model, sessions=True, workspace=WORKSPACE)
    result = identify(NOMINAL, data, how)
    digests = dict.fromkeys(("robot_digest", "plan_digest", "journal_digest"), "")
    return RecordedIdentification.of(result, series=1, journal_records=1, at_utc="", **digests)


@pytest.fixture(scope="module")
def by_sessions(shots):
    return recorded(shots, "full")


@pytest.fixture
def errors_of(whole):
    """Errors of shots by what was identified, in a campaign that has nothing else."""

    def errors(data, found) -> ModelErrors:
        run = MeasuredSeries(gather(whole.campaign).run.series, NOMINAL.mechanism)
        vars(run)["shots"] = data
        evidence = Evidence(campaign=whole.campaign, run=run, identification=found)
        return Evaluation(evidence).errors

    return errors


def rms(errors_mm):
    return float(np.sqrt(np.mean(errors_mm**2)))


def test_errors_are_as_small_as_if_nobody_had_moved_the_tracker(shots, errors_of, by_sessions):
    errors = errors_of(shots, read_identification(by_sessions.document()))
    assert len(errors.positions.after_mm) == len(shots)
    for after_mm in (
        by_sessions.residuals.fitted.after,
        errors.positions.after_mm,
        errors.unseen.after_mm,
    ):
        assert rms(after_mm) < 2.0 * NOISE_MM


def test_frames_are_those_in_which_the_tracker_stood(shots, by_sessions):
    first, second = by_sessions.value.sessions
    assert first.shots == tuple(n for n in shots.numbers if n < MOVED_AT)
    assert second.shots == tuple(n for n in shots.numbers if n >= MOVED_AT)
    base_from_first = first.frame.tracker_from_base.inverted()
    moved = second.frame.tracker_from_base.after(base_from_first)
    points_mm = TRACKER_FROM_BASE.apply(np.eye(3) * 500.0)
    np.testing.assert_allclose(
        moved.apply(points_mm), ELSEWHERE.apply(points_mm), atol=20.0 * NOISE_MM
    )


def test_distances_between_sessions_are_none(shots, errors_of):
    """The stand moves between the two shots of a pair: their distance is left out, and named."""
    points, session = shots.points_in_tracker_mm.copy(), shots.session.copy()
    before = [MOVED_AT - 1]
    points[before], session[before] = ELSEWHERE.apply(points[before]), 1
    data = replace(shots, session=session, points_in_tracker_mm=points)
    found = recorded(data, "paper")
    assert [excluded.pair for excluded in found.judgement.excluded] == [data.pairs[MOVED_AT - 1]]
    errors = errors_of(data, found)
    assert len(errors.fitted.numbers) == 59
    assert rms(errors.fitted.after_mm) < 2.0 * NOISE_MM
    assert found.judgement.verdict == "pass"
