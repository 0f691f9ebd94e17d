"""Write the reference tables that follow from the code.

python docs/make_reference.py

`docs/reference/commands.md` comes from the commands' help; in `docs/reference/files.md` each part
between `<!-- keys of NAME -->` and `<!-- end -->` comes from that file's schema. A key's meaning is
its description, the docstring below its field in `sim`, or else the docstring of its section.
"""

import ast
import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

from typer import Context
from typer.core import TyperGroup
from typer.main import get_command

from app.main import COMMANDS, app
from campaigns.kinematics.catalog import FAMILY, MECHANISMS
from campaigns.robots.schema import contents_model
from campaigns.settings.config import CampaignConfig
from sim.scenarios.schema import Scenario

DOCS = Path(__file__).parent
FILES, COMMANDS_PAGE = DOCS / "reference" / "files.md", DOCS / "reference" / "commands.md"
SCHEMAS = {"campaign.yaml": CampaignConfig, "cell.yaml": Scenario}
PART = re.compile(r"(<!-- keys of (.*?) -->\n).*?(\n<!-- end -->)", re.DOTALL)
HEAD = """# Commands

Every option, from the commands' own help: `docs/make_reference.py` writes this page.
`pkmcal COMMAND --help` also explains how the command works, with examples.
"""
TYPES = {"string": "text", "boolean": "true, false", "array": "list", "object": "mapping"}
CRANKS = tuple(name for name, chain in FAMILY.items() if chain.joints[0].is_revolute)
RAILS = tuple(name for name in FAMILY if name not in CRANKS)
SIX_LEGS = tuple(name for name, each in MECHANISMS.items() if len(each.joints) == 6)
GROUPS = {"all": tuple(MECHANISMS), "cranks": CRANKS, "rails": RAILS, "six legs": SIX_LEGS}
"""Words for mechanisms that have keys in common: `cranks` and `rails` are those under a plate."""
SHARED_BY = 3  # commands from which on an option of one meaning is described once, at the top


def pages() -> dict[Path, str]:
    """Return the text that each page should have."""
    head = ("key", "default or type", "meaning")
    tables = {
        name: table(head, keys_of(model.model_json_schema())) for name, model in SCHEMAS.items()
    }
    tables["robot.yaml"] = table((*head, "mechanisms"), robot_rows())
    text = FILES.read_text(encoding="utf-8")
    filled = PART.sub(lambda part: f"{part[1]}\n{tables[part[2]]}\n{part[3]}", text)
    return {FILES: filled, COMMANDS_PAGE: commands_page()}


def table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    """Write a table; rows that follow one another with one meaning are joined."""
    lines = [head, ("---",) * len(head)]
    for _, group in groupby(rows, key=lambda row: row[2:] or row):
        (first, value, *meaning), *others = group
        keys = ", ".join([first, *(f"`{row[0].rpartition('.')[2]}" for row in others)])
        values = [value, *(row[1] for row in others)]
        lines.append((keys, value if len(set(values)) == 1 else "; ".join(values), *meaning))
    return "\n".join(f"| {' | '.join(row)} |" for row in lines)


