"""Checking of a calibration in the time of a coffee."""

from pydantic import TypeAdapter

from campaigns.campaign import Campaign, now_utc
from campaigns.controllers.export import latest_identification, require_usable
from campaigns.errors import VerdictBad
from campaigns.evaluation.calibration_check import CalibrationCheck
from campaigns.identification.checking import StoredCalibration, check_calibration
from campaigns.journal.journal import Journal, JournalReader
from campaigns.journal.records import Finding
from campaigns.measuring.work import Work
from campaigns.options import CheckOptions
from campaigns.planning.plans import spread_shots
from campaigns.planning.predicted_uncertainty import EstimationSetup
from campaigns.planning.steps import joint_steps
from campaigns.shots.shots import shots_of_journal
from campaigns.workflow.work import engine_work

CHECK_SHOTS = 10


def check_work(campaign: Campaign, options: CheckOptions) -> Work:
    """Shots of a check as work for the engine, commanded by joints.

    Raises `ShotsMissing` and `VerdictBad` without an identification that passed, and `PlanInvalid`
    without a plan of at least as many shots.
    """
    with campaign.journal_reader() as journal:
        stored = _stored(campaign, journal)
    robot, count = stored.kinematics, options.shots or CHECK_SHOTS
    planned = spread_shots(campaign.read_plan(), robot, count)
    setup = EstimationSetup(stored.found.estimator, stored.known.names, campaign.instrument)
    digest = robot.parameters.digest()
    return engine_work(campaign, "check", joint_steps(planned), robot, digest, setup)


def record_check(campaign: Campaign, journal: Journal, series: int) -> CalibrationCheck:
    """Judge a check that was measured, and write the finding into the journal."""
    stored = _stored(campaign, journal)
    shots = shots_of_journal(journal.shots(series), campaign.robot.mechanism)
    judged = check_calibration(stored, shots, campaign.instrument)
    of = {"series": series, "of": stored.kinematics.parameters.digest(), "at_utc": now_utc()}
    body = TypeAdapter(CalibrationCheck).dump_python(judged, mode="json") | of
    journal.append(Finding("check", body), series=series)
    return judged


def _stored(campaign: Campaign, journal: JournalReader) -> StoredCalibration:
    """Latest identification, for a check; raises `ShotsMissing` and `VerdictBad`."""
    found = latest_identification(journal)
    require_usable(campaign.nominal, found)
    if found.covariance is None or not found.covariance.names:
        raise VerdictBad("the identification states no σ", remedy="identify again")
    return StoredCalibration(campaign.robot.kinematics, found)
