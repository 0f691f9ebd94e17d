"""Check of a calibration by a few shots, and update of the parameters by them."""

# A check asks whether the robot is still the one that was identified. It measures some of the
# plan's identification shots again, spread over the plan, and compares them with what the stored
# posterior predicts (campaigns/identification/checking.py). Shots are commanded by joints: the
# answer then does not depend on the parameters in the controller.
# An update takes the stored posterior as the prior of a fit to the check's shots, so that eight
# shots improve what a hundred determined. It is recorded as an identification of its own, whose
# pedigree names the set that it continues and the series that it used.

from collections.abc import Sequence
from dataclasses import asdict, replace

import numpy as np

from campaigns.campaign import Campaign, now_utc
from campaigns.controllers.export import latest_identification, require_usable
from campaigns.design.tours import shortest_tour
from campaigns.errors import PlanInvalid, ShotsMissing, VerdictBad
from campaigns.identification.checking import RecordedCheck, check, read_check
from campaigns.identification.identify import update
from campaigns.identification.result import (
    WITHOUT_SHOTS,
    Pedigree,
    RecordedIdentification,
    StoredPosterior,
)
from campaigns.journal.journal import Journal, JournalReader
from campaigns.journal.records import Finding
from campaigns.journal.views import Series
from campaigns.kinematics.model import Kinematics
from campaigns.measuring.work import Work
from campaigns.options import CheckOptions
from campaigns.planning.paths import RobotModel
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import joints_of
from campaigns.planning.steps import joint_steps
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots, shots_of_journal, with_readings
from campaigns.workflow.identification import identification_options
from campaigns.workflow.work import engine_work

CHECK_SHOTS = 8
"""Number of shots of a check, unless another number is requested."""


def check_work(campaign: Campaign, options: CheckOptions) -> Work:
    """Return the work of a check: shots all over the plan on a short tour, commanded by joints.

    Raise `ShotsMissing` or `VerdictBad` without an identification that passed, and `PlanInvalid`.
    """
    with campaign.journal_reader() as journal:
        identification, _ = _passed_identification(campaign, journal)
    fitted = [s for s in campaign.read_plan() if s.purpose is ShotSet.IDENTIFICATION]
    identified = Kinematics.of(campaign.robot.mechanism, identification.value.flat())
    robot = replace(campaign.robot_model, kinematics=identified)
    chosen = _shots_on_tour(fitted, options.shots or CHECK_SHOTS, robot)
    planned = [
        replace(shot, shot=number, purpose=ShotSet.CHECK, pair=None)
        for number, shot in enumerate(chosen)
    ]
    fit_options = identification_options(campaign)
    digest = _digest(campaign, identification)
    return engine_work(campaign, "check", joint_steps(planned), identified, digest, fit_options)


# The joints of a plan at the limits may bring the identified robot beyond them, and no safe way
# leads there. So ways are tested before anything moves:
#
# 1. Places spread evenly over the plan. Each takes the nearest shot in the plan's order that the
#    identified robot reaches by a safe way from the workspace's centre.
# 2. A short tour of these shots, which begins at the centre.
def _shots_on_tour(
    fitted: Sequence[PlannedShot], count: int, robot: RobotModel
) -> tuple[PlannedShot, ...]:
    """Return up to `count` of the fitted shots that a robot reaches; raise `PlanInvalid` for none.

    The same robot and plan give the same shots.
    """
    kinematics, joints = robot.kinematics, joints_of(fitted)
    centre, order = kinematics.inverse(robot.centre[None]), list[int]()
    places = np.linspace(0, len(fitted) - 1, min(count, len(fitted))).astype(int)
    reached: Sequence[int] = ()
    if centre.is_solved[0]:
        ways = robot.safe_ways(np.broadcast_to(centre.values, joints.shape), joints)
        reached = [shot for shot, way in enumerate(ways) if way is not None]
    # a short plan may give the same place twice: each counts once
    for place in np.unique(places):
        free = [shot for shot in reached if shot not in order]
        order += sorted(free, key=lambda shot: (abs(shot - place), shot))[:1]
    if not order:
        raise PlanInvalid(
            "the identified robot reaches no identification shot of plan.csv from the centre",
            remedy="correct validation.centre_mm in campaign.yaml, or make a new plan",
        )
    stops = np.repeat(np.array(order)[:, None], 2, axis=1)  # each shot as a pair of itself
    tour = shortest_tour(
        kinematics.comparable(joints), stops, kinematics.comparable(centre.values[0])
    )
    return tuple(fitted[place] for place in tour[:, 0].tolist())


