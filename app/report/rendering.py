"""Pages as HTML text: one file with its style and figures inside, needing no network.

A page's template extends base.html.jinja; its sections stand in a template of their own, which says
in which words rows and pictures stand by the macros of parts.html.jinja.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from functools import cache
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure

from app.report.figures.drawing import svg_text
from app.report.figures.picture import Picture
from campaigns.files.table import number
from campaigns.version import VERSION
from drivers.texts import printable

GENERATOR = f"pkmcal {VERSION}"
PACKAGE = "app.report"
MARK = "<!--figure {}-->"
"""Holds the place of a figure: text from outside has no such brackets."""
LONG_TABLE = 34
"""A table of more rows may be cut by the end of a printed page."""
SHORT_CELL = 24
"""Letters of a cell that is kept on one line: a word, a time, a name."""


@dataclass(frozen=True, slots=True)
class Outline:
    """Contents of a page, written down while its sections are."""

    sections: dict[str, str] = field(default_factory=dict)
    """Titles by name, in order."""
    missing: dict[str, str] = field(default_factory=dict)
    """What is not there and what would bring it, each once, with the first section that has it."""
    figures: list[str] = field(default_factory=list)
    drawings: list[tuple[str, Callable[[], str]]] = field(default_factory=list)
    """Titles, and what draws each; a mark on the page keeps their places."""

    def begin(self, name: str, title: str) -> int:
        """Begin a section; gives its number."""
        self.sections[name] = title
        return len(self.sections)

    def lack(self, text: str) -> str:
        """Write down a lack of the section; gives its words."""
        self.missing.setdefault(text, [*self.sections][-1])
        return text

    def picture(self, name: str, title: str, *given: Any, **named: Any) -> str:
        """Keep the place of a figure, which is drawn when the page is written."""
        draw, *values = given
        self.figures.append(name)
        self.drawings.append((title, lambda: drawn(draw, name, title, *values, **named)))
        return Markup(MARK.format(len(self.drawings)))  # noqa: S704 - a number of our own


def no_word(_title: str, _number: int, _total: int) -> None:
    """Tell nothing of figures that are drawn."""


def rendered(
    template: str,
    values: Mapping[str, object],
    *,
    package: str = PACKAGE,
    tell: Callable[[str, int, int], None] = no_word,
) -> tuple[str, Outline]:
    """Fill in a template of a package: figures are drawn, whatever is text is escaped.

    `tell` hears of each figure before it is drawn: title, number, how many there are. Gives the
    page and what is on it.
    """
    outline = Outline()
    environment = _environment(package)
    page = environment.get_template(template).render(values, outline=outline, generator=GENERATOR)
    for count, (title, draw) in enumerate(outline.drawings, start=1):
        tell(title, count, len(outline.drawings))
        page = page.replace(MARK.format(count), draw(), 1)
    return page, outline


def drawn(
    draw: Callable[..., Picture | Figure], name: str, title: str, *given: Any, **named: Any
) -> str:
    """Figure as markup. Any: what each figure is drawn of."""
    made = draw(*given, **named)
    if isinstance(made, Picture):
        return made.svg(title)
    return svg_text(made, name, title)


def moment(utc: str) -> str:
    """Time of the journal as people read it: `2026-03-02 08:15 UTC (09:15 CET)`.

    The local time stands beside it where the machine that writes the page has another.
    """
    told = f"{utc[:10]} {utc[11:16]} UTC"
    try:
        local = datetime.fromisoformat(utc).astimezone()
    except ValueError:
        return told
    return told if not local.utcoffset() else f"{told} ({local:%H:%M} {local.tzname()})"


@cache
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
    environment.globals |= {"LONG": LONG_TABLE, "SHORT": SHORT_CELL}
    environment.filters |= {"plain": _plain, "prose": _prose, "number": number, "moment": moment}
    return environment


def _cleaned(value: object) -> object:
    """What a device or file says, without hidden characters; markup is ours and stays."""
    return printable(value) if isinstance(value, str) and not isinstance(value, Markup) else value


def _plain(body: str) -> str:
    """Plain text of a body, on one line: it is escaped where it is shown."""
    return " ".join(Markup(body).unescape().split())  # noqa: S704 - turned back into text at once


def _prose(text: str) -> Markup:
    """A sentence in which `backticks` are commands."""
    pieces = printable(text).split("`")
    marked = (Markup("<code>{}</code>").format(p) if k % 2 else p for k, p in enumerate(pieces))
    return Markup("").join(marked)
