"""YAML files: read within bounds, checked key by key, and errors in one line with their place.

A file is read in three steps. The round-trip loader of ruamel gives a tree that keeps comments,
quotes and the line of every key. The key `schema` decides whether the file is of the right kind and
version. Then the tree, as JSON, goes through a pydantic model that accepts no unknown key and
converts nothing. If the model finds faults, the one to correct first is worded as file, line, key,
value and limit, with the field's own description as the remedy.

Why the round trip: an error needs the line, and a robot file that is written again with other
numbers keeps the comments that people wrote into it. New files are written from a model, each key
below its description, so that a campaign.yaml explains itself.
"""

import io
import json
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, ClassVar, TypeVar, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, PydanticCustomError
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.scalarstring import DoubleQuotedScalarString

from campaigns.errors import ConfigInvalid
from campaigns.files.text_file import read_text
from campaigns.files.wording import shown, suggestion
from campaigns.removed import drop_former_defaults, removed_in_file
from drivers.bounded_files import FileRefused, bounded, loaded_yaml

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
    "string_pattern_mismatch": "is {input}, which is not valid here",
    BROKEN_RULE: "{message}",
}
"""Words by pydantic's name of the finding; the finding itself fills the braces."""


def broken_rule(message: str) -> PydanticCustomError:
    """Return a finding for a validator to raise; the message states value and limit."""
    return PydanticCustomError(BROKEN_RULE, "{message}", {"message": message})


def _check_rising(interval: tuple[float, float]) -> tuple[float, float]:
    if interval[0] < interval[1]:
        return interval
    raise broken_rule(f"is {list(interval)}, the lowest must be below the highest")


RISING = AfterValidator(_check_rising)
Place = Annotated[float, Field(ge=-100_000.0, le=100_000.0)]
Length = Annotated[float, Field(gt=0.0, le=100_000.0)]
Point = tuple[Place, Place, Place]
PlaceRange = Annotated[tuple[Place, Place], RISING]


def explained(
    error: ValidationError, model: type[BaseModel], name: str, tree: CommentedMap | None = None
) -> ConfigInvalid:
    """Return the error for the finding to correct first, with its line in the tree.

    Without a tree, `name` alone states where the contents are from.
    """
    # A misspelt key gives two findings: one key is missing, another unknown. The unknown one
    # comes first, because its remedy can suggest the right spelling.
    findings = error.errors(include_url=False)
    first = min(findings, key=lambda finding: finding["type"] != "extra_forbidden")
    where = name if tree is None else f"{name}:{_line(tree, first['loc'])}"
    more = f" (and {len(findings) - 1} more)" if len(findings) > 1 else ""
    invalid = ConfigInvalid(f"{where}: {_problem(first)}{more}", remedy=_remedy(first, model))
    if issubclass(model, FileModel):
        invalid.page = model.page
    return invalid


def key_path(location: Location) -> str:
    """Write a place as `geometry.arms[2].forearm_mm`."""
    parts = (f"[{part}]" if isinstance(part, int) else f".{shown(part)}" for part in location)
    return "".join(parts).removeprefix(".")


def _problem(error: ErrorDetails) -> str:
    words = WORDS.get(error["type"], "is {input}: {message}")
    text = shown(json.dumps(error["input"], ensure_ascii=False, default=str))
    value = "empty" if error["input"] is None else text
    details = {"input": value, "message": error["msg"], **error.get("ctx", {})}
    return f"{key_path(error['loc'])} {words.format_map(details)}".strip()


def _remedy(error: ErrorDetails, model: type[BaseModel]) -> str:
    if instead := removed_in_file(key_path(error["loc"]), error["input"]):
        return instead
    steps = [*_fields_towards(model, error["loc"])]
    if error["type"] == "extra_forbidden":
        key, keys = steps[-1]
        if key.isdecimal():  # {arm_mm: 350,5} holds a key 5
            return "write a decimal point, not a comma"
        return suggestion(key, tuple(keys))
    for key, fields in reversed(steps):
        if key in fields and fields[key].description:
            return f"give {fields[key].description}"
    return "correct the value"


