"""pkmcal help: show a page of the documentation, which is installed with the program."""

import re
import sysconfig
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from app.console import Terminal
from campaigns.errors import OptionsInvalid
from campaigns.files.wording import suggestion

Page = Annotated[
    str | None,
    typer.Argument(
        metavar="PAGE",
        help="A page's name, with # and a heading for a part; default: list the pages.",
        show_default=False,
    ),
]
PLACES = (Path(__file__).parents[2], Path(sysconfig.get_path("data")) / "share" / "pkmcal")
"""Folders that may hold the docs: of a checkout, and of an installed program."""


@dataclass(frozen=True, slots=True)
class HelpAnswer:
    """Answer of `help`: a page's text, or the titles of all pages by name."""

    page: str
    text: str
    pages: Mapping[str, str]


def command(terminal: Terminal, page: Page = None) -> None:
    """Show a page of the documentation.

    The pages are installed with the program. Errors name the page, and often the part, that says
    more.

    pkmcal help
    pkmcal help by-hand
    pkmcal help files#plancsv
    """
    pages = find_pages()
    if page is None:
        titles = {name: title_of(path) for name, path in pages.items()}
        terminal.listing("Pages, for `pkmcal help PAGE`", titles)
        terminal.conclude(HelpAnswer("", "", titles))
        return
    name, _, part = page.removesuffix(".md").rpartition("/")[2].partition("#")
    name = name.removesuffix(".md")
    if name not in pages:
        raise OptionsInvalid(f"there is no page {name}", remedy=suggestion(name, tuple(pages)))
    text = pages[name].read_text(encoding="utf-8")
    text = part_of(text, part, name) if part else text
    for line in text.splitlines():
        terminal.say(line)
    terminal.conclude(HelpAnswer(page, text, {}))


def find_pages() -> dict[str, Path]:
    """Return the pages by name; raise `OptionsInvalid` for an installation without them."""
    docs = next((place / "docs" for place in PLACES if (place / "docs").is_dir()), None)
    if docs is None:
        raise OptionsInvalid(
            "the pages are not installed beside the program", remedy="install pkmcal's wheel again"
        )
    return {path.stem: path for path in sorted(docs.glob("*/*.md")) if path.stem != "README"}


def title_of(path: Path) -> str:
    """Return the first heading of a page."""
    with path.open(encoding="utf-8") as file:
        return file.readline().lstrip("# ").strip()


def part_of(text: str, anchor: str, name: str) -> str:
    """Return the part of a page below a heading, up to the next one of its level or above.

    Raise `OptionsInvalid` for a heading that the page does not have.
    """
    headings = [*_headings(text)]
    anchors = [heading.anchor for heading in headings]
    if anchor not in anchors:
        raise OptionsInvalid(
            f"page {name} has no part {anchor}", remedy=suggestion(anchor, tuple(anchors))
        )
    place = anchors.index(anchor)
    begin, level = headings[place].line, headings[place].level
    behind = (heading.line for heading in headings[place + 1 :] if heading.level <= level)
    return "\n".join(text.splitlines()[begin : next(behind, None)])


@dataclass(frozen=True, slots=True)
class _Heading:
    """Heading of a page: its line, its level, and the anchor by which links name it."""

    line: int
    level: int
    anchor: str


def _headings(text: str) -> Iterator[_Heading]:
    """Yield the headings of a page; lines inside blocks of code are none."""
    is_code = False
    for number, line in enumerate(text.splitlines()):
        is_code ^= line.startswith("```")
        if not is_code and (match := re.match(r"(#+) (.*)", line)):
            words = re.sub(r"[^\w\- ]", "", match[2].lower()).replace(" ", "-")
            yield _Heading(number, len(match[1]), words)
