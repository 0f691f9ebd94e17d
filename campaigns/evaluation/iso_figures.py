"""Figures of a validation's tests beside those of ISO 9283 that they resemble.

The test `iso9283` is made as the standard makes it, and its figures have the standard's symbols.
None of the others is, so each figure has a name of its own. Which of the standard's it resembles,
and what would be needed for the standard's symbol, stands beside it.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from campaigns.arrays import AXES
from campaigns.evaluation.validation import (
    CUBE_FIGURES,
    DistanceTest,
    MeasuredLength,
    RepeatabilityTest,
    ValidationResult,
)

NO_FRAME = "not formed: too few commanded points for a base frame"
FIVE_POSES = "30 visits from one direction to each of five poses"
AP = f"AP (7.2.1): {FIVE_POSES}, in a base frame known beforehand"
RP = f"RP (7.2.2): {FIVE_POSES}"
VAP = "vAP (7.2.3): 30 visits from each of three directions"
AD, RD = (f"{symbol} (7.3): one pair of poses, 30 times" for symbol in ("AD", "RD"))
AT = "AT (8.2): 10 cycles in motion, in a base frame known beforehand"


@dataclass(frozen=True, slots=True)
class IsoRow:
    """Figure under its own name, or why there is none, and what the standard asks for instead."""

    name: str
    figure: MeasuredLength | None
    n: int
    """Repetitions: visits, or cycles of a path."""
    tested: str
    """How it was tested here."""
    asked: str

    @property
    def is_signed(self) -> bool:
        """Whether the sign of the figure says something."""
        return self.asked is AD


def iso_rows(found: ValidationResult) -> tuple[IsoRow, ...]:
    """Every figure of the standard once, that of paths once a line."""
    return (*_cube_rows(found), *_pose_rows(found), *_distance_rows(found), *_path_rows(found))


def cube_poses(**stages: ValidationResult | None) -> tuple[tuple[str, str, RepeatabilityTest], ...]:
    """Stage, name and visits of each of the standard's poses, P1 to P5."""
    return tuple(
        (stage, f"P{number}", each)
        for stage, found in stages.items()
        for number, each in enumerate(found.cube if found else (), start=1)
    )


def cube_frame(found: ValidationResult) -> str:
    """Frame in which AP is told: that of the pairs where they are of the same series."""
    if not found.cube[0].in_base:
        return NO_FRAME
    pairs, own = (found.series.get(name) for name in ("distances", "iso9283"))
    of = "the pairs" if pairs is not None and pairs == own else "these poses alone"
    return f"frame fitted to {of}"


def _cube_rows(found: ValidationResult) -> Iterator[IsoRow]:
    visits, how, where = 0, "not measured: `--only iso9283`", ""
    if found.cube:
        visits = min(len(each.points_mm) for each in found.cube)
        how = f"{visits} visits from one direction to each of {len(found.cube)} poses"
        where = f"; {cube_frame(found)}"
    accuracy, rp = found.worst_of_cube
    yield IsoRow(CUBE_FIGURES[0], accuracy, visits, how + where, AP)
    yield IsoRow(CUBE_FIGURES[1], rp, visits, how, RP)


def _pose_rows(found: ValidationResult) -> Iterator[IsoRow]:
    visits, how, count = found.repeatability, "not measured: no repeated visits", 0
    where = how
    if visits is not None:
        count = len(visits.points_mm)
        how = f"{count} visits of one pose, each from another direction"
        where = f"{how}; frame fitted" if visits.in_base else NO_FRAME
    accuracy, rp = (visits.accuracy, visits.rp) if visits else (None, None)
    yield IsoRow("visits' mean, from the commanded point", accuracy, count, where, AP)
    yield IsoRow("repeated visits, l̄ + 3 S", rp, count, how, RP)
    once = "not measured: each direction of approach is visited once"
    yield IsoRow("variation with the direction of approach", None, 0, once, VAP)


def _distance_rows(found: ValidationResult) -> Iterator[IsoRow]:
    test, tested = found.distances, "not measured: no pairs"
    if test is not None:
        tested = f"{len(test.pairs)} pairs, each measured once"
    worst = _worst(test) if test else None
    yield IsoRow("largest error of a distance", worst, 1, tested, AD)
    once = "not measured: each pair is measured once"
    yield IsoRow("scatter of a distance", None, 0, once, RD)


def _worst(test: DistanceTest) -> MeasuredLength:
    """Measured minus commanded, as the standard has it."""
    row = int(np.argmax(np.abs(test.errors_mm)))
    return MeasuredLength(-float(test.errors_mm[row]), float(test.standard_uncertainty_mm[row]))


def _path_rows(found: ValidationResult) -> Iterator[IsoRow]:
    for axis in AXES:
        line, tested = found.line(axis), "not measured: no such line"
        if line is not None:
            length = float(np.linalg.norm(line.commanded_mm[-1] - line.commanded_mm[0]))
            tested = f"{len(line.points_mm)} standing points over {length:.0f} mm; frame fitted"
            tested = tested if line.in_base else NO_FRAME
        off = line.off_commanded if line else None
        yield IsoRow(f"off the commanded line along {axis}", off, 1, tested, AT)
