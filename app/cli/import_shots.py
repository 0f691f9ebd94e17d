"""pkmcal import: take shots that were measured with other software."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal, cast, get_args

import typer

from app.cli.check import show_check
from app.console import Terminal
from app.next import tell_next, tell_step
from app.options import Folder, Turns, ask_turns, folder_and_file
from app.report.terminal_text import show_validation
from campaigns.assessment import evaluate
from campaigns.campaign import Campaign, open_campaign
from campaigns.errors import CoordinatesAmbiguous, OptionsInvalid
from campaigns.files.cells import DecimalSign
from campaigns.files.wording import listed
from campaigns.next_step import NextStep
from campaigns.options import ImportStage
from campaigns.robots.printer_config import PRINTER, PrinterConfig
from campaigns.shots.import_export import ImportedFile
from campaigns.shots.joined_shots import Join, holds_joints, join_rows, read_joints, skipped_names
from campaigns.shots.observations_csv import ObservationRow, holds_observations, read_observations
from campaigns.shots.point_files import PointFile, read_points
from campaigns.shots.point_layout import PointFormat
from campaigns.shots.point_words import MM_PER_UNIT, Coordinates, LengthUnit
from campaigns.shots.printer_observations import printer_observations
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots_csv import ShotRow, in_unit, read_shots
from campaigns.shots.turn_forms import TurnForm
from campaigns.workflow.importing import (
    ImportTerms,
    declared_set,
    import_check,
    import_observations,
    import_shots,
    import_validation,
    replaced_import,
    replaced_observations,
)
from campaigns.workflow.programs import planned_joints
from drivers.bounded_files import Encoding
from drivers.texts import as_word

Form = Literal["shots", "ascii"]
LISTED = 10
"""Number of shots left out that a line names; the journal has all."""
DEFAULT_SETS = {None: ShotSet.IDENTIFICATION, "check": ShotSet.CHECK}
"""Set of shots whose file names none, by the stage; of validations it is `validation`."""


@dataclass(frozen=True, slots=True)
class ImportAnswer:
    """Answer of `import`."""

    series: int
    """Number of the series; 0 for observations of other kinds than points, which are of none."""
    shots: int
    """Number of shots, or of observations."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportSource:
    """File to import, and how it is read."""

    file: Path
    points: bool = False
    """Whether it holds points of tracker software, whose joints are in another file."""
    joints: Path | None = None
    join: Join = "name"
    turns: TurnForm | None = None
    unit: LengthUnit | None = None
    skip: tuple[str, ...] = ()
    form: PointFormat = field(default_factory=PointFormat)
    """Layout of a file of points, without its unit."""


