"""Import of shots measured with other software: to identify from, as a validation or a check."""

# A file proves less than a measurement of our own, so an import asks what a run knows by itself:
#
# 1. Would the shots take the place of others? Only with consent (`anyway`).
# 2. Are they this robot's? Units, signs, order of joints, a mirrored frame, copies of shots that
#    the journal has. No consent helps here: the data would be wrong.
# 3. In which order were they measured? By their times, or else as the rows stand. Order matters for
#    drift, and for backlash, which depends on the way by which a joint arrived.
# 4. For a validation: which set did the controller hold? It cannot be read, so it is declared
#    (`declared_set`), and the report says so. The commanded pose, which no file has, is taken to be
#    the pose that the declared set has at the joints as read.
#
# Only then are the shots appended to the journal, as a finished series in one commit.

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from campaigns.arrays import Index
from campaigns.campaign import Campaign
from campaigns.controllers.export import FILE_NAME, WrittenSet, written_sets
from campaigns.controllers.load_checks import read_parameter_file
from campaigns.errors import OptionsInvalid, ShotsInvalid
from campaigns.evaluation.plausibility import check_distances, check_shots
from campaigns.evidence import STAGES, is_program_there, program_path
from campaigns.identification.checking import FEWEST_SHOTS, RecordedCheck
from campaigns.identification.observed import measured_of, objects_of
from campaigns.identification.other_kinds import other_kinds
from campaigns.identification.plausible_observations import check_observations
from campaigns.journal.journal import Journal
from campaigns.journal.records import Event, Finding, Stage
from campaigns.kinematics.model import Kinematics
from campaigns.options import ValidationStage
from campaigns.robots.reduced_form import form_of
from campaigns.settings.instrument import StatedInstrument
from campaigns.settings.sections import TrackerConfig
from campaigns.shots.import_export import ImportedFile, ImportedSeries, append_import, refuse_copies
from campaigns.shots.observation_records import (
    NO_OBSERVATIONS,
    RecordedObservations,
    append_observations,
    recorded_observations,
    refuse_copied_observations,
)
from campaigns.shots.observations_csv import ObservationRow, default_in_words, require_measured
from campaigns.shots.point_words import LengthUnit
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import OF_SESSIONS, shots_of_rows
from campaigns.shots.shots_csv import ShotRow, set_back_before, time_order
from campaigns.shots.stops import averaged_in_words
from campaigns.workflow import validation
from campaigns.workflow.checking import digest_to_check, record_check
from campaigns.workflow.work import all_series, known_sets
from drivers.bounded_files import is_there
from drivers.values import Vector3


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportTerms:
    """Terms of an import: where its rows come from, and what is overruled.

    Attributes:
        name: Name of the source, for messages.
        files: Files that the journal names with the series.
        unit: Unit of lengths in the file, for messages; the rows themselves are in mm.
        skipped: Names of the shots that the import leaves out, for the journal.
        `tell`: Receives sentences on the order of the shots.
        anyway: Whether to import although the shots take the place of others, or the declared
            set is wrong for the stage.
    """

    name: str = "shots"
    files: Sequence[ImportedFile] = ()
    unit: LengthUnit = "mm"
    skipped: Sequence[str] = ()
    tell: Callable[[str], None] = lambda _: None
    anyway: bool = False


def import_shots(
    campaign: Campaign, rows: Sequence[ShotRow], terms: ImportTerms | None = None
) -> int:
    """Write shots of files into the journal as a series to identify from.

    Args:
        campaign: The campaign.
        rows: The shots, as rows of a shots.csv.
        terms: Where the rows come from, and what is overruled.

    Returns:
        The number of the series.

    Raises:
        OptionsInvalid: The shots would take the place of a run or import.
        ShotsInvalid: The shots cannot be this robot's, or are copies; the message names file and
            cause.
    """
    terms = terms or ImportTerms()
    robot, settings = campaign.robot, campaign.config.model_dump(mode="json")
    if not terms.anyway and (objection := replaced_import(campaign, rows, terms.name)):
        raise objection
    _check(campaign, rows, terms, {"import"} if terms.anyway else set())
    order = _order(rows, terms)
    with campaign.journal() as journal:
        _record_skipped(journal, terms)
        imported = ImportedSeries(robot.digest(), settings, terms.files)
        return append_import(journal, rows, robot.kinematics, imported, order)


