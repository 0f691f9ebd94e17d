"""Figures of a validation's tests beside those of ISO 9283 that they resemble.

None of the tests is made as the standard makes it, so each figure has a name of its own. Which of
the standard's it resembles, and what would be needed for the standard's symbol, stands beside it.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from campaigns.evaluation import iso9283
from campaigns.evaluation.iso9283 import Figure, Symbol
from campaigns.evaluation.validation import AXES, DistanceTest, ValidationResult

NO_FRAME = "not formed: too few commanded points for a base frame"


@dataclass(frozen=True, slots=True)
class Asked:
    """Condition that the standard asks for before a figure has its symbol."""

    symbol: Symbol
    clause: str
    needs: str

    def __str__(self) -> str:
        return f"{self.symbol} ({self.clause}): {self.needs}"


FIVE_POSES = "30 visits from one direction to each of five poses"
AP = Asked("AP", "7.2.1", f"{FIVE_POSES}, in a base frame known beforehand")
RP = Asked("RP", "7.2.2", FIVE_POSES)
VAP = Asked("vAP", "7.2.3", "30 visits from each of three directions")
AD = Asked("AD", "7.3", "one pair of poses, 30 times")
RD = Asked("RD", "7.3", "one pair of poses, 30 times")
AT = Asked("AT", "8.2", "10 cycles in motion, in a base frame known beforehand")


@dataclass(frozen=True, slots=True)
class IsoRow:
    """Figure under its own name, or why there is none, and what the standard asks for instead."""

    name: str
    figure: Figure | None
    tested: str
    """How it was tested here."""
    asked: Asked


def iso_rows(found: ValidationResult) -> tuple[IsoRow, ...]:
    """Every figure of the standard once, that of paths once a line."""
    return (*_pose_rows(found), *_distance_rows(found), *_path_rows(found))


def _pose_rows(found: ValidationResult) -> Iterator[IsoRow]:
    visits, accuracy, repeatability = found.repeatability, None, None
    how = where = "not measured: no repeated visits"
    if visits is not None:
        how = f"{len(visits.points_mm)} visits of one pose, each from another direction"
        where = f"{how}; frame fitted" if found.in_base else NO_FRAME
        repeatability = iso9283.pose_repeatability(visits.points_mm)
        if found.in_base:
            accuracy = iso9283.pose_accuracy(
                visits.commanded_mm, visits.points_mm, visits.radius.standard_uncertainty_mm
            )
    yield IsoRow("visits' mean, from the commanded point", accuracy, where, AP)
    yield IsoRow("repeated visits, l̄ + 3 S", repeatability, how, RP)
    once = "not measured: each direction of approach is visited once"
    yield IsoRow("variation with the direction of approach", None, once, VAP)


def _distance_rows(found: ValidationResult) -> Iterator[IsoRow]:
    test, accuracy, tested = found.distances, None, "not measured: no pairs"
    if test is not None:
        accuracy = _worst(test)
        tested = f"{len(test.pairs)} pairs, each measured once"
    yield IsoRow("largest error of a distance", accuracy, tested, AD)
    once = "not measured: each pair is measured once"
    yield IsoRow("scatter of a distance", None, once, RD)


def _worst(test: DistanceTest) -> Figure:
    row = int(np.argmax(np.abs(test.errors_mm)))
    return iso9283.distance_accuracy(
        float(test.commanded_mm[row]),
        test.measured_mm[row : row + 1],
        float(test.standard_uncertainty_mm[row]),
    )


def _path_rows(found: ValidationResult) -> Iterator[IsoRow]:
    for axis in AXES:
        line, name = found.line(axis), f"off the commanded line along {axis}"
        if line is None:
            yield IsoRow(name, None, "not measured: no such line", AT)
        elif not found.in_base:
            yield IsoRow(name, None, NO_FRAME, AT)
        else:
            start, end = line.commanded_mm[0], line.commanded_mm[-1]
            figure = iso9283.line_accuracy(
                start, end, line.points_mm[None], line.straightness.standard_uncertainty_mm
            )
            length = float(np.linalg.norm(end - start))
            tested = f"{len(line.points_mm)} standing points over {length:.0f} mm; frame fitted"
            yield IsoRow(name, figure, tested, AT)