def command(
    terminal: Terminal,
    folder: Folder,
    file: Annotated[
        Path | None,
        typer.Argument(
            metavar="FILE",
            help="A shots.csv, points, an observations.csv or a printer.cfg.",
            show_default=False,
        ),
    ] = None,
    *,
    form: Annotated[
        Form | None,
        typer.Option(
            "--format",
            help="shots: the CSV file above. ascii: points of other software. Default: by the "
            "file's first line.",
        ),
    ] = None,
    unit: Annotated[
        LengthUnit | None,
        typer.Option(
            help="Unit of lengths in the file. Default: that of its header; mm for a shots.csv."
        ),
    ] = None,
    joints: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="For points: file of the joints of each, in columns name,q0_deg…q3_deg,pair,set. "
            "Default: the one that plan --program wrote into DIR.",
        ),
    ] = None,
    join: Annotated[
        Join, typer.Option(help="For points: how they belong to joints, by name or in order.")
    ] = "name",
    columns: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES", help="For points: what the columns hold, such as name,x,y,z."
        ),
    ] = None,
    coordinates: Annotated[
        Coordinates | None,
        typer.Option(help="For points: which of two sets of X Y Z in the header counts."),
    ] = None,
    decimal: Annotated[
        DecimalSign | None,
        typer.Option(
            help="Decimal sign, also of the joints' file. Default: as the numbers show; needed if "
            "each can be read in two ways."
        ),
    ] = None,
    encoding: Annotated[
        Encoding | None, typer.Option(help="Of files without a byte-order mark. Default: utf-8.")
    ] = None,
    turns: Turns = None,
    skip: Annotated[
        list[str] | None,
        typer.Option(
            metavar="SHOT",
            help="For points: leave this shot out, and the other one of its pair; repeatable. "
            "missing: all whose point lacks.",
            show_default=False,
        ),
    ] = None,
    stage: Annotated[
        ImportStage | None,
        typer.Option(
            help="Import the shots as a validation before or after calibration, or as a check."
        ),
    ] = None,
    robot: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="With --stage: parameters that the controller had, a robot file or a file of "
            "export. Default for before: the nominal ones; for after: those that export or correct "
            "wrote last.",
        ),
    ] = None,
    force: Annotated[
        bool,
        typer.Option(
            "--force", help="Import even if such shots are already there, or if the stage is wrong."
        ),
    ] = False,
) -> None:
    """Import shots measured with other software.

    A CSV file with one row per shot: encoder values, and the reflector's position in the tracker's
    frame. Two rows with the same pair number are a pair. The header for a robot of four arms is

    pair,q0_deg,q1_deg,q2_deg,q3_deg,x_mm,y_mm,z_mm

    and may go on with set, theta_deg, sxx, sxy, sxz, syy, syz, szz (mm²), temperature_degC, time,
    and session: a number of the tracker's station. Turns of a platform with three are rx_deg,
    ry_deg, rz_deg, or as --turns says.
    The set is "identification", which is the default, "validation", for pairs that the fit never
    uses and that validate it, or "known-length", for the ends of a bar of known_lengths in
    campaign.yaml, without joints.

    Shots that cannot be from this robot are refused with the cause: points in another unit or in a
    mirrored frame, joints with another sign, order, zero or factor, a tracker that stood elsewhere
    from some shot on, a point farther from where the nominal robot puts it than gate.distance_mm in
    campaign.yaml.

    A point export of tracker software (SpatialAnalyzer, OpenIndy, Leica) is read together with
    --joints, a file with the joints of each point. The export's header states columns, unit,
    uncertainties and times.

    With --stage the shots are a validation, as `pkmcal validate` measures it: pairs of the set
    "validation", which is the default here, and the sets rotation, straightness, repeatability and
    iso-cube. The controller's parameters are declared, not read, and the report says so. Exit code
    1 has the same meaning as for `pkmcal validate`. With --stage check the shots test whether the
    robot is still calibrated, as `pkmcal check` does; `plan --program csv --stage check` writes
    which ones.

    A CSV file with a column kind holds observations of other kinds than points: heights of a bed,
    distances by callipers, poses of a probe. Its columns are kind, object, the joints, value_mm (or
    x_mm, y_mm, z_mm and what else the kind measures), std_mm, pair and set. Objects stand under
    objects in campaign.yaml. `pkmcal identify` uses them with the shots, or alone.

    The printer.cfg of a Delta printer with Klipper holds such observations too: the heights of the
    bed that DELTA_CALIBRATE saved, and the distances of DELTA_ANALYZE. The campaign is made from
    the same file, with its objects bed and part: pkmcal new DIR --offline --robot printer.cfg

    The journal keeps the files' names and sha256, and the report shows them.

    pkmcal import cell-5 shots.csv
    pkmcal import cell-5 observations.csv
    pkmcal import cell-5 printer.cfg
    pkmcal import cell-5 points.txt --unit mm
    pkmcal import cell-5 points.txt --stage before
    """
    # 1. check the options
    folder, file = folder_and_file(folder, file)
    campaign = open_campaign(folder)
    _check_stage(stage, robot)
    source = ImportSource(
        file=file,
        points=form == "ascii",
        joints=joints,
        join=join,
        turns=turns,
        unit=unit,
        skip=tuple(skip or ()),
        form=PointFormat(
            columns=columns.split(",") if columns else None,
            coordinates=coordinates,
            decimal=decimal,
            encoding=encoding,
        ),
    )
    if form is None and (file.suffix == PRINTER or holds_observations(file)):
        if stage or source != ImportSource(file=file):
            raise OptionsInvalid(
                f"{file}: options of shots and points are not for observations (column kind)",
                remedy="leave out all options but --force",
            )
        _import_observations(terminal, campaign, file, force=force)
        return
    if form is None and not holds_joints(file, campaign.robot.mechanism, encoding):
        source = replace(source, points=True)
    # 2. read it: rows with joints in both cases, lengths in mm
    rows, terms = _read(terminal, campaign, source, stage)
    # 3. compare with the robot and the journal, and write the series
    force = force or (stage is None and _may_replace(terminal, campaign, rows, file))
    terms = replace(terms, anyway=force)
    with terminal.telling("comparing the shots with the robot and the journal"):
        if stage is None:
            series = import_shots(campaign, rows, terms)
        elif stage == "check":
            check = import_check(campaign, rows, terms)
        else:
            held = declared_set(campaign, stage, robot)
            done = import_validation(campaign, rows, stage, held, terms)
    if stage is None:
        _conclude(terminal, campaign, source, ImportAnswer(series, len(rows)))
        return
    terminal.say(f"imported: {len(rows)} shots as '{stage}'")
    if stage == "check":
        show_check(terminal, campaign, check)
    else:
        show_validation(terminal, done, campaign)


def _check_stage(stage: ImportStage | None, robot: Path | None) -> None:
    """Raise `OptionsInvalid` for a robot file where no parameters are declared."""
    if robot is None or stage in {"before", "after"}:
        return
    if stage == "check":
        raise OptionsInvalid(
            "--robot is for a validation: a check does not depend on the controller's parameters",
            remedy="leave --robot out",
        )
    raise OptionsInvalid(
        "--robot is for a validation, but no --stage is given",
        remedy="give --stage before or after, or leave --robot out",
    )


