"""Campaigns of all kinds of observation at robots whose truth is known: real errors against σ.

Robots are of single rods or bars (`benchmarks.observed_truths`), each drawn anew. A case is what
was measured at them; each campaign of it is identified, asked for what it shall determine. Of each
quantity stand the medians of real and stated errors, in how many campaigns the real one was more
than twice the stated one, and in how many it was determined. A pass is wrong if a quantity that was
asked for was not determined, or more than twice as far off as stated.
"""

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from benchmarks.observed_truths import TrueCell
from campaigns.arrays import Array
from pkmcal import Measured, Object, Shots, identify, sample_workspace

PRINTER, PAR4, HEXAPOD = "linear-delta", "par4-prototype", "hexapod"
SCALE: Mapping[str, tuple[float, str]] = {
    **dict.fromkeys(("flat", "xy", "position"), (1e3, "µm")),
    "rotation": (1e3, "mdeg"),
}
"""Factor and unit in which a quantity is printed."""
TOO_LARGE = 2.0
"""Real error over the stated one above which σ is wrong."""
BED = Object("bed")
BLOCK = Object("block", on=BED, height_mm=30.0, std_mm=0.01)
PART = Object("part", shrinkage_percent=0.2, shrinkage_std_percent=0.01)
FIRST = Object("first", place_mm=(31.0, 8.0, -21.0), std_mm=2.0)
SECOND = Object("second", place_mm=(-41.0, 31.0, 24.0), std_mm=2.0, on=FIRST)
HALF = replace(FIRST, name="half 1", body="half 1")
OTHER_HALF = replace(SECOND, name="half 2", body="half 2", on=HALF)
BAR = Object("bar", place_mm=(20.5, -15.5, 35.0), std_mm=1.0, length_mm=400.0, length_std_mm=0.002)

Observed = tuple[Shots | None, list[Measured]]


@dataclass(frozen=True, slots=True)
class Case:
    """Observations that are made at a kind of robot, and what is asked of them."""

    name: str
    robot: str
    asked: tuple[str, ...]
    observe: Callable[[TrueCell, Array], Observed]
    """Measures at poses (110, t) of the workspace."""


def _heights(cell: TrueCell, count: int = 37) -> list[Measured]:
    """Return heights over the bed, and thirteen held-out ones."""
    fitted, held_out = cell.on_level(150.0, count), cell.on_level(110.0, 13)
    return [
        cell.measure("height", BED, fitted),
        cell.measure("height", BED, held_out, held_out=True),
    ]


def _widths(cell: TrueCell, part: Object) -> list[Measured]:
    """Return a dozen widths of a drawn part by callipers, and a dozen held-out ones."""
    halves = [cell.on_level(radius, 24).reshape(2, 12, -1) for radius in (140.0, 100.0)]
    return [
        cell.measure("distance", part, poses.swapaxes(0, 1), 0.03, held_out=held_out)
        for poses, held_out in zip(halves, (False, True), strict=True)
    ]


def _blocks(cell: TrueCell) -> list[Measured]:
    """Return heights above a block on the bed."""
    return [cell.measure("block", BLOCK, cell.on_level(120.0, 19, 30.0))]


