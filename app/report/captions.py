"""Captions that look at their data: what a figure shows this time, in a sentence."""

from collections.abc import Mapping, Sequence

import numpy as np

from app.report.groups import PairGroup
from campaigns.arrays import AXES, Array
from campaigns.estimation.information import SIGNIFICANCE, Uncertainty
from campaigns.evaluation.model_errors import PositionErrors
from campaigns.evaluation.patterns import (
    Tested,
    centred,
    neighbours_agree,
    rank_trend,
    share_from_middle,
    stands_out,
)
from campaigns.evaluation.time_series import TimeSeries
from campaigns.evaluation.validation import RepeatabilityTest, RotationTest, ValidationResult
from campaigns.files.table import number

EDGE, MIDDLE = 0.75, 0.25
"""Shares of shots that are nearer to the middle of the workspace."""
STRONG = 0.7
Stage = ValidationResult | None


def shots_in_words(group: PairGroup) -> str:
    """Errors of position, shot by shot: the largest, whether it stands out, a trend."""
    stage, errors = _latest(group)
    ratio, p = stands_out(errors)
    outlying = "it stands out" if p < SIGNIFICANCE else "none stands out"
    order = np.arange(len(errors), dtype=float)
    return (
        f"The largest {stage} is {number(errors.max())} mm at {_named(group, 'shot', errors)}, "
        f"{number(ratio, 1)} times the median: {outlying} ({_p(p)}); "
        f"{_trends({'the order of shots': rank_trend(order, errors)})}."
    )


def pairs_in_words(groups: Sequence[PairGroup]) -> str:
    """Errors of distance, pair by pair: rms of each group, and the largest of all."""
    told = [(group, *_latest(group)) for group in groups]
    stage = told[-1][1]
    told = [each for each in told if each[1] == stage]
    rms = (f"{g.name} {number(np.sqrt(np.mean(mm**2)))} mm" for g, _, mm in told)
    group, _, errors = max(told, key=lambda each: float(np.abs(each[2]).max()))
    largest = f"{number(np.abs(errors).max())} mm at {_named(group, 'pair', errors)}"
    return f"Rms {stage}: {', '.join(rms)}; the largest is {largest} ({group.name})."


def spread_in_words(groups: Sequence[PairGroup]) -> str:
    """How errors of distance are spread: their mean, and whether it is zero."""
    parts = []
    for stage in ("before", "after"):
        known = [mm for each in groups if (mm := getattr(each, f"{stage}_mm")) is not None]
        if known:
            mean, p = centred(np.concatenate(known))
            where = "not centred on zero" if p < SIGNIFICANCE else "centred on zero"
            parts.append(f"{stage} they are {where}: mean {number(mean, signed=True)} mm ({_p(p)})")
    return _sentence("; ".join(parts))


def arrows_in_words(positions: PositionErrors) -> str:
    """Errors in the workspace: whether neighbours agree."""
    parts = []
    for stage, errors in (("before", positions.before_mm), ("after", positions.after_mm)):
        if errors is not None:
            cosine, p = neighbours_agree(positions.poses[:, :3], errors)
            verb = "agree" if p < SIGNIFICANCE else "do not agree"
            told = f"mean cosine {number(cosine, 2)}, {_p(p)}"
            parts.append(f"{stage}, neighbours {verb} ({told})")
    return _sentence("; ".join(parts))


def places_in_words(positions: PositionErrors) -> str:
    """Errors against place and angle: where the largest is, and what they follow."""
    assert positions.after_mm is not None, "drawn of the identified model alone"
    size, poses = np.linalg.norm(positions.after_mm, axis=1), positions.poses
    row = int(size.argmax())
    share = share_from_middle(poses[:, :3], row)
    near = (
        "near the edge" if share > EDGE else "near the middle" if share < MIDDLE else "half-way out"
    )
    away = np.linalg.norm(poses[:, :3] - poses[:, :3].mean(axis=0), axis=1)
    columns = {"radius": away, **dict(zip((*AXES, "angle"), poses.T, strict=False))}
    trends = {name: rank_trend(column, size) for name, column in columns.items()}
    return (
        f"The largest is {number(size[row])} mm at shot {positions.numbers[row]}, {near} of the "
        f"workspace; {_trends(trends)}."
    )


def tilt_in_words(positions: PositionErrors) -> str:
    """Tilt of the plate: the largest, and whether it grows outwards."""
    poses = positions.poses
    size = 1e3 * np.linalg.norm(positions.plate_tilt_rad[:, :2], axis=1)
    row = int(size.argmax())
    away = np.linalg.norm(poses[:, :2] - poses[:, :2].mean(axis=0), axis=1)
    trend = _trends({"the distance from the middle": rank_trend(away, size)})
    return f"The largest is {number(size[row], 2)} mrad at shot {positions.numbers[row]}; {trend}."


