"""Pictures made of letters, for a terminal: a histogram by bars of eighths of a letter."""

from collections.abc import Sequence

import numpy as np

EIGHTHS = " ▏▎▍▌▋▊▉█"
BINS = 9
LEAST = 1e-6
"""Errors below this need no picture of their own."""
WIDTH = 40
"""Letters of the longest bar."""


def histogram_lines(
    errors_mm: Sequence[float], unit: str = "mm", *, bins: int = BINS, width: int = WIDTH
) -> list[str]:
    """One line a bin: its limits, a bar, the count; no line for no errors.

    The bins lie evenly about zero, so that a lean to one side is seen.
    """
    if len(errors_mm) == 0:
        return []
    largest = max(float(np.abs(errors_mm).max()), LEAST)
    counts, edges = np.histogram(errors_mm, bins, (-largest, largest))
    decimals = max(0, 2 - int(np.floor(np.log10(largest))))
    limits = [f"{edge:+.{decimals}f}".replace("-", "−") for edge in edges]
    room = max(map(len, limits))
    return [
        f"{low:>{room}} … {high:>{room}} {unit} {bar(count / counts.max(), width)} {count}"
        for low, high, count in zip(limits[:-1], limits[1:], counts.tolist(), strict=True)
    ]


def bar(part: float, width: int = WIDTH) -> str:
    """A bar of so large a part of the width, (0 to 1), filled up with blanks."""
    eighths = round(part * width * 8)
    whole, rest = divmod(eighths, 8)
    return ("█" * whole + EIGHTHS[rest].strip()).ljust(width)
