"""The figures of ISO 9283 that a stage's tests give, and those that they cannot give."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from app.report.stages import StageView
from campaigns.evaluation import iso9283
from campaigns.evaluation.iso9283 import Figure, Symbol
from campaigns.evaluation.validation import AXES, DistanceTrace

NO_FRAME = "too few commanded points for a base frame"


@dataclass(frozen=True, slots=True)
class IsoRow:
    """A figure, or why there is none. `conditions`: how it was tested; how the standard does it."""

    symbol: Symbol
    what: str
    figure: Figure | None
    conditions: str


def iso_rows(stage: StageView) -> tuple[IsoRow, ...]:
    """Every symbol once, AT once a line."""
    return (*_pose_rows(stage), *_distance_rows(stage), *_path_rows(stage))


def _pose_rows(stage: StageView) -> Iterator[IsoRow]:
    cloud, accuracy, repeatability = stage.cloud, None, None
    visits = "not measured: no repeated visits"
    where = visits
    if cloud is not None:
        visits = "one pose, each visit from another direction; 30 from one, at five poses"
        where = f"{visits}; frame fitted" if stage.in_base else NO_FRAME
        repeatability = iso9283.pose_repeatability(cloud.points_mm)
        if stage.in_base:
            accuracy = iso9283.pose_accuracy(
                cloud.commanded_mm, cloud.points_mm, cloud.radius.instrument_mm
            )
    yield IsoRow("AP", "pose accuracy", accuracy, where)
    yield IsoRow("RP", "pose repeatability", repeatability, visits)
    once = "not measured: each direction of approach is visited once"
    yield IsoRow("vAP", "variation of pose accuracy with direction", None, once)


def _distance_rows(stage: StageView) -> Iterator[IsoRow]:
    trace, accuracy, conditions = stage.distances, None, "not measured: no pairs"
    if trace is not None:
        accuracy = _worst(trace)
        conditions = f"largest of {len(trace.pairs)} pairs, each measured once; one pair, 30 times"
    yield IsoRow("AD", "distance accuracy", accuracy, conditions)
    once = "not measured: each pair is measured once"
    yield IsoRow("RD", "distance repeatability", None, once)


def _worst(trace: DistanceTrace) -> Figure:
    row = int(np.argmax(np.abs(trace.errors_mm)))
    return iso9283.distance_accuracy(
        float(trace.commanded_mm[row]),
        trace.measured_mm[row : row + 1],
        float(trace.instrument_mm[row]),
    )


def _path_rows(stage: StageView) -> Iterator[IsoRow]:
    for axis in AXES:
        line, what = stage.line(axis), f"path accuracy, line along {axis}"
        if line is None:
            yield IsoRow("AT", what, None, "not measured: no such line")
        elif not stage.in_base:
            yield IsoRow("AT", what, None, NO_FRAME)
        else:
            start, end = line.commanded_mm[0], line.commanded_mm[-1]
            figure = iso9283.line_accuracy(
                start, end, line.points_mm[None], line.straightness.instrument_mm
            )
            length = float(np.linalg.norm(end - start))
            yield IsoRow(
                "AT",
                what,
                figure,
                f"{len(line.points_mm)} standing points over {length:.0f} mm; 10 cycles in motion",
            )
