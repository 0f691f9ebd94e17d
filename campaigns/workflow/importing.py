"""Import of shots measured with other software: to identify from, or as a validation."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from campaigns.arrays import Index
from campaigns.campaign import Campaign
from campaigns.controllers.export import FILE_NAME, WrittenSet, written_sets
from campaigns.controllers.load_checks import read_parameter_file
from campaigns.errors import OptionsInvalid, ShotsInvalid
from campaigns.evaluation.plausibility import check_distances, check_shots
from campaigns.evaluation.validation import SET_OF
from campaigns.evidence import STAGES
from campaigns.journal.records import Finding, Stage
from campaigns.journal.views import Series
from campaigns.kinematics.mechanism import Kinematics
from campaigns.options import ValidationStage
from campaigns.robots.reduced_form import form_of
from campaigns.settings.sections import TrackerConfig
from campaigns.shots.import_export import ImportedFile, append_import, refuse_copies
from campaigns.shots.point_files import LengthUnit
from campaigns.shots.shots import shots_of_rows
from campaigns.shots.shots_csv import ShotRow, time_order
from campaigns.workflow import validation
from campaigns.workflow.work import known_sets
from drivers.bounded_files import is_there
from drivers.values import Vector3


def import_shots(
    campaign: Campaign,
    rows: Sequence[ShotRow],
    name: str = "shots",
    files: Sequence[ImportedFile] = (),
    unit: LengthUnit = "mm",
    *,
    tell: Callable[[str], None] = lambda _: None,
    anyway: bool = False,
) -> int:
    """Write shots of files into the journal as a series to identify from; gives its number.

    `unit` is that of the file; `tell` reports the order of the shots. Raises `ShotsInvalid`, naming
    file and cause, for shots that cannot be this robot's, and for copies, unless it is
    `anyway` another import that this one takes the place of.
    """
    robot, settings = campaign.robot, campaign.config.model_dump(mode="json")
    if not anyway and (again := replaced_import(campaign, rows, name)):
        raise again
    _check(campaign, rows, name, unit, {"import"} if anyway else set())
    order = _order(rows, name, tell)
    with campaign.journal() as journal:
        return append_import(
            journal, rows, robot.kinematics, robot.digest(), settings, files, order=order
        )


def declared_set(
    campaign: Campaign, stage: ValidationStage, path: Path | None = None
) -> WrittenSet:
    """Set that somebody says a controller held; nothing is read from it.

    Of a robot file, or of whatever `export` or `correct` wrote. By default the nominal one before
    calibration, and after it what they wrote last. Raises `OptionsInvalid` where there is none,
    `ConfigInvalid` for a file that holds no set.
    """
    nominal = campaign.robot
    if path is None and stage == "before":
        return WrittenSet.of(campaign.config.robot, nominal.parameters)
    written: tuple[WrittenSet, ...] = ()
    if campaign.journal_path.exists():
        with campaign.journal_reader() as journal:
            written = tuple(written_sets(journal))
    if path is not None:
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
    robot = read_parameter_file(path, campaign.folder, nominal)
    form = form_of(robot.provenance, str(path))
    return WrittenSet.of(path.name, robot.parameters, projection=form)


def import_validation(
    campaign: Campaign,
    rows: Sequence[ShotRow],
    stage: ValidationStage,
    held: WrittenSet,
    name: str = "shots",
    files: Sequence[ImportedFile] = (),
    unit: LengthUnit = "mm",
    *,
    tell: Callable[[str], None] = lambda _: None,
    anyway: bool = False,
) -> validation.Validated:
    """Write shots into the journal as a validation, and judge it as one that was measured.

    Commanded is taken to be the pose that the declared set has at the joints as read; with
    corrected targets that is the wanted one. Raises `ShotsInvalid`, and `OptionsInvalid` for the
    wrong stage unless `anyway`.
    """
    robot, settings = campaign.robot, campaign.config.model_dump(mode="json")
    tests = set(SET_OF.values())
    for place, row in enumerate(rows, start=1):
        if row.purpose not in tests:
            raise ShotsInvalid(
                f"{name}: shot {place} of the file is of the set {row.purpose.value}, which is no "
                "test of a validation",
                remedy=f"give one of {', '.join(sorted(each.value for each in tests))}",
            )
    by_targets = held.by == "targets" and stage == "after"
    state = known_sets(campaign).state(held.digest)
    wrong = None if by_targets else validation.wrong_state(campaign, state, stage)
    if wrong is not None:
        remedy = "say what it held by --robot FILE; --force takes them in as they are"
        wrong = OptionsInvalid(wrong.problem, remedy=remedy)
    again = validation.replaced(campaign, stage, frozenset(row.purpose for row in rows))
    if again is not None:
        remedy = "keep them and go on; --force takes these in their place"
        again = OptionsInvalid(again.problem, remedy=remedy)
    if not anyway:
        validation.require_or_record(campaign, (again, wrong), anyway=False)
    _check(campaign, rows, name, unit, STAGES[stage] if anyway else set())
    validation.require_or_record(campaign, (again, wrong), anyway=anyway)
    kinematics, order = Kinematics.of(robot.mechanism, held.wanted), _order(rows, name, tell)
    with campaign.journal() as journal:
        if held.projection is not None and state.form is None:  # of a file of older software
            journal.append(Finding("export", asdict(held)))
        series = append_import(
            journal,
            rows,
            kinematics,
            held.digest,
            settings,
            files,
            stage="after by targets" if by_targets else stage,
            declared=held.file,
            order=order,
        )
        return validation.record_validation(campaign, journal, series, stage, held.by)


def replaced_import(
    campaign: Campaign, rows: Sequence[ShotRow], name: str
) -> OptionsInvalid | None:
    """Return the objection to shots that would count in the place of others."""
    earlier = [series for series in _measured(campaign) if series.to_identify]
    if not earlier or not any(row.purpose.on_robot for row in rows):
        return None
    return OptionsInvalid(
        f"{name}: series {earlier[-1].number} of {len(earlier[-1].shots)} shots "
        f"({earlier[-1].started.stage}) is there already; from this import on the new shots "
        "alone would count",
        remedy="--force takes them in its place; to use both, import one file with all shots "
        "and a column session, 1 or 2, for the tracker's stations",
    )


def _measured(campaign: Campaign) -> tuple[Series, ...]:
    if not campaign.journal_path.exists():
        return ()
    with campaign.journal_reader() as journal:
        return journal.series()


def _order(rows: Sequence[ShotRow], name: str, tell: Callable[[str], None]) -> Index | None:
    """Return the order of time of the rows, (N,); None, and say why, if it is the file's."""
    order, lacking = time_order([row.time or "" for row in rows])
    if order is None:
        tell(f"{name}: {lacking}: the order of rows is taken as the order of time")
    elif (late := np.flatnonzero(np.diff(order) < 0)).size:
        first, second = order[late[0] : late[0] + 2].tolist()
        tell(f"{name}: sorted by time: shot {first} was measured before shot {second}")
    sessions = np.array([row.session for row in rows])
    if np.ptp(sessions):  # one after the other
        order = np.arange(len(rows)) if order is None else order
        order = order[np.argsort(sessions[order], kind="stable")]
        stations = len(np.unique(sessions))
        tell(f"{name}: {stations} stations of the tracker by column session: identify --sessions")
    return order


