"""The command line: global options, commands by name, and one place where errors become codes."""

# How a command runs, from the shell to its exit code:
#
# 1. `pkmcal.py` sets what has to be set before NumPy is imported. `main` makes the streams outlast
#    their readers, and lets the signals that end a process raise KeyboardInterrupt, as Ctrl-C does.
# 2. Typer asks `LazyGroup` for the command that was typed, and only its module in `app/cli` is
#    imported. Help and completion take names and summaries from `COMMANDS`: they import nothing.
# 3. `options.as_typer_command` translates the command's parameters for Typer: a terminal, a
#    campaign and dataclasses of options become --json, --verbose, DIR and single options.
# 4. The command returns (exit code 0), or `Terminal.conclude` ends it with code 1, or it raises.
# 5. `_reported` is the one place where whatever was raised becomes a line on stderr, a document
#    on stdout with --json, and an exit code. So all failures look alike, and none is a traceback.

import gc
import os
import re
import signal
import sys
import traceback
from collections.abc import Mapping, Sequence
from importlib import import_module
from itertools import takewhile
from pathlib import Path
from shutil import get_terminal_size
from textwrap import fill, shorten, wrap
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.exceptions import Abort, TyperException

from app.exits import Exit, exit_code
from app.interrupt import interrupted_by_signals, unblock_signals
from app.streams import FULL_HEIGHT, make_streams_last, print_document
from campaigns.version import VERSION, commit
from drivers.errors import ExplainedError, LinkDown, MotionFault, RobotStateUnknown
from drivers.texts import printable, quoted, shortened

HELP = """Calibrates parallel robots with a laser tracker.

A campaign is a folder; each command names the next one.
Try it without hardware: pkmcal dry-run
"""

MORE_HELP = """All commands: pkmcal --help   One: pkmcal COMMAND --help
Pages:        pkmcal help"""

EXIT_CODES = """Exit codes: 0 done and good; 1 done, but the result is not good; 2 bad input or
usage; 3 a device failed or refused; 4 the journal or another file could not be written;
70 an error in pkmcal itself; 130 interrupted. Every error is one line on stderr: what, where,
value and limit, what to do next.
"""

MEASURING = {"run", "validate", "check"}
"""Commands that go on where they ended, once they are typed again."""
COMMANDS = {
    "new": ("new", "Make a campaign's folder: settings and nominal robot."),
    "devices": ("devices", "Connect to both devices and show their state."),
    "plan": ("plan", "Choose the poses to measure and write plan.csv."),
    "validate": ("validate", "Measure how accurate the robot is as its user commands it."),
    "run": ("run", "Measure the shots of the plan that are still missing."),
    "identify": ("identify", "Find the parameters that explain the measured shots."),
    "export": ("export", "Write the identified parameters as a robot file."),
    "load": ("load", "Put the compensated parameters into the controller."),
    "report": ("report", "Write the report: the whole campaign on one page."),
    "status": ("status", "Show where the campaign is, and the next command."),
    "check": ("check", "Test with a few shots whether the robot is still calibrated."),
    "watch": ("watch", "Serve a live page of the campaign, for a tablet or a wall screen."),
    # from here on under "More commands"
    "dry-run": ("dry_run", "Run a whole campaign without hardware."),
    "import": ("import_shots", "Import shots measured with other software."),
    "correct": ("correct", "Correct targets for a controller that keeps its nominal parameters."),
    "history": ("history", "Show parameters and errors over campaigns."),
    "study": ("study", "Simulate many campaigns of a plan; compare them with the truth."),
    "robot": ("robot", "Make a robot file from the sizes of a symmetrical robot."),
    "sim": ("simulate", "Serve a simulated cell on loopback."),
    "check-journal": (
        "check_journal",
        "Check whether the journal is intact, and show its contents.",
    ),
    "trust": ("trust", "Let the program of a mechanism run, once you have read it."),
    "set": ("set_keys", "Change keys of campaign.yaml; its comments stay."),
    "help": ("help_pages", "Show a page of the documentation."),
}
"""Module in `app.cli`, imported when it is named, and first line of its help, by name."""
FIRST_COMMANDS = 12
"""Of `COMMANDS`; the others are listed after them."""

PAGE = re.compile(r"docs/[a-z]+(?:-[a-z]+)*/([a-z-]+)\.md(#[a-z0-9-]+)?")
"""Page that an error names by its place in the docs; the command shows it wherever it is."""
COMPLETES = "_PKMCAL_COMPLETE"
"""Variable by which a shell asks for completions, without arguments."""
LONGEST_LINE = 950
"""Characters of an error line: what a file or option says in it is cut in the middle."""

