"""Scenarios: shipped ones by name, others by path.

A cell file is read within bounds (drivers/bounded_files.py), parsed by the schema, and refused with
the first thing wrong, its place, and a remedy. Where a file is edited, its comments are kept.
"""

import json
from collections.abc import Callable
from importlib.resources import files
from io import StringIO
from pathlib import Path
from typing import get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap

from drivers import bounded_files
from sim.errors import ScenarioInvalid
from sim.scenarios.schema import Scenario
from sim.section import nearest

SCHEMA = "pkmcal/cell/1"
VALUE_LENGTH_SHOWN = 40
SUFFIX = ".yaml"
FOLDED_AT_COLUMN = 80


def shipped_scenarios() -> tuple[str, ...]:
    """Return the names of the scenarios that come with pkmcal."""
    names = (file.name for file in files(__package__).iterdir())
    return tuple(sorted(name.removesuffix(SUFFIX) for name in names if name.endswith(SUFFIX)))


def shipped_text(name: str) -> str:
    """Return the cell file of a shipped scenario."""
    return (files(__package__) / f"{name}{SUFFIX}").read_text(encoding="utf-8")


def load_scenario(name_or_path: str) -> Scenario:
    """Load a shipped scenario by its name, or one in a file; raises `ScenarioInvalid`."""
    shipped = name_or_path in shipped_scenarios()
    name = f"{name_or_path}{SUFFIX}" if shipped else str(Path(name_or_path))
    return parse_scenario(_source(name_or_path), name)


def parse_scenario(text: str, name: str) -> Scenario:
    """Parse a scenario; `name` is the file's, for messages. Raises `ScenarioInvalid`."""
    try:
        tree = bounded_files.loaded_yaml(
            bounded_files.bounded(YAML(typ="safe", pure=True)), text, name
        )
    except bounded_files.FileRefused as error:
        raise ScenarioInvalid(error.problem, remedy=error.remedy) from error
    if not isinstance(tree, dict) or tree.get("schema") != SCHEMA:
        raise ScenarioInvalid(
            f"{name}: is not a scenario file", remedy=f"begin with 'schema: {SCHEMA}'"
        )
    contents = {key: value for key, value in tree.items() if key != "schema"}
    # By way of JSON: pydantic is strict about Python's types, but a list of a file has to become
    # the tuple of the schema, and what is no JSON (a date, a set) is to be refused as a text.
    try:
        return Scenario.model_validate_json(json.dumps(contents, default=str))
    except ValidationError as error:
        raise _explain(error, name) from error
    except (TypeError, ValueError, RecursionError) as error:
        raise ScenarioInvalid(
            f"{name}: holds more than plain keys, lists and values ({error})",
            remedy="write it without tags and compound keys",
        ) from error


def _explain(error: ValidationError, name: str) -> ScenarioInvalid:
    """Return an error that states the first finding, its place, and how many more there are."""
    details = error.errors()
    first = details[0]
    more = f" (and {len(details) - 1} more)" if len(details) > 1 else ""
    where = ".".join(map(str, first["loc"])) or "the scenario"
    problem, remedy = _reason(first)
    return ScenarioInvalid(f"{name}: {where} {problem}{more}", remedy=remedy)


def _reason(detail: ErrorDetails) -> tuple[str, str]:
    """Return what is wrong by one of pydantic's findings, and its remedy."""
    if detail["type"] == "extra_forbidden":
        *parents, unknown = detail["loc"]
        return "is not a known key", nearest(str(unknown), _keys_at(parents))
    if detail["type"] == "missing":
        return "is missing", "add it"
    if detail["type"] == "value_error":
        return f"is inconsistent: {detail['ctx']['error']}", "correct it"
    shown = json.dumps(detail["input"], default=str)[:VALUE_LENGTH_SHOWN]
    return f"is {shown}: {detail['msg'].lower()}", "correct the value"


def _keys_at(path: list[int | str]) -> list[str]:
    """Return the keys that the schema has at a place in the file."""
    # the path has keys and indices of lists; indices lead to no other section
    model: type[BaseModel] = Scenario
    for step in path:
        if isinstance(step, str):
            model = _section_in(model.model_fields[step].annotation) or model
    return list(model.model_fields)


def _section_in(annotation: object) -> type[BaseModel] | None:
    """Return the section in an annotation such as `Section | None` or `tuple[Section, ...]`."""
    for part in (annotation, *get_args(annotation)):
        if isinstance(part, type) and get_origin(part) is None and issubclass(part, BaseModel):
            return part
    return None


def scenario_text(name_or_path: str, seed: int | None = None) -> str:
    """Return a scenario's YAML, comments and all, with another seed if one is given.

    Raises `ScenarioInvalid`.
    """
    load_scenario(name_or_path)
    text = _source(name_or_path)
    if seed is None:
        return text
    return edited(text, lambda tree: tree.update(seed=seed), width=FOLDED_AT_COLUMN)


def edited(text: str, edit: Callable[[CommentedMap], None], width: int = 1000) -> str:
    """Edit a cell file, its comments kept; long lines are folded at a width."""
    yaml = YAML()
    yaml.width = width
    tree = yaml.load(text)
    edit(tree)
    written = StringIO()
    yaml.dump(tree, written)
    return written.getvalue()


def _source(name_or_path: str) -> str:
    if name_or_path in shipped_scenarios():
        return shipped_text(name_or_path)
    path = Path(name_or_path)
    if not bounded_files.is_there(path):
        raise ScenarioInvalid(
            f"scenario '{name_or_path}' is neither a shipped one nor a file",
            remedy=nearest(name_or_path, shipped_scenarios()),
        )
    try:
        return bounded_files.decoded(
            bounded_files.read_bounded(path, bounded_files.YAML_BYTES), str(path)
        )
    except bounded_files.FileRefused as error:
        raise ScenarioInvalid(error.problem, remedy=error.remedy) from error
