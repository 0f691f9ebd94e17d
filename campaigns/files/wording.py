"""Wording of errors: what was written, and what was probably meant."""

from collections.abc import Collection, Sequence

from drivers.texts import nearest_word, printable

UNITS = frozenset(
    {"um", "mm", "cm", "m", "in", "inch", "mm2", "m2", "deg", "rad", "mrad", "ms", "s", "min"}
    | {"degC", "degF", "K", "percent"}
)

SHOWN_CHARACTERS = 40
LOOKED_AT = 10 * SHOWN_CHARACTERS
"""Characters of a text that are searched for words, for it may be 5 MB long."""


def shown(text: str) -> str:
    """Return a text that fits into an error line: short, on one line, printable."""
    text = text.strip()
    line = printable(" ".join(text[:LOOKED_AT].split()))
    fits = len(line) <= SHOWN_CHARACTERS and len(text) <= LOOKED_AT
    return line if fits else f"{line[:SHOWN_CHARACTERS]}…"


def listed(names: Sequence[str], most: int) -> str:
    """Return names in a row, at most so many, and the number of the others."""
    text = ", ".join(names[:most])
    return f"{text} and {len(names) - most} more" if len(names) > most else text


def suggestion(word: str, choices: Collection[str]) -> str:
    """Return what to write instead of an unknown word: one of the choices, or all of them."""
    # `forearm_m` for `forearm_mm` is no slip of the pen: with the name the value must change
    for name in choices:
        unit = name.rpartition("_")[2]
        if unit in UNITS and name != word and _quantity(name) == _quantity(word):
            return f"write {name}, with the value in {unit}"
    nearest = nearest_word(word, choices)
    if nearest:
        return f"did you mean {nearest}?"
    return f"known here: {', '.join(choices)}"


def _quantity(name: str) -> str:
    """Return a name without its unit: `forearm` of `forearm_mm`, `forearm_m` and `forearm`."""
    stem, _, unit = name.rpartition("_")
    return (stem if stem and unit in UNITS else name).lower()
