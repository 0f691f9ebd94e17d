"""CSV files: one table of columns by which a file is read and written.

A `CsvForm` lists the columns that a kind of file may have; each column states how its text becomes
a value and back. A spreadsheet may have changed a file, or somebody else written it, so form is
read with patience and meaning strictly:

1. Separator, decimal sign, quotes, comments, a first column that counts the rows and empty columns
   at the end are recognised, as in files of points (`cells`). The header is the first line that
   names what is required, so that titles may stand above it, and a line of units below. One decimal
   sign counts for all numbers.
2. Headings are compared by their words: `q0_deg`, `Q0 [deg]`. Those that differ from each other by
   a number alone, such as J1, J2 and J3, stand for the form's numbered columns if they are as many.
3. Every row must be as long as the header, and every value be valid; what can be read in two ways
   is refused.

Numbers are written with the shortest decimals that give the same double, so
reading and writing again changes nothing. A text that begins like a formula is written with a `'`
before it: a spreadsheet that opens the file must not calculate what an operator typed. Spreadsheets
of countries with decimal commas open such a file as one column of texts: `spreadsheet_text` writes
it as they do, and as it is read here again.
"""

import csv
import io
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

from campaigns.errors import CampaignError
from campaigns.files.cells import (
    COMMENT,
    NUMBER,
    WITH_COMMA,
    DecimalSign,
    decimal_sign,
    is_number,
    point_text,
    possible_splits,
    split_line,
)
from campaigns.files.wording import shown, suggestion

_WHOLE_NUMBER = re.compile(r"\+?(\d{1,18})(?:\.0*)?", re.ASCII)
SIDES = {"0": 0, "1": 1, "+1": 1, "-1": -1}
_TEXT_OF_FORMULA = re.compile(r"'*[=+\-@\t\r]")
"""Beginning of a text that a spreadsheet would calculate, with any marks before it."""
BYTE_ORDER_MARK = "\ufeff"
"""Beginning by which spreadsheets recognise UTF-8; every reader of ours passes over it."""
MOST_LINES = 50_000
"""Largest number of lines that are read, more than twice what a campaign can plan."""
MOST_CHARACTERS = 100_000
"""Longest line that is read; a row of any instrument has a hundredth of it."""

UNIT_WORDS = {
    **dict.fromkeys(("degree", "degrees"), "deg"),
    **dict.fromkeys(("millimeter", "millimeters", "millimetre", "millimetres"), "mm"),
}
"""Units of columns by the words that other software has for them."""
_SEPARATOR_LINE = re.compile(r'"?sep=([;,\t]?)"?', re.I)
"""Line that states the separator for a spreadsheet."""
_NUMBERED = re.compile(r"(.*[^\W\d][\W]*)(\d{1,2})(\D*)")
"""Heading with a number behind a word: what stands before, the number, what stands behind."""


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
    match = _WHOLE_NUMBER.fullmatch(text)  # also 1.0, as programs write columns with empty cells
    return int(match[1]) if match else None


@dataclass(frozen=True, slots=True)
class CsvForm:
    """The columns that a file may have, in order, and the error that a wrong file raises."""

    columns: tuple[CsvColumn, ...]
    invalid: type[CampaignError]
    numbered: tuple[str, ...] = ()
    """Columns that other software numbers in its way, such as J1, J2, J3, in their order."""
    if_unclear: str = "write decimal points and separate the columns by commas"
    """Remedy for numbers with commas that may be read in two ways."""

    @property
    def names(self) -> set[str]:
        """Names of all columns."""
        return {column.name for column in self.columns}

    @property
    def required(self) -> list[str]:
        """Names of the columns that a file must have."""
        return [column.name for column in self.columns if column.required]

    def column(self, name: str) -> CsvColumn:
        """Return the column of a name."""
        return next(column for column in self.columns if column.name == name)

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
class HeaderPlace:
    """Separator of a text's columns, and the number of lines above those that it names."""

    separator: str
    above: int