def import_observations(
    campaign: Campaign, rows: Sequence[ObservationRow], terms: ImportTerms
) -> None:
    """Write a file of observations of other kinds than points into the journal, in one record.

    Args:
        campaign: The campaign, whose `objects` were measured.
        rows: The observations, all measured.
        terms: The one file that they come from, and what is overruled.

    Raises:
        OptionsInvalid: They would take the place of an earlier file of that name, or are of an
            object that campaign.yaml does not have.
        ShotsMissing: Too few to say more than where an object is.
        ShotsInvalid: They cannot be this robot's, are copies, or have no values yet.
    """
    name, file = terms.name, next(iter(terms.files), ImportedFile(terms.name, ""))
    require_measured(rows, name)
    if by_default := default_in_words(rows):
        terms.tell(f"{name}: {by_default}")
    if not terms.anyway and (objection := replaced_observations(campaign, file.name)):
        raise objection
    others = [each for each in _observations(campaign).files if each.name != file.name]
    refuse_copied_observations(rows, others, name)
    objects = objects_of(campaign.config.objects)
    counting = [row for each in others for row in each.rows]
    nominal, limit_mm = campaign.robot.kinematics, campaign.config.gate.distance_mm
    check_observations(nominal, rows, objects, limit_mm, name)
    other_kinds(measured_of([*counting, *rows], objects), nominal)  # refuses too few of them
    with campaign.journal() as journal:
        append_observations(journal, rows, file)


def replaced_observations(campaign: Campaign, file: str) -> OptionsInvalid | None:
    """Return the objection to a file that takes the place of an earlier one; None without one."""
    earlier = next((each for each in _observations(campaign).files if each.name == file), None)
    if earlier is None:
        return None
    return OptionsInvalid(
        f"{file}: a file of that name with {len(earlier.rows)} observations is there already; from "
        "this import on the new ones alone would count",
        remedy="--force takes them in its place; a file of another name adds to it",
    )


def _observations(campaign: Campaign) -> RecordedObservations:
    """Return the observations of the journal; none without one."""
    if not campaign.journal_path.exists():
        return NO_OBSERVATIONS
    with campaign.journal_reader() as journal:
        return recorded_observations(journal)


def declared_set(
    campaign: Campaign, stage: ValidationStage, path: Path | None = None
) -> WrittenSet:
    """Return the set that a controller is declared to have held; nothing is read from it.

    `path` is a robot file, or a file that `export` or `correct` wrote. By default it is the nominal
    set before calibration, and after it the set that they wrote last. Raise `OptionsInvalid` if
    they wrote none, and `ConfigInvalid` for a file without a parameter set.
    """
    nominal = campaign.robot
    if path is None and stage == "before":
        return WrittenSet.of(campaign.config.robot, nominal.parameters)
    written: tuple[WrittenSet, ...] = ()
    if campaign.journal_path.exists():
        with campaign.journal_reader() as journal:
            written = tuple(written_sets(journal))
    if path is not None:
        # a copy of an exported file, under whatever name, is the exported set
        sha256 = ImportedFile.of(path).sha256
        parameters = next((each for each in written if each.sha256 == sha256), None)
    else:
        parameters = next(iter(written), None)
        path = campaign.path(FILE_NAME)
    if parameters is not None:
        return parameters
    if not is_there(path):
        raise OptionsInvalid(
            f"--stage {stage}: nothing says what the controller held: neither `pkmcal export` nor "
            "`pkmcal correct` has written anything",
            remedy="write it with one of them, or name the robot file with --robot FILE",
        )
    robot = read_parameter_file(path, nominal)
    form = form_of(robot.provenance, str(path))
    return WrittenSet.of(path.name, robot.parameters, projection=form)


def import_validation(
    campaign: Campaign,
    rows: Sequence[ShotRow],
    stage: ValidationStage,
    held: WrittenSet,
    terms: ImportTerms | None = None,
) -> validation.Validated:
    """Write shots into the journal as a validation, and judge it as a measured one.

    Args:
        campaign: The campaign.
        rows: The shots, each of the set of a test.
        stage: Before or after calibration.
        held: The set that the controller held, from `declared_set`.
        terms: Where the rows come from, and what is overruled.

    Returns:
        The figures of the tests, and the verdicts on the stage and on the campaign.

    Raises:
        ShotsInvalid: The shots cannot be this robot's, are copies, or are of no test.
        OptionsInvalid: The set is wrong for the stage, or its tests were measured already.
    """
    terms = terms or ImportTerms()
    settings = campaign.config.model_dump(mode="json")
    _require_tests(rows, terms.name)
    # 1. Objections that consent overrules come before the check of the shots, which takes long.
    objections = tuple(_objections(campaign, rows, stage, held))
    if objections and not terms.anyway:
        raise objections[0]
    # 2. What no consent overrules: copies, and shots of another robot.
    _check(campaign, rows, terms, STAGES[stage] if terms.anyway else set())
    by_targets = _is_by_targets(held, stage)
    declared, files = held.file, tuple(terms.files)
    if by_targets:
        declared, run = _program_run(campaign, held)
        files += run
    # 3. Write overruled objections and the shots, and judge them. Shots that are refused above
    #    change nothing.
    kinematics, order = Kinematics.of(campaign.robot.mechanism, held.wanted), _order(rows, terms)
    recorded_form = known_sets(campaign).state(held.digest).form
    with campaign.journal() as journal:
        validation.record_objections(journal, objections)
        _record_skipped(journal, terms)
        # a form from a file that older software exported: its loss is not in the journal yet
        if held.projection is not None and recorded_form is None:
            journal.append(Finding("export", asdict(held)))
        imported = ImportedSeries(
            held.digest,
            settings,
            files,
            stage="after by targets" if by_targets else stage,
            declared=declared,
        )
        series = append_import(journal, rows, kinematics, imported, order)
        return validation.record_validation(campaign, journal, series, stage, held.by)


