"""CSV files: one table of columns by which a file is read and written.

A `CsvForm` lists the columns that a kind of file may have; each column states how its text becomes
a value and back. Reading is strict, because a spreadsheet may have changed the file: the header
must name the columns, every row must be as long as the header, a number must be written with a
decimal point. What else people write (semicolons, tabs, decimal commas) is recognized only to say
so in the error. Numbers are written with the shortest decimals that give the same double, so
reading and writing again changes nothing. A text that begins like a formula is written with a `'`
before it: a spreadsheet that opens the file must not calculate what an operator typed.
"""

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
"""Number as files hold it; matched in a time that grows with the text's length, not its square."""
_WHOLE_NUMBER = re.compile(r"\+?\d{1,18}", re.ASCII)
WITH_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?", re.ASCII)
SIDES = {"0": 0, "1": 1, "+1": 1, "-1": -1}
_TEXT_OF_FORMULA = re.compile(r"'*[=+\-@\t\r]")
"""Beginning of a text that a spreadsheet would calculate, with any marks before it."""
MOST_LINES = 50_000
"""Largest number of lines that are read, more than twice what a campaign can plan."""
MOST_CHARACTERS = 100_000
"""Longest line that is read; a row of any instrument has a hundredth of it."""

_POINT_REMEDY = "write decimal points and separate the columns by commas"


def number_text(value: float) -> str:
    """Write the shortest decimals that give the same double when they are read."""
    return repr(float(value) + 0.0)  # -0.0 becomes 0.0


def fixed_text(value: float, decimals: int) -> str:
    """Write a fixed number of decimals, as controllers read them."""
    return f"{round(float(value), decimals) + 0.0:.{decimals}f}"  # -0.0 becomes 0.0


def angle_text(angle_rad: float) -> str:
    """Write an angle in deg, with at most 12 decimals."""
    # Converting to rad and back changes the last digits of a double. Twelve decimals are coarser
    # than this change, so a file that is read and written again stays equal; and they are finer
    # than any encoder.
    return number_text(round(math.degrees(angle_rad), 12))


@dataclass(frozen=True, slots=True)
class CsvColumn:
    """Column of a file: how its values are read and written, and whether the file must have it."""

    name: str
    required: bool = False
    wanted: str = ""
    """Condition that a value must meet, in words."""
    # Any: columns hold numbers and texts
    read: Callable[[str], Any] = str
    """Converts a text to its value; gives None for a text that is not valid."""
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
        """Return the text of a column; empty if the row has none."""
        return self.texts.get(column, "")

    def value(self, name: str) -> Any:
        """Return the value of a column; raise `invalid` if its text is not valid.

        Any: columns hold numbers and texts.
        """
        text, column = self.text(name), self.columns[name]
        if (value := column.read(text)) is not None:
            return value
        if not text:
            word = "empty" if name in self.texts else "missing"
            raise self.wrong(f"{name} is {word}", remedy=f"give {column.wanted}")
        if WITH_COMMA.fullmatch(text):
            raise self.wrong(f"{name} is '{shown(text)}', a decimal comma", remedy=_POINT_REMEDY)
        raise self.wrong(
            f"{name} is '{shown(text)}', must be {column.wanted}", remedy="correct the value"
        )

    def values(self, names: Iterable[str]) -> tuple[Any, ...]:
        """Return the values of several columns; raise `invalid` as `value` does."""
        return tuple(map(self.value, names))

    def wrong(self, problem: str, *, remedy: str) -> CampaignError:
        """Return the error of this file's kind, with the line before the problem."""
        return self.invalid(f"{self.where}: {problem}", remedy=remedy)


def parse_csv(text: str, name: str, form: CsvForm) -> Iterator[CsvRow]:
    """Yield the rows of a file whose first line names its columns; raise `form.invalid`."""
    check_lines(text, name, form.invalid)
    lines = _filled_lines(text, name, form.invalid)
    columns = {column.name: column for column in form.columns}
    where, header = next(lines, (f"{name}:1", []))
    _check_header(header, where, form)
    for where, values in lines:
        if len(values) != len(header):
            raise _length_error(values, header, where, form.invalid)
        texts = dict(zip(header, map(_unmark, values), strict=True))
        yield CsvRow(where, texts, columns, form.invalid)


def check_lines(text: str, name: str, invalid: type[CampaignError]) -> None:
    """Raise `invalid`, before a line is read, for a text with too many or too long lines."""
    if max(text.count("\n"), text.count("\r")) > MOST_LINES:
        raise invalid(
            f"{name}: has more than {MOST_LINES} lines, the most that are read",
            remedy="check that it is the right file",
        )
    for number, line in enumerate(io.StringIO(text, newline=None), start=1):
        if len(line) > MOST_CHARACTERS:
            raise invalid(
                f"{name}:{number}: has {len(line)} characters, more than the {MOST_CHARACTERS} of "
                "the longest line that is read",
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
    writer.writerows([_mark(_one_line(value)) for value in row] for row in rows)
    return stream.getvalue()


def _filled_lines(
    text: str, name: str, invalid: type[CampaignError]
) -> Iterator[tuple[str, list[str]]]:
    """Yield each line that is not empty as its place and its values."""
    # a quoted value may hold line breaks: a row begins after the last line of the row before
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


# The mark must come off again without fail, also from a text that began with `'` before it was
# marked. So a text of any number of `'` before a formula's sign is marked, and one `'` is taken off
# exactly such a text. A negative number begins like a formula, but is one to calculate with.
def _mark(text: str) -> str:
    is_text = _TEXT_OF_FORMULA.match(text) and not NUMBER.fullmatch(text)
    return f"'{text}" if is_text else text


def _unmark(text: str) -> str:
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


def _length_error(
    values: list[str], header: list[str], where: str, invalid: type[CampaignError]
) -> CampaignError:
    problem = f"{where}: {len(values)} values for {len(header)} columns"
    if len(values) > len(header):
        return invalid(f"{problem}: perhaps decimal commas", remedy=_POINT_REMEDY)
    return invalid(problem, remedy="give every column a value, or leave its place empty")
