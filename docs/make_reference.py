"""Write the reference tables that follow from the code.

python docs/make_reference.py

`docs/reference/commands.md` comes from the commands' help; in `docs/reference/files.md` each part
between `<!-- keys of NAME -->` and `<!-- end -->` comes from that file's schema. A key's meaning is
its description, or the docstring below its field.
"""

import ast
import inspect
import re
import textwrap
from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic_core import PydanticUndefined
from typer import Context
from typer.core import TyperGroup
from typer.main import get_command

from app.main import COMMANDS, app
from campaigns.kinematics.catalog import MECHANISMS
from campaigns.kinematics.parameters import OPTIONAL
from campaigns.robots.schema import RobotContents
from campaigns.settings.config import CampaignConfig
from sim.scenarios.schema import Scenario

FILES = Path(__file__).with_name("reference") / "files.md"
COMMANDS_PAGE = FILES.with_name("commands.md")
SCHEMAS = {"robot.yaml": RobotContents, "campaign.yaml": CampaignConfig, "cell.yaml": Scenario}
PART = re.compile(r"(<!-- keys of (.*?) -->\n).*?(\n<!-- end -->)", re.DOTALL)
HEAD = """# Commands

Every option, from the commands' own help: `docs/make_reference.py` writes this page.
`pkmcal COMMAND --help` also explains how the command works, with examples.
"""
WORDS = {float: "number", int: "integer", str: "text", tuple: "[x, y, z]"}
SHARED_BY = 5  # commands from which on an option of one meaning is described once, at the top


def pages() -> dict[Path, str]:
    """Return the text that each page should have."""
    head = ("key", "type, default", "meaning")
    tables = {name: table(head, merged(rows_of(model, "", {}))) for name, model in SCHEMAS.items()}
    tables["geometry"] = table(("key", "default", "meaning", "of"), merged(parameter_rows()))
    text = FILES.read_text(encoding="utf-8")
    filled = PART.sub(lambda part: f"{part[1]}\n{tables[part[2]]}\n{part[3]}", text)
    return {FILES: filled, COMMANDS_PAGE: commands_page()}


def table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    """Write a table in markdown."""
    return "\n".join(f"| {' | '.join(row)} |" for row in [head, ("---",) * len(head), *rows])


def rows_of(
    section: type[BaseModel], prefix: str, seen: dict[type[BaseModel], str]
) -> Iterator[tuple[str, ...]]:
    """Yield a row for each key; of sections with the same keys the first is written out."""
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(section))).body
    docstrings = {
        ast.unparse(field.target): " ".join(str(text.value.value).split()).removesuffix(".")
        for field, text in pairwise(getattr(tree, "body", []))
        if isinstance(field, ast.AnnAssign)
        if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
    }
    for name, field in section.model_fields.items():
        key, kind = prefix + name, type_of(field.annotation)
        inner, meaning = section_in(field.annotation), field.description or docstrings.get(name, "")
        if inner in seen:
            meaning += f"; keys as of `{seen[inner]}`"
        if inner is None or inner in seen or kind == "list":
            default = "**needed**" if field.is_required() else shown(field.default)
            yield f"`{key}`", ", ".join(filter(None, (kind, default))), wording(meaning)
        if inner is not None and seen.setdefault(inner, key) == key:
            yield from rows_of(inner, f"{key}[]." if kind == "list" else f"{key}.", seen)


def section_in(kind: Any) -> type[BaseModel] | None:
    """Return the class of a section, of an optional one, or of a list of sections."""
    if isinstance(kind, type) and not get_args(kind):
        return kind if issubclass(kind, BaseModel) and kind.model_fields else None
    parts = () if get_origin(kind) in {dict, Literal} else get_args(kind)
    return next(filter(None, map(section_in, parts)), None)


