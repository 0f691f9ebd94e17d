"""Parts of a page, and times as they are written on it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from campaigns.files.table import Column, Row

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Tone = Literal["text", "missing", "note"]


@dataclass(frozen=True, slots=True)
class Paragraph:
    """Sentence or two; `missing` says what is not there and what would bring it."""

    text: str
    tone: Tone = "text"


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of texts. `note` stands below in small print."""

    title: str
    columns: tuple[Column[Any], ...]
    rows: tuple[Row, ...]
    note: str = ""


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


def moment(utc: str) -> str:
    """Time of the journal as people read it: `2026-03-02 08:15 UTC`."""
    return f"{utc[:10]} {utc[11:16]} UTC"
