"""Arguments and options that several commands share, worded once; options objects as options."""

import inspect
from collections.abc import Callable, Iterable
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from types import GenericAlias
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import typer

from app.console import Terminal
from campaigns.campaign import Campaign, open_campaign
from campaigns.errors import OptionsInvalid
from campaigns.settings.option import Option

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
Force = Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")]
Anew = Annotated[
    bool, typer.Option("--anew", help="Start a new series instead of resuming an unfinished one.")
]

Plain = Annotated[
    bool, typer.Option("--plain", help="Print lines instead of the screen; keys do nothing.")
]


def folder_and_file(first: Path, second: Path | None) -> tuple[Path, Path]:
    """Return the campaign's folder and a file by what was typed: a single argument is the file.

    Raises `OptionsInvalid` where no file was named.
    """
    if second is not None:
        return first, second
    if first.is_dir():
        raise OptionsInvalid("FILE is missing", remedy="name the file to read")
    return Path(), first


def picture_file(path: Path | None) -> Path | None:
    """Return the path of a picture; raise `OptionsInvalid` for an unknown kind of file."""
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


def completed(words: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """Return what completes an option by those of the words that begin as what was typed."""
    return lambda incomplete: [word for word in words() if word.startswith(incomplete)]


def expanded(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command as Typer reads it.

    In place of a `Terminal` it takes the context and --json, of a `Campaign` the folder, and of an
    options object, a dataclass, an option for each field that is annotated with an `Option`.

    Any: Typer checks what an option holds when it is typed.
    """
    hints = get_type_hints(command, include_extras=True)
    objects = {
        name: _options_of(kind)
        for name, kind in hints.items()
        if is_dataclass(kind) and kind is not Campaign
    }
    parameters: list[inspect.Parameter] = []
    for name, parameter in inspect.signature(command).parameters.items():
        if hints[name] is Terminal:
            parameters.append(_parameter("context", typer.Context))
        elif hints[name] is Campaign:
            parameters.append(_parameter("folder", Folder))
        elif name in objects:
            defaults = {field.name: field.default for field in fields(hints[name])}
            parameters += [
                _parameter(option, *_typed(option, hint, defaults[option]))
                for option, hint in objects[name].items()
            ]
        else:
            parameters.append(_parameter(name, hints[name], parameter.default))
    if Terminal in hints.values():
        parameters.append(_parameter("as_json", Json, default=False))

    def called(**given: Any) -> None:
        if "terminal" in hints:
            context = given.pop("context")
            given["terminal"] = Terminal(
                as_json=given.pop("as_json"),
                verbose=context.obj is True,
                command=context.info_name or "",
            )
        for name, options in objects.items():
            typed = {option: given.pop(option) for option in options}
            given[name] = hints[name](
                **{
                    option: _value(options[option], value)
                    for option, value in typed.items()
                    if value is not None  # it was not given: the options object has its default
                }
            )
        if "campaign" in hints:
            given["campaign"] = open_campaign(given.pop("folder"))
        command(**given)

    called.__doc__ = command.__doc__
    called.__annotations__ = {each.name: each.annotation for each in parameters}
    called.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined] # inspect looks for it
    return called


def _parameter(
    name: str, annotation: Any, default: object = inspect.Parameter.empty
) -> inspect.Parameter:
    default = inspect.Parameter.empty if default is MISSING else default
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation
    )


def _options_of(kind: Any) -> dict[str, Any]:
    """Return annotations of the options by field; those of the class itself before inherited."""
    hints = get_type_hints(kind, include_extras=True)
    names = (name for base in kind.__mro__ for name in vars(base).get("__annotations__", ()))
    return {name: hints[name] for name in names if isinstance(_option_of(hints[name]), Option)}


def _option_of(hint: Any) -> Any:
    return getattr(hint, "__metadata__", (None,))[-1]


def _typed(name: str, hint: Any, default: Any) -> tuple[Any, Any]:
    """Return what Typer is to read for an option, and its default."""
    option, kind = _option_of(hint), get_args(hint)[0]
    if option.read is not None:
        default, kind = option.typed, str
    elif get_origin(kind) is tuple:
        default, kind = None, GenericAlias(list, get_args(kind)[0])
    words = typer.Option(
        option.name or f"--{name.replace('_', '-')}",
        help=option.help,
        metavar=option.metavar,
        min=option.least,
        max=option.most,
        show_default=option.default or True,
        autocompletion=option.words and completed(option.words),
    )
    return Annotated[kind, words], default


def _value(hint: Any, given: Any) -> Any:
    """Return the value of what was typed."""
    if (read := _option_of(hint).read) is not None:
        return read(given)
    return tuple(given or ()) if get_origin(get_args(hint)[0]) is tuple else given