def lines_in_words(before: Stage, after: Stage) -> str:
    """Straightness: the worst line of each stage, and in which direction it bends."""
    parts = []
    for name, stage in (("before", before), ("after", after)):
        if stage is not None and stage.lines:
            worst = max(stage.lines, key=lambda line: line.straightness.value_mm)
            told = f"{number(worst.straightness.value_mm)} mm along {worst.axis}"
            parts.append(
                f"{name}, the worst line is off by {told}, most in {_widest(worst.away_mm)}"
            )
    return _sentence("; ".join(parts))


def rotation_in_words(before: RotationTest | None, after: RotationTest | None) -> str:
    """Rotation: how far the point goes, where most, and whether it follows the angle."""
    parts = []
    for name, test in (("before", before), ("after", after)):
        if test is not None:
            angles = test.turn_rad
            trends = {axis: rank_trend(angles, test.away_mm[:, n]) for n, axis in enumerate(AXES)}
            most = _widest(test.away_mm)
            follows = _trends(
                trends, "it follows the angle in {}", "it follows the angle in no direction"
            )
            parts.append(
                f"{name}, the point moves by {number(test.moved.value_mm)} mm, most in {most}; "
                f"{follows}"
            )
    return _sentence("; ".join(parts))


def visits_in_words(before: RepeatabilityTest | None, after: RepeatabilityTest | None) -> str:
    """Repeatability: scatter by direction, and whether a visit stands out."""
    stage, test = ("after", after) if after is not None else ("before", before)
    assert test is not None, "drawn where one was measured"
    away = test.away_mm
    widths = ", ".join(f"{axis} {number(away[:, n].std(ddof=1))}" for n, axis in enumerate(AXES))
    ratio, p = stands_out(np.linalg.norm(away, axis=1))
    outlying = "it stands out" if p < SIGNIFICANCE else "none stands out"
    return (
        f"{len(away)} visits {stage}, σ in mm: {widths}; the farthest is {number(ratio, 1)} "
        f"times as far as the median: {outlying} ({_p(p)})."
    )


def correlations_in_words(known: Uncertainty) -> str:
    """Correlations: the strongest, and how many are strong."""
    if len(known.names) < 2:
        return ""
    [most] = known.strongest(1)
    size = np.abs(known.correlations())[np.triu_indices(len(known.names), k=1)]
    return (
        f"The strongest is {number(most.value, 2, signed=True)}, of {most.a} with {most.b}; "
        f"{int(np.sum(size > STRONG))} of {len(size)} are beyond {STRONG}."
    )


def time_in_words(courses: Sequence[TimeSeries]) -> str:
    """Air and drift of each series: from where to where, how far, and with which trend."""
    parts = []
    for each in courses:
        air, moved = each.air_range, each.moved_mm
        if air is not None:
            parts.append(f"{each.name}: air {number(air[0], 2)} to {number(air[1], 2)} °C")
        if moved is not None:
            trend = _trends({"time": rank_trend(each.drift_s[1:], each.drift_mm[1:])})
            parts.append(
                f"{each.name}: the drift pose moved by {number(moved)} mm at most; {trend}"
            )
    return _sentence("; ".join(parts))


def _latest(group: PairGroup) -> tuple[str, Array]:
    """Stage and errors after, else before."""
    if group.after_mm is not None:
        return "after", group.after_mm
    assert group.before_mm is not None, "a group has errors of a stage"
    return "before", group.before_mm


def _named(group: PairGroup, what: str, errors: Array) -> str:
    """Number of the shot or pair of the largest error, else its place."""
    row = int(np.abs(errors).argmax())
    return f"{what} {group.numbers[row]}" if group.numbers else f"mark {row + 1}"


def _widest(away_mm: Array) -> str:
    return AXES[int(np.sum(away_mm**2, axis=0).argmax())]


def _trends(
    tested: Mapping[str, Tested], some: str = "it follows {}", none: str = "no trend with {}"
) -> str:
    """What sizes follow, of several things; p are those of the best of so many tests."""
    corrected = {name: (r, min(1.0, len(tested) * p)) for name, (r, p) in tested.items()}
    found = {name: each for name, each in corrected.items() if each[1] < SIGNIFICANCE}
    if found:
        told = (f"{name} ({number(r, 2, signed=True)}, {_p(p)})" for name, (r, p) in found.items())
        return some.format(", ".join(told))
    return f"{none.format(' or '.join(tested))} ({_p(min(p for _, p in corrected.values()))})"


def _p(p: float) -> str:
    return "p < 0.001" if p < 1e-3 else f"p = {p:.2g}"


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}." if text else ""
