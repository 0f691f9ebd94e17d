"""Identification of a campaign from its latest run or import."""

# This module joins three independent parts: the campaign's folder, the journal and the mathematics
# (campaigns/identification).
#
# 1. Check the names in the options against the robot's parameters, before anything takes time.
# 2. Open the journal for writing, which locks the campaign. The fit must rest on the records whose
#    digest its result states, so no shot may be added while it runs.
# 3. Collect the accepted shots: the latest run or finished import, plus shots at bars of known
#    length from an import of their own; then temperatures of parts, then the options' selection.
# 4. Fit. 5. Write the result as a finding with everything that it rests on: digests of robot, plan
#    and journal, the settings, the options as typed. `status`, `export` and the report compare
#    these with the present state, and so notice a result that is out of date.

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from campaigns.campaign import Campaign, now_utc
from campaigns.identification.identify import identify as identify_shots
from campaigns.identification.observations import HOLD_OUT_SEED, asked_shots
from campaigns.identification.observed import hold_out, measured_of, objects_of
from campaigns.identification.options import IdentificationOptions, matching, named_priors
from campaigns.identification.other_kinds import Measured
from campaigns.identification.reflector_shots import reflector_observations
from campaigns.identification.result import (
    WITHOUT_SHOTS,
    IdentificationResult,
    RecordedIdentification,
)
from campaigns.identification.without_points import identify_without_points
from campaigns.journal.journal import JournalReader
from campaigns.journal.records import Finding
from campaigns.journal.views import Series
from campaigns.settings.option import typed_words
from campaigns.shots.observation_records import recorded_observations
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots, shots_of_journal, with_readings


def identify(
    campaign: Campaign,
    options: IdentificationOptions | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> RecordedIdentification:
    """Identify from the latest run or import, and write the result into the journal.

    Imported observations of other kinds are fitted with the shots, or alone if there are none.

    Args:
        campaign: The campaign, with accepted shots of a run, or an import.
        options: Options of `pkmcal identify`; by default the usual ones.
        `tell`: Receives words on the progress.

    Returns:
        The result as the journal keeps it: parameters with 1 σ, residuals, findings, verdict.

    Raises:
        OptionsInvalid: Options name unknown parameters, or contradict each other.
        ShotsMissing: Nothing has been measured, or too little for the options.
        ShotsInvalid: The shots cannot be this robot's.

    Example:
        >>> workflow.identify(open_campaign("cell-7")).judgement.verdict
        'pass'
    """
    options = options or IdentificationOptions()
    robot = campaign.robot
    campaign.require_journal()
    with campaign.journal() as journal:
        asked = asked_measurements(campaign, journal, options)
        series, shots, measured = asked.series, asked.shots, asked.measured
        started_s = time.perf_counter()
        result: IdentificationResult
        if shots is None:
            tell("fitting observations without a tracker")
            result = identify_without_points(robot.kinematics, measured, asked.options)
        else:
            result = identify_shots(robot.kinematics, shots, asked.options, tell, measured)
        recorded = RecordedIdentification.of(
            result,
            seconds=time.perf_counter() - started_s,
            series=WITHOUT_SHOTS if series is None else series.number,
            shots=0 if shots is None else len(shots),
            observations=sum(len(group.joints) for group in measured),
            asked=tuple(typed_words(options)),
            robot_digest=robot.digest(),
            plan_digest="" if series is None else series.started.plan_digest,
            journal_digest=journal.digest(),
            journal_records=journal.last_number(),
            at_utc=now_utc(),
            settings=campaign.identification_settings,
        )
        journal.append(Finding("identification", recorded.document()))
    return recorded


@dataclass(frozen=True, slots=True, eq=False)
class AskedMeasurements:
    """Measurements to identify from as options ask for them."""

    series: Series | None
    """Series of the shots; None: no tracker has measured."""
    shots: Shots | None
    measured: tuple[Measured, ...]
    """Observations of other kinds than points."""
    options: IdentificationOptions
    """The options, completed by what the campaign states."""


def asked_measurements(
    campaign: Campaign, journal: JournalReader, options: IdentificationOptions
) -> AskedMeasurements:
    """Return what `identify` fits; raise `OptionsInvalid` or `ShotsMissing` as it does."""
    table = campaign.robot.mechanism.parameters
    named_priors(options.prior, table)  # raises for an unknown name; the result is not needed here
    for pattern in (*options.free, *options.fix):
        matching(pattern, table)
    series = campaign.series_to_identify(journal)
    measured = _observations(campaign, journal, series, options)
    if series is None and not measured:
        raise campaign.nothing_measured()
    shots = None if series is None else _shots(campaign, journal, series, options)
    return AskedMeasurements(
        series, shots, measured, identification_options(campaign, options, series)
    )


def _shots(
    campaign: Campaign, journal: JournalReader, series: Series, options: IdentificationOptions
) -> Shots:
    """Return the shots of a series as options ask for them, those at bars from elsewhere too."""
    mechanism = campaign.robot.mechanism
    measured = journal.shots(series.number)
    # a run that measured the bars itself needs no shots at bars from elsewhere
    if not any(shot.intent.purpose == ShotSet.KNOWN_LENGTH.value for shot in measured):
        measured = (*measured, *campaign.known_length_shots(journal))
    shots = shots_of_journal(measured, mechanism)
    shots = with_readings(shots, campaign.config.part_temperatures)
    return asked_shots(shots, mechanism.joints, options)


def _observations(
    campaign: Campaign,
    journal: JournalReader,
    series: Series | None,
    options: IdentificationOptions,
) -> tuple[Measured, ...]:
    """Return the observations of other kinds than points, a share held out as options ask.

    Those of the series itself are of reflectors elsewhere on the platform.
    """
    rows = recorded_observations(journal).rows
    rng = np.random.default_rng(HOLD_OUT_SEED)
    rows = hold_out(rows, options.hold_out, rng) if options.hold_out else rows
    objects = objects_of(campaign.config.objects)
    shots = () if series is None else journal.shots(series.number)
    instrument = campaign.instrument
    if series is not None:
        instrument = campaign.instrument_of(series.started).uncertainty
    by_tracker = reflector_observations(shots, objects, instrument)
    return (*measured_of(rows, objects), *by_tracker)


def identification_options(
    campaign: Campaign, options: IdentificationOptions | None = None, series: Series | None = None
) -> IdentificationOptions:
    """Return options completed by a campaign's tolerances, tracker, limits and workspace.

    `options` None: the usual ones. `series` is that of the shots, whose tracker counts; None: what
    is measured now.
    """
    stated = None if series is None else campaign.instrument_of(series.started)
    return replace(
        options or IdentificationOptions(),
        instrument=campaign.instrument if stated is None else stated.uncertainty,
        tolerances=campaign.robot.tolerances,
        tolerance=campaign.robot.tolerance,
        limits_mm=campaign.config.acceptance.distances_mm,
        rotation_deg=campaign.config.acceptance.rotation_deg,
        known_lengths=campaign.config.known_lengths,
        workspace=campaign.workspace_sample(),
        reference_degC=campaign.config.reference_temperature_degC,
    )