def _read(
    terminal: Terminal, campaign: Campaign, source: ImportSource, stage: ImportStage | None
) -> tuple[tuple[ShotRow, ...], ImportTerms]:
    """Read a file of shots, or of points with the joints beside; return rows and their terms."""
    file, mechanism, joints = source.file, campaign.robot.mechanism, source.joints
    default = DEFAULT_SETS.get(stage, ShotSet.VALIDATION)
    skipped: tuple[str, ...] = ()
    if source.points:
        joints = joints or planned_joints(campaign, file, stage or "run")
        points = _read_asking(terminal, file, replace(source.form, unit=source.unit))
        read_in = points.unit
        turns = ask_turns(terminal, source.turns, joints, mechanism.task)
        at_joints = read_joints(joints, mechanism, default, turns, source.form)
        skipped = skipped_names(points, at_joints, source.skip)
        rows, joined = join_rows(points, at_joints, source.join, frozenset(skipped))
        for note in (*points.notes, joined):
            terminal.note(note)
        if skipped:
            terminal.note(f"left out: {len(skipped)} shots: {listed(skipped, LISTED)}")
    elif joints or source.skip or source.form.columns or source.form.coordinates:
        raise OptionsInvalid(
            "--joints, --columns, --coordinates and --skip are for point files of other software",
            remedy="add --format ascii, or leave them out; delete rows that are not to be imported",
        )
    else:
        read_in = source.unit or "mm"
        turns = ask_turns(terminal, source.turns, file, mechanism.task)
        shots = read_shots(file, mechanism, default, turns, source.form)
        rows = tuple(in_unit(shots, MM_PER_UNIT[read_in]))
    files = tuple(ImportedFile.of(path) for path in (file, joints) if path is not None)
    terms = ImportTerms(
        name=str(file), files=files, unit=read_in, skipped=skipped, tell=terminal.note
    )
    return rows, terms


def _conclude(
    terminal: Terminal, campaign: Campaign, source: ImportSource, answer: ImportAnswer
) -> None:
    """Print which shots were imported to identify from, and what is next."""
    terminal.say(f"imported: {answer.shots} shots, as series {answer.series}")
    evaluation = evaluate(campaign)
    if evaluation.before is None:
        stated = {"--unit": source.unit, "--decimal": source.form.decimal}
        options = (word for option, value in stated.items() if value for word in (option, value))
        words = ("import", as_word(str(campaign.folder)), as_word(f"before{source.file.suffix}"))
        before = NextStep((*words, "--stage", "before", *options))
        terminal.note(
            f"to import pairs measured with the controller's own parameters: {before.text}"
        )
    terminal.conclude(answer, tell_next(terminal, campaign, evaluation=evaluation))


def _import_observations(
    terminal: Terminal, campaign: Campaign, file: Path, *, force: bool
) -> None:
    """Import observations of other kinds than points, and report what is next."""
    names = [item.name for item in campaign.config.objects]
    if file.suffix == PRINTER:
        rows = printer_observations(PrinterConfig.read(file), campaign.robot.kinematics)
    else:
        rows = read_observations(file, campaign.robot.mechanism, names)
    objection = None if force else replaced_observations(campaign, file.name)
    force = force or bool(
        objection and terminal.asks(f"{objection.problem}. Import it in their place?")
    )
    with terminal.telling("comparing the observations with the robot and the journal"):
        files = (ImportedFile.of(file),)
        terms = ImportTerms(name=str(file), files=files, tell=terminal.note, anyway=force)
        import_observations(campaign, rows, terms)
    counts = Counter((row.kind, row.object) for row in rows)
    listed = ", ".join(f"{count} of {of} ({kind})" for (kind, of), count in counts.items())
    terminal.say(f"imported: {len(rows)} observations: {listed}")
    following = (
        tell_next(terminal, campaign)
        if file.suffix != PRINTER
        else _judge_bed(terminal, campaign, rows)
    )
    terminal.conclude(ImportAnswer(0, len(rows)), following)


def _judge_bed(terminal: Terminal, campaign: Campaign, rows: Sequence[ObservationRow]) -> NextStep:
    """Print and return the identification that judges what a printer's firmware measured."""
    kinds = {row.kind for row in rows if row.purpose is ShotSet.VALIDATION}
    asked = [name for kind, name in (("height", "flat"), ("distance", "xy")) if kind in kinds]
    wanted = ("--for", ",".join(asked)) if asked else ()
    return tell_step(terminal, NextStep(("identify", as_word(str(campaign.folder)), *wanted)))


def _read_asking(terminal: Terminal, file: Path, form: PointFormat) -> PointFile:
    """Read points; if the file has two sets of coordinates, ask which of them counts."""
    try:
        return read_points(file, form)
    except CoordinatesAmbiguous as error:
        prompt = terminal.prompt()
        typed = prompt(f"{error.problem}. Which ones count, actual or nominal? ") if prompt else ""
        if typed.strip() not in get_args(Coordinates):
            raise  # the error names the option that answers the question in a script
        return read_points(file, replace(form, coordinates=cast("Coordinates", typed.strip())))


def _may_replace(
    terminal: Terminal, campaign: Campaign, rows: Sequence[ShotRow], file: Path
) -> bool:
    """Return whether the operator agrees that the shots count in the place of earlier ones."""
    objection = replaced_import(campaign, rows, str(file))
    return bool(objection and terminal.asks(f"{objection.problem}. Import it in their place?"))
