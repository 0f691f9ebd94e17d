"""Pages as HTML text: one file with its style and figures inside, needing no network.

A page's template extends base.html.jinja and shows parts by the macros of parts.html.jinja. What it
shows comes as `page`, which must have a `generator`. Its sections may come from a template too,
which says in which words the rows and pictures stand that it is given.
"""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import TYPE_CHECKING, TypeVar

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from app.report.figures.drawing import svg_text
from app.report.parts import (
    Paragraph,
    Part,
    Picture,
    Section,
    Table,
    Tone,
    moment,
)
from campaigns.files.table import Column, number, texts
from campaigns.version import VERSION
from drivers.texts import printable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

T = TypeVar("T")

GENERATOR = f"pkmcal {VERSION}"
PACKAGE = "app.report"
LONG_TABLE = 34
"""A table of more rows may be cut by the end of a printed page."""


def rendered(template: str, page: object, *, package: str = PACKAGE) -> str:
    """Fill in a template of a package; figures are drawn, whatever is text is escaped."""
    return _environment(package).get_template(template).render(page=page)


def sections_of(
    template: str, values: Mapping[str, object], *, package: str = PACKAGE
) -> tuple[Section, ...]:
    """Sections that a template says, in its order.

    In it `{% call section(name, title) %}` holds calls of `table`, `picture`, `text`, `note` and
    `missing`, whose bodies are the words: a table's note, a picture's caption, a paragraph. Raises
    `ValueError` for words outside of these.
    """
    writer = _SectionWriter()
    calls = {
        "section": writer.section,
        "table": writer.table,
        "picture": writer.picture,
        **{tone: partial(writer.paragraph, tone) for tone in ("text", "note", "missing")},
    }
    _nothing(_environment(package).get_template(template).render(values, **calls))
    return tuple(writer.sections)


class _SectionWriter:
    """Sections made by the calls of a template, each of which leaves nothing where it stands."""

    def __init__(self) -> None:
        self.sections: list[Section] = []
        self._parts: list[Part] = []

    def section(self, name: str, title: str, *, caller: Callable[[], str]) -> str:
        self._parts = []
        _nothing(caller())
        self.sections.append(Section(name, title, tuple(self._parts)))
        return ""

    def paragraph(self, tone: Tone, *, caller: Callable[[], str]) -> str:
        self._parts.append(Paragraph(_plain(caller()), tone))
        return ""

    def table(
        self,
        title: str,
        columns: tuple[Column[T], ...],
        rows: Iterable[T],
        *,
        caller: Callable[[], str] | None = None,
    ) -> str:
        note = "" if caller is None else _plain(caller())
        self._parts.append(Table(title, columns, texts(columns, rows), note))
        return ""

    def picture(
        self,
        name: str,
        title: str,
        draw: "Callable[..., Figure]",
        *given: object,
        caller: Callable[[], str],
        **named: object,
    ) -> str:
        drawing = partial(draw, *given, **named)
        self._parts.append(Picture(name, title, _plain(caller()), drawing))
        return ""


def _plain(body: str) -> str:
    """Plain text of a body, on one line: it is escaped where it is shown."""
    return " ".join(Markup(body).unescape().split())  # noqa: S704 - turned back into text at once


def _nothing(left: str) -> None:
    if left.strip():
        raise ValueError(f"words that stand in no part of a section: '{left.strip()}'")


def _environment(package: str) -> Environment:
    environment = Environment(
        loader=ChoiceLoader(
            [PackageLoader(name, ".") for name in dict.fromkeys((package, PACKAGE))]
        ),
        autoescape=True,
        finalize=_cleaned,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["LONG"] = LONG_TABLE
    environment.tests |= {"table": _is_table, "picture": _is_picture}
    environment.filters |= {
        "drawing": _drawing,
        "prose": _prose,
        "number": number,
        "moment": moment,
    }
    return environment


def _cleaned(value: object) -> object:
    """What a device or file says, without hidden characters; markup is ours and stays."""
    return printable(value) if isinstance(value, str) and not isinstance(value, Markup) else value


def _is_table(part: Part) -> bool:
    return isinstance(part, Table)


def _is_picture(part: Part) -> bool:
    return isinstance(part, Picture)


def _drawing(picture: Picture) -> Markup:
    svg = svg_text(picture.draw(), picture.name, picture.title)
    return Markup(svg)  # noqa: S704 - drawn by us, holds no text from outside


def _prose(text: str) -> Markup:
    """A sentence in which `backticks` are commands."""
    pieces = printable(text).split("`")
    marked = (Markup("<code>{}</code>").format(p) if k % 2 else p for k, p in enumerate(pieces))
    return Markup("").join(marked)
