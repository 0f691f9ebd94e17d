"""Frame of every yardstick: its command line, tables, limits kept or missed, exit code."""

import argparse
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

Cell = str | int | float


@dataclass(frozen=True, slots=True)
class Figure:
    """One measured value with its limits; without any it is for information."""

    name: str
    value: float
    unit: str = ""
    lowest: float = -math.inf
    highest: float = math.inf

    @property
    def kept(self) -> bool:
        """Whether the value is within its limits; NaN never is."""
        return self.lowest <= self.value <= self.highest

    @property
    def verdict(self) -> str:
        """'kept' or 'missed' with the limits; empty without limits."""
        asked = [f"at least {self.lowest:g}"] if self.lowest > -math.inf else []
        asked += [f"at most {self.highest:g}"] if self.highest < math.inf else []
        return ", ".join(["kept" if self.kept else "missed", *asked]) if asked else ""


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of values under a title; the first column names them."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]

    def __str__(self) -> str:
        lines = [self.columns, *([text_of(cell) for cell in row] for row in self.rows)]
        return f"{self.title}\n{_aligned(lines, '<' + '>' * (len(self.columns) - 1))}"


@dataclass(frozen=True, slots=True)
class Report:
    """Findings of a yardstick, as text and as a document."""

    figures: Sequence[Figure] = ()
    tables: Sequence[Table] = ()

    @property
    def missed(self) -> list[str]:
        """Names of the figures outside their limits."""
        return [figure.name for figure in self.figures if figure.verdict and not figure.kept]

    def __str__(self) -> str:
        lines = [(f.name, text_of(f.value), f.unit, f.verdict) for f in self.figures]
        return "\n\n".join([*map(str, self.tables), *([_aligned(lines, "<><<")] if lines else [])])

    def document(self) -> dict[str, object]:
        tables = {
            table.title: [
                {
                    name: None if cell != cell else cell
                    for name, cell in zip(table.columns, row, strict=True)
                }
                for row in table.rows
            ]
            for table in self.tables
        }
        figures = {
            f.name: {"value": f.value, "unit": f.unit, "verdict": f.verdict} for f in self.figures
        }
        return {"tables": tables, "figures": figures, "missed": self.missed}


def text_of(cell: Cell) -> str:
    """Four digits of a number that is not whole; nothing for NaN."""
    if not isinstance(cell, float):
        return str(cell)
    if math.isnan(cell):
        return ""
    return f"{cell:.0f}" if 1000.0 <= abs(cell) < math.inf else f"{cell:.4g}"


def _aligned(lines: Sequence[Sequence[str]], sides: str) -> str:
    """Columns as wide as their widest cell, each to its side of '<' and '>'."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    texts = (
        [f"{cell:{side}{width}}" for cell, side, width in zip(line, sides, widths, strict=True)]
        for line in lines
    )
    return "\n".join("  ".join(text).rstrip() for text in texts)


def main(
    description: str | None,
    measure: Callable[..., Report],
    words: Sequence[str] | None = None,
    /,
    **defaults: int | str,
) -> int:
    """Measure and print; `defaults` are those of the options. 1 when a limit is missed."""
    parser = argparse.ArgumentParser(description=(description or "").split("\n", maxsplit=1)[0])
    for name, default in defaults.items():
        word = "N" if isinstance(default, int) else "NAME"
        parser.add_argument(f"--{name}", type=type(default), default=default, metavar=word)
    parser.add_argument("--json", action="store_true", help="one JSON document on stdout")
    asked = vars(parser.parse_args(words))
    as_json = asked.pop("json")
    report = measure(**asked)
    print(json.dumps(report.document(), indent=1) if as_json else report)
    return 1 if report.missed else 0
