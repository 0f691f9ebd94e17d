"""observations.csv: what other instruments than a tracker measured, and what a plan wants measured.

A row is an observation at one pose of the robot: its kind, the object that was measured (a name of
`objects` in campaign.yaml), the joints, the kind's values and their σ. A distance is between two
poses: two rows with one label in the column `pair`, and its value in either. A row without a value
is planned: it is measured, and its value filled in. No σ is assumed, so that each row states one,
and may say where it has it from: a verdict that rests on a usual σ is no certificate.
"""

from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from campaigns.errors import ObservationsInvalid
from campaigns.files.csv_file import (
    CsvColumn,
    CsvForm,
    CsvRow,
    angle_column,
    column_names,
    number_column,
    parse_csv,
    whole_column,
)
from campaigns.files.text_file import read_text, write_text_unless_there
from campaigns.files.wording import shown, suggestion
from campaigns.fit.kinds import KINDS, TURNS_DEG, Kind
from campaigns.kinematics.mechanism import Mechanism
from campaigns.shots import columns
from campaigns.shots.shot_sets import ShotSet
from drivers.bounded_files import CSV_BYTES, FileRefused, codec_of, read_bounded

FILE_NAME = "observations.csv"
KIND, OBJECT, STD, PAIR, SESSION = "kind", "object", "std_mm", "pair", "session"
STD_SOURCE, DEFAULT = "std_source", "default"
"""Column for the source of σ, and its word for what is usual of such instruments."""
HEADS = (CsvColumn(KIND), CsvColumn(OBJECT), CsvColumn(STD), CsvColumn("value_mm"))
"""Columns by which a file of observations is recognised."""
SETS = (ShotSet.IDENTIFICATION, ShotSet.VALIDATION)
"""Sets of observations: fitted, and held out."""


@dataclass(frozen=True, slots=True)
class ObservationRow:
    """Observation of one kind at one object: measured, or planned."""

    kind: str
    """Word of `campaigns.fit.kinds.KINDS`."""
    object: str
    """Name of the bed, block, part, probe or reflector."""
    joints: tuple[tuple[float, ...], ...]
    """Joint values of each of its poses (k, n), rad or mm: two of a distance, else one."""
    values: tuple[float, ...]
    """Measured values in the kind's columns, mm and rad; () if it is planned."""
    std_mm: float
    """1 σ of each value; of turns that of points 100 mm apart."""
    purpose: ShotSet = ShotSet.IDENTIFICATION
    """Set: identification, or validation for one that is held out."""
    pair: str = ""
    """Label of the two rows of two poses; "" of one pose."""
    time: str | None = None
    """Time as the file states it; None: unknown."""
    session: int = 0
    """Number of the tracker's station; 0 if all are of one."""
    line: int = 0
    """Line of the file it was read from, of two the later one; 0 if it is from none."""
    file: str = ""
    """Name of that file."""
    std_source: str | None = None
    """Source of σ as the file states it; None: not recorded by the software of that time."""

    @property
    def place(self) -> str:
        """Where it stands, for messages: file and line; "" if it is from no file."""
        return f"{self.file}:{self.line}" if self.line else ""

    @property
    def is_planned(self) -> bool:
        """Whether it still has to be measured."""
        return not self.values

    @property
    def std_source_in_words(self) -> str:
        """The source of σ."""
        if self.std_source is None:
            return "not recorded by the software of that time"
        usual = {"": "the file's own figures", DEFAULT: "default: usual of such instruments"}
        return usual.get(self.std_source, self.std_source)


def default_in_words(rows: Collection[ObservationRow]) -> str:
    """Return that some rows have a usual σ, and what to do about it; "" if none has."""
    count = sum(row.std_source == DEFAULT for row in rows)
    if not count:
        return ""
    return (
        f"σ of {count} of {len(rows)} observations is what is usual, by which no certificate is "
        f"issued: before they are measured or imported, write that of your instrument into {STD}, "
        f"and its data sheet with who took it from there into {STD_SOURCE}"
    )


def holds_observations(path: Path) -> bool:
    """Return whether a file's first line has a column `kind`, by whatever separator."""
    with suppress(FileRefused, ObservationsInvalid):
        data = read_bounded(path, CSV_BYTES)
        text = data.decode(codec_of(data), errors="replace")
        return KIND in column_names(text, CsvForm(HEADS, ObservationsInvalid))
    return False


