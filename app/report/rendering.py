"""Pages as HTML text: one file with its style and figures inside, needing no network.

A page's template extends base.html.jinja and shows parts by the macros of parts.html.jinja. What it
shows comes as `page`, which must have a `generator`.
"""

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from app.report.figures.drawing import svg_text
from app.report.parts import Part, Picture, Table
from campaigns.version import VERSION

GENERATOR = f"pkmcal {VERSION}"
PACKAGE = "app.report"
LONG_TABLE = 34
"""A table of more rows may be cut by the end of a printed page."""


def rendered(template: str, page: object, *, package: str = PACKAGE) -> str:
    """Fill in a template of a package; figures are drawn, whatever is text is escaped."""
    environment = Environment(
        loader=ChoiceLoader(
            [PackageLoader(name, ".") for name in dict.fromkeys((package, PACKAGE))]
        ),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["LONG"] = LONG_TABLE
    environment.tests |= {"table": _is_table, "picture": _is_picture}
    environment.filters |= {"drawing": _drawing, "prose": _prose}
    return environment.get_template(template).render(page=page)


def _is_table(part: Part) -> bool:
    return isinstance(part, Table)


def _is_picture(part: Part) -> bool:
    return isinstance(part, Picture)


def _drawing(picture: Picture) -> Markup:
    svg = svg_text(picture.draw(), picture.name, picture.title)
    return Markup(svg)  # noqa: S704 - drawn by us, holds no text from outside


def _prose(text: str) -> Markup:
    """A sentence in which `backticks` are commands."""
    pieces = text.split("`")
    marked = (Markup("<code>{}</code>").format(p) if k % 2 else p for k, p in enumerate(pieces))
    return Markup("").join(marked)