def import_check(
    campaign: Campaign, rows: Sequence[ShotRow], terms: ImportTerms | None = None
) -> RecordedCheck:
    """Write shots into the journal as a check of the last identification, and judge it.

    Args:
        campaign: The campaign, with an identification that passed.
        rows: The shots, all of the set `check`, at joints all over the plan.
        terms: Where the rows come from.

    Returns:
        The check: whether the robot is as it was identified.

    Raises:
        ShotsInvalid: The shots cannot be this robot's, are copies, too few, or of another set.
        ShotsMissing, VerdictBad: There is no identification that passed.
    """
    # A check compares shots at their joints with the identified robot: whatever set the controller
    # held does not matter, and none is declared.
    terms = terms or ImportTerms()
    digest = digest_to_check(campaign)
    sets = {row.purpose for row in rows}
    if sets != {ShotSet.CHECK} or len(rows) < FEWEST_SHOTS:
        words = ", ".join(sorted(each.value for each in sets))
        raise ShotsInvalid(
            f"{terms.name}: {len(rows)} shots of {words}; a check has at least {FEWEST_SHOTS}, all "
            "of the set check",
            remedy="measure what `pkmcal plan DIR --program csv --stage check` writes",
        )
    _check(campaign, rows, terms, set())
    order = _order(rows, terms)
    settings, name = campaign.config.model_dump(mode="json"), Path(terms.name).name
    with campaign.journal() as journal:
        _record_skipped(journal, terms)
        imported = ImportedSeries(digest, settings, terms.files, stage="check", declared=name)
        series = append_import(journal, rows, campaign.robot.kinematics, imported, order)
        return record_check(campaign, journal, series)


def _record_skipped(journal: Journal, terms: ImportTerms) -> None:
    """Write into the journal which shots an import left out."""
    if terms.skipped:
        names = ", ".join(terms.skipped)
        journal.append(Event("shot skipped", f"{terms.name}: left out of the import: {names}"))


def _require_tests(rows: Sequence[ShotRow], name: str) -> None:
    """Raise `ShotsInvalid` for the first shot that is of no test of a validation."""
    for place, row in enumerate(rows, start=1):
        if row.purpose not in validation.TESTS:
            tests = ", ".join(sorted(test.value for test in validation.TESTS))
            raise ShotsInvalid(
                f"{name}: shot {place} of the file is of the set {row.purpose.value}, which is no "
                "test of a validation",
                remedy=f"give one of {tests}",
            )


def _is_by_targets(held: WrittenSet, stage: ValidationStage) -> bool:
    """Return whether a stage was measured at targets that were corrected with the set."""
    return held.by == "targets" and stage == "after"


# A file of corrected poses may hold any poses. What the robot was commanded in the validation is in
# the program for it, whose heading names the set that its poses are corrected with.
def _program_run(campaign: Campaign, held: WrittenSet) -> tuple[str, tuple[ImportedFile, ...]]:
    """Return what declares corrected targets, in words, and the program that was run, if any."""
    program = program_path(campaign.folder, "after")
    if not is_program_there(campaign.folder, "after", held.digest):
        return f"{held.file}, without {program.name} of that set", ()
    run = ImportedFile.of(program)
    return f"{run.name}, sha256 {run.sha256[:16]}…", (run,)


def _objections(
    campaign: Campaign, rows: Sequence[ShotRow], stage: ValidationStage, held: WrittenSet
) -> Iterator[OptionsInvalid]:
    """Yield the objections to a validation's import: tests measured already, and a wrong set."""
    tests = frozenset(row.purpose for row in rows)
    if replaced := validation.replaced(campaign, stage, tests):
        remedy = "keep them and go on; --force takes these in their place"
        yield OptionsInvalid(replaced.problem, remedy=remedy)
    # with corrected targets a controller holds the nominal set: `held` names the correcting one
    if _is_by_targets(held, stage):
        return
    state = known_sets(campaign).state(held.digest)
    if wrong := validation.wrong_state(campaign, state, stage):
        remedy = "say what it held by --robot FILE; --force takes them in as they are"
        yield OptionsInvalid(wrong.problem, remedy=remedy)


