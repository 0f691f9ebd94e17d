"""Options of a step of the work: a field each, whose annotation says how a command offers it."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields
from enum import Enum
from typing import TYPE_CHECKING, Any, TypeVar, get_args, get_origin, get_type_hints

from pydantic import TypeAdapter, ValidationError

from campaigns.errors import OptionsInvalid
from campaigns.files.wording import shown, suggestion

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Options = TypeVar("Options", bound="DataclassInstance")
Value = TypeVar("Value")


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
    words: Callable[[], Iterable[str]] | None = None
    """Words that the shell completes by Tab."""


def options_of(kind: type[Options], words: Mapping[str, object]) -> Options:
    """Make options from values, or from words as on the command line, by their fields' names.

    Raises `OptionsInvalid` for an unknown name, naming the known ones, and for an unknown value.
    """
    hints, names = get_type_hints(kind, include_extras=True), [each.name for each in fields(kind)]
    for name in words:
        if name not in names:
            remedy = suggestion(name, names)
            raise OptionsInvalid(f"'{shown(name)}' is not an option", remedy=remedy)
    return kind(**{name: _value_of(name, hints[name], value) for name, value in words.items()})


def _value_of(name: str, hint: Any, value: object) -> object:
    """Return an option's value for a word or a value; what is no `Option` stays as it is."""
    option = getattr(hint, "__metadata__", (None,))[-1]
    if not isinstance(option, Option):
        return value
    if isinstance(value, str) and option.read is not None:
        return option.read(value)
    typed = get_args(hint)[0]
    if isinstance(value, str) and get_origin(typed) is tuple:
        value = (value,)
    return checked(typed, value, name)


def checked(kind: type[Value], value: object, name: str) -> Value:
    """Return the value of this type for a word or a value; raises `OptionsInvalid`."""
    try:
        return TypeAdapter(kind).validate_python(value)
    except ValidationError as error:
        problem = f"{name} is {shown(repr(value))}"
        raise OptionsInvalid(problem, remedy=remedy_for(error.errors()[0])) from error


def remedy_for(error: Mapping[str, Any]) -> str:
    """Return what to give instead of a value that pydantic refused with this error.

    Any: values of the error's context are of various types.
    """
    kind, context = str(error["type"]), error.get("ctx", {})
    choices = str(context.get("expected") or error["msg"].partition(" is not one of ")[2])
    if choices:
        *others, last = choices.replace("'", "").rstrip(".").replace(" or ", ", ").split(", ")
        return f"use {', '.join(others)} or {last}" if others else f"use {last}"
    kinds = {
        "int": "give a whole number",
        "float": "give a number",
        "bool": "use True or False",
        "tuple": "give a name or a list of names",
        "greater": f"give {context.get('ge')} or more",
        "less": f"give {context.get('le')} or less",
    }
    return kinds.get(kind.partition("_")[0], str(error["msg"]).lower())


def typed_words(options: "DataclassInstance") -> list[str]:
    """Words of options that are not as they are by default, as typed."""
    hints, words = get_type_hints(type(options), include_extras=True), list[str]()
    for field in fields(options):
        option, value = getattr(hints[field.name], "__metadata__", (None,))[-1], None
        if isinstance(option, Option):
            value = getattr(options, field.name)
        if isinstance(option, Option) and value != field.default and value is not None:
            name = option.name or f"--{field.name.replace('_', '-')}"
            values = value if isinstance(value, tuple) and option.read is None else (value,)
            words += [name] if value is True else [w for v in values for w in (name, _typed(v))]
    return words


def _typed(value: object) -> str:
    """Write a value as it is typed; a range by its ends."""
    if isinstance(value, tuple):
        return "-".join("" if end is None else str(end) for end in value)
    return str(value.value if isinstance(value, Enum) else value)
