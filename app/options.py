"""Arguments and options that several commands share, worded once; options objects as options."""

# Commands are plain functions without Typer: `command(terminal, campaign, options, *, dry=False)`.
# `RunOptions` and its like serve the Python API as well, with help, bounds and metavar in an
# `Option` at each field. `as_typer_command` gives such a function the signature that Typer reads,
# and makes its arguments of what Typer has read.

import inspect
from collections.abc import Callable, Iterable, Sequence
from dataclasses import MISSING, fields, is_dataclass
from math import inf
from pathlib import Path
from types import GenericAlias
from typing import Annotated, Any, cast, get_args, get_origin, get_type_hints

import typer

from app.console import Terminal
from app.interrupt import first_stop_counts
from campaigns.campaign import Campaign, CampaignFolder, open_campaign, open_folder
from campaigns.errors import OptionsInvalid
from campaigns.files.csv_file import spreadsheet_text
from campaigns.files.text_file import replace_text
from campaigns.files.wording import shown
from campaigns.kinematics.axes import Axis
from campaigns.robots.program import ProgramUntrusted, trust
from campaigns.settings.option import Option
from campaigns.shots.turn_forms import TurnForm, foreign_columns, has_unknown_turns
from drivers.values import Vector3

MAY_RUN = "{problem}. Did you read it, and may it run, now and later?"
QUESTION = "reflector from the controlled point, measured to 3 mm, x y z mm; Enter: fit it: "
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
Verbose = Annotated[
    bool,
    typer.Option(
        "--verbose", help="Also show all tables, the devices' identities and each state of a shot."
    ),
]
Yes = Annotated[
    bool, typer.Option("--yes", "-y", help="Do not ask whether the cell is clear: it is.")
]
Port = Annotated[int, typer.Option(min=0, max=65535, metavar="N", help="Port; 0: any free one.")]
Dry = Annotated[bool, typer.Option("--dry", help="Show what would happen, and do nothing.")]
Force = Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")]
Anew = Annotated[
    bool, typer.Option("--anew", help="Start a new series instead of resuming an unfinished one.")
]

Plain = Annotated[
    bool, typer.Option("--plain", help="Print lines instead of the screen; keys do nothing.")
]
Excel = Annotated[
    bool,
    typer.Option(
        "--excel",
        help="Write CSV as spreadsheets with decimal commas open it: semicolons, UTF-8 with its "
        "mark. Those with decimal points open it without.",
    ),
]


Turns = Annotated[
    TurnForm | None,
    typer.Option(
        help="How the file writes three turns of a platform. xyz: R = Rx·Ry·Rz; zyx: R = Rz·Ry·Rx, "
        "as A B C of KUKA, W P R of Fanuc, roll pitch yaw. Default: by the columns; rx_deg ry_deg "
        "rz_deg are a rotation vector."
    ),
]
REFLECTOR_HELP = "Reflector on the plate from the controlled point, mm, if it was measured."
REFLECTOR_METAVAR = "X,Y,Z"


def for_spreadsheets(*paths: Path | None, excel: bool) -> None:
    """With --excel rewrite CSV files for decimal commas; None is no file. Raise `WriteFailed`."""
    for path in filter(None, paths) if excel else ():
        replace_text(path, spreadsheet_text(path.read_text(encoding="utf-8")))


def read_place(text: str) -> Vector3:
    """Return the place of a text of three numbers; raise `OptionsInvalid` for any other text."""
    words = text.strip("[]() ").replace(",", " ").split()
    try:
        x, y, z = map(float, words)
    except ValueError:
        x = y = z = inf
    if not max(abs(x), abs(y), abs(z)) < inf:  # NaN too
        raise OptionsInvalid(f"'{shown(text)}' is no place", remedy="give it as 20,-30,-45")
    return x, y, z


def ask_reflector(terminal: Terminal) -> Vector3 | None:
    """Ask for the reflector's place; return None if it is not known, or without a terminal."""
    prompt = terminal.prompt()
    while prompt is not None and (typed := prompt(QUESTION).removesuffix("mm").strip()):
        try:
            return read_place(typed)
        except OptionsInvalid as error:
            terminal.note(f"{error.problem}: {error.remedy}, or nothing")
    return None


def ask_turns(
    terminal: Terminal, turns: TurnForm | None, file: Path, task: Sequence[Axis]
) -> TurnForm | None:
    """Return how a file writes three turns, asked for where its columns leave it open.

    None: by its columns; their reader refuses angles in unknown order. Raise `OptionsInvalid` for a
    robot without three turns.
    """
    if not foreign_columns(task):
        if turns is None:
            return None
        raise OptionsInvalid(
            f"--turns {turns} is for platforms with three turns, which this robot's has not",
            remedy="leave it out",
        )
    if turns is not None or not has_unknown_turns(file):
        return turns
    prompt, forms = terminal.prompt(), get_args(TurnForm)
    question = f"{file}: in which order are its turns: {', '.join(forms)}? (zyx: A B C, W P R) "
    typed = prompt(question).strip() if prompt else ""
    return cast("TurnForm", typed) if typed in forms else None


