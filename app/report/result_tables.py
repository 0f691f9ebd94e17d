"""Tables on results, alike on the terminal and on the page. Nothing here needs matplotlib."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from campaigns.arrays import AXES, Array
from campaigns.evaluation.decision import Requirement
from campaigns.evaluation.gains import NO_CHANGE, Gain
from campaigns.evaluation.iso_figures import IsoRow
from campaigns.evaluation.summary import ErrorSummary, summary
from campaigns.evaluation.validation import MeasuredLength, RepeatabilityTest
from campaigns.evidence import Evaluation
from campaigns.files.table import NOTHING, Column, Row, number, texts, words

Stage = Literal["before", "after"]
STAGES: tuple[Stage, Stage] = ("before", "after")
KEY_FIGURES = ("distances, mean error", "distances, largest error", "rotation")
STRAIGHTNESS = "straightness"
Stages = tuple[IsoRow | None, IsoRow | None]
"""The same figure before and after."""


def limits(head: str) -> tuple[Column[Requirement], ...]:
    """Columns of requirements: what, error, U, limit, margin, decision."""
    return (
        words(head, lambda each: each.name),
        Column("e", lambda each: "not measured" if each.error is None else each.error, "mm"),
        Column("U", lambda each: each.expanded_uncertainty, "mm"),
        Column("limit", lambda each: "none set" if each.limit is None else each.limit, "mm"),
        Column("margin", lambda each: each.margin, "mm", signed=True),
        words("decision", lambda each: each.decision or NOTHING),
    )


ERRORS: tuple[Column[tuple[str, str, ErrorSummary]], ...] = (
    words("errors", lambda row: row[0]),
    words("", lambda row: row[1]),
    Column("n", lambda row: row[2].n),
    Column("mean", lambda row: row[2].mean, "mm"),
    Column("σ", lambda row: row[2].sigma, "mm"),
    Column("max", lambda row: row[2].max, "mm"),
    Column("mean + 3σ", lambda row: row[2].mean_plus_3_sigma, "mm"),
    Column("P95", lambda row: row[2].p95, "mm"),
)

BEFORE_AND_AFTER: tuple[Column[Gain], ...] = (
    words("", lambda gain: gain.name),
    Column("before", lambda gain: _mm(gain.before), "mm"),
    Column("after", lambda gain: _mm(gain.after), "mm"),
)
GAINS: tuple[Column[Gain], ...] = (
    *BEFORE_AND_AFTER,
    Column("U of the difference", lambda gain: gain.expanded_uncertainty_mm, "mm"),
    Column("gain", lambda gain: _percent_gained(gain)),
)

ISO: tuple[Column[Stages], ...] = (
    words("figure", lambda both: _known(both).name),
    Column("n", lambda both: _shown(both).n if _shown(both).figure else None),
    Column("before", lambda both: _iso_value(both[0]), "mm"),
    Column("U", lambda both: _iso_uncertainty(both[0]), "mm"),
    Column("after", lambda both: _iso_value(both[1]), "mm"),
    Column("U", lambda both: _iso_uncertainty(both[1]), "mm"),
    words("tested here", lambda both: _shown(both).tested),
    words("in the standard", lambda both: _shown(both).asked),
)

CubePose = tuple[str, str, RepeatabilityTest]
"""Stage, name, visits."""
UNKNOWN = (None,) * len(AXES)


def by_axis(
    head: str,
    of: Callable[[CubePose, int], float | None],
    *,
    decimals: int = 3,
    signed: bool = False,
) -> Iterator[Column[CubePose]]:
    """Columns of a vector, mm."""
    for at, axis in enumerate(AXES):
        yield Column(head + axis, partial(lambda at, row: of(row, at), at), "mm", decimals, signed)


CUBE: tuple[Column[CubePose], ...] = (
    words("", lambda row: row[0]),
    words("pose", lambda row: row[1]),
    *by_axis("", lambda row, at: float(row[2].commanded_mm[at]), decimals=0),
    Column("n", lambda row: len(row[2].points_mm)),
    Column("AP", lambda row: _mm(row[2].accuracy), "mm"),
    Column("U", lambda row: _expanded(row[2].accuracy), "mm"),
    *by_axis("AP ", lambda row, at: _mm((row[2].components or UNKNOWN)[at]), signed=True),
    Column("RP", lambda row: row[2].rp.value_mm, "mm"),
    Column("U", lambda row: _expanded(row[2].rp), "mm"),
)
"""Figures of ISO 9283's cube, pose by pose."""


