"""The command that runs others on a controller's computer, as a campaign's files name it."""

import re
import shlex

from drivers.errors import AddressInvalid

_HOST = re.compile(r"([a-z0-9_][a-z0-9_.-]*@)?[a-z0-9_][a-z0-9_.:-]*", re.ASCII | re.IGNORECASE)


def command_prefix(command: str) -> tuple[str, ...]:
    """Words that stand before what is run there; none for this computer.

    Raises `AddressInvalid` for all but `ssh [USER@]HOST` and the absolute path of one program.
    """
    try:
        words = tuple(shlex.split(command))
    except ValueError:  # a quote that is not closed
        words = (command,)
    is_ssh = len(words) == 2 and words[0] == "ssh" and _HOST.fullmatch(words[1]) is not None
    is_program = len(words) == 1 and words[0].startswith("/")
    if words and not (is_ssh or is_program):
        raise AddressInvalid(
            f"the command '{command}' is none of those that a campaign's files may name",
            remedy="write ssh USER@HOST, whose options belong in ~/.ssh/config, or the absolute "
            "path of a program of yours, without options, that takes a command as ssh does",
        )
    return words
