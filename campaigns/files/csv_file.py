"""CSV files: one table of columns by which a file is read and written."""

import csv
import io
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from campaigns.errors import CampaignError
from campaigns.files.wording import shown, suggestion

NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)
"""Matches in a time that grows with the text's length, not with its square."""
_WHOLE_NUMBER = re.compile(r"\+?\d{1,18}", re.ASCII)
WITH_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?", re.ASCII)
SIDES = {"0": 0, "1": 1, "+1": 1, "-1": -1}
_TEXT_OF_FORMULA = re.compile(r"'*[=+\-@\t\r]")
"""Beginning of a text that a spreadsheet would calculate, or of one that was marked as text."""
MOST_LINES = 50_000
"""Of a file, so that it is refused within a second: more than twice what a campaign can plan."""

_POINT_REMEDY = "write decimal points and separate the columns by commas"


def number_text(value: float) -> str:
    """Write the shortest decimals that give the double again."""
    return repr(float(value) + 0.0)  # -0.0 becomes 0.0


def fixed_text(value: float, decimals: int) -> str:
    """Write so many decimals, as controllers read them."""
    return f"{round(float(value), decimals) + 0.0:.{decimals}f}"  # -0.0 becomes 0.0


def angle_text(angle_rad: float) -> str:
    """Write an angle in deg.

    Its 12 decimals are fewer than converting to rad and back loses, and more than any encoder has:
    a file that was read and written again is the same file.
    """
    return number_text(round(math.degrees(angle_rad), 12))


@dataclass(frozen=True, slots=True)
class CsvColumn:
    """Column of a file: how its values are read and written, and whether the file must have it."""

    name: str
    required: bool = False
    wanted: str = ""
    """What a value must be, in words."""
    # Any: columns hold numbers and texts
    read: Callable[[str], Any] = str
    """Makes the value of a text; None if the text is no such value."""
    write: Callable[[Any], str] = str


def number_column(name: str, *, required: bool = False) -> CsvColumn:
    """Return a column of finite numbers."""
    return CsvColumn(name, required, "a number", _finite, number_text)


def angle_column(name: str, *, required: bool = False) -> CsvColumn:
    """Return a column of angles, in degrees in the file and in rad outside of it."""
    return CsvColumn(name, required, "a number within ±360", _angle_rad, angle_text)


def whole_column(name: str, *, required: bool = False) -> CsvColumn:
    """Return a column of whole numbers."""
    return CsvColumn(name, required, "a whole number from 0", _whole)


def side_column(name: str) -> CsvColumn:
    """Return a column of the sides from which a joint came."""
    wanted = "1, -1 or 0: the joint last moved to larger values, to smaller, or it is not known"
    return CsvColumn(name, False, wanted, SIDES.get)  # noqa: FBT003 - not required


def _finite(text: str) -> float | None:
    if NUMBER.fullmatch(text) and math.isfinite(value := float(text)):
        return value
    return None


def _angle_rad(text: str) -> float | None:
    value = _finite(text)
    return None if value is None or abs(value) > 360.0 else math.radians(value)


def _whole(text: str) -> int | None:
    return int(text) if _WHOLE_NUMBER.fullmatch(text) else None


@dataclass(frozen=True, slots=True)
class CsvForm:
    """The columns that a file may have, in order, and the error that a wrong file raises."""

    columns: tuple[CsvColumn, ...]
    invalid: type[CampaignError]

    @property
    def required(self) -> list[str]:
        """Names of the columns that a file must have."""
        return [column.name for column in self.columns if column.required]

    def text(self, rows: Sequence[Mapping[str, object]]) -> str:
        """Write values by column, None or "" where there is none.

        An optional column without any value is left out.
        """
        columns = [
            column
            for column in self.columns
            if column.required or any(row.get(column.name) not in (None, "") for row in rows)
        ]
        texts = [
            ["" if (value := row.get(c.name)) is None else c.write(value) for c in columns]
            for row in rows
        ]
        return csv_text([column.name for column in columns], texts)


