"""What a call of a simulated GeoCOM instrument leads to: now, or when it has ended."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from drivers.wire.geocom_constants import Result

Value = float | str


@dataclass(frozen=True, slots=True)
class Outcome:
    """A return code and the values behind it; whole numbers and flags are written as such."""

    result: int = Result.OK
    values: tuple[Value, ...] = ()


@dataclass(frozen=True, slots=True)
class Later:
    """Something that takes time: when it ends, and what then comes of it."""

    due_s: float
    finish: Callable[[float], Outcome]


Handler = Callable[[Sequence[str], float], Outcome | Later]
"""Takes a call's parameters as words, and the time; may raise `WireError` for the words."""

DONE = Outcome()


def refusal(result: Result, values: int = 0) -> Outcome:
    """Say no; an instrument still sends its values, as zeros."""
    return Outcome(result, (0.0,) * values)
