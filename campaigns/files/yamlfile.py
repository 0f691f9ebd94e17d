"""The one way to read and write YAML (1.2): comments and line numbers kept, contents checked.

Whatever is wrong with a file raises `ConfigInvalid`: one line that names the place and the way out.
"""

import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from campaigns.errors import ConfigInvalid
from campaigns.files.textfile import read_text
from campaigns.files.wording import shown
from campaigns.files.yaml_explanation import explained

UNBROKEN_LINE = 4096
"""Columns; long texts stay on their line."""


class FileModel(BaseModel):
    """What a file may hold: nothing unknown, nothing converted, no NaN; fixed once read.

    The `description` of a field is a noun phrase; it becomes the file's comment and the remedy.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


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
        """Return a tree of one's own, comments and all; a deep copy of a tree loses some."""
        return parse_document(self.text, self.name).tree


def read_document(path: Path, *, if_missing: str) -> YamlDocument:
    """Read a YAML file; `if_missing` is the remedy when there is none."""
    return parse_document(read_text(path, ConfigInvalid, if_missing=if_missing), str(path))


def parse_document(text: str, name: str) -> YamlDocument:
    """Read a YAML text that must be a mapping."""
    tree = _loaded(text, name)
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
    """Check the document against its schema, such as `pkmcal/robot/1`, and return what it holds."""
    _check_schema(document, schema)
    try:
        return model.model_validate_json(_plain_json(document))
    except ValidationError as error:
        raise explained(error, model, document.name, document.tree) from error


def checked_settings(settings: Mapping[str, object], name: str, model: type[Model]) -> Model:
    """Check what was not read from a file but said otherwise; `name` says where, for messages."""
    try:
        return model.model_validate_json(json.dumps(settings))
    except ValidationError as error:
        raise explained(error, model, name) from error


def _loaded(text: str, name: str) -> object:
    try:
        tree: object = _yaml().load(text)
    except MarkedYAMLError as error:
        raise _not_yaml(error, name) from error
    except (YAMLError, ValueError) as error:
        problem = " ".join(str(error).split())
        raise ConfigInvalid(f"{name}: is not YAML: {problem}", remedy="correct the file") from error
    except (AssertionError, AttributeError, LookupError, RecursionError) as error:
        # what ruamel lets slip on unusual tags and directives, found by feeding it garbage
        raise ConfigInvalid(
            f"{name}: has tags, directives or nesting that cannot be read",
            remedy="write plain keys, lists and values",
        ) from error
    return tree


def _yaml() -> YAML:
    yaml = YAML()
    yaml.composer.warn_double_anchors = False
    yaml.preserve_quotes = True
    yaml.width = UNBROKEN_LINE
    yaml.indent(mapping=2, sequence=4, offset=2)
    return yaml


def _not_yaml(error: MarkedYAMLError, name: str) -> ConfigInvalid:
    mark = error.problem_mark or error.context_mark
    where = f"{name}:{mark.line + 1}" if mark else name
    problem = " ".join(str(error.problem or error.context).split())
    if "duplicate key" in problem:
        return ConfigInvalid(f"{where}: {problem}", remedy="keep one of the two")
    return ConfigInvalid(
        f"{where}: is not YAML: {problem}", remedy="correct the line, or the one before it"
    )


def _plain_json(document: YamlDocument) -> str:
    """Return the tree without the schema, as JSON: there a list is a list and a number a number."""
    contents = {key: value for key, value in document.tree.items() if key != "schema"}
    try:
        return json.dumps(contents, default=str)
    except (TypeError, ValueError, RecursionError) as error:
        raise ConfigInvalid(
            f"{document.name}: holds more than plain keys, lists and values ({error})",
            remedy="write it without compound keys",
        ) from error


def _check_schema(document: YamlDocument, wanted: str) -> None:
    found = document.tree.get("schema")
    if found == wanted:
        return
    if found is None:
        raise ConfigInvalid(
            f"{document.name}:1: schema is missing", remedy=f"begin with 'schema: {wanted}'"
        )
    raise ConfigInvalid(
        f"{document.place_of('schema')}: schema is '{shown(str(found))}', must be '{wanted}'",
        remedy=_schema_remedy(str(found), wanted),
    )


def _schema_remedy(found: str, wanted: str) -> str:
    kind, _, version = wanted.rpartition("/")
    found_kind, _, found_version = found.rpartition("/")
    if found_kind != kind:
        return f"give a {kind} file here"
    if found_version.isdecimal() and int(found_version) > int(version):
        return "a newer pkmcal wrote the file: update this one"
    return f"write 'schema: {wanted}'"