def replaced_import(
    campaign: Campaign, rows: Sequence[ShotRow], name: str
) -> OptionsInvalid | None:
    """Return the objection to shots that would take the place of others; None if there are none.

    `name` is the source's, for the message.
    """
    earlier = [series for series in all_series(campaign) if series.to_identify]
    if not earlier or not any(row.purpose.on_robot for row in rows):
        return None
    return OptionsInvalid(
        f"{name}: series {earlier[-1].number} of {len(earlier[-1].shots)} shots "
        f"({earlier[-1].started.stage}) is there already; from this import on the new shots "
        "alone would count",
        remedy="--force takes them in its place; to use both, import one file with all shots "
        "and a column session, 1 or 2, for the tracker's stations",
    )


def _order(rows: Sequence[ShotRow], terms: ImportTerms) -> Index | None:
    """Return the rows' order of time, (N,), or None if it is that of the file; report which."""
    name, tell = terms.name, terms.tell
    times = [row.time or "" for row in rows]
    order, lacking = time_order(times)
    if order is None:
        tell(f"{name}: {lacking}: the order of rows is taken as the order of time")
    elif (late := np.flatnonzero(np.diff(order) < 0)).size:
        first, second = order[late[0] : late[0] + 2].tolist()
        tell(f"{name}: sorted by time: shot {first} was measured before shot {second}")
    if (row := set_back_before(times)) is not None:
        tell(
            f"{name}: times go back once, from {times[row - 1]} at shot {row - 1} to {times[row]}, "
            "as a clock's at the end of summer time: the order of rows is kept"
        )
    sessions = np.array([row.session for row in rows])
    if np.ptp(sessions):
        # stations of the tracker one after the other; a stable sort keeps the order within each
        order = np.arange(len(rows)) if order is None else order
        order = order[np.argsort(sessions[order], kind="stable")]
        stations = len(np.unique(sessions))
        tell(
            f"{name}: {stations} stations of the tracker by column session: identify {OF_SESSIONS}"
        )
    return order


def _check(
    campaign: Campaign, rows: Sequence[ShotRow], terms: ImportTerms, replacing: Collection[Stage]
) -> None:
    """Raise `ShotsInvalid`, naming file and cause, for copies and for shots of another robot.

    Report rows that are samples of fewer stops. `replacing` are stages whose imports the shots
    take the place of.
    """
    # A shot that counts twice would prove itself. Shots that no longer count may come again: those
    # of imports that broke off, and those that this import replaces.
    name = terms.name
    counting = (
        series
        for series in all_series(campaign)
        if not series.started.imported
        or (series.finished and series.started.stage not in replacing)
    )
    refuse_copies(rows, counting, name)
    nominal, tolerance = campaign.robot.kinematics, campaign.robot.tolerance
    shots = shots_of_rows(rows, nominal)
    if averaged := averaged_in_words(shots, nominal.mechanism.joints):
        terms.tell(f"{name}: {averaged}")
    has_none = np.isnan(shots.stated_covariance_mm2).any(axis=(1, 2))
    stated = StatedInstrument.of(campaign.config.tracker)
    if campaign.config.certificate.is_asked and stated.of_all.source == "default":
        terms.tell(
            f"{name}: U rests on default limits of what all shots have in common, by which no "
            "certificate is issued; state tracker.common with data_sheet and typed_by in "
            "campaign.yaml before you import"
        )
    if has_none.any() and stated.of_shot.source == "default":
        terms.tell(
            f"{name}: {has_none.sum()} points have no uncertainty of their own: U rests on default "
            "limits, by which no certificate is issued; state tracker.uncertainty with data_sheet "
            "and typed_by in campaign.yaml before you import them"
        )
    shots = shots.rows(np.flatnonzero([bool(row.joints) and row.purpose.on_robot for row in rows]))
    numbers = np.unique(shots.session).tolist()
    # The tracker's place distinguishes the arms of a symmetrical robot. It is left out where
    # campaign.yaml does not state it: with several stations, and while it is the default.
    place_mm: Vector3 | None = campaign.config.tracker.place_mm
    if len(numbers) > 1 or place_mm == TrackerConfig.model_fields["place_mm"].default:
        place_mm = None
    for number in numbers:
        station = shots.rows(np.flatnonzero(shots.session == number))
        where = f"{name}, session {number}" if len(numbers) > 1 else name
        check_shots(nominal, station, where, place_mm, terms.unit, tolerance)
        check_distances(nominal, station, campaign.config.gate.distance_mm, where, tolerance)
