"""Identification of a campaign from its latest run or import."""

import time
from dataclasses import replace

from campaigns.campaign import Campaign, now_utc
from campaigns.estimation.estimators import Model
from campaigns.identification.model_selection import asked_shots, candidate_models, identify_model
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.result import RecordedIdentification
from campaigns.journal.records import Finding
from campaigns.settings.option import typed_words
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import shots_of_journal


def identify(
    campaign: Campaign, options: IdentificationOptions | None = None
) -> RecordedIdentification:
    """Identify from the latest run or import, and write the result into the journal.

    Raises `OptionsInvalid`, `ShotsMissing` and `ShotsInvalid`.
    """
    options = options or IdentificationOptions()
    robot = campaign.robot
    space, chosen = robot.mechanism.parameters, (options.free, options.fix, options.prior)
    candidate_models(space, options.model or Model.AUTO, *chosen)  # refused before anything is read
    how = identification_options(campaign, options)
    campaign.require_journal()
    with campaign.journal() as journal:
        series = campaign.measured_series(journal)
        model = options.model or model_to_find(series.started.model)
        measured = journal.shots(series.number)
        if not any(shot.intent.purpose == ShotSet.KNOWN_LENGTH.value for shot in measured):
            measured = (*measured, *campaign.known_length_shots(journal))
        shots = shots_of_journal(measured, robot.mechanism)
        shots = asked_shots(shots, options)
        started_s = time.perf_counter()
        found = identify_model(robot.kinematics, shots, replace(how, model=model))
        recorded = RecordedIdentification.of(
            replace(found, seconds=time.perf_counter() - started_s),
            series=series.number,
            shots=len(shots),
            model=model.value,
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


def model_to_find(planned: str) -> Model:
    """Model to look for in shots that were planned for another, by its word.

    Of shots that can tell the full one the smallest that explains them; none is named in a series
    of older software, which looked for the standard one.
    """
    known = [each for each in Model if each.value == planned]
    if not planned:
        return Model.STANDARD
    return known[0] if known and known[0] is not Model.FULL else Model.AUTO


def identification_options(
    campaign: Campaign, options: IdentificationOptions
) -> IdentificationOptions:
    """Options with what this campaign says of itself."""
    return replace(
        options,
        instrument=campaign.instrument,
        tolerance=campaign.robot.tolerance,
        limits_mm=campaign.config.acceptance.distances_mm,
        known_lengths=campaign.config.known_lengths,
        workspace=campaign.workspace_sample(),
    )
