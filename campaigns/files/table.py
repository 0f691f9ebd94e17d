"""Tables: head and cell of every column in one place, for the terminal, for CSV and for pages.

A table is a tuple of columns; its rows are values of any class, from which each column takes its
cell. So terminal and page cannot show different figures, and a program that reads the CSV gets the
unrounded number under the head that people see.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from html import escape
from importlib import import_module
from operator import itemgetter
from typing import Any, Generic, Literal, TypeVar

from campaigns.files.csv_file import csv_text, number_text

T = TypeVar("T")
Kind = Literal["number", "words", "code"]
Cell = str | float | None
Row = tuple[str, ...]
"""Texts of a row, one a column."""

NOTHING = "–"
"""Cell of a row that has no value there."""


@dataclass(frozen=True, slots=True)
class Column(Generic[T]):
    """Head of a column, its unit, and its cell in a row: a text, a number, or None for neither.

    Numbers are set to the right, words and code to the left.
    """

    head: str
    of: Callable[[T], Cell]
    unit: str = ""
    decimals: int | Callable[[T], int] = 3
    """Decimals of a number, for all rows or by the row."""
    signed: bool = False
    kind: Kind = "number"

    def text(self, row: T) -> str:
        """Return the cell as people read it: rounded, with a true minus sign."""
        cell = self.of(row)
        if isinstance(cell, str | int):  # a count has no decimals
            return str(cell)
        decimals = self.decimals if isinstance(self.decimals, int) else self.decimals(row)
        return number(cell, decimals, signed=self.signed)

    def csv(self, row: T) -> str:
        """Return the cell as programs read it: the shortest decimals of the same double."""
        cell = self.of(row)
        if cell is None:
            return ""
        return str(cell) if isinstance(cell, str | int) else number_text(cell)


def words(head: str, of: Callable[[T], str]) -> Column[T]:
    """Return a column of words."""
    return Column(head, of, kind="words")


def by_place(*heads: str) -> tuple[Column[Row], ...]:
    """Return columns for rows of texts, by their place in the row."""
    return tuple(words(head, itemgetter(place)) for place, head in enumerate(heads))


def texts(columns: Sequence[Column[T]], rows: Iterable[T]) -> tuple[Row, ...]:
    """Return the texts of rows as people read them."""
    return tuple(tuple(column.text(row) for column in columns) for row in rows)


def csv_table(columns: Sequence[Column[T]], rows: Iterable[T]) -> str:
    """Return rows as a CSV file's text, below the columns' heads."""
    heads = [column.head for column in columns]
    return csv_text(heads, ([column.csv(row) for column in columns] for row in rows))


def html_table(title: str, columns: Sequence[Column[T]], rows: Iterable[T]) -> str:
    """Return rows as a table for notebooks, below their title; every text is escaped."""
    head = "".join(
        f"<th>{escape(f'{c.head}, {c.unit}' if c.unit else c.head)}</th>" for c in columns
    )
    lines = "".join(
        "<tr>" + "".join(f"<td>{escape(text)}</td>" for text in row) + "</tr>"
        for row in texts(columns, rows)
    )
    return (
        f"<p>{escape(title)}</p><table><thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table>"
    )


def find_pandas() -> Any:
    """Return the module pandas; raise `ImportError` with a remedy without it.

    Any: pandas is not among our dependencies.
    """
    try:
        return import_module("pandas")
    except ModuleNotFoundError as error:
        if error.name != "pandas":  # it is installed, and lacks a part of its own
            raise
        raise ImportError(
            "a DataFrame needs pandas, which is not installed → pip install pandas, or install "
            "pkmcal with its extra: pip install '.[pandas]'",
            name="pandas",
        ) from error


def number(value: float | None, decimals: int = 3, *, signed: bool = False) -> str:
    """Write a number with a true minus sign; a dash for None."""
    if value is None:
        return NOTHING
    rounded = round(value, decimals) or 0.0  # a number that rounds to 0 has no sign
    text = f"{rounded:{'+' if signed and rounded else ''}.{decimals}f}"
    return text.replace("-", "−")


def decimals_by(std: float | None, otherwise: int = 4) -> int:
    """Return the decimals by which a standard deviation has two digits (GUM 7.2.6).

    `otherwise` are those of a value without σ, or with a σ of 0.
    """
    if not std or not math.isfinite(std):
        return otherwise
    return max(1 - math.floor(math.log10(float(f"{abs(std):.1e}"))), 0)


def two_digits(std: float) -> str:
    """Write a standard deviation in two digits, without an exponent."""
    return number(std, decimals_by(std))