def folder_and_file(first: Path, second: Path | None) -> tuple[Path, Path]:
    """Return the campaign's folder and a file from one or two arguments; a single one is the file.

    Raise `OptionsInvalid` if no file is named.
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


def completer(words: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """Return a function that lists those of the words that begin with what was typed."""
    return lambda incomplete: [word for word in words() if word.startswith(incomplete)]


def as_typer_command(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command with the parameters that Typer reads.

    A `Terminal` becomes the context, --verbose and --json, a `Campaign` the folder, and a dataclass
    of options an option for each of its fields that is annotated with an `Option`.

    Any: Typer checks what an option holds when it is typed.
    """
    # 1. the signature: replace each of these parameters by those that are typed for it
    hints = get_type_hints(command, include_extras=True)
    objects = {
        name: _options_of(kind)
        for name, kind in hints.items()
        if is_dataclass(kind) and kind not in {Campaign, CampaignFolder}
    }
    parameters: list[inspect.Parameter] = []
    for name, parameter in inspect.signature(command).parameters.items():
        if hints[name] is Terminal:
            parameters.append(_parameter("context", typer.Context))
        elif hints[name] in {Campaign, CampaignFolder}:
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
        parameters.append(_parameter("verbose", Verbose, default=False))
        parameters.append(_parameter("as_json", Json, default=False))

    # 2. the call: make terminal, options and campaign of what was typed. Options come before the
    # campaign, so that a mistyped option is reported before a missing folder.
    def run_command(**arguments: Any) -> None:
        if "terminal" in hints:
            context = arguments.pop("context")
            arguments["terminal"] = Terminal(
                as_json=arguments.pop("as_json"),
                # before the command or behind it
                verbose=arguments.pop("verbose") or context.obj is True,
                command=context.info_name or "",
            )
        for name, options in objects.items():
            typed = {option: arguments.pop(option) for option in options}
            arguments[name] = hints[name](
                **{
                    option: _value(options[option], value)
                    for option, value in typed.items()
                    if value is not None  # not typed: the dataclass has the default
                }
            )
        folder = arguments.pop("folder") if "campaign" in hints else None

        def work() -> None:
            opened = {} if folder is None else {"campaign": _opened(hints["campaign"], folder)}
            command(**arguments, **opened)

        with first_stop_counts():
            _run_trusting(work, arguments.get("terminal"))

    # 3. Typer reads help, annotations and signature from the function that it is given
    run_command.__doc__ = command.__doc__
    run_command.__annotations__ = {each.name: each.annotation for each in parameters}
    run_command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined] # inspect looks for it
    return run_command


def _opened(kind: Any, folder: Path) -> CampaignFolder:
    """Open a folder as a command's parameter is annotated: with its robot, or without."""
    return open_campaign(folder) if kind is Campaign else open_folder(folder)


def _run_trusting(work: Callable[[], None], terminal: Terminal | None) -> None:
    """Run a command, again once the operator trusts the program that it needs; else raise.

    A program is needed before anything is done: where its robot's file is read.
    """
    try:
        work()
    except ProgramUntrusted as error:
        question = MAY_RUN.format(problem=error.problem)
        if terminal is None or not terminal.asks(question):
            raise
        trust(error.program)
        work()


def _parameter(
    name: str, annotation: Any, default: object = inspect.Parameter.empty
) -> inspect.Parameter:
    default = inspect.Parameter.empty if default is MISSING else default
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation
    )


def _options_of(kind: Any) -> dict[str, Any]:
    """Return annotations of the options by field; those of the class itself before inherited."""
    # the order of fields is the order in help: a command's own options come first
    hints = get_type_hints(kind, include_extras=True)
    names = (name for base in kind.__mro__ for name in vars(base).get("__annotations__", ()))
    return {name: hints[name] for name in names if isinstance(_option_of(hints[name]), Option)}


def _option_of(hint: Any) -> Any:
    return getattr(hint, "__metadata__", (None,))[-1]


def _typed(name: str, hint: Any, default: Any) -> tuple[Any, Any]:
    """Return the annotation that Typer reads for an option, and its default."""
    option, kind = _option_of(hint), get_args(hint)[0]
    # An option with a reader (`0-60`, `20%`) is typed as text. An option of several values may be
    # repeated: Typer wants a list, and None for none, where the dataclass has a tuple.
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
        autocompletion=option.words and completer(option.words),
    )
    return Annotated[kind, words], default


def _value(hint: Any, typed: Any) -> Any:
    """Return the value of the dataclass's field for what was typed."""
    if (read := _option_of(hint).read) is not None:
        return read(typed)
    return tuple(typed or ()) if get_origin(get_args(hint)[0]) is tuple else typed