def _check(
    campaign: Campaign,
    rows: Sequence[ShotRow],
    name: str,
    unit: LengthUnit,
    replacing: Collection[Stage],
) -> None:
    """Raise `ShotsInvalid`, naming file and cause, for shots that cannot be this robot's.

    Copies too, of each other and of what the journal has, but for imports that broke off, and those
    of the stages whose place these take.
    """
    counting = (
        series
        for series in _measured(campaign)
        if not series.started.imported
        or (series.finished and series.started.stage not in replacing)
    )
    refuse_copies(rows, counting, name)
    nominal = campaign.robot.kinematics
    shots = shots_of_rows(rows, nominal)
    shots = shots.rows(np.flatnonzero([bool(row.joints) and row.purpose.on_robot for row in rows]))
    numbers = np.unique(shots.session).tolist()
    place_mm: Vector3 | None = campaign.config.tracker.place_mm
    if len(numbers) > 1 or place_mm == TrackerConfig.model_fields["place_mm"].default:
        place_mm = None
    for number in numbers:
        station = shots.rows(np.flatnonzero(shots.session == number))
        where = f"{name}, session {number}" if len(numbers) > 1 else name
        check_shots(nominal, station, where, place_mm, unit)
        check_distances(nominal, station, campaign.config.gate.distance_mm, where)