@dataclass(frozen=True, slots=True)
class CsvRow:
    """Line with its number and its texts by column. A column that the file lacks is empty."""

    where: str
    texts: Mapping[str, str]
    form: CsvForm
    decimal: DecimalSign | None = None
    """Decimal sign of the file's numbers; None: a point."""

    def text(self, column: str) -> str:
        """Return the text of a column; empty if the row has none."""
        return self.texts.get(column, "")

    def value(self, name: str) -> Any:
        """Return the value of a column; raise `invalid` if its text is not valid.

        Any: columns hold numbers and texts.
        """
        text, column = self.text(name), self.form.column(name)
        for notation in (text, point_text(text, self.decimal)):
            if notation is not None and (value := column.read(notation)) is not None:
                return value
        if not text:
            word = "empty" if name in self.texts else "missing"
            raise self.wrong(f"{name} is {word}", remedy=f"give {column.wanted}")
        if WITH_COMMA.fullmatch(text):
            problem = f"{name} is '{shown(text)}', a decimal comma"
            raise self.wrong(problem, remedy=self.form.if_unclear)
        raise self.wrong(
            f"{name} is '{shown(text)}', must be {column.wanted}", remedy="correct the value"
        )

    def notation(self, name: str) -> str:
        """Return the text of a column, with a decimal point if it is a number."""
        text = self.text(name)
        return point_text(text, self.decimal) or text

    def values(self, names: Iterable[str]) -> tuple[Any, ...]:
        """Return the values of several columns; raise `invalid` as `value` does."""
        return tuple(map(self.value, names))

    def wrong(self, problem: str, *, remedy: str) -> CampaignError:
        """Return the error of this file's kind, with the line before the problem."""
        return self.form.invalid(f"{self.where}: {problem}", remedy=remedy)


def parse_csv(
    text: str, name: str, form: CsvForm, decimal: DecimalSign | None = None
) -> Iterator[CsvRow]:
    """Yield the rows of a file whose first line names its columns; raise `form.invalid`.

    `decimal` is the sign of its numbers; None: as the numbers show.
    """
    check_lines(text, name, form.invalid)
    place = _header_place(text, form)
    _check_above(text, name, place, form)
    lines = [*_filled_lines(text, name, place, form)]
    where, cells = lines[0] if lines else (f"{name}:1", [])
    header = _columns(cells, form)
    rows = [(row, _as_long(values, header)) for row, values in lines[1:] if values != cells]
    rows = [row for row in rows if not _is_comment(row[1], header, form)]
    header = _without_index(header, [values[0] for _, values in rows], form)
    _check_header(header, where, form)
    if rows and _states_units(rows[0][1], header):
        del rows[0]
    numbers = [place for place, heading in enumerate(header) if _is_of_numbers(heading, form)]
    decimal = decimal or decimal_sign(v[i] for _, v in rows for i in numbers if i < len(v))
    for where, values in rows:
        if len(values) != len(header):
            raise _length_error(values, header, where, form)
        texts = dict(zip(header, map(_unmark, values), strict=True))
        yield CsvRow(where, texts, form, decimal)


def column_names(text: str, form: CsvForm) -> list[str]:
    """Return the columns that a text's header names, unknown headings as they stand."""
    for _, cells in _filled_lines(text, "", _header_place(text, form), form):
        return _columns(cells, form)
    return []


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


def spreadsheet_text(text: str) -> str:
    """Return a file's text from `csv_text` as spreadsheets with decimal commas open it.

    Columns are separated by semicolons, numbers have commas, and a mark states that it is UTF-8.
    """
    rows = csv.reader(io.StringIO(text, newline=""))
    stream = io.StringIO()
    writer = csv.writer(stream, delimiter=";", lineterminator="\n")
    writer.writerows([_with_comma(value) for value in row] for row in rows)
    return BYTE_ORDER_MARK + stream.getvalue()


def _with_comma(text: str) -> str:
    return text.replace(".", ",") if NUMBER.fullmatch(text) else text


