"""What pydantic finds in a YAML file, as one line: file, line, key, value, limit, remedy."""

import json
from collections.abc import Iterator, Mapping, Sequence
from types import NoneType
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, PydanticCustomError
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from campaigns.errors import ConfigInvalid
from campaigns.files.wording import shown, suggestion

Location = Sequence[int | str]

BROKEN_RULE = "broken_rule"

WORDS: Mapping[str, str] = {
    "missing": "is missing",
    "extra_forbidden": "is not a known key",
    "float_type": "is {input}, must be a number",
    "int_type": "is {input}, must be a whole number",
    "int_from_float": "is {input}, must be a whole number",
    "finite_number": "is {input}, must be a finite number",
    "string_type": "is {input}, must be text: put it in quotes",
    "string_too_short": "is {input}, must not be empty",
    "bool_type": "is {input}, must be true or false",
    "tuple_type": "is {input}, must be a list in [ ]",
    "dict_type": "is {input}, must hold keys with values",
    "model_type": "is {input}, must hold keys with values",
    "too_long": "has {actual_length} entries, must have {max_length}",
    "greater_than": "is {input}, must be above {gt:g}",
    "greater_than_equal": "is {input}, must be at least {ge:g}",
    "less_than": "is {input}, must be below {lt:g}",
    "less_than_equal": "is {input}, must be at most {le:g}",
    "multiple_of": "is {input}, must be a multiple of {multiple_of}",
    "literal_error": "is {input}, must be {expected}",
    "string_pattern_mismatch": "is {input}, which has not the right form",
    BROKEN_RULE: "{message}",
}
"""By pydantic's name of the finding; what is in braces comes from the finding itself."""


def broken_rule(message: str) -> PydanticCustomError:
    """Return a finding of our own for a validator to raise; it says value and limit itself."""
    return PydanticCustomError(BROKEN_RULE, "{message}", {"message": message})


def explained(
    error: ValidationError, model: type[BaseModel], name: str, tree: CommentedMap | None = None
) -> ConfigInvalid:
    """Word the finding to correct first: an unknown key often is the missing one, misspelt.

    Without a tree, `name` alone says where the contents are from.
    """
    findings = error.errors(include_url=False)
    first = min(findings, key=lambda found: found["type"] != "extra_forbidden")
    where = name if tree is None else f"{name}:{_line(tree, first['loc'])}"
    more = f" (and {len(findings) - 1} more)" if len(findings) > 1 else ""
    return ConfigInvalid(f"{where}: {_problem(first)}{more}", remedy=_remedy(first, model))


def key_path(location: Location) -> str:
    """Write a place as `geometry.arms[2].forearm_mm`."""
    parts = (f"[{part}]" if isinstance(part, int) else f".{shown(part)}" for part in location)
    return "".join(parts).removeprefix(".")


def _problem(found: ErrorDetails) -> str:
    words = WORDS.get(found["type"], "is {input}: {message}")
    known = {"input": _shown(found["input"]), "message": found["msg"], **found.get("ctx", {})}
    return f"{key_path(found['loc'])} {words.format_map(known)}".strip()


def _remedy(found: ErrorDetails, model: type[BaseModel]) -> str:
    *parent, last = found["loc"] or ("",)
    if found["type"] == "extra_forbidden":
        return _instead_of(str(last), tuple(_fields(_annotation_at(model, parent))))
    description = _description(model, found["loc"])
    return f"give {description}" if description else "correct the value"


def _instead_of(key: str, known: tuple[str, ...]) -> str:
    if key.isdecimal():  # {arm_mm: 350,5} holds a key 5
        return "write a decimal point, not a comma"
    return suggestion(key, known)


def _shown(value: object) -> str:
    return "empty" if value is None else shown(json.dumps(value, ensure_ascii=False, default=str))


def _line(tree: CommentedMap, location: Location) -> int:
    """Find the line, from 1, of the place or of what it is missing from."""
    *_, line = _lines_towards(tree, location)
    return line + 1


def _lines_towards(tree: CommentedMap, location: Location) -> Iterator[int]:
    """Yield the lines, from 0, of the document, of the place's first key, of the next, …."""
    node: Any = tree  # a tree of ruamel's: mappings, lists, and anything as leaves
    yield 0
    for key in location:
        if not isinstance(node, CommentedMap | CommentedSeq) or key not in (node.lc.data or {}):
            return
        yield node.lc.data[key][0]
        node = node[key]


def _description(model: type[BaseModel], location: Location) -> str | None:
    """Find the description of the nearest field that has one."""
    for length in range(len(location), 0, -1):
        *parent, last = location[:length]
        field = _fields(_annotation_at(model, parent)).get(str(last))
        if field and field.description:
            return field.description
    return None


def _annotation_at(model: type[BaseModel], location: Location) -> object:
    """Find the type that a model has at a place; None where it does not say."""
    annotation: object = model
    for key in location:
        field = _fields(annotation).get(str(key))
        annotation = field.annotation if field else _entry(annotation, key)
    return annotation


def _entry(annotation: object, key: int | str) -> object:
    """Find the type of a tuple's entry."""
    entries = get_args(annotation)
    return entries[key] if isinstance(key, int) and key < len(entries) else None


def _fields(annotation: object) -> Mapping[str, FieldInfo]:
    """List a model's fields, also of an optional one; nothing for any other type."""
    choices = get_args(annotation)
    model = choices[0] if NoneType in choices else annotation
    return model.model_fields if isinstance(model, type) and issubclass(model, BaseModel) else {}
