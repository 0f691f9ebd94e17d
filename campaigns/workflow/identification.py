"""Identification of a campaign from its latest run or import."""

import time
from dataclasses import replace

from campaigns.campaign import Campaign, now_utc
from campaigns.identification.identify import identify as identify_shots
from campaigns.identification.observations import asked_shots
from campaigns.identification.options import IdentificationOptions, matching, named_priors
from campaigns.identification.result import RecordedIdentification
from campaigns.journal.records import Finding
from campaigns.settings.option import typed_words
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import shots_of_journal, with_readings


def identify(
    campaign: Campaign, options: IdentificationOptions | None = None
) -> RecordedIdentification:
    """Identify from the latest run or import, and write the result into the journal.

    Raise `OptionsInvalid`, `ShotsMissing` and `ShotsInvalid`.
    """
    options = options or IdentificationOptions()
    robot = campaign.robot
    table = robot.mechanism.parameters
    named_priors(options.prior, table)  # unknown names are refused before anything is read
    for pattern in (*options.free, *options.fix):
        matching(pattern, table)
    how = identification_options(campaign, options)
    campaign.require_journal()
    with campaign.journal() as journal:
        series = campaign.measured_series(journal)
        measured = journal.shots(series.number)
        if not any(shot.intent.purpose == ShotSet.KNOWN_LENGTH.value for shot in measured):
            measured = (*measured, *campaign.known_length_shots(journal))
        shots = shots_of_journal(measured, robot.mechanism)
        shots = asked_shots(with_readings(shots, campaign.config.part_temperatures), options)
        started_s = time.perf_counter()
        result = identify_shots(robot.kinematics, shots, how)
        recorded = RecordedIdentification.of(
            replace(result, seconds=time.perf_counter() - started_s),
            series=series.number,
            shots=len(shots),
            asked=tuple(typed_words(options)),
            robot_digest=robot.digest(),
            plan_digest=series.started.plan_digest,
            journal_digest=journal.digest(),
            journal_records=journal.last_number(),
            at_utc=now_utc(),
            settings=campaign.identification_settings,
        )
        journal.append(Finding("identification", recorded.document()))
    return recorded


def identification_options(
    campaign: Campaign, options: IdentificationOptions | None = None
) -> IdentificationOptions:
    """Return options, by default the usual ones, with a campaign's robot, tracker and limits."""
    return replace(
        options or IdentificationOptions(),
        instrument=campaign.instrument,
        tolerances=campaign.robot.tolerances,
        limits_mm=campaign.config.acceptance.distances_mm,
        known_lengths=campaign.config.known_lengths,
        workspace=campaign.workspace_sample(),
        reference_degC=campaign.config.reference_temperature_degC,
    )
