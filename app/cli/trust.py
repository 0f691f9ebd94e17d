"""pkmcal trust: let the program of a mechanism run, and show or withdraw what may."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from app.console import Terminal
from campaigns.errors import OptionsInvalid
from campaigns.files.yaml_file import read_document
from campaigns.robots.program import (
    PYTHON,
    Program,
    list_path,
    program_of,
    trust,
    trusted_programs,
    withdraw,
)
from campaigns.settings.config import read_campaign

Place = Annotated[
    Path | None,
    typer.Argument(
        metavar="DIR",
        help="A campaign's folder, a robot file, or the program itself.",
        show_default=False,
    ),
]
ListIt = Annotated[bool, typer.Option("--list", help="Show the programs that may run.")]
Withdraw = Annotated[bool, typer.Option("--withdraw", help="Let the program run no longer.")]


@dataclass(frozen=True, slots=True)
class TrustAnswer:
    """Answer of `trust`: the list of programs that may run, by sha256."""

    list: Path
    trusted: dict[str, str]


def command(
    terminal: Terminal,
    *,
    place: Place = None,
    list_them: ListIt = False,
    withdraws: Withdraw = False,
) -> None:
    """Let the program of a mechanism run, once you have read it.

    A robot file may name a Python file as its mechanism, `mechanism: my.py:OWN`. It is a program,
    which can do whatever you can. So it runs only if your own list has the sha256 of its bytes:
    after each change of the file it has to be trusted again. The list is a file of this user, in no
    campaign's folder. Mechanisms of installed packages need no trust.

    pkmcal trust cell-9
    pkmcal trust biglide.py
    pkmcal trust --list
    pkmcal trust cell-9 --withdraw
    """
    if list_them == (place is not None):
        raise OptionsInvalid(
            "DIR and --list contradict each other" if list_them else "DIR is missing",
            remedy="give DIR, whose program is meant, or --list",
        )
    if place is not None:
        program = _program(place)
        if not withdraws:
            trust(program)
            terminal.say(f"may run: {program.path} (sha256 {program.sha256})")
        elif withdraw(program):
            terminal.say(f"may run no longer: {program.path} (sha256 {program.sha256})")
        else:
            terminal.say(f"was not trusted: {program.path} (sha256 {program.sha256})")
    trusted = trusted_programs()
    if list_them:
        for sha256, path in trusted.items():
            terminal.say(f"{sha256}  {path}")
        terminal.note(f"{len(trusted)} programs may run, by {list_path()}")
    terminal.conclude(TrustAnswer(list_path(), trusted))


def _program(place: Path) -> Program:
    """Return the program of a folder, a robot file or of its own path; none is run.

    Raise `ConfigInvalid` for files that cannot be read, `OptionsInvalid` where none is named.
    """
    if place.suffix == PYTHON:
        return Program.read(place)
    robot = place / read_campaign(place).robot if place.is_dir() else place
    word = read_document(robot, if_missing="name a robot file").tree.get("mechanism")
    program = program_of(word, robot.parent)
    if program is None:
        raise OptionsInvalid(
            f"{robot}: its mechanism is {word}, which is no program in a folder",
            remedy="nothing has to be trusted",
        )
    return program
