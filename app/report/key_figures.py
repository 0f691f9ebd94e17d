"""A few figures before and after, for readers who read no further than the verdict."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from app.report.contents import Contents
from app.report.parts import number
from app.report.stages import StageView


@dataclass(frozen=True, slots=True)
class KeyFigure:
    """A figure in mm, as it stands on the page; a dash where it was not measured."""

    name: str
    before: str
    after: str


def key_figures(contents: Contents) -> tuple[KeyFigure, ...]:
    """Those of the commanded robot that were measured in at least one stage."""
    before = dict(_values(contents.before)) if contents.before else {}
    after = dict(_values(contents.after)) if contents.after else {}
    return tuple(
        KeyFigure(name, number(before.get(name)), number(after.get(name)))
        for name in {**before, **after}
    )


def _values(stage: StageView) -> Iterator[tuple[str, float]]:
    if stage.distances is not None:
        errors = np.abs(stage.distances.errors_mm)
        yield "distances, mean error", float(errors.mean())
        yield "distances, largest error", float(errors.max())
    if stage.lines:
        worst = max(line.straightness.value_mm for line in stage.lines)
        yield "straightness, worst line", worst
    if stage.turn is not None:
        yield "rotation", stage.turn.moved.value_mm
