"""Parts of a page, and numbers as they are written on it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from campaigns.files.table import NOTHING, Row, number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Tone = Literal["text", "missing", "note"]


@dataclass(frozen=True, slots=True)
class Paragraph:
    """Sentence or two; `missing` says what is not there and what would bring it."""

    text: str
    tone: Tone = "text"


@dataclass(frozen=True, slots=True)
class Column:
    """Head of a column; numbers are set to the right, words and code to the left."""

    title: str
    unit: str = ""
    kind: Literal["number", "words", "code"] = "number"


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of texts. `note` stands below in small print."""

    title: str
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    note: str = ""

    def __post_init__(self) -> None:
        """A row with a cell too many or too few would shift its meaning."""
        if any(len(row) != len(self.columns) for row in self.rows):
            raise ValueError(f"table '{self.title}': rows don't fit {len(self.columns)} columns")


@dataclass(frozen=True, slots=True)
class Picture:
    """Figure: how to draw it, and what is to be seen in it."""

    name: str
    title: str
    caption: str
    draw: Callable[[], "Figure"]


Part = Paragraph | Table | Picture


@dataclass(frozen=True, slots=True)
class Section:
    """Numbered section of the page."""

    name: str
    title: str
    parts: tuple[Part, ...]

    @property
    def missing(self) -> tuple[str, ...]:
        """Lacks of this section: what it would have shown and cannot."""
        return tuple(
            part.text
            for part in self.parts
            if isinstance(part, Paragraph) and part.tone == "missing"
        )


def words(*titles: str) -> tuple[Column, ...]:
    """Columns of words."""
    return tuple(Column(title, kind="words") for title in titles)


def numbers(unit: str, titles: Sequence[str]) -> tuple[Column, ...]:
    """Columns of numbers of one unit."""
    return tuple(Column(title, unit) for title in titles)


def percent_gained(before: float | None, after: float | None) -> str:
    """Gain: by how much something has become smaller."""
    if before is None or after is None or before == 0.0:
        return NOTHING
    return f"{number(100.0 * (1.0 - after / before), 0)} %"


def moment(utc: str) -> str:
    """Time of the journal as people read it: `2026-03-02 08:15 UTC`."""
    return f"{utc[:10]} {utc[11:16]} UTC"