def record_check(campaign: Campaign, journal: Journal, series: int) -> RecordedCheck:
    """Judge the shots of a check's series, and write the finding into the journal.

    Raise `ShotsMissing` or `VerdictBad` without an identification that passed.
    """
    identification, posterior = _passed_identification(campaign, journal)
    shots = _shots(campaign, journal, series)
    fit_options = identification_options(campaign, series=_series(journal, series))
    judged = check(campaign.robot.kinematics, shots, posterior, fit_options)
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
        checked = check_to_update_by(campaign, journal)
        identification, posterior = _passed_identification(campaign, journal)
        shots = _shots(campaign, journal, checked.series)
        fit_options = identification_options(campaign, series=_series(journal, checked.series))
        result = update(campaign.robot.kinematics, shots, posterior, fit_options, checked.parts)
        former, positions = identification.provenance, identification.uncertainty.position_std_mm
        recorded = RecordedIdentification.of(
            result,
            series=former.series,
            shots=len(shots),
            asked=("--update",),
            robot_digest=campaign.robot.digest(),
            plan_digest=former.plan_digest,
            journal_digest=journal.digest(),
            journal_records=journal.last_number(),
            at_utc=now_utc(),
            settings=campaign.identification_settings,
            pedigree=Pedigree(
                updates=checked.of,
                series=(former.series, checked.series),
                shots=len(shots),
                position_std_before_mm=positions.mean if positions else None,
            ),
        )
        journal.append(Finding("identification", recorded.document()))
    return recorded


def check_to_update_by(campaign: Campaign, journal: JournalReader) -> RecordedCheck:
    """Return the latest check; raise `ShotsMissing` unless it is of the latest parameters."""
    digest = _digest(campaign, _passed_identification(campaign, journal)[0])
    checks = journal.findings("check")
    checked = read_check(checks[-1].record.body) if checks else None
    # a check of an older set says nothing about the posterior that is to be updated
    if checked is None or checked.of != digest:
        raise ShotsMissing(
            "--update: the latest parameters were not checked yet",
            remedy="run `pkmcal check DIR` first, or import its shots with --stage check",
        )
    return checked


def _passed_identification(
    campaign: Campaign, journal: JournalReader
) -> tuple[RecordedIdentification, StoredPosterior]:
    """Return the latest identification and its posterior.

    Raise `ShotsMissing` without an identification, and `VerdictBad` if it did not pass or has no
    posterior, as the paper's method has none.
    """
    identification = latest_identification(journal)
    require_usable(campaign.nominal, identification)
    if identification.provenance.series == WITHOUT_SHOTS:
        raise VerdictBad(
            "it was identified from observations without a tracker: a check measures shots again",
            remedy="import new observations, and identify again",
        )
    if (posterior := identification.uncertainty.posterior) is None:
        raise VerdictBad(
            f"--model {identification.provenance.model} keeps nothing to check by",
            remedy="identify again without it",
        )
    return identification, posterior


def _digest(campaign: Campaign, identification: RecordedIdentification) -> str:
    """Return the digest of the identified parameters."""
    return identification.value.parameter_set(campaign.robot.mechanism).digest()


def digest_to_check(campaign: Campaign) -> str:
    """Return the digest of the parameters that a check is of.

    Raise `ShotsMissing` or `VerdictBad` without an identification that passed.
    """
    with campaign.journal_reader() as journal:
        return _digest(campaign, _passed_identification(campaign, journal)[0])


def _series(journal: JournalReader, number: int) -> Series:
    """Return a check's series."""
    return next(each for each in journal.series("check") if each.number == number)


def _shots(campaign: Campaign, journal: JournalReader, series: int) -> Shots:
    """Return the shots of a check's series that were accepted."""
    shots = shots_of_journal(journal.shots(series), campaign.robot.mechanism)
    return with_readings(shots.of_set(ShotSet.CHECK), campaign.config.part_temperatures)