def _header_place(text: str, form: CsvForm) -> HeaderPlace:
    """Return where the header is: the first line that names all columns which the form requires.

    Without any it is the line with most of the columns, or else the first that is no comment. A
    comment is the header only if all its headings are columns.
    """
    stated: str | None = None
    best: HeaderPlace | None = None
    most = above = 0
    for line in io.StringIO(text[:MOST_CHARACTERS], newline=None):  # more are no titles
        if match := _SEPARATOR_LINE.fullmatch(line.strip()):
            stated = match[1]
        elif line.strip():
            is_comment = bool(COMMENT.match(line))
            for separator, columns in _possible_columns(line, form, stated).items():
                count = len(columns & form.names)
                is_whole = columns >= {*form.required} and count > 1
                if is_whole and (not is_comment or columns <= form.names):
                    return HeaderPlace(separator, above)
                if not is_comment and (best is None or count > most):
                    best = HeaderPlace(separator if count > 1 else stated or ",", above)
                    most = max(count, 1)
        above += 1
    return best or HeaderPlace(",", above)


def _possible_columns(line: str, form: CsvForm, stated: str | None) -> dict[str, set[str]]:
    """Return the columns that a line names by each separator, or by the one that is stated."""
    return {
        separator: {*_columns([*cells], form)}
        for separator, cells in possible_splits(_uncommented(line))
        if stated in {None, separator}
    }


def _check_above(text: str, name: str, place: HeaderPlace, form: CsvForm) -> None:
    """Raise the form's error for a line above the header that reads as a row of the table."""
    needed = sum(_is_of_numbers(column, form) for column in form.required)
    for number, line in enumerate(islice(io.StringIO(text, newline=None), place.above), start=1):
        count = sum(map(is_number, split_line(line, place.separator)))
        if count >= needed > 0 and not COMMENT.match(line):
            raise form.invalid(
                f"{name}:{number}: reads as a row above the line that names the columns",
                remedy="put that line first",
            )


def _filled_lines(
    text: str, name: str, place: HeaderPlace, form: CsvForm
) -> Iterator[tuple[str, list[str]]]:
    """Yield each line that is not empty as its place and its values, from the header on."""
    # a quoted value may hold line breaks: a row begins after the last line of the row before
    lines: Iterable[str] = islice(io.StringIO(text, newline=""), place.above, None)
    if not place.separator:
        lines = (f"{' '.join(line.split())}\n" for line in lines)
    reader = csv.reader(lines, delimiter=place.separator or " ", strict=True, skipinitialspace=True)
    line, is_header = place.above + 1, True
    try:
        for values in reader:
            texts = [_one_line(value) for value in values]
            if any(texts):
                if is_header:  # which may be a comment
                    texts[0], is_header = _uncommented(texts[0]), False
                yield f"{name}:{line}", texts
            line = place.above + reader.line_num + 1
    except csv.Error as error:
        raise form.invalid(
            f"{name}:{line}: is not CSV ({error})", remedy="correct the line's quotes"
        ) from error


def _is_comment(values: Sequence[str], header: Sequence[str], form: CsvForm) -> bool:
    """Return whether a line is a comment: of a whole row, one whose first text is no name."""
    mark = COMMENT.match(values[0])
    if mark is None:
        return False
    may_be_name = not _is_of_numbers(header[0], form) and len(values) == len(header)
    return not may_be_name or values[0][mark.end() :].startswith(" ")


def _without_index(header: list[str], cells: Sequence[str], form: CsvForm) -> list[str]:
    """Return the columns without the heading of a first one that counts the rows from 0 or 1."""
    counts = [f"{number}" for number in range(len(cells) + 1)]
    if not cells or header[0] in form.names or [*cells] not in (counts[:-1], counts[1:]):
        return header
    return _columns(["", *header[1:]], form)


def _states_units(values: Sequence[str], header: Sequence[str]) -> bool:
    """Return whether a line under the header states nothing but units of its columns."""
    words = map(_words, values)
    pairs = [*zip(header, words, strict=False)]
    has_digit = any(map(str.isdigit, "".join(values)))
    return not has_digit and all(not word or name.endswith(f"_{word}") for name, word in pairs)


def _uncommented(text: str) -> str:
    return COMMENT.sub("", text, count=1).strip()


