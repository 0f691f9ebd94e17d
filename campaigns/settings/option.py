"""Options of a step of the work: one field for each, whose annotation holds its words and limits.

A step such as planning has a dataclass of options. A field is annotated with its type and an
`Option`: help text, limits, how its text is read. From this one place come the options of the
command line (`app/options.py`), the checks of the Python API (`options_of`), and the words that an
identification keeps in its record to say how it was asked for (`typed_words`). So a command and the
API accept and refuse equal values, with equal remedies.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
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
    """Placeholder of the value in the help; None: the name of the type."""
    least: float | None = None
    most: float | None = None
    read: Callable[[str], object] | None = None
    """Converts a typed word to the value; raises `OptionsInvalid`."""
    typed: str | None = None
    """Default as it is typed, for an option with `read`."""
    name: str = ""
    """Name on the command line; empty: the field's name with dashes."""
    default: str | None = None
    """Words for the default in the help, where the default is None."""
    words: Callable[[], Iterable[str]] | None = None
    """Words that the shell completes by Tab."""


def options_of(kind: type[Options], words: Mapping[str, object]) -> Options:
    """Make options from values, or from words as on the command line, by their fields' names.

    Raise `OptionsInvalid` for an unknown name, listing the accepted ones, and for a wrong value.
    """
    hints = get_type_hints(kind, include_extras=True)
    names = [field.name for field in fields(kind)]
    for name in words:
        if name not in names:
            remedy = suggestion(name, names)
            raise OptionsInvalid(f"'{shown(name)}' is not an option", remedy=remedy)
    return kind(**{name: _value_of(name, hints[name], value) for name, value in words.items()})


def options_of_words(kind: type[Options], words: Sequence[str]) -> Options:
    """Make options from typed words, each option at most once; words of no option are passed over.

    Raise `OptionsInvalid` for a wrong value.
    """
    values = dict[str, object]()
    for name, hint in get_type_hints(kind, include_extras=True).items():
        option = getattr(hint, "__metadata__", (None,))[-1]
        typed = isinstance(option, Option) and (option.name or _typed_name(name))
        if typed and typed in words:
            is_flag = get_args(hint)[0] is bool
            values[name] = True if is_flag else words[words.index(typed) + 1]
    return options_of(kind, values)


def _typed_name(field: str) -> str:
    """Return the name on the command line of an option that states none."""
    return f"--{field.replace('_', '-')}"


def _value_of(name: str, hint: Any, value: object) -> object:
    """Return an option's value for a word or a value; fields without an `Option` stay unchecked."""
    option = getattr(hint, "__metadata__", (None,))[-1]
    if not isinstance(option, Option):
        return value
    if isinstance(value, str) and option.read is not None:
        return option.read(value)
    typed = get_args(hint)[0]
    # a single name stands for a tuple of one, not for the tuple of its letters
    if isinstance(value, str) and get_origin(typed) is tuple:
        value = (value,)
    return checked(typed, value, name)


def checked(kind: type[Value], value: object, name: str) -> Value:
    """Return the value of this type for a word or a value; raise `OptionsInvalid`."""
    try:
        return TypeAdapter(kind).validate_python(value)
    except ValidationError as error:
        problem = f"{name} is {shown(repr(value))}"
        raise OptionsInvalid(problem, remedy=remedy_for(error.errors()[0])) from error


def remedy_for(error: Mapping[str, Any]) -> str:
    """Return what to give instead of a value that pydantic refused with this error.

    Any: values of the error's context are of various types.
    """
    # pydantic lists the choices of a Literal or enumeration in `expected`, click at the end of its
    # message; both as "'a', 'b' or 'c'"
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
    """Return the words of all options that differ from their defaults, as a user types them."""
    hints, words = get_type_hints(type(options), include_extras=True), list[str]()
    for field in fields(options):
        option, value = getattr(hints[field.name], "__metadata__", (None,))[-1], None
        if isinstance(option, Option):
            value = getattr(options, field.name)
        if isinstance(option, Option) and value != field.default and value is not None:
            name = option.name or _typed_name(field.name)
            # a tuple is an option given several times, unless a text such as 10-20 is read as one
            values = value if isinstance(value, tuple) and option.read is None else (value,)
            words += [name] if value is True else [w for v in values for w in (name, _type(v))]
    return words


def _type(value: object) -> str:
    """Return a value as a user types it; a range of shots or pairs as first and last."""
    if isinstance(value, tuple):
        return "-".join("" if end is None else str(end) for end in value)
    return str(value.value if isinstance(value, Enum) else value)
