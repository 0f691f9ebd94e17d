"""Parts of a page as plain data: sections of tables, figures and paragraphs, for the template."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeVar

from markupsafe import Markup
from matplotlib.figure import Figure

from app.report.drawing import svg_text
from campaigns.files.table import Column, Row, texts

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """Part of a section: a table, a figure, a list of facts, or a paragraph."""

    form: Literal["table", "figure", "facts", "text", "note"]
    text: str = ""
    """Paragraph, caption of a figure or note below a table; `backticks` are commands."""
    title: str = ""
    name: str = ""
    """Name of a figure, its id on the page."""
    panels: tuple[Markup, ...] = ()
    """SVG elements of a figure."""
    columns: Sequence[Column[Any]] = ()
    """Columns of a table."""
    rows: tuple[Row, ...] = ()
    """Rows of a table or a list of facts."""


@dataclass(frozen=True, slots=True)
class Section:
    """Section of the page, filled in the order of reading; one without blocks is left out."""

    name: str
    title: str
    blocks: list[Block] = field(default_factory=list)

    def table(
        self, title: str, columns: Sequence[Column[T]], rows: Iterable[T], note: str = ""
    ) -> None:
        """Add a table, if it has rows."""
        if cells := texts(columns, rows):
            block = Block(form="table", title=title, columns=columns, rows=cells, text=note)
            self.blocks.append(block)

    def figure(self, name: str, title: str, panels: Iterable[Figure], caption: str) -> None:
        """Draw a figure and add it."""
        svgs = (svg_text(panel, f"{name}-{n}", title) for n, panel in enumerate(panels, start=1))
        # matplotlib escapes the texts of its SVG
        marked = tuple(Markup(svg) for svg in svgs)  # noqa: S704
        figure = Block(form="figure", name=name, title=title, panels=marked, text=caption)
        self.blocks.append(figure)

    def facts(self, rows: Iterable[Row]) -> None:
        """Add a list of names and texts, without those whose text is empty."""
        self.blocks.append(Block(form="facts", rows=tuple(row for row in rows if row[1])))

    def text(self, *sentences: str) -> None:
        """Add a paragraph for each sentence, with a capital and a full stop."""
        for sentence in sentences:
            self.blocks.append(Block(form="text", text=f"{sentence[0].upper()}{sentence[1:]}."))

    def note(self, text: str) -> None:
        """Add a paragraph in small print."""
        self.blocks.append(Block(form="note", text=text))
