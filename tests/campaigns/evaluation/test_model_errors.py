"""Model errors over several sessions: each shot by the frame of its own."""

from dataclasses import replace

import numpy as np
import pytest
from rod_campaigns import TRACKER_FROM_BASE, rod_campaign
from scipy.spatial.transform import Rotation

from campaigns.evaluation.model_errors import ModelErrors
from campaigns.evidence import Evaluation, Evidence, MeasuredSeries, gather
from campaigns.fit.rigid_transforms import Transform
from campaigns.identification.identify import identify
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.result import RecordedIdentification, read_identification
from campaigns.robots.robot import find_robot

NOMINAL = find_robot("par4-prototype").robot.kinematics
NOISE_MM = 0.01
MOVED_AT = 70
ELSEWHERE = Transform(
    Rotation.from_euler("zyx", [70.0, 3.0, -2.0], degrees=True).as_matrix(),
    np.array([900.0, -2000.0, 40.0]),
)


@pytest.fixture(scope="module")
def shots():
    """60 pairs to identify from and 20 unseen ones, the tracker elsewhere from shot 70 on."""
    data = rod_campaign("par4-prototype", shots=120, pairs=20, seed=6, noise_mm=NOISE_MM).shots
    later = np.array(data.numbers) >= MOVED_AT
    points = data.points_in_tracker_mm
    points = np.where(later[:, None], ELSEWHERE.apply(points), points)
    return replace(data, points_in_tracker_mm=points, session=later.astype(int))


def recorded(data, model, *, sessions):
    options = IdentificationOptions(model=model, sessions=sessions)
    found = identify(NOMINAL, data, options)
    provenance = {"series": 1, "journal_records": 1, "at_utc": ""}
    digests = dict.fromkeys(("robot_digest", "plan_digest", "journal_digest"), "")
    return RecordedIdentification.of(found, **provenance, **digests)


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


def test_errors_are_as_small_as_if_nobody_had_moved_the_tracker(shots, errors_of):
    found = recorded(shots, "full", sessions=True)
    errors = errors_of(shots, read_identification(found.document()))
    assert len(errors.positions.after_mm) == 160
    for after_mm in (found.fitted.after, errors.positions.after_mm, errors.unseen.after_mm):
        assert rms(after_mm) < 2.0 * NOISE_MM


def test_frames_are_those_in_which_the_tracker_stood(shots):
    found = recorded(shots, "full", sessions=True)
    places = np.eye(3) * 500.0
    stood = (TRACKER_FROM_BASE, ELSEWHERE.after(TRACKER_FROM_BASE))
    assert [each.shots for each in found.sessions] == [
        tuple(n for n in shots.numbers if (n >= MOVED_AT) == late) for late in (False, True)
    ]
    one_robot = found.sessions[0].frame.tracker_from_base.inverted()
    moved = found.sessions[1].frame.tracker_from_base.after(one_robot)
    in_tracker_mm = stood[0].apply(places)
    np.testing.assert_allclose(
        moved.apply(in_tracker_mm), ELSEWHERE.apply(in_tracker_mm), atol=20.0 * NOISE_MM
    )


def test_one_frame_for_all_shots_has_no_sessions(shots, errors_of):
    early = shots.rows(np.flatnonzero(np.array(shots.numbers) < MOVED_AT))
    found = recorded(early, "full", sessions=False)
    assert found.sessions == ()
    assert rms(errors_of(early, found).positions.after_mm) < 2.0 * NOISE_MM


def test_distances_between_sessions_are_none(shots, errors_of):
    """The stand moves between the two shots of a pair: their distance is left out, and named."""
    data = replace(
        shots,
        session=(np.array(shots.numbers) >= MOVED_AT - 1).astype(int),
        points_in_tracker_mm=np.where(
            (np.array(shots.numbers) == MOVED_AT - 1)[:, None],
            ELSEWHERE.apply(shots.points_in_tracker_mm),
            shots.points_in_tracker_mm,
        ),
    )
    found = recorded(data, "paper", sessions=True)
    assert [(each.pair, each.reason) for each in found.excluded] == [
        (data.pairs[MOVED_AT - 1], "its shots are of two sessions")
    ]
    errors = errors_of(data, found)
    assert len(errors.fitted.numbers) == 59
    assert rms(errors.fitted.after_mm) < 2.0 * NOISE_MM
    assert found.verdict == "pass"
