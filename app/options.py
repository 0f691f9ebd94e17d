"""Arguments and options that several commands share, worded once; options objects as options."""

import inspect
from collections.abc import Callable
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from types import GenericAlias
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import typer

from campaigns.errors import OptionsInvalid
from campaigns.settings.option import Option

EMPTY = inspect.Parameter.empty
NOTES = "__annotations__"
PICTURES = (".svg", ".png", ".pdf")
Folder = Annotated[
    Path,
    typer.Argument(
        metavar="DIR",
        help="The campaign's folder; default: the current one.",
        default_factory=Path,
        show_default=False,
    ),
]
NewFolder = Annotated[Path, typer.Argument(metavar="DIR", help="The campaign's folder.")]
Json = Annotated[
    bool,
    typer.Option(
        "--json",
        help='One JSON document on stdout, messages on stderr; {"error": …} when it fails.',
    ),
]
Yes = Annotated[
    bool, typer.Option("--yes", "-y", help="Do not ask whether the cell is clear: it is.")
]
Port = Annotated[int, typer.Option(min=0, max=65535, metavar="N", help="0: any free one.")]
Dry = Annotated[bool, typer.Option("--dry", help="Show what would happen, and do nothing.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace the file if it exists.")]
Anew = Annotated[
    bool, typer.Option("--anew", help="Start a new series instead of resuming an unfinished one.")
]

Plain = Annotated[
    bool, typer.Option("--plain", help="Print lines instead of the screen; keys do nothing.")
]


def folder_and_file(first: Path, second: Path | None) -> tuple[Path, Path]:
    """The campaign's folder and a file of what was typed: one argument alone is the file.

    Raises `OptionsInvalid` where no file was named.
    """
    if second is not None:
        return first, second
    if first.is_dir():
        raise OptionsInvalid("FILE is missing", remedy="name the file to read")
    return Path(), first


def picture_file(path: Path | None) -> Path | None:
    """Refuse at once what could not be written at the end."""
    if path is not None and path.suffix.lower() not in PICTURES:
        raise OptionsInvalid(
            f"--plot {path}: the name of a picture ends in {', '.join(PICTURES)}",
            remedy="let it end in one of them",
        )
    return path


Plot = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="Also draw a picture: .svg, .png or .pdf.", callback=picture_file
    ),
]
Seed = Annotated[
    int | None, typer.Option(min=0, metavar="N", help="Seed, instead of the scenario's.")
]


def expanded(command: Callable[..., None]) -> Callable[..., None]:
    """The command as Typer reads it: with every `Option` of it and of its options objects.

    Any: what an option holds is checked by Typer, when it is typed.
    """
    signature, hints = inspect.signature(command), get_type_hints(command, include_extras=True)
    kinds = {name: _options_of(kind) for name, kind in hints.items() if is_dataclass(kind)}
    singles = {name: hint for name, hint in hints.items() if isinstance(_words(hint), Option)}
    parameters: list[inspect.Parameter] = []
    for name, each in signature.parameters.items():
        if name in kinds:
            defaults = {own.name: own.default for own in fields(hints[name])}
            parameters += [_offered(own, kinds[name][own], defaults[own]) for own in kinds[name]]
        elif name in singles:
            parameters.append(_offered(name, singles[name], each.default))
        else:
            parameters.append(each.replace(annotation=hints[name]))

    def called(**given: Any) -> None:
        for name, options in kinds.items():
            typed = {own: given.pop(own) for own in options}
            given[name] = hints[name](
                **{
                    own: _value(options[own], value)
                    for own, value in typed.items()
                    if value is not None  # it was not given: the options object knows its default
                }
            )
        given |= {name: _value(hint, given[name]) for name, hint in singles.items()}
        command(**given)

    called.__doc__ = command.__doc__
    called.__annotations__ = {each.name: each.annotation for each in parameters}
    called.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined] # inspect looks for it
    return called


def _options_of(kind: Any) -> dict[str, Any]:
    """Annotations of the options by their fields' names; those of the class itself first."""
    hints = get_type_hints(kind, include_extras=True)
    names = dict.fromkeys(name for base in kind.__mro__ for name in vars(base).get(NOTES, ()))
    return {name: hints[name] for name in names if isinstance(_words(hints[name]), Option)}


def _words(hint: Any) -> Any:
    return getattr(hint, "__metadata__", (None,))[-1]


def _offered(name: str, hint: Any, default: Any) -> inspect.Parameter:
    """Parameter for an option."""
    option, typed = _words(hint), get_args(hint)[0]
    if option.read is not None:
        default, typed = option.typed, str
    elif get_origin(typed) is tuple:
        default, typed = None, GenericAlias(list, get_args(typed)[0])
    words = typer.Option(
        option.name or f"--{name.replace('_', '-')}",
        help=option.help,
        metavar=option.metavar,
        min=option.least,
        max=option.most,
        show_default=option.default or True,
    )
    default = EMPTY if default is MISSING else default
    annotation = Annotated[typed, words]  # type: ignore[valid-type] # known only when it runs
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation
    )


def _value(hint: Any, given: Any) -> Any:
    """Value of what was typed."""
    if (read := _words(hint).read) is not None:
        return read(given)
    return tuple(given or ()) if get_origin(get_args(hint)[0]) is tuple else given