def read_observations(
    path: Path, mechanism: Mechanism, objects: Collection[str] | None = None
) -> tuple[ObservationRow, ...]:
    """Read a file of observations, in its order; planned ones have no values.

    `objects` are the names in campaign.yaml; None: every name is taken. Raise
    `ObservationsInvalid` with the line.
    """
    text = read_text(
        path, ObservationsInvalid, if_missing="check the file's name", most_bytes=CSV_BYTES
    )
    return parse_observations(text, str(path), mechanism, objects)


def write_observations(
    path: Path, rows: Sequence[ObservationRow], mechanism: Mechanism, *, overwrite: bool = False
) -> None:
    """Write the file; raises `OutputExists` unless `overwrite`, or `WriteFailed`."""
    write_text_unless_there(path, observations_text(rows, mechanism), overwrite=overwrite)


def require_measured(rows: Sequence[ObservationRow], name: str) -> None:
    """Raise `ObservationsInvalid`, with line and number, if any of the rows is only planned."""
    planned = [row for row in rows if row.is_planned]
    if planned:
        raise ObservationsInvalid(
            f"{name}:{planned[0].line}: {len(planned)} of {len(rows)} observations have no value, "
            f"this one of {planned[0].object} is the first",
            remedy="measure them and fill in their values, or take their rows out",
        )


def parse_observations(
    text: str, name: str, mechanism: Mechanism, objects: Collection[str] | None = None
) -> tuple[ObservationRow, ...]:
    """Read the observations of a file's text; raise `ObservationsInvalid` with the line."""
    lines: dict[tuple[str, ...], list[CsvRow]] = {}
    for row in parse_csv(text, name, _form(mechanism)):
        kind = _kind_of(row)
        _check_object(row, objects)
        _check_columns(row, kind)
        label = row.text(PAIR) or row.where  # an observation of one pose stands alone
        lines.setdefault((kind.name, row.text(OBJECT), label), []).append(row)
    if not lines:
        raise ObservationsInvalid(
            f"{name}: holds no observations", remedy="check that it is the right file"
        )
    return tuple(_observation_of(rows, mechanism) for rows in lines.values())


def observations_text(rows: Sequence[ObservationRow], mechanism: Mechanism) -> str:
    """Write the text of a file, with the columns that any row fills, or will when measured."""
    lines = [line for row in rows for line in _lines_of(row, mechanism)]
    filled = {name for line in lines for name, value in line.items() if value not in (None, "")}
    filled |= {name for row in rows for name in KINDS[row.kind].columns}
    # an empty column of values stays: somebody fills it in
    form = _form(mechanism)
    kept = [column for column in form.columns if column.required or column.name in filled]
    return CsvForm(tuple(replace(column, required=True) for column in kept), form.invalid).text(
        lines
    )


def _form(mechanism: Mechanism) -> CsvForm:
    """Return the columns of a file of observations of a robot."""
    measured = dict.fromkeys(name for kind in KINDS.values() for name in kind.columns)
    return CsvForm(
        (
            CsvColumn(KIND, required=True),
            CsvColumn(OBJECT, required=True),
            *columns.columns_of(mechanism.joints),
            *((angle_column if name in TURNS_DEG else number_column)(name) for name in measured),
            number_column(STD, required=True),
            CsvColumn(STD_SOURCE),
            CsvColumn(PAIR),
            CsvColumn("set"),
            CsvColumn("time"),
            whole_column(SESSION),
        ),
        ObservationsInvalid,
    )


def _kind_of(row: CsvRow) -> Kind:
    """Return the kind of a row; raise `ObservationsInvalid` for one that does not exist."""
    name = row.text(KIND)
    if name not in KINDS:
        problem = f"unknown kind '{shown(name)}'" if name else "kind is empty"
        raise row.wrong(problem, remedy=suggestion(name, tuple(KINDS)))
    return KINDS[name]


def _check_object(row: CsvRow, objects: Collection[str] | None) -> None:
    """Raise `ObservationsInvalid` for a row of no object, or of none in campaign.yaml."""
    name = row.text(OBJECT)
    if not name:
        raise row.wrong("object is empty", remedy="name the bed, part or probe that was measured")
    if objects is None or name in objects:
        return
    meant = f"{suggestion(name, objects)}, or write" if objects else "write"
    raise row.wrong(
        f"unknown object '{shown(name)}'",
        remedy=f"{meant} `- {{name: {shown(name)}}}` under objects in campaign.yaml, with what is "
        "known of it",
    )


