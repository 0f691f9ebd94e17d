"""Check of a calibration by a few shots, and update of the parameters by them."""

# A check asks whether the robot is still the one that was identified. It measures some of the
# plan's identification shots again, spread evenly over the plan, and compares them with what the
# stored posterior predicts (campaigns/identification/checking.py). Shots are commanded by joints:
# the answer then does not depend on the parameters in the controller.
# An update takes the stored posterior as the prior of a fit to the check's shots, so that eight
# shots improve what a hundred determined. It is recorded as an identification of its own, whose
# pedigree names the set that it continues and the series that it used.

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
"""Number of shots of a check, unless another number is requested."""


def check_work(campaign: Campaign, options: CheckOptions) -> Work:
    """Return the work of a check: shots spread evenly over the plan, commanded by joints.

    Raise `ShotsMissing` or `VerdictBad` without an identification that passed, and `PlanInvalid`.
    """
    with campaign.journal_reader() as journal:
        identification, _ = _passed_identification(campaign, journal)
    fitted = [s for s in campaign.read_plan() if s.purpose is ShotSet.IDENTIFICATION]
    count = min(options.shots or CHECK_SHOTS, len(fitted))
    # a short plan may give the same place twice: each counts once
    places = np.unique(np.linspace(0, len(fitted) - 1, count).astype(int)).tolist()
    planned = [
        replace(fitted[place], shot=number, purpose=ShotSet.CHECK, pair=None)
        for number, place in enumerate(places)
    ]
    robot = Kinematics.of(campaign.robot.mechanism, identification.flat())
    fit_options = identification_options(campaign)
    digest = _digest(campaign, identification)
    return engine_work(campaign, "check", joint_steps(planned), robot, digest, fit_options)


def record_check(campaign: Campaign, journal: Journal, series: int) -> RecordedCheck:
    """Judge the shots of a check's series, and write the finding into the journal.

    Raise `ShotsMissing` or `VerdictBad` without an identification that passed.
    """
    identification, posterior = _passed_identification(campaign, journal)
    shots = _shots(campaign, journal, series)
    judged = check(campaign.robot.kinematics, shots, posterior, identification_options(campaign))
    of = _digest(campaign, identification)
    recorded = RecordedCheck(**asdict(judged), series=series, of=of, at_utc=now_utc())
    journal.append(Finding("check", asdict(recorded)), series=series)
    return recorded


def update_by_check(campaign: Campaign) -> RecordedIdentification:
    """Update the latest identification by the shots of the latest check, and record the new set.

    Raise `ShotsMissing` without a check of the latest identification, and `VerdictBad` if the
    identification did not pass.
    """
    with campaign.journal() as journal:
        identification, posterior = _passed_identification(campaign, journal)
        digest = _digest(campaign, identification)
        checks = journal.findings("check")
        checked = read_check(checks[-1].record.body) if checks else None
        # a check of an older set says nothing about the posterior that is to be updated
        if checked is None or checked.of != digest:
            raise ShotsMissing(
                "--update: the latest parameters were not checked yet",
                remedy=f"run `pkmcal check {campaign.folder}` first",
            )
        shots = _shots(campaign, journal, checked.series)
        fit_options = identification_options(campaign)
        result = update(campaign.robot.kinematics, shots, posterior, fit_options, checked.parts)
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


def _passed_identification(
    campaign: Campaign, journal: JournalReader
) -> tuple[RecordedIdentification, StoredPosterior]:
    """Return the latest identification and its posterior.

    Raise `ShotsMissing` without an identification, and `VerdictBad` if it did not pass or has no
    posterior, as the paper's method has none.
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
    """Return the digest of the identified parameters."""
    return identification.parameter_set(campaign.robot.mechanism).digest()


def _shots(campaign: Campaign, journal: JournalReader, series: int) -> Shots:
    """Return the shots of a check's series that were accepted."""
    shots = shots_of_journal(journal.shots(series), campaign.robot.mechanism)
    return shots.of_set(ShotSet.CHECK)
