"""Check of a calibration by a few shots, and update of the parameters by them."""

from dataclasses import asdict, replace

import numpy as np

from campaigns.campaign import Campaign, now_utc
from campaigns.controllers.export import latest_identification, require_usable
from campaigns.errors import ShotsMissing, VerdictBad
from campaigns.identification.checking import RecordedCheck, check, read_check
from campaigns.identification.identify import update
from campaigns.identification.result import Pedigree, RecordedIdentification, StoredPosterior
from campaigns.journal.journal import Journal, JournalReader
from campaigns.journal.records import Finding
from campaigns.kinematics.mechanism import Kinematics
from campaigns.measuring.work import Work
from campaigns.options import CheckOptions
from campaigns.planning.steps import joint_steps
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots, shots_of_journal
from campaigns.workflow.identification import identification_options
from campaigns.workflow.work import engine_work

CHECK_SHOTS = 8
"""Shots of a check, spread evenly over those of the plan, unless others are asked for."""


def check_work(campaign: Campaign, options: CheckOptions) -> Work:
    """Return shots spread over the plan as work for the engine, commanded by joints.

    Raise `ShotsMissing` and `VerdictBad` without an identification that passed, and `PlanInvalid`.
    """
    with campaign.journal_reader() as journal:
        identification, _ = _stored(campaign, journal)
    fitted = [s for s in campaign.read_plan() if s.purpose is ShotSet.IDENTIFICATION]
    count = min(options.shots or CHECK_SHOTS, len(fitted))
    places = np.unique(np.linspace(0, len(fitted) - 1, count).astype(int)).tolist()
    planned = [
        replace(fitted[place], shot=number, purpose=ShotSet.CHECK, pair=None)
        for number, place in enumerate(places)
    ]
    robot = Kinematics.of(campaign.robot.mechanism, identification.flat())
    how = identification_options(campaign)
    digest = _digest(campaign, identification)
    return engine_work(campaign, "check", joint_steps(planned), robot, digest, how)


def record_check(campaign: Campaign, journal: Journal, series: int) -> RecordedCheck:
    """Judge a check that was measured, and write the finding into the journal."""
    identification, posterior = _stored(campaign, journal)
    shots = _shots(campaign, journal, series)
    judged = check(campaign.robot.kinematics, shots, posterior, identification_options(campaign))
    of = _digest(campaign, identification)
    recorded = RecordedCheck(**asdict(judged), series=series, of=of, at_utc=now_utc())
    journal.append(Finding("check", asdict(recorded)), series=series)
    return recorded


def update_by_check(campaign: Campaign) -> RecordedIdentification:
    """Update the latest identification by the shots of the latest check, and record the new set.

    Raise `ShotsMissing` without a check of that set, `VerdictBad` without a set that passed.
    """
    with campaign.journal() as journal:
        identification, posterior = _stored(campaign, journal)
        digest = _digest(campaign, identification)
        checks = journal.findings("check")
        checked = read_check(checks[-1].record.body) if checks else None
        if checked is None or checked.of != digest:
            raise ShotsMissing(
                "--update: the latest parameters were not checked yet",
                remedy=f"run `pkmcal check {campaign.folder}` first",
            )
        shots = _shots(campaign, journal, checked.series)
        how = identification_options(campaign)
        result = update(campaign.robot.kinematics, shots, posterior, how, checked.parts)
        positions = identification.position_std_mm
        recorded = RecordedIdentification.of(
            result,
            series=identification.series,
            shots=len(shots),
            asked=("--update",),
            robot_digest=campaign.robot.digest(),
            plan_digest=identification.plan_digest,
            journal_digest=journal.digest(),
            journal_records=journal.last_number(),
            at_utc=now_utc(),
            settings=campaign.identification_settings,
            pedigree=Pedigree(
                updates=digest,
                series=(identification.series, checked.series),
                shots=len(shots),
                position_std_before_mm=positions.mean if positions else None,
            ),
        )
        journal.append(Finding("identification", recorded.document()))
    return recorded


def _stored(
    campaign: Campaign, journal: JournalReader
) -> tuple[RecordedIdentification, StoredPosterior]:
    """Return the latest identification and its posterior.

    Raise `ShotsMissing` without one, `VerdictBad` for one that did not pass or has no posterior.
    """
    identification = latest_identification(journal)
    require_usable(campaign.nominal, identification)
    if identification.posterior is None:
        raise VerdictBad(
            f"--model {identification.model} keeps nothing to check by",
            remedy="identify again without it",
        )
    return identification, identification.posterior


def _digest(campaign: Campaign, identification: RecordedIdentification) -> str:
    return identification.parameter_set(campaign.robot.mechanism).digest()


def _shots(campaign: Campaign, journal: JournalReader, series: int) -> Shots:
    shots = shots_of_journal(journal.shots(series), campaign.robot.mechanism)
    return shots.of_set(ShotSet.CHECK)