def _columns(header: Sequence[str], form: CsvForm) -> list[str]:
    """Return the column that each heading names, without empty ones at the end."""
    # 1. By its words, whatever their case and what stands between them.
    by_words = {_words(column.name): column.name for column in form.columns}
    names = [by_words.get(_words(heading), heading) for heading in header]
    while len(names) > 1 and not names[-1]:
        names.pop()
    # 2. By number, if not all of the numbered columns are there.
    if not {*form.numbered} <= {*names}:
        others = {*by_words.values()} - {*form.numbered}
        by_number = _by_number([name for name in names if name not in others], form.numbered)
        names = [by_number.get(name, name) for name in names]
    # 3. A table's index has no heading; of rows with names it is the name.
    if names and not names[0] and "name" in by_words.values() and "name" not in names:
        names[0] = "name"
    return names


def _words(heading: str) -> str:
    text = heading.lower().replace("°c", " degc ").replace("°", " deg ")
    words = re.findall(r"[^\W_]+", text)
    return "_".join(UNIT_WORDS.get(word, word) for word in words)


def _by_number(headings: Iterable[str], numbered: Sequence[str]) -> dict[str, str]:
    """Return the numbered columns by headings that are alike but for a number, as J1, J2, J3.

    None if they are not as many, not numbered in a row, or state another unit.
    """
    sets: dict[tuple[str, str], dict[int, str]] = {}
    for heading in headings:
        if match := _NUMBERED.fullmatch(heading):
            sets.setdefault((match[1], match[3]), {})[int(match[2])] = heading
    alike = [
        [of_number[number] for number in sorted(of_number)]
        for (_, behind), of_number in sets.items()
        if len(of_number) == len(numbered) == max(of_number) - min(of_number) + 1
        and all({*_words(behind).split("_")} <= {"", *name.split("_")} for name in numbered)
    ]
    return dict(zip(alike[0], numbered, strict=True)) if len(alike) == 1 else {}


def _is_of_numbers(column: str, form: CsvForm) -> bool:
    return any(column == other.name and other.read is not str for other in form.columns)


def _as_long(values: list[str], header: Sequence[str]) -> list[str]:
    """Return the values of a row without empty ones behind the last column."""
    spare = values[len(header) :]
    return values if any(spare) else values[: len(header)]


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
    if any(map(is_number, header)):
        texts = [c.name for c in form.columns if c.read is str and not c.required]
        names = [*texts[: max(len(header) - len(form.required), 0)], *form.required]
        raise form.invalid(
            f"{where}: there is no header, the first line holds numbers",
            remedy=f"write {','.join(names)} above it",
        )
    names = [column.name for column in form.columns]
    for place, column in enumerate(header):
        if not column and place > 0:
            raise form.invalid(
                f"{where}: column {place + 1} has no name", remedy="name it, or take it out"
            )
        if column and column not in names:
            raise _unknown_column(column, header, where, form)
        if column and header.count(column) > 1:
            raise form.invalid(f"{where}: column {column} stands twice", remedy="keep one")
    for column in form.required:
        if column not in header:
            raise form.invalid(f"{where}: column {column} is missing", remedy=remedy)


def _unknown_column(column: str, header: Sequence[str], where: str, form: CsvForm) -> CampaignError:
    absent = [c.name for c in form.columns if c.name not in header]
    remedy = suggestion(column, absent)
    number = _NUMBERED.fullmatch(column)
    if number and int(number[2]) == len(form.numbered):
        remedy = f"the joints are counted from 0 here: {', '.join(form.numbered)}"
    return form.invalid(f"{where}: unknown column '{shown(column)}'", remedy=remedy)


def _length_error(values: list[str], header: list[str], where: str, form: CsvForm) -> CampaignError:
    problem = f"{where}: {len(values)} values for {len(header)} columns"
    if len(values) > len(header):
        return form.invalid(
            f"{problem}: perhaps decimal commas",
            remedy="write decimal points, or separate the columns by semicolons",
        )
    return form.invalid(problem, remedy="give every column a value, or leave its place empty")
