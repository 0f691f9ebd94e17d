"""The command line: global options, all commands, and one place where errors become exit codes."""

import sys
from typing import Annotated

import typer
from typer.exceptions import Abort, TyperException

from app.commands import (
    devices,
    dry_run,
    export,
    identify,
    import_shots,
    load,
    new,
    plan,
    run,
    simulate,
    validate,
)
from app.exits import Exit, exit_code
from drivers.errors import ExplainedError

HELP = """Calibrates parallel robots with a laser tracker.

A campaign is a folder. The usual way through it:

  new → devices → plan → validate --stage before → run → identify → export → load →
  validate --stage after

Try it without hardware: pkmcal dry-run
"""

app = typer.Typer(
    name="pkmcal",
    help=HELP,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    rich_markup_mode=None,
)
app.command("new")(new.command)
app.command("devices")(devices.command)
app.command("plan")(plan.command)
app.command("run")(run.command)
app.command("import")(import_shots.command)
app.command("identify")(identify.command)
app.command("validate")(validate.command)
app.command("export")(export.command)
app.command("load")(load.command)
app.command("sim")(simulate.command)
app.command("dry-run")(dry_run.command)


def _print_version(asked: bool) -> None:  # noqa: FBT001 - Typer's signature for callbacks
    if asked:
        from campaigns.version import VERSION

        typer.echo(f"pkmcal {VERSION}")
        raise typer.Exit


@app.callback()
def main_options(
    *,
    verbose: Annotated[
        bool, typer.Option("--verbose", help="Tell also what devices are asked and answer.")
    ] = False,
    debug: Annotated[
        bool, typer.Option("--debug", help="On an error show where in the software it arose.")
    ] = False,
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Say the version and leave.", callback=_print_version, is_eager=True
        ),
    ] = False,
) -> None:
    """Take the options that stand before the command; `main` looks at --debug itself."""


def main() -> None:
    """Run the command line and leave with the exit code that scripts may rely on."""
    sys.exit(run_command(sys.argv[1:]))


def run_command(arguments: list[str]) -> int:
    """Run one command; gives its exit code. Designed errors become one line on stderr."""
    try:
        code = app(arguments, standalone_mode=False)
    except (Abort, KeyboardInterrupt):
        return _told("interrupted", Exit.INTERRUPTED)
    except TyperException as error:
        return _told(f"{error.format_message()} → see `pkmcal --help`", Exit.BAD_INPUT)
    except ExplainedError as error:
        if "--debug" in arguments:
            raise
        return _told(str(error), exit_code(error))
    return code if isinstance(code, int) else Exit.DONE


def _told(line: str, code: Exit) -> Exit:
    typer.echo(f"pkmcal: {line}", err=True)
    return code