def _check_columns(row: CsvRow, kind: Kind) -> None:
    """Raise `ObservationsInvalid` for values of another kind, or a pair that it has not."""
    others = {name for other in KINDS.values() for name in other.columns} - {*kind.columns}
    filled = sorted(name for name in others if row.text(name))
    if filled:
        raise row.wrong(
            f"{filled[0]} is {shown(row.text(filled[0]))}, but a {kind.name} has "
            f"{', '.join(kind.columns)}",
            remedy=f"leave {', '.join(filled)} empty, or correct the kind",
        )
    if row.text(PAIR) and kind.poses == 1:
        raise row.wrong(
            f"pair is {shown(row.text(PAIR))}, but a {kind.name} is of one pose",
            remedy="leave it empty",
        )
    if not row.text(PAIR) and kind.poses > 1:
        raise row.wrong(
            f"pair is empty, but a {kind.name} is of {kind.poses} poses",
            remedy="give its two rows one label, such as 1",
        )


def _observation_of(rows: Sequence[CsvRow], mechanism: Mechanism) -> ObservationRow:
    """Return the observation of its rows, one a pose; raise `ObservationsInvalid` with the line."""
    last, kind = rows[-1], KINDS[rows[-1].text(KIND)]
    if len(rows) != kind.poses:
        problem, count = f"pair {shown(last.text(PAIR))} of {shown(last.text(OBJECT))}", len(rows)
        remedy = "add the row of its other pose" if count == 1 else "give each pair its own label"
        raise last.wrong(f"{problem} has {_counted(count)}, must have two", remedy=remedy)
    sets = {_set_of(row) for row in rows}
    if len(sets) > 1:
        raise last.wrong("the rows of the pair are of two sets", remedy="give both the same set")
    filled = [row for row in rows if any(map(row.text, kind.columns))]
    values = {row.values(kind.columns) for row in filled}
    if len(values) > 1:
        raise last.wrong("both rows of the pair have values, which differ", remedy="keep one")
    return ObservationRow(
        kind=kind.name,
        object=last.text(OBJECT),
        joints=tuple(row.values(columns.axis_columns(mechanism.joints)) for row in rows),
        values=values.pop() if values else (),
        std_mm=_std_of([*filled, *rows][0]),
        std_source=[*filled, *rows][0].text(STD_SOURCE),
        purpose=sets.pop(),
        pair=last.text(PAIR),
        time=next((row.text("time") for row in reversed(rows) if row.text("time")), None),
        session=last.value(SESSION) if last.text(SESSION) else 0,
        line=int(last.where.rpartition(":")[2]),
        file=Path(last.where.rpartition(":")[0]).name,
    )


def _counted(count: int) -> str:
    return "one row" if count == 1 else f"{count} rows"


def _set_of(row: CsvRow) -> ShotSet:
    """Return the set of a row; raise `ObservationsInvalid` for one that does not exist."""
    purpose = columns.shot_set(row, ShotSet.IDENTIFICATION)
    if purpose not in SETS:
        raise row.wrong(
            f"set is {purpose.value}", remedy=f"give {' or '.join(each.value for each in SETS)}"
        )
    return purpose


def _std_of(row: CsvRow) -> float:
    """Return the σ of a row; raise `ObservationsInvalid` without one."""
    if not row.text(STD):
        raise row.wrong(
            f"{STD} is empty: no σ is assumed",
            remedy="give 1 σ of a value by its instrument: 0.01 of a good touch probe, 0.03 of "
            "callipers",
        )
    std_mm: float = row.value(STD)
    if std_mm <= 0.0:
        raise row.wrong(f"{STD} is {std_mm:g}, must be above 0", remedy="give 1 σ of a value")
    return std_mm


def _lines_of(row: ObservationRow, mechanism: Mechanism) -> Iterator[dict[str, object]]:
    """Yield the values of an observation by column, a line a pose; its own values in the last."""
    names = columns.axis_columns(mechanism.joints)
    for place, joints in enumerate(row.joints, start=1):
        values = row.values if place == len(row.joints) else ()
        yield {
            KIND: row.kind,
            OBJECT: row.object,
            **dict(zip(names, joints, strict=True)),
            **dict(zip(KINDS[row.kind].columns, values, strict=bool(values))),
            STD: row.std_mm,
            STD_SOURCE: row.std_source,
            PAIR: row.pair,
            "set": "" if row.purpose is ShotSet.IDENTIFICATION else row.purpose.value,
            "time": row.time,
            SESSION: row.session or None,
        }