def type_of(kind: Any) -> str:
    """Return the words for a type in the table."""
    origin, parts = get_origin(kind), [part for part in get_args(kind) if part is not NoneType]
    if origin in {Annotated, Union, UnionType}:
        return type_of(parts[0])
    if origin is Literal:
        return " or ".join(f"`{part}`" for part in parts)
    if origin is tuple and (Ellipsis in parts or len(parts) == 2):
        return "list" if Ellipsis in parts else "[lowest, highest]"
    return WORDS.get(origin or kind, kind.__name__ if origin is None else "mapping")


def shown(default: Any) -> str:
    """Return a default as a file has it; nothing for what may be left out."""
    if default in (None, "", (), {}, PydanticUndefined) or isinstance(default, BaseModel | dict):
        return ""
    if isinstance(default, tuple):
        return f"[{', '.join(map(shown, default))}]" if isinstance(default[0], float) else ""
    return f"{default:g}" if isinstance(default, float) else str(default).lower()


def wording(text: str) -> str:
    """Return a description as a sentence, without the unit and form that key and type show."""
    text = re.sub(r",? \[x, y(, z)?\]( mm)?", "", text.removesuffix("; may be left out"))
    text = re.sub(r", (mm|s|deg|%|ppm|µm|°C)(?=$|;)", "", text).removeprefix("the ")
    return text[:1].upper() + text[1:]


def merged(rows: Iterable[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Join rows that follow one another and differ in their keys alone."""
    joined: list[tuple[str, ...]] = []
    for key, *cells in rows:
        again = joined.pop() if joined and joined[-1][1:] == tuple(cells) else None
        joined.append((f"{again[0]}, `{key.rpartition('.')[2]}" if again else key, *cells))
    return joined


def parameter_rows() -> Iterator[tuple[str, ...]]:
    """Yield a row for each parameter of arms and platform, with the robots that have it."""
    owners: dict[tuple[str, ...], dict[str, None]] = {}
    for name, chain in MECHANISMS.items():
        limb, robot = "cranks" if chain.joints[0].is_revolute else "rails", chain.parameters
        for roles, default in (((), "**needed**"), (OPTIONAL, "0")):
            for key, of, fields in (
                ("arms[].", limb, robot.arm_fields),
                ("", name, robot.platform_fields),
            ):
                for field in fields(*roles):
                    meaning = re.sub("^[xyz] of", "place of", field.description)
                    row = (f"`{key}{field.name}`", default, wording(meaning))
                    owners.setdefault(row, {})[of] = None
    for row, of in owners.items():
        yield *row, "all" if set(of) in ({"cranks", "rails"}, set(MECHANISMS)) else ", ".join(of)


def commands_page() -> str:
    """Write the options of every command, those of most commands once."""
    group = get_command(app)
    assert isinstance(group, TyperGroup)
    options = {name: list(option_rows(group, name)) for name in COMMANDS}
    uses = Counter(row for rows in options.values() for row in rows)
    shared = [row for row, count in uses.items() if count >= SHARED_BY]
    text = f"{HEAD}\n{table(('in most commands', 'meaning'), shared)}\n"
    for name, rows in options.items():
        own = [row for row in rows if row not in shared]
        text += f"\n## {name}\n\n{COMMANDS[name][1]}\n"
        text += f"\n{table(('option', 'meaning'), own)}\n" if own else ""
    return text


def option_rows(group: Any, name: str) -> Iterator[tuple[str, str]]:
    """Yield names and meaning of each argument and option, as help shows them."""
    command = group.get_command(Context(group), name)
    for parameter in command.params:
        names, meaning = parameter.get_help_record(Context(command)) or ("", "")
        names = re.sub(r" <(path|str|csv|list.*)>", "", names).replace("|", " or ")
        meaning = re.sub(r"\[default: \((.*?)\)", r"[default: \1", meaning).replace("  [", " [")
        if names:
            yield f"`{names}`", meaning


if __name__ == "__main__":
    for page, written in pages().items():
        page.write_text(written, encoding="utf-8")