@dataclass(frozen=True, slots=True, eq=False)
class PairGroup:
    """Errors of a group of pairs or shots, mm; a stage that was not measured is None."""

    name: str
    marker: str
    before_mm: Array | None
    after_mm: Array | None
    numbers: tuple[int, ...] = ()
    """Numbers of the pairs or shots; empty if they have none."""

    def __len__(self) -> int:
        return max(len(e) for e in (self.before_mm, self.after_mm) if e is not None)

    def errors_mm(self, stage: Stage) -> Array | None:
        """Return the errors of a stage, mm."""
        return self.before_mm if stage == "before" else self.after_mm


def key_figure_rows(found: Evaluation) -> tuple[Row, ...]:
    """Figures for readers who read no further: name, before, after, what is shown.

    Those of the commanded robot that were measured in at least one stage.
    """
    lines = [gain for gain in found.gains if gain.name.startswith(STRAIGHTNESS)]
    worst = max(lines, key=_larger, default=None)
    chosen = [gain for gain in found.gains if gain.name in KEY_FIGURES]
    shown: Column[Gain] = words("", lambda gain: NO_CHANGE if gain.shown is False else "")
    return texts((*BEFORE_AND_AFTER, shown), [*chosen, *([worst] if worst else [])])


def errors(found: Evaluation) -> list[tuple[str, str, ErrorSummary]]:
    """Errors before and after: of what, stage, summary."""
    return [
        (name, stage, summary(errors))
        for name, *stages in _compared_errors(found)
        for stage, errors in zip(("before", "after"), stages, strict=True)
        if errors is not None
    ]


def error_group(
    name: str, marker: str, before: Array, after: Array, numbers: tuple[int, ...] = ()
) -> PairGroup:
    """Return a group of distances (N, 1) with their sign, or of positions (N, 3) by length."""
    old, new = (
        errors[:, 0] if errors.shape[1] == 1 else np.linalg.norm(errors, axis=1)
        for errors in (before, after)
    )
    return PairGroup(name, marker, old, new, numbers)


def pair_groups(found: Evaluation) -> list[PairGroup]:
    """Return fitted and hold-out pairs by the models, and the pairs that were commanded."""
    errors = found.errors
    modelled = (
        ("fitted pairs", "o", errors.fitted if errors else None),
        ("hold-out pairs", "D", errors.unseen if errors else None),
    )
    groups = [
        PairGroup(name, marker, pairs.before_mm, pairs.after_mm, pairs.numbers)
        for name, marker, pairs in modelled
        if pairs is not None
    ]
    old, new = (stage.distances if stage else None for stage in (found.before, found.after))
    if old or new:
        numbers = {test.pairs for test in (old, new) if test}
        named = numbers.pop() if len(numbers) == 1 else ()
        before, after = (test.errors_mm if test else None for test in (old, new))
        groups.append(PairGroup("commanded pairs", "s", before, after, named))
    return groups


def _compared_errors(found: Evaluation) -> Iterator[tuple[str, Array | None, Array | None]]:
    shots = found.errors.shots if found.errors else None
    if shots is not None:
        yield "fitted positions", shots.before_mm, shots.after_mm
    for group in pair_groups(found):
        yield group.name, group.before_mm, group.after_mm
    before, after = (stage.absolute_mm if stage else None for stage in (found.before, found.after))
    yield "commanded positions", before, after


def _mm(length: MeasuredLength | None) -> float | None:
    return None if length is None else length.value_mm


def _expanded(length: MeasuredLength | None) -> float | None:
    return None if length is None else length.expanded_uncertainty_mm


def _larger(gain: Gain) -> float:
    return max(each.value_mm for each in (gain.before, gain.after) if each is not None)


def _percent_gained(gain: Gain) -> str:
    """By how much something has become smaller, unless the difference is within its U."""
    if gain.before is None or gain.after is None:
        return NOTHING
    if not gain.shown:
        return NO_CHANGE
    return percent_gained(gain.before.value_mm, gain.after.value_mm)


def percent_gained(before: float | None, after: float | None) -> str:
    """Gain: by how much something has become smaller."""
    if before is None or after is None or before == 0.0:
        return NOTHING
    return f"{number(100.0 * (1.0 - after / before), 0)} %"


def _known(both: Stages) -> IsoRow:
    known = both[1] or both[0]
    assert known is not None, "a row is of one stage at least"
    return known


def _shown(both: Stages) -> IsoRow:
    """Stage whose n and test are told: after, if it was measured there."""
    before, after = both
    return after if after and after.figure else before or _known(both)


def _iso_value(row: IsoRow | None) -> str | None:
    if row is None or row.figure is None:
        return None
    return number(row.figure.value_mm)


def _iso_uncertainty(row: IsoRow | None) -> float | None:
    return _expanded(row.figure) if row else None