@dataclass(frozen=True, slots=True)
class CsvRow:
    """Line with its number and its texts by column. A column that the file lacks is empty."""

    where: str
    texts: Mapping[str, str]
    columns: Mapping[str, CsvColumn]
    invalid: type[CampaignError]

    def text(self, column: str) -> str:
        """Return what stands there; empty when nothing does."""
        return self.texts.get(column, "")

    def value(self, name: str) -> Any:
        """Read the value of a column as its kind is; raises for any other text.

        Any: columns hold numbers and texts.
        """
        text, column = self.text(name), self.columns[name]
        if (value := column.read(text)) is not None:
            return value
        if not text:
            raise self.wrong(f"{name} is empty", remedy=f"give {column.wanted}")
        if WITH_COMMA.fullmatch(text):
            raise self.wrong(f"{name} is '{shown(text)}', a decimal comma", remedy=_POINT_REMEDY)
        raise self.wrong(
            f"{name} is '{shown(text)}', must be {column.wanted}", remedy="correct the value"
        )

    def values(self, names: Iterable[str]) -> tuple[Any, ...]:
        """Read the values of some columns."""
        return tuple(map(self.value, names))

    def wrong(self, problem: str, *, remedy: str) -> CampaignError:
        """Return the error of this file's kind, with the line before the problem."""
        return self.invalid(f"{self.where}: {problem}", remedy=remedy)


def parse_csv(text: str, name: str, form: CsvForm) -> Iterator[CsvRow]:
    """Yield the rows of a file whose first line names its columns; raises `form.invalid`."""
    check_lines(text, name, form.invalid)
    lines = _filled_lines(text, name, form.invalid)
    columns = {column.name: column for column in form.columns}
    where, header = next(lines, (f"{name}:1", []))
    _check_header(header, where, form)
    for where, values in lines:
        if len(values) != len(header):
            raise _wrong_length(values, header, where, form.invalid)
        texts = dict(zip(header, map(_unmarked, values), strict=True))
        yield CsvRow(where, texts, columns, form.invalid)


def check_lines(text: str, name: str, invalid: type[CampaignError]) -> None:
    """Raise `invalid`, before a line is read, for more than could be of such a file."""
    if max(text.count("\n"), text.count("\r")) > MOST_LINES:
        raise invalid(
            f"{name}: has more than {MOST_LINES} lines, the most that are read",
            remedy="check that it is the right file",
        )


def csv_text(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Write a header and rows as a file's text, each row on one line.

    A text that a spreadsheet would take for a formula gets a `'` before it, which `parse_csv`
    takes away again; numbers stay as they are.
    """
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([_marked(_one_line(value)) for value in row] for row in rows)
    return stream.getvalue()


def _filled_lines(
    text: str, name: str, invalid: type[CampaignError]
) -> Iterator[tuple[str, list[str]]]:
    """Yield each line that is not empty as its place and its values."""
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    line = 1
    try:
        for values in reader:
            texts = [_one_line(value) for value in values]
            if any(texts):
                yield f"{name}:{line}", texts
            line = reader.line_num + 1
    except csv.Error as error:
        raise invalid(
            f"{name}:{line}: is not CSV ({error})", remedy="correct the line's quotes"
        ) from error


def _marked(text: str) -> str:
    is_text = _TEXT_OF_FORMULA.match(text) and not NUMBER.fullmatch(text)
    return f"'{text}" if is_text else text


def _unmarked(text: str) -> str:
    if not text.startswith("'"):
        return text
    bare = text.removeprefix("'")
    return bare if _TEXT_OF_FORMULA.match(text) and not NUMBER.fullmatch(bare) else text


def _one_line(text: str) -> str:
    text = text.strip()
    return text if text.isprintable() else " ".join(text.splitlines())


def _check_header(header: list[str], where: str, form: CsvForm) -> None:
    remedy = f"the first line must name {','.join(form.required)}"
    if not header:
        raise form.invalid(f"{where}: the file is empty", remedy=remedy)
    _check_separator(header, where, form.invalid)
    names = [column.name for column in form.columns]
    for column in header:
        if not column:
            place = header.index("") + 1
            raise form.invalid(
                f"{where}: column {place} has no name", remedy="name it, or take it out"
            )
        if column not in names:
            absent = [name for name in names if name not in header]
            raise form.invalid(
                f"{where}: unknown column '{shown(column)}'", remedy=suggestion(column, absent)
            )
        if header.count(column) > 1:
            raise form.invalid(f"{where}: column {column} stands twice", remedy="keep one")
    for column in form.required:
        if column not in header:
            raise form.invalid(f"{where}: column {column} is missing", remedy=remedy)


def _check_separator(header: list[str], where: str, invalid: type[CampaignError]) -> None:
    for separator, name in ((";", "semicolons"), ("\t", "tabs")):
        if separator in header[0]:
            raise invalid(f"{where}: the columns are separated by {name}", remedy=_POINT_REMEDY)


def _wrong_length(
    values: list[str], header: list[str], where: str, invalid: type[CampaignError]
) -> CampaignError:
    problem = f"{where}: {len(values)} values for {len(header)} columns"
    if len(values) > len(header):
        return invalid(f"{problem}: perhaps decimal commas", remedy=_POINT_REMEDY)
    return invalid(problem, remedy="give every column a value, or leave its place empty")