LONGEST_NAME = 30
"""Characters of names beside which help explains them, and not below."""

SETTINGS = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


def write_rows(formatter: Any, heading: str, rows: Sequence[tuple[str, str]]) -> None:
    """Write names with their explanations under a heading, wrapped between words alone."""
    column = min(max(len(names) for names, _ in rows), LONGEST_NAME) + 4
    formatter.write(f"\n{heading}:\n")
    for names, text in rows:
        lines = wrap(text, formatter.width - column, break_long_words=False, break_on_hyphens=False)
        margin = f"  {names}".ljust(column)
        if len(margin) > column:  # long names have a line of their own, their text the next one
            formatter.write(f"{margin}\n")
            margin = ""
        formatter.write(f"{margin:<{column}}" + ("\n" + " " * column).join(lines) + "\n")


def write_paragraphs(formatter: Any, text: str) -> None:
    """Write paragraphs wrapped between words alone; lines that are to be copied stay whole."""
    for paragraph in text.split("\n\n"):
        lines = paragraph.splitlines()
        # examples of commands and the header of shots.csv are copied from the screen
        if not paragraph.startswith(("pkmcal ", "pair,")):
            width = formatter.width - 2
            lines = wrap(paragraph, width, break_long_words=False, break_on_hyphens=False)
        formatter.write("\n" + "".join(f"  {line}\n" for line in lines))


SECTIONS = {
    "Which shots": "shots placement until skip only only-shots hold-out update sessions",
    "Which model": "model free fix prior",
    "Devices": "controller tracker offline controller-driver tracker-driver",
    "Points of other software": "joints join columns coordinates decimal encoding",
    "Safety": "yes dry force retry verify",
    "Output": "plot to pdf csv excel plain verbose json help",
}
"""Headings under which help lists options, by their names; all others stand under Options."""


class SectionedCommand(TyperCommand):
    """Command whose help lists its options in sections, and values by plain names."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return the words of the usage line: [DIR] for an argument that may be left out."""
        arguments = [p for p in self.get_params(ctx) if p.param_type_name == "argument"]
        names = [(p.metavar or str(p.name).upper(), p.required) for p in arguments]
        return ["[OPTIONS]", *(name if required else f"[{name}]" for name, required in names)]

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse words; an option without its value is refused with the command that it is of."""
        try:
            return super().parse_args(ctx, args)
        except TyperException as error:
            if getattr(error, "ctx", ctx) is None:
                error.ctx = ctx  # type: ignore[attr-defined] # the error of a usage has it
            raise

    def format_help_text(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002
        """Write what the command does, and examples."""
        write_paragraphs(formatter, self.help or "")

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments and options, each section under its heading."""
        sections: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
        sections |= {heading: [] for heading in SECTIONS}
        for parameter in self.get_params(ctx):
            names, text = parameter.get_help_record(ctx) or ("", "")
            # Typer writes bounds as inequalities of x: say them in words
            text = re.sub(r"(\d+)<=x<=(\d+)", r"\1 to \2", text)
            text = re.sub(r"x>=(\d+)", r"\1 or more", text)
            if parameter.param_type_name == "argument":
                sections["Arguments"].append((str(parameter.metavar), text))
                continue
            # the long name: click keeps the names of --help in a set, so either may be the first
            word = max(parameter.opts, key=len).lstrip("-")
            headings = (head for head, words in SECTIONS.items() if word in words.split())
            sections[next(headings, "Options")].append((re.sub("[<>]", "", names), text))
        for heading, rows in sections.items():
            if rows:
                write_rows(formatter, heading, rows)


