"""Identifications with other values of some fields, whichever parts the fields belong to."""

from dataclasses import fields, replace
from typing import TypeVar

from campaigns.identification.result import IdentificationResult

ResultT = TypeVar("ResultT", bound=IdentificationResult)


def with_fields(result: ResultT, **values: object) -> ResultT:
    """The same result with these fields; a name that no part has is refused."""
    parts = {}
    for part in fields(result):
        content = getattr(result, part.name)
        names = {field.name for field in fields(content)} & {*values}
        parts[part.name] = replace(content, **{name: values.pop(name) for name in names})
    assert not values, f"no part has {', '.join(values)}"
    return replace(result, **parts)
