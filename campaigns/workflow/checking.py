"""Checking of a calibration in the time of a coffee, and its repair without a new campaign."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from pydantic import TypeAdapter

from campaigns.campaign import Campaign, now_utc
from campaigns.controllers.export import latest_identification, require_usable
from campaigns.design.criteria import CriterionName
from campaigns.errors import OptionsInvalid, VerdictBad
from campaigns.evaluation.base_motion import FEWEST
from campaigns.evaluation.calibration_check import CalibrationCheck, read_check
from campaigns.identification.check_design import confusions
from campaigns.identification.checking import (
    StoredCalibration,
    check_calibration,
    repaired,
    repaired_estimate,
)
from campaigns.identification.result import RecordedIdentification
from campaigns.journal.journal import Journal, JournalReader
from campaigns.journal.records import Finding, Stage
from campaigns.measuring.work import Work
from campaigns.options import CheckOptions
from campaigns.planning.further_shots import further_shots
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.predicted_uncertainty import EstimationSetup
from campaigns.planning.steps import joint_steps
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots, shots_of_journal
from campaigns.workflow.work import engine_work

CHECK_SHOTS, REPAIR_SHOTS = 8, 6
CHECKED_BY: CriterionName = "D"
REPAIRED_BY: CriterionName = "I"


def check_work(campaign: Campaign, options: CheckOptions) -> Work:
    """Shots of a check, or of a repair, as work for the engine, commanded by joints.

    Raises `ShotsMissing` and `VerdictBad` without an identification that passed, `PlanInvalid`, and
    `OptionsInvalid` for a repair of what no check found changed.
    """
    with campaign.journal_reader() as journal:
        stored = _stored(campaign, journal)
        known, criterion = stored.with_expected_changes, CHECKED_BY
        told_apart = None if options.repair else partial(confusions, stored)
        if options.repair:
            series, judged = _to_repair(campaign, journal, stored)
            stored = stored.with_moved(judged.of_robot)
            shots = _shots(campaign, journal, series)
            found, *_ = repaired_estimate(stored, judged.of_robot, shots, campaign.instrument)
            assert found.covariance is not None, "the prior alone determines everything"
            count = len(stored.known.names)
            known, criterion = found.covariance[:count, :count], REPAIRED_BY
    free, robot = stored.known.names, stored.kinematics
    region = replace(campaign.region, kinematics=robot)
    instrument = replace(campaign.instrument, robot_scatter_mm=stored.scatter.point_mm)
    count = options.shots or (REPAIR_SHOTS if options.repair else CHECK_SHOTS)
    rng = np.random.default_rng(campaign.config.plan.seed)
    planned = further_shots(region, free, known, instrument, criterion, count, rng, told_apart)
    planned = (*planned, *_nests(campaign, stored, planned[-1])) if not options.repair else planned
    setup = EstimationSetup(stored.found.estimator, free, campaign.instrument)
    stage: Stage = "repair" if options.repair else "check"
    digest = robot.parameters.digest()
    return engine_work(campaign, stage, joint_steps(planned), robot, digest, setup)


def _nests(
    campaign: Campaign, stored: StoredCalibration, last: PlannedShot
) -> Iterator[PlannedShot]:
    """Nests that the campaign knows, measured while the robot stands at the last shot's pose."""
    names = [each.name for each in campaign.config.nests if each.name in stored.found.nests]
    for number, name in enumerate(names if len(names) >= FEWEST else (), start=last.shot + 1):
        yield replace(last, shot=number, purpose=ShotSet.NEST, pair=None, nest=name)


def record_check(campaign: Campaign, journal: Journal, series: int) -> CalibrationCheck:
    """Judge a check that was measured, and write the finding into the journal."""
    stored = _stored(campaign, journal)
    judged = check_calibration(stored, _shots(campaign, journal, series), campaign.instrument)
    of = {"series": series, "of": stored.kinematics.parameters.digest(), "at_utc": now_utc()}
    body = TypeAdapter(CalibrationCheck).dump_python(judged, mode="json") | of
    journal.append(Finding("check", body), series=series)
    return judged


def record_repair(campaign: Campaign, journal: Journal, series: int) -> RecordedIdentification:
    """Identify what changed from a check and further shots, and write it as the latest set."""
    stored = _stored(campaign, journal)
    checked, judged = _to_repair(campaign, journal, stored)
    shots = _shots(campaign, journal, checked, series)
    sample, both = campaign.workspace_sample(), (checked, series)
    found = repaired(stored, judged.of_robot, shots, campaign.instrument, sample, both)
    recorded = replace(
        found,
        journal_digest=journal.digest(),
        journal_records=journal.last_number(),
        at_utc=now_utc(),
    )
    journal.append(Finding("identification", recorded.document()))
    return recorded


def _stored(campaign: Campaign, journal: JournalReader) -> StoredCalibration:
    """Latest identification, for a check; raises `ShotsMissing` and `VerdictBad`."""
    found = latest_identification(journal)
    require_usable(campaign.nominal, found)
    if found.covariance is None or not found.covariance.names:
        raise VerdictBad("the identification states no σ", remedy="identify again")
    return StoredCalibration(campaign.robot.kinematics, found)


def _to_repair(
    campaign: Campaign, journal: JournalReader, stored: StoredCalibration
) -> tuple[int, CalibrationCheck]:
    """Latest check of the stored set, by series, where it named a part that can be found anew."""
    checks = [
        each.record.body for each in journal.records_of(Finding) if each.record.kind == "check"
    ]
    judged = read_check(checks[-1]) if checks else None
    if judged is None or judged.of != stored.kinematics.parameters.digest():
        raise OptionsInvalid(
            "--repair: these parameters were not checked yet",
            remedy=f"`pkmcal check {campaign.folder}` first",
        )
    if not stored.can_repair(judged):
        raise OptionsInvalid(
            f"--repair: the latest check names no part to find anew ({judged.says})",
            remedy="measure a campaign again if the robot changed, with `pkmcal run --anew`",
        )
    return judged.series, judged


def _shots(campaign: Campaign, journal: JournalReader, *series: int) -> Shots:
    """Shots of some series, each with a frame of its own."""
    every = [(each, shot) for each in series for shot in journal.shots(each)]
    shots = shots_of_journal([shot for _, shot in every], campaign.robot.mechanism)
    return replace(shots, session=np.array([each for each, _ in every], dtype=np.intp))
