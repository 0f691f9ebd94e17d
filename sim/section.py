"""Section of a scenario file: what all of them have in common."""

import difflib
from collections.abc import Iterable
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
Count = Annotated[int, Field(ge=1)]
Point = tuple[float, float, float]


def nearest(unknown: str, known: Iterable[str]) -> str:
    """Return a remedy for an unknown word: the nearest known one, or all of them."""
    words = list(known)
    close = difflib.get_close_matches(unknown, words, n=1)
    return f"did you mean {close[0]}?" if close else f"known here: {', '.join(words)}"


class Section(BaseModel):
    """Section of a file: nothing unknown, nothing converted, no NaN; fixed once read."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)