# The path of a finding (`geometry`, `arms`, 2, `forearm_mm`) is followed through the types: a key
# leads to the type of that field, a number to the type of that entry of a tuple. Where a type is no
# model, as in a dictionary of free keys, there are no fields to suggest.
def _fields_towards(
    annotation: object, location: Location
) -> Iterator[tuple[str, Mapping[str, FieldInfo]]]:
    """Yield each key of a place, with the fields of the model in which it should stand."""
    for key in location:
        fields = fields_of(annotation)
        yield str(key), fields
        field, entries = fields.get(str(key)), get_args(annotation)
        if field is not None:
            annotation = field.annotation
        elif isinstance(key, int) and entries:  # of a tuple, `tuple[X, ...]` or `tuple[X, Y, Z]`
            annotation = entries[0 if entries[-1] is Ellipsis else min(key, len(entries) - 1)]
        else:
            annotation = None


def _line(tree: CommentedMap, location: Location) -> int:
    """Return the line, from 1, of a place, or of the mapping from which the place is missing."""
    # ruamel keeps in `lc.data` the line and column, from 0, of each key or entry of a node
    node: Any = tree  # a tree of ruamel's: mappings, lists, and anything as leaves
    line = 0
    for key in location:
        if not isinstance(node, CommentedMap | CommentedSeq) or key not in (node.lc.data or {}):
            break
        line, node = node.lc.data[key][0], node[key]
    return line + 1


def fields_of(annotation: object) -> Mapping[str, FieldInfo]:
    """Return a model's fields, also of an optional model; none for any other type."""
    choices = get_args(annotation)
    model = choices[0] if NoneType in choices else annotation
    return model.model_fields if isinstance(model, type) and issubclass(model, BaseModel) else {}


class FileModel(BaseModel):
    """Contents of a file: nothing unknown, nothing converted, no NaN; fixed once read.

    The `description` of a field is a noun phrase; it becomes the comment in a new file and, after
    "give", the remedy of an error.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)
    page: ClassVar[str] = ""
    """Page and heading of the documentation that explain the file's keys."""


Model = TypeVar("Model", bound=FileModel)


@dataclass(frozen=True, slots=True)
class YamlDocument:
    """A YAML mapping: the text as it was read, and its tree, which is not to be edited.

    `name` is the file's, for messages.
    """

    name: str
    text: str
    tree: CommentedMap

    def place_of(self, key: str) -> str:
        """Return the file's name and the line of a key of the outermost mapping."""
        return f"{self.name}:{self.tree.lc.key(key)[0] + 1}"

    def editable_tree(self) -> CommentedMap:
        """Return a separate tree with all comments; a deep copy of a tree loses some of them."""
        tree = loaded_yaml(_yaml(), self.text, self.name)
        assert isinstance(tree, CommentedMap), "as it was when it was read"
        return tree


def read_document(path: Path, *, if_missing: str) -> YamlDocument:
    """Read a YAML file; `if_missing` is the remedy when the file does not exist."""
    return parse_document(read_text(path, ConfigInvalid, if_missing=if_missing), str(path))


def parse_document(text: str, name: str) -> YamlDocument:
    """Read a YAML text that must be a mapping."""
    try:
        tree = _shared_tree(text)
    except FileRefused as error:  # its problem begins with the name, which is empty there
        raise ConfigInvalid(f"{name}{error.problem}", remedy=error.remedy) from error
    if tree is None:
        raise ConfigInvalid(f"{name}: is empty", remedy="write the file anew or restore it")
    if not isinstance(tree, CommentedMap):
        raise ConfigInvalid(
            f"{name}: holds no keys with values", remedy="begin with a line such as 'name: VALUE'"
        )
    return YamlDocument(name, text, tree)


def yaml_text(tree: CommentedMap) -> str:
    """Write a tree as the text of a file, comments included."""
    stream = io.StringIO()
    _yaml().dump(tree, stream)
    return stream.getvalue()


def checked(document: YamlDocument, schema: str, model: type[Model]) -> Model:
    """Check a document against its schema, such as `pkmcal/robot/1`, and return its contents."""
    _check_schema(document, schema)
    try:
        return model.model_validate_json(_plain_json(document))
    except ValidationError as error:
        raise explained(error, model, document.name, document.tree) from error


