"""Figures of ISO 9283 that a validation's tests give, and those that they cannot give."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from campaigns.evaluation import iso9283
from campaigns.evaluation.iso9283 import Figure, Symbol
from campaigns.evaluation.validation import AXES, DistanceTest, ValidationResult

NO_FRAME = "too few commanded points for a base frame"


@dataclass(frozen=True, slots=True)
class IsoRow:
    """Figure, or why there is none. `conditions`: how it was tested; how the standard does it."""

    symbol: Symbol
    what: str
    figure: Figure | None
    conditions: str


def iso_rows(found: ValidationResult) -> tuple[IsoRow, ...]:
    """Every symbol once, AT once a line."""
    return (*_pose_rows(found), *_distance_rows(found), *_path_rows(found))


def _pose_rows(found: ValidationResult) -> Iterator[IsoRow]:
    visits, accuracy, repeatability = found.repeatability, None, None
    how = "not measured: no repeated visits"
    where = how
    if visits is not None:
        how = "one pose, each visit from another direction; 30 from one, at five poses"
        where = f"{how}; frame fitted" if found.in_base else NO_FRAME
        repeatability = iso9283.pose_repeatability(visits.points_mm)
        if found.in_base:
            accuracy = iso9283.pose_accuracy(
                visits.commanded_mm, visits.points_mm, visits.radius.standard_uncertainty_mm
            )
    yield IsoRow("AP", "pose accuracy", accuracy, where)
    yield IsoRow("RP", "pose repeatability", repeatability, how)
    once = "not measured: each direction of approach is visited once"
    yield IsoRow("vAP", "variation of pose accuracy with direction", None, once)


def _distance_rows(found: ValidationResult) -> Iterator[IsoRow]:
    test, accuracy, conditions = found.distances, None, "not measured: no pairs"
    if test is not None:
        accuracy = _worst(test)
        conditions = f"largest of {len(test.pairs)} pairs, each measured once; one pair, 30 times"
    yield IsoRow("AD", "distance accuracy", accuracy, conditions)
    once = "not measured: each pair is measured once"
    yield IsoRow("RD", "distance repeatability", None, once)


def _worst(test: DistanceTest) -> Figure:
    row = int(np.argmax(np.abs(test.errors_mm)))
    return iso9283.distance_accuracy(
        float(test.commanded_mm[row]),
        test.measured_mm[row : row + 1],
        float(test.standard_uncertainty_mm[row]),
    )


def _path_rows(found: ValidationResult) -> Iterator[IsoRow]:
    for axis in AXES:
        line, what = found.line(axis), f"path accuracy, line along {axis}"
        if line is None:
            yield IsoRow("AT", what, None, "not measured: no such line")
        elif not found.in_base:
            yield IsoRow("AT", what, None, NO_FRAME)
        else:
            start, end = line.commanded_mm[0], line.commanded_mm[-1]
            figure = iso9283.line_accuracy(
                start, end, line.points_mm[None], line.straightness.standard_uncertainty_mm
            )
            length = float(np.linalg.norm(end - start))
            yield IsoRow(
                "AT",
                what,
                figure,
                f"{len(line.points_mm)} standing points over {length:.0f} mm; 10 cycles in motion",
            )
