"""What a validation series shows (paper section IV.E, ISO 9283): the robot as it is commanded."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import JsonValue

from campaigns.config_sections import AcceptanceConfig
from campaigns.journal_views import AcceptedShot
from campaigns.numerics.frames import fit_transform
from campaigns.numerics.geometry import Array, Index
from campaigns.numerics.statistics import Spread, spread
from campaigns.planning import pose_row
from campaigns.shot_sets import ShotSet

SHOTS_FOR_A_FRAME = 4
AXES = ("x", "y", "z")
NO_AXIS = -1
SAME_MM = 1e-6
"""Below this a commanded coordinate has not changed."""


@dataclass(frozen=True, slots=True)
class Repeatability:
    """Many approaches to one point: radius of the sphere about their mean, and ISO 9283's RP."""

    radius_mm: float
    rp_mm: float
    approaches: int


@dataclass(frozen=True, slots=True)
class FrameErrors:
    """Distances to the commanded points after the six-parameter fit (eqs. 22-25)."""

    mean: float
    max: float


@dataclass(frozen=True, slots=True)
class Validation:
    """Results in mm; None for a test that was not run."""

    distances: Spread | None
    rotation_mm: float | None
    straightness_mm: Mapping[str, float] | None
    repeatability: Repeatability | None
    frame: FrameErrors | None

    def document(self) -> dict[str, JsonValue]:
        """As `validate --json` prints it."""
        return {
            "distances_mm": _picked(self.distances, "mean_abs", "max_abs"),
            "rotation_mm": self.rotation_mm,
            "straightness_mm": dict(self.straightness_mm) if self.straightness_mm else None,
            "repeatability": _picked(self.repeatability, "radius_mm", "rp_mm", "approaches"),
            "frame_mm": _picked(self.frame, "mean", "max"),
        }


def _picked(value: object | None, *names: str) -> JsonValue:
    return None if value is None else {name: getattr(value, name) for name in names}


def evaluate(shots: Sequence[AcceptedShot]) -> Validation:
    """Evaluate the accepted shots of a validation series."""
    validation = _of(shots, ShotSet.VALIDATION)
    return Validation(
        _distances(validation),
        rotation_mm(_points(_of(shots, ShotSet.ROTATION))),
        _straightness(_of(shots, ShotSet.STRAIGHTNESS)),
        repeatability(_points(_of(shots, ShotSet.REPEATABILITY))),
        frame_errors(_commanded(validation), _points(validation)),
    )


def _of(shots: Sequence[AcceptedShot], purpose: ShotSet) -> list[AcceptedShot]:
    return [shot for shot in shots if shot.intent.purpose == purpose.value]


def _points(shots: Sequence[AcceptedShot]) -> Array:
    """Measured, in the tracker's frame, (N, 3)."""
    return np.array([shot.outcome.point_in_tracker_mm for shot in shots]).reshape(-1, 3)


def _commanded(shots: Sequence[AcceptedShot]) -> Array:
    """Commanded, in the base frame, (N, 3)."""
    return np.array([pose_row(shot.intent.target)[:3] for shot in shots]).reshape(-1, 3)


def _distances(shots: Sequence[AcceptedShot]) -> Spread | None:
    """Commanded minus measured distances of the pairs."""
    pairs: dict[int, list[AcceptedShot]] = {}
    for shot in shots:
        if shot.intent.pair is not None:
            pairs.setdefault(shot.intent.pair, []).append(shot)
    errors = [
        float(np.linalg.norm(np.diff(_commanded(pair), axis=0)))
        - float(np.linalg.norm(np.diff(_points(pair), axis=0)))
        for pair in pairs.values()
        if len(pair) == 2
    ]
    return spread(np.array(errors)) if errors else None


def rotation_mm(points: Array) -> float | None:
    """Largest distance between any two points (N, 3) measured while only θ should change."""
    if len(points) < 2:
        return None
    return float(np.linalg.norm(points[:, None] - points[None], axis=2).max())


def _straightness(shots: Sequence[AcceptedShot]) -> dict[str, float] | None:
    """By the axis along which each line was commanded; a line needs three points."""
    points, axes = _points(shots), line_axes(_commanded(shots))
    lines = {name: points[axes == axis] for axis, name in enumerate(AXES)}
    found = {name: straightness_mm(line) for name, line in lines.items() if len(line) > 2}
    return found or None


def line_axes(commanded_mm: Array) -> Index:
    """The axis (0, 1, 2) of the line to which each commanded point belongs, (N,).

    Points (N, 3) come line by line, and along each line only one coordinate changes: a point is of
    the line of its predecessor as long as it differs from it along one axis alone.
    """
    steps = np.abs(np.diff(commanded_mm, axis=0)) > SAME_MM
    axes = np.full(len(commanded_mm), NO_AXIS, dtype=np.intp)
    for row, changed in enumerate(steps, start=1):
        if np.count_nonzero(changed) == 1:
            axes[row] = int(np.argmax(changed))
            if axes[row - 1] == NO_AXIS:
                axes[row - 1] = axes[row]
    return axes


def straightness_mm(points: Array) -> float:
    """Largest distance of points (N, 3) from their best line."""
    centred = points - points.mean(axis=0)
    direction = np.linalg.svd(centred)[2][0]
    away = centred - np.outer(centred @ direction, direction)
    return float(np.linalg.norm(away, axis=1).max())


def repeatability(points: Array) -> Repeatability | None:
    """Of points (N, 3) measured at one commanded pose: radius, and RP = l̄ + 3 S_l.

    ISO 9283, 7.2.2. None for fewer than two points.
    """
    if len(points) < 2:
        return None
    lengths = np.linalg.norm(points - points.mean(axis=0), axis=1)
    rp = float(lengths.mean() + 3.0 * lengths.std(ddof=1))
    return Repeatability(float(lengths.max()), rp, len(points))


def frame_errors(commanded_in_base_mm: Array, measured_in_tracker_mm: Array) -> FrameErrors | None:
    """Absolute accuracy in the tracker's frame; None for points that don't fix one well.

    These are fewer than four, or all on a line.
    """
    if len(commanded_in_base_mm) < SHOTS_FOR_A_FRAME:
        return None
    try:
        tracker_from_base = fit_transform(commanded_in_base_mm, measured_in_tracker_mm)
    except ValueError:
        return None
    away = tracker_from_base.apply(commanded_in_base_mm) - measured_in_tracker_mm
    lengths = np.linalg.norm(away, axis=1)
    return FrameErrors(float(lengths.mean()), float(lengths.max()))


def broken_limits(found: Validation, limits: AcceptanceConfig) -> list[str]:
    """Every acceptance limit that the results break, with value and limit."""
    distances, repeated = found.distances, found.repeatability
    straight = found.straightness_mm
    checks = (
        (
            "mean distance error",
            distances.mean_abs if distances else None,
            limits.distance_mean_mm,
        ),
        (
            "largest distance error",
            distances.max_abs if distances else None,
            limits.distance_max_mm,
        ),
        ("rotation", found.rotation_mm, limits.rotation_mm),
        ("straightness", max(straight.values()) if straight else None, limits.straightness_mm),
        ("repeatability", repeated.radius_mm if repeated else None, limits.repeatability_mm),
    )
    return [
        f"{name} {value:.3f} mm, limit {limit:g} mm"
        for name, value, limit in checks
        if value is not None and limit is not None and value > limit
    ]
