"""Options of a step of the work: a field each, whose annotation says how a command offers it."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from campaigns.errors import OptionsInvalid


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


def require_finite(option: str, value: float) -> None:
    """Raise `OptionsInvalid` for what is no number that can be meant."""
    if not math.isfinite(value):
        raise OptionsInvalid(f"{option} is {value}", remedy="give a finite number")