# A command reads its campaign's files several times: `status` of a finished campaign takes 1.0 s,
# without this 1.3 s. The tree is shared, so no one may change it: `editable_tree` makes another.
@lru_cache(maxsize=16)
def _shared_tree(text: str) -> object:
    """Parse a text that was not parsed lately; raise `FileRefused`, which names no file."""
    return loaded_yaml(_yaml(), text, name="")


def _yaml() -> YAML:
    yaml = bounded(YAML())
    yaml.preserve_quotes = True
    yaml.width = 4096  # long texts stay on their line
    yaml.indent(mapping=2, sequence=4, offset=2)
    return yaml


def _plain_json(document: YamlDocument) -> str:
    """Return the tree without the schema, as JSON."""
    # A strict model takes from Python only a tuple for a tuple and a date for a date. From JSON it
    # takes a list and a text in ISO 8601, which is what a YAML file holds; `default=str` writes the
    # dates that the loader has made back into such texts.
    try:
        contents = json.loads(json.dumps(document.tree, default=str))
        contents.pop("schema", None)
        drop_former_defaults(contents)
        return json.dumps(contents)
    except (TypeError, ValueError, RecursionError) as error:
        raise ConfigInvalid(
            f"{document.name}: holds more than plain keys, lists and values ({error})",
            remedy="write it without compound keys",
        ) from error


def _check_schema(document: YamlDocument, wanted: str) -> None:
    schema = document.tree.get("schema")
    if schema == wanted:
        return
    if schema is None:
        raise ConfigInvalid(
            f"{document.name}:1: schema is missing", remedy=f"begin with 'schema: {wanted}'"
        )
    # another kind of file, a version of the future, or neither: each has its own remedy
    kind, _, version = wanted.rpartition("/")
    remedy = f"write 'schema: {wanted}'"
    if not str(schema).startswith(f"{kind}/"):
        remedy = f"give a {kind} file here"
    elif (number := re.search(r"/(\d{1,9})$", str(schema))) and int(number[1]) > int(version):
        remedy = "a newer pkmcal wrote the file: update this one"
    raise ConfigInvalid(
        f"{document.place_of('schema')}: schema is '{shown(str(schema))}', must be '{wanted}'",
        remedy=remedy,
    )


def commented_yaml(schema: str, settings: FileModel, usual: Collection[str] | None = None) -> str:
    """Write the keys of the settings, each below its description.

    With `usual` only these keys, such as `plan.shots`, and all that are not at their defaults.
    """
    tree = CommentedMap(schema=schema)
    _add(tree, settings, usual)
    return yaml_text(tree)


def _add(
    tree: CommentedMap, settings: FileModel, usual: Collection[str] | None, above: str = ""
) -> None:
    column = 2 * above.count(".")
    for name, field in type(settings).model_fields.items():
        key, value = above + name, getattr(settings, name)
        if usual is not None and not _is_written(key, value, field, usual):
            continue
        tree[name] = _value(value, usual, f"{key}.")
        gap = "\n" if column == 0 else ""
        tree.yaml_set_comment_before_after_key(
            name, before=f"{gap}{field.description}", indent=column
        )


def _is_written(key: str, value: object, field: FieldInfo, usual: Collection[str]) -> bool:
    """Return whether a key is usual, or a section with a usual key, or not at its default."""
    is_usual = any(word == key or word.startswith(f"{key}.") for word in usual)
    default = field.get_default(call_default_factory=True) if not field.is_required() else ...
    return is_usual or value != default


def _value(value: object, usual: Collection[str] | None, above: str) -> object:
    if isinstance(value, FileModel):
        section = CommentedMap()
        _add(section, value, usual, above)
        return section
    if isinstance(value, tuple) and any(isinstance(entry, FileModel) for entry in value):
        rows = CommentedSeq(CommentedMap(entry.model_dump(mode="json")) for entry in value)
        for row in rows:  # of many alike each is on one line, without comments
            row.fa.set_flow_style()
        return rows
    if isinstance(value, tuple):
        entries = CommentedSeq(value)
        entries.fa.set_flow_style()
        return entries
    if isinstance(value, str) and not value.isprintable():
        return DoubleQuotedScalarString(value)  # with escapes, so that no sign gets lost
    return value