def _both(
    kind: str, thing: Object, fitted: int, shots: int
) -> Callable[[TrueCell, Array], Observed]:
    """Return how shots and observations of a kind are measured, a quarter of those held out."""

    def observe(cell: TrueCell, poses: Array) -> Observed:
        where, more = poses[30 : 30 + fitted], poses[70 : 70 + max(fitted // 4, 8)]
        pairs = cell.shots(np.concatenate([poses[:shots], poses[-20:]]), 10)
        return pairs, [
            cell.measure(kind, thing, where),
            cell.measure("reflectors" if kind == "reflector" else kind, thing, more, held_out=True),
        ]

    return observe


def _by_bar(cell: TrueCell, poses: Array) -> Observed:
    """Return shots, and readings of a ball bar."""
    shots = cell.shots(np.concatenate([poses[:40], poses[-20:]]), 10)
    return shots, [cell.measure("ball-bar", BAR, poses[40:90], 0.001)]


UNKNOWN_PART = Object("part", shrinkage_percent=0.2, shrinkage_std_percent=0.3)
CASES = (
    Case("7 heights", PRINTER, ("flat",), lambda c, _: (None, _heights(c, 7))),
    Case("37 heights", PRINTER, ("flat",), lambda c, _: (None, _heights(c))),
    Case("+ callipers, shrinkage ± 0.3 %", PRINTER, ("flat", "xy"),
         lambda c, _: (None, [*_heights(c), *_widths(c, UNKNOWN_PART)])),
    Case("+ callipers, shrinkage ± 0.01 %", PRINTER, ("flat", "xy"),
         lambda c, _: (None, [*_heights(c), *_widths(c, PART)])),
    Case("+ the same and a block", PRINTER, ("flat", "xy"),
         lambda c, _: (None, [*_heights(c), *_widths(c, PART), *_blocks(c)])),
    Case("40 points + 37 heights", PRINTER, ("flat", "xy", "position"),
         lambda c, poses: (c.shots(poses[:60], 10), _heights(c))),
    Case("30 shots, one reflector", PAR4, ("position", "rotation"),
         lambda c, poses: (c.shots(np.concatenate([poses[:30], poses[-20:]]), 10), [])),
    Case("15 shots + 15 of the other half", PAR4, ("position", "rotation"),
         _both("reflector", OTHER_HALF, 15, 15)),
    Case("10 shots + 30 of both halves", PAR4, ("position", "rotation"),
         _both("reflectors", OTHER_HALF, 30, 10)),
    Case("40 shots, one reflector", HEXAPOD, ("position", "rotation"),
         lambda c, poses: (c.shots(np.concatenate([poses[:40], poses[-20:]]), 10), [])),
    Case("10 shots + 40 of two reflectors", HEXAPOD, ("position", "rotation"),
         _both("reflectors", SECOND, 40, 10)),
    Case("10 shots + 40 poses of a probe", HEXAPOD, ("position", "rotation"),
         _both("probe", replace(SECOND, on=None), 40, 10)),
    Case("40 shots + 50 of a ball bar", HEXAPOD, ("position",), _by_bar),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a campaign."""

    seed: int
    verdict: str
    quantities: dict[str, tuple[float, float, float]]
    """Real and stated error of each, mm or deg, and 1 if it was determined."""
    is_wrong: bool
    """Whether it passed wrongly."""


def run_campaign(case: Case, seed: int) -> Outcome:
    """Measure and identify a robot of a case, drawn by a seed."""
    cell = TrueCell.of(case.robot, seed)
    poses = sample_workspace(cell.robot, 110, seed=seed)
    shots, observations = case.observe(cell, poses)
    asked = {"quantities": (",".join(case.asked),)}
    result = identify(shots, cell.robot, observations=observations, options=asked)
    touched = next((rows.joints for rows in observations if rows.kind == "height"), None)
    real: Mapping[str, float] = cell.errors(result, touched)
    quantities: dict[str, tuple[float, float, float]] = {
        quantity.name: (real[quantity.name], quantity.rms, float(quantity.is_determined))
        for quantity in result.uncertainty.determined
    }
    is_wrong = result.judgement.verdict == "pass" and any(
        not is_determined or error > TOO_LARGE * stated
        for error, stated, is_determined in map(quantities.__getitem__, case.asked)
    )
    return Outcome(seed, str(result.judgement.verdict), quantities, is_wrong)


def cell_of(rows: Sequence[Outcome], quantity: str) -> str:
    """Return real over stated of a quantity, how often more than twice, how often determined."""
    of = [row.quantities[quantity] for row in rows if quantity in row.quantities]
    if not of:
        return ""
    real, stated, determined = np.array(of).T
    factor, unit = SCALE[quantity]
    return (
        f"{factor * np.median(real):.3g}/{factor * np.median(stated):.3g} {unit}, "
        f"{int((real > TOO_LARGE * stated).sum())}, {int(determined.sum())}"
    )


def main() -> None:
    """Run campaigns of all cases and print a table of real against stated errors."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--campaigns", type=int, default=20, help="of each case")
    parser.add_argument("--only", default="", help="cases whose name or robot has this word")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true", help="one object a campaign and line")
    asked = parser.parse_args()
    if not asked.json:
        print("real/stated, campaigns with real > 2 × stated, campaigns that determine it")
        print(f"| robot | observations | {' | '.join(SCALE)} | verdicts | wrong passes |")
        print("|---|---|" + "---|" * (len(SCALE) + 2))
    for case in (c for c in CASES if asked.only in f"{c.robot} {c.name}"):
        rows = []
        for seed in range(asked.seed, asked.seed + asked.campaigns):
            rows.append(run_campaign(case, seed))
            if asked.json:
                print(json.dumps({"case": case.name, **asdict(rows[-1])}), flush=True)
        verdicts = [row.verdict for row in rows]
        counts = ", ".join(f"{word} {verdicts.count(word)}" for word in sorted({*verdicts}))
        cells = " | ".join(cell_of(rows, quantity) for quantity in SCALE)
        wrong = sum(row.is_wrong for row in rows)
        if not asked.json:
            line = f"| {case.robot} | {case.name} | {cells} | {counts} | {wrong} of {len(rows)} |"
            print(line, flush=True)


if __name__ == "__main__":
    main()
