"""CSV files: numbers as text, rows by the columns that a header names, written and read."""

import csv
import io
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from campaigns.errors import CampaignError
from campaigns.files.wording import shown, suggestion

ANGLE_DECIMALS = 12
"""Decimals of a degree: far below what any encoder tells, far above what converting to rad and back
loses. So a file that was read and written again is the same file."""
NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)
"""Matches in a time that grows with the text's length, not with its square."""
SIGNS_OF_NUMBERS = b"+-.0123456789Ee"
"""Of these alone Python makes no number that `NUMBER` does not match."""
_WHOLE_NUMBER = re.compile(r"[+-]?\d+", re.ASCII)
WITH_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?", re.ASCII)
_TEXT_OF_FORMULA = re.compile(r"'*[=+\-@\t\r]")
"""Beginning of a text that a spreadsheet would calculate, or of one that was marked as text."""
_MARK = "'"
MOST_LINES = 50_000
"""Of a file, so that it is refused within a second: more than twice what a campaign can plan."""
_DIGITS_MAX = 18
"""A longer whole number is no number of a shot or pair."""

_POINT_REMEDY = "write decimal points and separate the columns by commas"


def number_text(value: float) -> str:
    """Write the shortest decimals that give the double again."""
    return repr(float(value) + 0.0)  # -0.0 becomes 0.0


def fixed_text(value: float, decimals: int) -> str:
    """Write so many decimals, as controllers read them."""
    return f"{round(float(value), decimals) + 0.0:.{decimals}f}"  # -0.0 becomes 0.0


def angle_text(angle_rad: float) -> str:
    """Write an angle in deg, to `ANGLE_DECIMALS`."""
    return number_text(round(math.degrees(angle_rad), ANGLE_DECIMALS))


@dataclass(frozen=True, slots=True)
class CsvForm:
    """The columns that a file must and may have, and the error that a wrong file raises."""

    required: tuple[str, ...]
    optional: tuple[str, ...]
    invalid: type[CampaignError]

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns, all of them, in order."""
        return (*self.required, *self.optional)


@dataclass(frozen=True, slots=True)
class CsvRow:
    """Line with its number and its texts by column. A column that the file lacks is empty."""

    where: str
    texts: Mapping[str, str]
    form: CsvForm

    def text(self, column: str) -> str:
        """Return what stands there; empty when nothing does."""
        return self.texts.get(column, "")

    def number(self, column: str) -> float:
        """Read a finite number."""
        text = self.texts.get(column, "")
        if NUMBER.fullmatch(text) and math.isfinite(value := float(text)):
            return value
        raise self._not_a_number(column, "a number")

    def whole_number(self, column: str) -> int:
        """Read a whole number, not negative."""
        text = self.text(column)
        if _WHOLE_NUMBER.fullmatch(text) and len(text) <= _DIGITS_MAX and int(text) >= 0:
            return int(text)
        raise self._not_a_number(column, "a whole number from 0")

    def wrong(self, problem: str, *, remedy: str) -> CampaignError:
        """Return the error of this file's kind, with the line before the problem."""
        return self.form.invalid(f"{self.where}: {problem}", remedy=remedy)

    def _not_a_number(self, column: str, wanted: str) -> CampaignError:
        text = shown(self.text(column))
        if not text:
            return self.wrong(f"{column} is empty", remedy=f"give {wanted}")
        if WITH_COMMA.fullmatch(text):
            return self.wrong(f"{column} is '{text}', a decimal comma", remedy=_POINT_REMEDY)
        return self.wrong(f"{column} is '{text}', must be {wanted}", remedy="correct the value")


def numbers_of(texts: Sequence[str]) -> list[float]:
    """Finite numbers of many texts, as `CsvRow.number` reads each; [] where any is none."""
    if "".join(texts).encode(errors="replace").translate(None, SIGNS_OF_NUMBERS):
        return []
    try:
        values = [*map(float, texts)]
    except ValueError:
        return []
    return values if all(map(math.isfinite, values)) else []


def parse_csv(text: str, name: str, form: CsvForm) -> Iterator[CsvRow]:
    """Yield the rows of a file whose first line names its columns; raises `form.invalid`."""
    check_lines(text, name, form.invalid)
    lines, is_marked = _filled_lines(text, name, form.invalid), _MARK in text
    where, header = next(lines, (f"{name}:1", []))
    _check_header(header, where, form)
    for where, values in lines:
        if len(values) != len(header):
            raise _wrong_length(values, header, where, form.invalid)
        texts = map(_unmarked, values) if is_marked else values
        yield CsvRow(where, dict(zip(header, texts, strict=True)), form)


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
    writer.writerows(
        [
            # most are words or numbers, which stay as they are
            value if value.isalnum() or NUMBER.fullmatch(value) else _marked(_one_line(value))
            for value in row
        ]
        for row in rows
    )
    return stream.getvalue()


def _filled_lines(
    text: str, name: str, invalid: type[CampaignError]
) -> Iterator[tuple[str, list[str]]]:
    """Yield each line that is not empty as its place and its values."""
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    line = 1
    try:
        for values in reader:
            texts = [value.strip() for value in values]
            if not (whole := "".join(texts)).isprintable():
                texts = [_one_line(value) for value in values]
            if whole:
                yield f"{name}:{line}", texts
            line = reader.line_num + 1
    except csv.Error as error:
        raise invalid(
            f"{name}:{line}: is not CSV ({error})", remedy="correct the line's quotes"
        ) from error


def _marked(text: str) -> str:
    is_text = _TEXT_OF_FORMULA.match(text) and not NUMBER.fullmatch(text)
    return f"{_MARK}{text}" if is_text else text


def _unmarked(text: str) -> str:
    if not text.startswith(_MARK):
        return text
    bare = text.removeprefix(_MARK)
    return bare if _TEXT_OF_FORMULA.match(text) and not NUMBER.fullmatch(bare) else text


def _one_line(text: str) -> str:
    text = text.strip()
    return text if text.isprintable() else " ".join(text.splitlines())


def _check_header(header: list[str], where: str, form: CsvForm) -> None:
    if not header:
        raise form.invalid(f"{where}: the file is empty", remedy=_header_remedy(form))
    _check_separator(header, where, form.invalid)
    for column in header:
        if not column:
            place = header.index("") + 1
            raise form.invalid(
                f"{where}: column {place} has no name", remedy="name it, or take it out"
            )
        if column not in form.columns:
            absent = [each for each in form.columns if each not in header]
            raise form.invalid(
                f"{where}: unknown column '{shown(column)}'", remedy=suggestion(column, absent)
            )
        if header.count(column) > 1:
            raise form.invalid(f"{where}: column {column} stands twice", remedy="keep one")
    for column in form.required:
        if column not in header:
            raise form.invalid(f"{where}: column {column} is missing", remedy=_header_remedy(form))


def _header_remedy(form: CsvForm) -> str:
    return f"the first line must name {','.join(form.required)}"


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
