"""Section of a scenario file: what all of them have in common."""

import difflib
from collections.abc import Iterable
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
Count = Annotated[int, Field(ge=1)]
Point = tuple[float, float, float]


def nearest(unknown: str, choices: Iterable[str]) -> str:
    """Return a remedy for an unknown word: the nearest of the choices, or all of them."""
    words = list(choices)
    close = difflib.get_close_matches(unknown, words, n=1)
    return f"did you mean {close[0]}?" if close else f"known here: {', '.join(words)}"


class Section(BaseModel):
    """Section of a file: no unknown keys, no converted types, no NaN; immutable."""

    # strict: 1 is no text and "1" no number, so that a slip of typing is not read as something else
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)