def keys_of(schema: dict[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Yield key, default or type, and meaning; of sections with the same keys only the first."""
    docstrings, seen = dict(field_docstrings()), dict[str, str]()

    def rows(section: dict[str, Any], prefix: str) -> Iterator[tuple[str, str, str]]:
        for name, field in section["properties"].items():
            key, needed = prefix + name, name in section.get("required", ())
            for choice in field.get("anyOf", ()):  # of an optional key the part that is not null
                field = choice | field if choice.get("type") != "null" else field
            item = field.get("items") or field.get("prefixItems", [field])[0]
            title = item.get("$ref", "").rpartition("/")[2]
            inner = schema.get("$defs", {}).get(title, {})
            meaning = field.get("description") or docstrings.get((section["title"], name), "")
            if title in seen:
                meaning += f"; keys as of `{seen[title]}`"
            if title in seen or item is not field or not inner.get("properties"):
                words = wording(meaning or section["description"])
                yield f"`{key}`", value_of(field, needed=needed), words
            if inner.get("properties") and seen.setdefault(title, key) == key:
                yield from rows(inner, f"{key}[]." if item is not field else f"{key}.")

    return rows(schema, "")


def field_docstrings() -> Iterator[tuple[tuple[str, str], str]]:
    """Yield the docstrings below fields in `sim` by class and field; pydantic drops them."""
    trees = (ast.parse(path.read_bytes()) for path in (DOCS.parent / "sim").rglob("*.py"))
    for section in (node for tree in trees for node in tree.body if isinstance(node, ast.ClassDef)):
        for field, text in pairwise(section.body):
            if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr):
                yield (
                    (section.name, ast.unparse(field.target)),
                    str(ast.literal_eval(text.value)).removesuffix("."),
                )


def value_of(field: dict[str, Any], *, needed: bool) -> str:
    """Return a key's default, with other choices behind it, or else its type."""
    default, choices = field.get("default"), field.get("enum", ())
    if choices:
        others = " or ".join(str(word) for word in choices if word != default)
        return others if default is None else f"{default} (or {others})"
    if default not in (None, "", [], {}) and not re.search("[{]", text := json.dumps(default)):
        return re.sub(r"\.0\b", "", text.strip('"'))
    items = [item for item in field.get("prefixItems", ()) if item.get("type") == "number"]
    coordinates = {2: "[lowest, highest]", 3: "[x, y, z]"}.get(len(items))
    kind = coordinates or TYPES.get(field.get("type", "object"), field.get("type", ""))
    return "**needed**" if needed and kind == "number" else kind + ", **needed**" * needed


def wording(text: str) -> str:
    """Return a description as a sentence, without the unit and form that key and type show."""
    text = re.sub(r",? \[x, y(, z)?\]( mm)?", "", " ".join(text.split()).removesuffix("."))
    text = re.sub(r", (mm|s|deg|%|ppm|µm|°C)(?=$|;)|; may be left out$", "", text)
    text = text.removeprefix("the ")
    return text[:1].upper() + text[1:]


def robot_rows() -> Iterator[tuple[str, ...]]:
    """Yield the keys of robot files of all mechanisms, each with the mechanisms that have it."""
    owners: dict[tuple[str, str, str], list[str]] = {}
    for name in MECHANISMS:
        for key, value, meaning in keys_of(contents_model(name, DOCS).model_json_schema()):
            words = re.sub("^[XYZ] of", "Place of", meaning).removesuffix(f": {name}")
            if value != "null":  # a key that the mechanism has not
                owners.setdefault((key, value, words), []).append(name)
    sections = list(dict.fromkeys(key.split(".")[0] for key, *_ in owners))
    for row in sorted(owners, key=lambda row: sections.index(row[0].split(".")[0])):
        yield *row, ", ".join(grouped(owners[row]))


def grouped(names: list[str]) -> Iterator[str]:
    """Yield the groups that are among mechanisms, and then the mechanisms of none of them."""
    for word, group in GROUPS.items():
        if {*group} <= {*names}:
            yield word
            names = [name for name in names if name not in group]
    yield from names


def commands_page() -> str:
    """Write the options of every command; those of several commands once."""
    group = get_command(app)
    assert isinstance(group, TyperGroup)
    options = {name: list(option_rows(group, name)) for name in COMMANDS}
    uses = Counter(row for rows in options.values() for row in rows)
    shared = [row for row, count in uses.items() if count >= SHARED_BY]
    text = f"{HEAD}\n{table(('in several commands', 'meaning'), shared)}\n"
    for name, rows in options.items():
        own = [row for row in rows if row not in shared]
        also = ", ".join(row[0] for row in rows if row in shared and uses[row] < 10)
        text += f"\n## {name}\n\n{COMMANDS[name][1]}" + f" Also {also}." * bool(also) + "\n"
        text += f"\n{table(('option', 'meaning'), own)}\n" if own else ""
    return text


def option_rows(group: Any, name: str) -> Iterator[tuple[str, str]]:
    """Yield names and meaning of each argument and option, as help shows them."""
    command = group.get_command(Context(group), name)
    for parameter in command.params:
        names, meaning = parameter.get_help_record(Context(command)) or ("", "")
        names = re.sub(r" <(path|str|list.*)>", "", names)
        names = re.sub(r"<(.*?)>", r"\1", names).replace("|", " or ")  # Typer's marks of choices
        meaning = re.sub(r"\[default: \((.*?)\)", r"[default: \1", meaning).replace("  [", " [")
        meaning = re.sub(r"(\d+)<=x<=(\d+)", r"\1 to \2", meaning).replace("x>=", "at least ")
        if names:
            yield f"`{names}`", meaning


if __name__ == "__main__":
    for page, written in pages().items():
        page.write_text(written, encoding="utf-8")
