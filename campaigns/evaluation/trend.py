"""Trend over campaigns and checks: which parameters drift, and when the next check is due.

A trend is claimed of a parameter whose slope is beyond chance among all of them, and whose values
lie on a line; what jumped is no trend. Campaigns are independent, what one folder holds is not.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import Literal

import numpy as np

from campaigns.arrays import Array
from campaigns.estimation.information import (
    SIGNIFICANCE,
    WeightedLine,
    WorkspaceSample,
    weighted_line,
)
from campaigns.estimation.point_sets import directions
from campaigns.evaluation.decision import COVERAGE, Decision
from campaigns.evaluation.validation import MeasuredLength

FEWEST = 3
"""Days from which a trend can be told: a line fits any two, and one day's changes are no trend."""
DAY_S = 86400.0
LATEST_DAYS = 3650.0
"""What drifts so slowly is not foretold to a day."""
EpochKind = Literal["campaign", "repair", "check"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Epoch:
    """Time at which parameters were measured: values and 1 σ by name, mm and deg, or none.

    Mean errors of distances are of the robot as commanded, or of hold-out pairs by the model.
    """

    folder: str
    kind: EpochKind
    measured_utc: str
    decision: Decision
    says: str
    values: dict[str, float] = field(default_factory=dict)
    std: dict[str, float] = field(default_factory=dict)
    position_std_mm: float | None = None
    before: MeasuredLength | None = None
    after: MeasuredLength | None = None
    unseen_mm: float | None = None

    @property
    def at(self) -> datetime:
        """When its last shot was measured."""
        return datetime.fromisoformat(self.measured_utc)


@dataclass(frozen=True, slots=True)
class Change:
    """Value of a parameter in an epoch, by its number from 1, and its change since the first."""

    name: str
    unit: str
    epoch: int
    measured_utc: str
    value: float
    std: float
    delta: float
    delta_std: float

    @property
    def ratio(self) -> float | None:
        """Δ/σ; None of the first."""
        return self.delta / self.delta_std if self.delta_std else None


@dataclass(frozen=True, slots=True)
class ParameterTrend:
    """Changes of one parameter, and its line in mm or deg a day; None for too few times."""

    changes: tuple[Change, ...]
    line: WeightedLine | None
    level: float
    """Chance below which it counts as more than chance, among all parameters."""

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return self.changes[0].name

    @property
    def drifts(self) -> bool:
        """Whether it has a slope beyond chance, along a line."""
        return self.line is not None and self.line.p < self.level <= self.line.misfit_p

    @property
    def jumps(self) -> bool:
        """Whether it changed beyond chance otherwise than along a line."""
        return self.line is not None and self.line.misfit_p < self.level

    @property
    def moves(self) -> bool:
        """Whether its values spread by more than their σ."""
        values, std = ([getattr(c, of) for c in self.changes] for of in ("value", "std"))
        return len(values) > 1 and bool(
            np.std(values, ddof=1) > np.linalg.norm(std) / len(std) ** 0.5
        )


@dataclass(frozen=True, slots=True)
class NextCheck:
    """When the next check is due, by what drifts; None where no trend tells it.

    `room_mm` is what is left of the limit, `mm_per_day` how fast it is used up, 2 σ in it.
    """

    says: str
    due_utc: str | None = None
    drifting: tuple[str, ...] = ()
    room_mm: float | None = None
    mm_per_day: float | None = None


def trends(epochs: Sequence[Epoch], units: Mapping[str, str]) -> tuple[ParameterTrend, ...]:
    """Trend of each parameter that any epoch tells, epochs in the order of time."""
    names = [name for name in units if any(name in epoch.std for epoch in epochs)]
    return tuple(_trend(name, units[name], epochs, SIGNIFICANCE / len(names)) for name in names)


def _trend(name: str, unit: str, epochs: Sequence[Epoch], level: float) -> ParameterTrend:
    known = [(number, each) for number, each in enumerate(epochs, start=1) if name in each.std]
    first, changes = known[0][1], list[Change]()
    for number, each in known:
        value, std, own = each.values[name], each.std[name], first.std[name]
        apart = 0.0 if each is first else float(np.hypot(std, own))
        if each is not first and each.folder == first.folder:  # whatever they share
            apart = std + own
        delta = value - first.values[name]
        changes.append(Change(name, unit, number, each.measured_utc, value, std, delta, apart))
    days = np.array([(each.at - first.at).total_seconds() / DAY_S for _, each in known])
    line = None
    if len({*days.astype(int).tolist()}) >= FEWEST:
        values, stds = np.array([(each.value, each.std) for each in changes]).T
        line = weighted_line(days, values, stds, [each.folder for _, each in known])
    return ParameterTrend(tuple(changes), line, level)


def next_check(
    epochs: Sequence[Epoch],
    found: Sequence[ParameterTrend],
    sample: WorkspaceSample | None,
    limit_mm: float | None,
    now: datetime,
) -> NextCheck:
    """Next check by the limit of the mean distance error, or else when U of positions doubles.

    `sample` has the drifting parameters; drift counts from the last calibration.
    Each that drifts and all together are tried, and the soonest counts: sooner rather than later.
    """
    told = _told(epochs)
    drifting = [each for each in found if each.drifts]
    if not drifting:
        few = not any(each.line for each in found)
        jumped = ", ".join(each.name for each in found if each.jumps)
        says = (
            f"no trend can be told of {told}: it takes {FEWEST} different days"
            if few
            else f"no trend in {told}"
        )
        return NextCheck(f"{says}; changed, but not steadily: {jumped}" if jumped else says)
    names, own = tuple(each.name for each in drifting), [e.line for e in drifting if e.line]
    last = next(e for e in reversed(epochs) if e.kind != "check" and e.values)
    error_mm = last.after.value_mm if last.after else last.unseen_mm
    ends, what = limit_mm, f"the mean distance error reaches {limit_mm} mm"
    if limit_mm is None or error_mm is None:
        own_u = COVERAGE * last.position_std_mm if last.position_std_mm else None
        ends, error_mm, what = own_u, 0.0, "U of positions doubles"
    drift = "; ".join(
        f"{e.name} drifts by {e.line.rate * 30:+.4f} ± {COVERAGE * e.line.rate_std * 30:.4f} "
        f"{e.changes[0].unit} in 30 days (U, k = 2)"
        for e in drifting
        if e.line
    ).replace("-", "−")
    if sample is None or ends is None:
        return NextCheck(
            f"{drift}; no limit and no U of positions tells when it matters", None, names
        )
    columns = sample.jacobian[:, :, [sample.names.index(name) for name in names]]
    if limit_mm is not None and what.startswith("the mean"):
        first, second = np.arange(len(columns) - 1), np.arange(1, len(columns))
        towards = directions(sample.poses[:, :3], first, second)
        columns = np.einsum("nk,nkf->nf", towards, columns[1:] - columns[:-1])[:, None]
    rates, std = np.array([line.rate for line in own]), np.array([line.rate_std for line in own])
    every = [*np.eye(len(names)), np.ones(len(names))]
    speed = max(
        _mean(columns @ (rates * some))
        + COVERAGE * sum(_mean(columns @ each) for each in np.diag(std * some))
        for some in every
    )
    room_mm = max(ends - error_mm, 0.0)
    if room_mm > LATEST_DAYS * speed:
        says = f"{drift}; not within {LATEST_DAYS / 365:.0f} years will it matter: {what} later"
        return NextCheck(says, None, names, room_mm, speed)
    due = last.at + timedelta(days=room_mm / speed)
    says = f"next check due {'since' if due <= now else 'on'} {due.date()}, when {what}: {drift}"
    return NextCheck(says, due.isoformat(timespec="seconds"), names, room_mm, speed)


def _mean(shifts_mm: Array) -> float:
    """Mean length of shifts (N, k)."""
    return float(np.linalg.norm(shifts_mm, axis=1).mean())


def _told(epochs: Sequence[Epoch]) -> str:
    """What there is, in words: `3 campaigns and 2 checks over 40 days`."""
    count = {
        kind: sum(each.kind == kind for each in epochs) for kind in ("campaign", "repair", "check")
    }
    words = [f"{n} {kind}{'s' * (n != 1)}" for kind, n in count.items() if n]
    return f"{' and '.join(words)} over {(epochs[-1].at - epochs[0].at).days} days"
