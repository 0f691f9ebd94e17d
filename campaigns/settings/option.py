"""Options of a step of the work: a field each, whose annotation says how a command offers it."""

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, fields
from enum import Enum
from typing import TYPE_CHECKING, get_type_hints

from campaigns.errors import OptionsInvalid

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


@dataclass(frozen=True, slots=True)
class Option:
    """Words and limits of an option on the command line."""

    help: str
    metavar: str | None = None
    """Stands for the value; None: as its type is called."""
    least: float | None = None
    most: float | None = None
    read: Callable[[str], object] | None = None
    """Makes the value of what is typed; raises `OptionsInvalid`."""
    typed: str | None = None
    """What stands for the default where the value is read."""
    name: str = ""
    """Name, if not the field's."""
    default: str | None = None
    """What is said of the default where None stands for it."""


def typed_words(options: "DataclassInstance", names: Collection[str] | None = None) -> list[str]:
    """Words of options that are not as they are by default, all or the named ones, as typed."""
    hints, found = get_type_hints(type(options), include_extras=True), list[str]()
    for each in fields(options):
        option, value = getattr(hints[each.name], "__metadata__", (None,))[-1], None
        if isinstance(option, Option) and (names is None or each.name in names):
            value = getattr(options, each.name)
        if isinstance(option, Option) and value != each.default and value is not None:
            name = option.name or f"--{each.name.replace('_', '-')}"
            values = value if isinstance(value, tuple) and option.read is None else (value,)
            found += [name] if value is True else [w for v in values for w in (name, _typed(v))]
    return found


def _typed(value: object) -> str:
    """A value as it is typed; a range by its ends."""
    if isinstance(value, tuple):
        return "-".join("" if end is None else str(end) for end in value)
    return str(value.value if isinstance(value, Enum) else value)


def require_finite(option: str, value: float) -> None:
    """Raise `OptionsInvalid` for what is no number that can be meant."""
    if not math.isfinite(value):
        raise OptionsInvalid(f"{option} is {value}", remedy="give a finite number")
