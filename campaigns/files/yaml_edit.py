"""Changes of single keys in a YAML file that people wrote: every other line stays as it is.

A tree that is written again would move comments: a comment above a key belongs, to the loader, to
the end of the key before. So the text is edited by lines. The tree says in which lines a key and
its value stand; those are replaced, and a new key is put where the file's model has it, below its
description.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic.fields import FieldInfo
from ruamel.yaml.comments import CommentedMap

from campaigns.files.yaml_file import FileModel, YamlDocument, fields_of, parse_document, yaml_text


def with_key(
    document: YamlDocument, model: type[FileModel], key: Sequence[str], value: object
) -> YamlDocument:
    """Return the document with a key, named by the keys towards it, set to a value.

    The result is not checked against the model. Raise `ConfigInvalid` if it is no YAML any more.
    """
    # 1. go down as far as there are sections of several lines; what is deeper is one new value
    tree: Any = document.tree
    fields: Mapping[str, FieldInfo] = model.model_fields
    path = [*key]
    while len(path) > 1 and _is_block(tree.get(path[0])):
        tree, fields = tree[path[0]], fields_of(getattr(fields.get(path[0]), "annotation", None))
        path.pop(0)
    name, *deeper = path
    for step in reversed(deeper):
        value = {step: value}
    if deeper and isinstance(tree.get(name), Mapping):  # a section in { } stays on its line
        value = _merged(tree[name], value)
    # 2. replace its lines, or put new ones where the model has the key
    lines = document.text.splitlines(keepends=True)
    column = tree.lc.col
    if name in tree:
        first = tree.lc.key(name)[0]
        last = _end(lines, first, column)
        comment = _comment(tree, name) if last == first + 1 else ""
        new = _lines(name, value, column, comment)
    else:
        first = last = _place(lines, tree, name, [*fields])
        described = getattr(fields.get(name), "description", None)
        head = [f"{' ' * column}# {described}\n"] if described else []
        new = ["\n" if column == 0 else "", *head, *_lines(name, value, column, "")]
        if first and not lines[first - 1].endswith("\n"):
            lines[first - 1] += "\n"
    text = "".join([*lines[:first], *new, *lines[last:]])
    return parse_document(text, document.name)


def _is_block(section: object) -> bool:
    """Return whether a value is a mapping with each key on a line of its own."""
    return isinstance(section, CommentedMap) and bool(section) and not section.fa.flow_style()


def _merged(old: Mapping[str, object], new: object) -> object:
    """Return a mapping with the keys of another one; at each depth the new value counts."""
    if not isinstance(new, Mapping):
        return new
    merged = CommentedMap(old)
    for key, value in new.items():
        below = old.get(key)
        merged[key] = _merged(below, value) if isinstance(below, Mapping) else value
    merged.fa.set_flow_style()
    return merged


def _lines(name: str, value: object, column: int, comment: str) -> list[str]:
    """Return the lines of a key with its value, beginning at a column."""
    lines = yaml_text(CommentedMap({name: value})).splitlines(keepends=True)
    lines = [" " * column + line for line in lines]
    if comment:
        lines[-1] = f"{lines[-1].rstrip()}  {comment}\n"
    return lines


def _end(lines: Sequence[str], first: int, column: int) -> int:
    """Return the number behind the last line of the value of a key that begins at a line."""
    # deeper lines belong to it, and a list may begin at the key's own column; comments and empty
    # lines behind the last of them explain what follows
    end = first + 1
    for number, line in enumerate(lines[first + 1 :], first + 1):
        words = line.strip()
        if not words or words.startswith("#"):
            continue
        indent = len(line) - len(line.lstrip())
        if indent < column or (indent == column and not words.startswith("- ")):
            break
        end = number + 1
    return end


def _place(lines: Sequence[str], tree: CommentedMap, name: str, names: Sequence[str]) -> int:
    """Return the number of the line before which a new key belongs, by the order of `names`."""
    # behind the nearest key before it in that order; the first line is that of the schema
    before = names[: names.index(name)] if name in names else names
    there = [key for key in before if key in tree] or [*tree][:1]
    return _end(lines, tree.lc.key(there[-1])[0], tree.lc.col)


def _comment(tree: CommentedMap, name: str) -> str:
    """Return the comment behind a value on its line; "" without one."""
    tokens = tree.ca.items.get(name) or [None] * 3
    text = tokens[2].value if tokens[2] is not None else ""
    match = re.match(r"#[^\n]*", text)
    return match[0] if match else ""