class LazyGroup(TyperGroup):
    """Commands of which a module is imported only when it is named.

    Any: Typer's own types of contexts and formatters are not public.
    """

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        # Names without their commands: click looks here for what a mistyped name may have meant.
        self.commands = dict.fromkeys(COMMANDS)  # type: ignore[assignment]

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ARG002
        """Return the names of commands in the order in which a campaign needs them."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> TyperCommand | None:  # noqa: ARG002
        """Import the command's module and return the command; None for an unknown name."""
        if cmd_name not in COMMANDS:
            return None
        gc.disable()  # imports leave no garbage: a search for it would take a fifth of the start
        try:
            from app.options import as_typer_command  # with pydantic and more, for commands only

            module, _ = COMMANDS[cmd_name]
            imported = import_module(f"app.cli.{module}")
        finally:
            gc.enable()
        # A Typer of its own for each command: a shared one would need all modules at once.
        program = typer.Typer(
            add_completion=False,
            pretty_exceptions_enable=False,
            context_settings=SETTINGS,
            rich_markup_mode=None,
        )
        program.command(cmd_name, cls=SectionedCommand)(as_typer_command(imported.command))
        command = typer.main.get_command(program)
        assert isinstance(command, TyperCommand), "one command makes no group"
        return command

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the commands, the usual ones first and none of them imported, and the options."""
        rows = [(name, summary) for name, (_, summary) in COMMANDS.items()]
        options = [option.get_help_record(ctx) for option in self.get_params(ctx)]
        sections: dict[str, Any] = {
            "Commands": rows[:FIRST_COMMANDS],
            "More commands": rows[FIRST_COMMANDS:],
            "Options": options,
        }
        for heading, lines in sections.items():
            write_rows(formatter, heading, lines)


app = typer.Typer(
    name="pkmcal",
    cls=LazyGroup,
    help=HELP,
    epilog=EXIT_CODES,
    pretty_exceptions_enable=False,
    context_settings=SETTINGS,
    rich_markup_mode=None,
)


def _print_version(requested: bool) -> None:  # noqa: FBT001 - Typer's signature for callbacks
    if requested:
        digest = commit()
        typer.echo(f"pkmcal {VERSION}{f' ({digest})' if digest else ''}")
        raise typer.Exit


@app.callback()
def main_options(
    context: typer.Context,
    *,
    verbose: Annotated[
        bool,
        typer.Option(
            "--verbose",
            help="Also show all tables, the devices' identities and each state of a shot.",
        ),
    ] = False,
    debug: Annotated[  # noqa: ARG001 - `run_command` looks for it itself
        bool, typer.Option("--debug", help="On an error, show where in the software it arose.")
    ] = False,
    version: Annotated[  # noqa: ARG001 - its callback does it all
        bool,
        typer.Option(
            "--version", help="Print the version and exit.", callback=_print_version, is_eager=True
        ),
    ] = False,
) -> None:
    """Take the options that stand before the command."""
    context.obj = verbose  # where `options.as_typer_command` finds it for the command's Terminal


def main() -> None:
    """Run the command line and leave with the exit code that scripts may rely on."""
    for variable in ("XDG_CACHE_HOME", "XDG_CONFIG_HOME"):
        stated = os.environ.get(variable)
        if stated is not None and not Path(stated).is_absolute():
            del os.environ[variable]  # Matplotlib would make that folder wherever it is started
    unblock_signals()
    make_streams_last()
    with interrupted_by_signals():
        outcome = _outcome(sys.argv[1:])
        # The command has ended: a Ctrl-C from now on changes neither its last line nor its code.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        code = _reported(outcome, sys.argv[1:])
    sys.exit(code)


def run_command(arguments: list[str]) -> int:
    """Run one command and return its exit code. Errors become one line on stderr."""
    return _reported(_outcome(arguments), arguments)


def _outcome(arguments: list[str]) -> int | Exception:
    """Run one command; return its exit code, or the error that has ended it."""
    try:
        if not arguments and COMPLETES not in os.environ:
            typer.echo(overview())
            return Exit.DONE
        code = app(arguments, prog_name="pkmcal", standalone_mode=False)
    except Abort:
        return Exit.INTERRUPTED
    except Exception as error:  # noqa: BLE001 - the last resort: a line rather than a traceback
        return error
    return code if isinstance(code, int) else Exit.DONE


def _reported(outcome: int | Exception, arguments: list[str]) -> int:
    """Print the line of a command that was ended by an error or a signal; return the exit code."""
    # The words are read here, because a usage error comes before Typer has read any option:
    # --debug counts before the command alone, --json anywhere.
    as_json = "--json" in arguments
    if isinstance(outcome, Exception):
        if "--debug" in takewhile(lambda word: word.startswith("-"), arguments):
            traceback.print_exception(outcome)
        line, code = _explain_error(outcome, arguments)
        details = outcome.details if isinstance(outcome, ExplainedError) else {}
        return _print_error(_with_folder(line, arguments), code, details, as_json=as_json)
    if outcome == Exit.INTERRUPTED:  # Typer has turned Ctrl-C into this code, without a word
        line = _with_folder("interrupted → start the command again when ready", arguments)
        return _print_error(line, Exit.INTERRUPTED, {}, as_json=as_json)
    return outcome


def overview() -> str:
    """Return the twelve usual commands, and where the others are: it fits on a small terminal."""
    usual = [*COMMANDS.items()][:FIRST_COMMANDS]
    (width, height), margin = get_terminal_size(), " " * 12
    if height < FULL_HEIGHT:  # a line for each command, and the shell's own prompt below
        lines = (
            f"  {name:<10}{shorten(s, width - 12, placeholder=' …')}" for name, (_, s) in usual
        )
        return "\n".join([HELP.splitlines()[0], *lines, MORE_HELP.splitlines()[0]])
    rows = (
        fill(f"  {name:<10}{summary}", width, subsequent_indent=margin)
        for name, (_, summary) in usual
    )
    return "\n".join([HELP, "Commands, in the order of a campaign:", *rows, "", MORE_HELP])


def _explain_error(error: Exception, arguments: list[str]) -> tuple[str, Exit]:
    """Return the line of an error, problem → remedy, and its exit code."""
    if isinstance(error, TyperException):
        return _usage_line(error), Exit.BAD_INPUT
    if isinstance(error, ExplainedError):
        text = f"{error}{f' ({error.page})' if error.page else ''}{_resumption(error, arguments)}"
        return PAGE.sub(r"`pkmcal help \1\2`", text), exit_code(error)
    problem = f"unforeseen {type(error).__name__}: {error}"
    return f"{problem} → report it, with what `pkmcal --debug …` shows", Exit.BUG


def _resumption(error: ExplainedError, arguments: list[str]) -> str:
    """Return how measuring goes on once the device works again; "" after any other error."""
    command = next((word for word in arguments if not word.startswith("-")), "")
    if command not in MEASURING or not isinstance(
        error, LinkDown | MotionFault | RobotStateUnknown
    ):
        return ""
    words = (word if word.startswith("-") else quoted(word) for word in arguments)
    return f"; then `pkmcal {' '.join(words)}` resumes"


def _with_folder(text: str, arguments: list[str]) -> str:
    """Complete an error's line by what concerns the failed command's folder.

    A load without an end is named, whatever failed: what the controller holds is not known.
    DIR is replaced in the commands of the text, but not in `new DIR`.
    """
    from drivers.bounded_files import is_file  # with the YAML reader, which no --help needs

    folders = (word for word in (*arguments, ".") if is_file(Path(word) / "campaign.yaml"))
    folder = next(folders, None)
    if folder is None:
        return text
    if is_file(journal := Path(folder) / "campaign.db"):
        from campaigns.controllers.load_journal import unended_in

        unended = unended_in(journal)
        text = f"{text}; {unended}" if unended else text
    place = quoted(folder)
    return re.sub("(`pkmcal (?!new )[a-z-]+ )DIR", lambda match: match[1] + place, text)


def _print_error(line: str, code: Exit, details: Mapping[str, object], *, as_json: bool) -> Exit:
    """Print an error's line on stderr, and with --json its document on stdout."""
    # Devices and files may put anything into an error: shorten it, make it visible, keep one line.
    line = " ".join(printable(shortened(line, LONGEST_LINE)).split())
    text = f"pkmcal: {line}"
    if sys.stderr is not None and sys.stderr.isatty():  # elsewhere it stays one line
        width = get_terminal_size().columns
        text = fill(text, width, break_long_words=False, break_on_hyphens=False)
    typer.echo(text, err=True)
    if as_json:
        problem, _, remedy = line.partition(" → ")
        error = {"problem": problem, "remedy": remedy, "exit_code": int(code)}
        print_document({"schema": "pkmcal/error/1", **details, "error": error})
    return code


def _usage_line(error: TyperException) -> str:
    """Return what is wrong with the options, with the value and what to give instead."""
    problem, context = error.format_message().rstrip("."), getattr(error, "ctx", None)
    remedy = f"see `{context.command_path if context else 'pkmcal'} --help`"
    cause: Any = error.__cause__
    if type(cause).__name__ == "ValidationError":  # pydantic's, which is not imported for this
        from campaigns.settings.option import remedy_for

        parameter: Any = getattr(error, "param", None)
        name = parameter.opts[-1] if parameter.opts[-1].startswith("-") else parameter.name.upper()
        details = cause.errors()[0]
        return f"{name} is '{details['input']}' → {remedy_for(details)}; {remedy}"
    option = getattr(error, "option_name", None)
    for parameter in context.command.params if context else ():
        if option in parameter.opts and parameter.help:
            return f"{problem} → {parameter.help.rstrip('.')}; {remedy}"
    return f"{problem} → {remedy}"


if __name__ == "__main__":
    main()
