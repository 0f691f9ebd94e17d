"""Validation: errors of the commanded robot, each with the instrument's uncertainty.

Lengths are in mm. Vectors are in the base frame as fitted to the commanded points (paper eq. 25),
or, with too few of them, in the tracker's axes.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from pydantic import JsonValue

from campaigns.arrays import Array, Index
from campaigns.estimation.point_sets import (
    away_from_best_line,
    away_from_mean,
    directions,
    distances_mm,
    farthest_apart,
    fitted_frame,
)
from campaigns.estimation.rigid_transforms import Transform
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.evaluation.decision import COVERAGE, Decision, Requirement, decide_all
from campaigns.evaluation.iso9283 import pose_repeatability
from campaigns.settings.sections import AcceptanceConfig
from campaigns.shots.pairs import pair_rows
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots

AXES = ("x", "y", "z")
NO_AXIS = -1
SAME_MM = 1e-6
"""Below this a commanded coordinate has not changed."""
SHOTS_OF_A_LINE = 3
OF_THE_OUTERMOST = 0.5
"""Standard deviation of the outermost of many visits' distances, over that of a coordinate."""


@dataclass(frozen=True, slots=True)
class MeasuredLength:
    """Length, and the instrument's standard uncertainty in the direction in which it lies."""

    value_mm: float
    standard_uncertainty_mm: float

    @property
    def expanded_uncertainty_mm(self) -> float:
        """U, k = 2."""
        return COVERAGE * self.standard_uncertainty_mm

    def with_scatter(self, scatter_mm: float) -> "MeasuredLength":
        """The same with a scatter in its uncertainty beside the instrument's."""
        together = float(np.hypot(self.standard_uncertainty_mm, scatter_mm))
        return MeasuredLength(self.value_mm, together)


@dataclass(frozen=True, slots=True, eq=False)
class TestShots:
    """Shots of one test: what was commanded in the base frame, and what was measured."""

    __test__ = False  # its name is not that of a test of ours

    pairs: tuple[int | None, ...]
    commanded: Array
    """(N, t), mm and rad."""
    points_mm: Array
    """(N, 3)"""
    covariance_mm2: Array
    """(N, 3, 3)"""

    @classmethod
    def of(cls, shots: Shots, instrument: TrackerUncertainty) -> "TestShots":
        """Shots in the tracker's frame; those of no stated covariance get the instrument's."""
        points = shots.points_in_tracker_mm
        return cls(shots.pairs, shots.commanded, points, shots.covariance_mm2(instrument))

    def __len__(self) -> int:
        return len(self.pairs)

    @property
    def turn(self) -> Array:
        """Commanded turn of a platform that turns, its last coordinate, (N,)."""
        return np.asarray(self.commanded[:, -1])

    def rows(self, rows: Index) -> "TestShots":
        """Some of them."""
        return TestShots(
            tuple(self.pairs[row] for row in rows.tolist()),
            self.commanded[rows],
            self.points_mm[rows],
            self.covariance_mm2[rows],
        )

    def seen_from(self, other_from_this: Transform) -> "TestShots":
        """With the measured points in another frame."""
        rotation = other_from_this.rotation
        covariance = rotation @ self.covariance_mm2 @ rotation.T
        points = other_from_this.apply(self.points_mm)
        return TestShots(self.pairs, self.commanded, points, covariance)

    def base_from_tracker(self) -> Transform | None:
        """Base frame that fits the commanded points best; None with too few for one."""
        return fitted_frame(self.points_mm, self.commanded[:, :3])


@dataclass(frozen=True, slots=True, eq=False)
class DistanceTest:
    """Pairs whose distance was commanded and measured, (M,) each."""

    pairs: tuple[int, ...]
    commanded_mm: Array
    measured_mm: Array
    standard_uncertainty_mm: Array

    @property
    def errors_mm(self) -> Array:
        """Commanded minus measured."""
        return np.asarray(self.commanded_mm - self.measured_mm)

    @property
    def mean(self) -> MeasuredLength:
        """Mean error without signs.

        Its uncertainty is not reduced by averaging: an instrument's errors at points near each
        other are alike.
        """
        size = np.abs(self.errors_mm)
        return MeasuredLength(float(size.mean()), float(self.standard_uncertainty_mm.mean()))

    @property
    def largest(self) -> MeasuredLength:
        """Largest error without sign."""
        size = np.abs(self.errors_mm)
        worst = int(np.argmax(size))
        return MeasuredLength(float(size[worst]), float(self.standard_uncertainty_mm[worst]))


@dataclass(frozen=True, slots=True, eq=False)
class LineTest:
    """Commanded straight line, (N, 3) each."""

    axis: str
    commanded_mm: Array
    points_mm: Array
    away_mm: Array
    """From the best line to the measured points."""
    straightness: MeasuredLength

    @property
    def along_mm(self) -> Array:
        """Commanded place along the line, (N,)."""
        return np.asarray(self.commanded_mm[:, AXES.index(self.axis)])


@dataclass(frozen=True, slots=True, eq=False)
class RotationTest:
    """Motion of the point while only the platform should turn."""

    turn_rad: Array
    """As commanded, (N,)."""
    away_mm: Array
    """From the mean, (N, 3)."""
    moved: MeasuredLength
    """Largest distance between any two points."""


@dataclass(frozen=True, slots=True, eq=False)
class RepeatabilityTest:
    """Points (N, 3) of repeated visits to one commanded point (3,)."""

    commanded_mm: Array
    points_mm: Array
    radius: MeasuredLength
    """Of the sphere about their mean."""

    @property
    def away_mm(self) -> Array:
        """From their mean, (N, 3)."""
        return away_from_mean(self.points_mm)

    @property
    def scatter_mm(self) -> float:
        """Standard deviation of one coordinate about the mean; the tracker's noise is in it."""
        away = self.away_mm
        return float(np.sqrt(np.sum(away**2) / (3 * (len(away) - 1))))

    @property
    def rp_mm(self) -> float:
        """l̄ + 3 S of their distances from their mean: RP, were they visits from one direction."""
        return pose_repeatability(self.points_mm).value_mm


@dataclass(frozen=True, slots=True, eq=False)
class ValidationResult:
    """Results of a validation; None or empty for a test that was not run."""

    in_base: bool
    """Frame of the vectors: the base's, or not."""
    distances: DistanceTest | None
    absolute_mm: Array | None
    """Distances of the pairs' points from where they were commanded, the frame fitted, (N,)."""
    rotation: RotationTest | None
    lines: tuple[LineTest, ...]
    repeatability: RepeatabilityTest | None

    def line(self, axis: str) -> LineTest | None:
        """Line along an axis."""
        return next((line for line in self.lines if line.axis == axis), None)

    @property
    def worst_straightness(self) -> MeasuredLength | None:
        """Straightness of the least straight line."""
        every = (line.straightness for line in self.lines)
        return max(every, key=lambda length: length.value_mm, default=None)

    def figures(self) -> dict[str, MeasuredLength | None]:
        """All that limits may be asked for, by the names on screen and page."""
        distances, repeated = self.distances, self.repeatability
        lines = {axis: self.line(axis) for axis in AXES}
        return {
            "distances, mean error": distances.mean if distances else None,
            "distances, largest error": distances.largest if distances else None,
            "rotation": self.rotation.moved if self.rotation else None,
            **{
                f"straightness along {axis}": line.straightness if line else None
                for axis, line in lines.items()
            },
            "repeatability, radius of the sphere": repeated.radius if repeated else None,
        }

    def comparable_figures(self) -> dict[str, MeasuredLength | None]:
        """The same figures for comparison with another validation's of the same tests.

        Beside the instrument the uncertainty holds by how much the robot's own scatter would change
        a figure, so far as repeated visits show it. That of the mean error is reduced by averaging:
        what an instrument's errors have in common, two validations have too.
        """
        scatter_mm = self.repeatability.scatter_mm if self.repeatability else 0.0
        shares = {
            "distances, largest error": np.sqrt(2.0),
            "rotation": np.sqrt(2.0),
            "repeatability, radius of the sphere": OF_THE_OUTERMOST,
        }
        found = {
            name: length and length.with_scatter(scatter_mm * float(shares.get(name, 1.0)))
            for name, length in self.figures().items()
        }
        if self.distances is not None:
            mean = self.distances.mean.with_scatter(scatter_mm * float(np.sqrt(2.0)))
            together = mean.standard_uncertainty_mm / float(np.sqrt(len(self.distances.pairs)))
            found["distances, mean error"] = MeasuredLength(mean.value_mm, together)
        return found

    def further_figures_mm(self) -> dict[str, float | None]:
        """Further figures, of which no limit is asked."""
        repeated, absolute = self.repeatability, self.absolute_mm
        return {
            "repeatability, l̄ + 3 S": repeated.rp_mm if repeated else None,
            "in the tracker's frame, mean": None if absolute is None else float(absolute.mean()),
            "in the tracker's frame, largest": None if absolute is None else float(absolute.max()),
        }

    def document(self) -> dict[str, JsonValue]:
        """As `validate --json` prints it."""
        straight: dict[str, JsonValue] = {
            line.axis: line.straightness.value_mm for line in self.lines
        }
        return {
            "distances_mm": None if self.distances is None else _distances(self.distances),
            "rotation_mm": None if self.rotation is None else self.rotation.moved.value_mm,
            "straightness_mm": straight or None,
            "repeatability": None if self.repeatability is None else _repeated(self.repeatability),
            "frame_mm": None if self.absolute_mm is None else _absolute(self.absolute_mm),
        }


def _distances(test: DistanceTest) -> dict[str, JsonValue]:
    return {"mean_abs": test.mean.value_mm, "max_abs": test.largest.value_mm}


def _repeated(test: RepeatabilityTest) -> dict[str, JsonValue]:
    approaches = len(test.points_mm)
    return {"radius_mm": test.radius.value_mm, "rp_mm": test.rp_mm, "approaches": approaches}


def _absolute(away_mm: Array) -> dict[str, JsonValue]:
    return {"mean": float(away_mm.mean()), "max": float(away_mm.max())}


def evaluate_validation(shots: Shots, instrument: TrackerUncertainty) -> ValidationResult:
    """Result of the accepted shots of a validation series.

    `instrument` stands in for shots of which the tracker stated no uncertainty. The frame is that
    of the pairs, or of all shots where there are too few pairs.
    """
    everything = TestShots.of(shots, instrument)
    validation = everything.rows(_rows_of(shots, ShotSet.VALIDATION))
    frame = validation.base_from_tracker() or everything.base_from_tracker()
    in_base = everything if frame is None else everything.seen_from(frame)

    def test(purpose: ShotSet) -> TestShots:
        return in_base.rows(_rows_of(shots, purpose))

    distances = test(ShotSet.VALIDATION)
    return ValidationResult(
        frame is not None,
        distance_test(distances),
        None if frame is None or len(distances) == 0 else _absolute_mm(distances),
        rotation_test(test(ShotSet.ROTATION)),
        line_tests(test(ShotSet.STRAIGHTNESS)),
        repeatability_test(test(ShotSet.REPEATABILITY)),
    )


def distance_test(shots: TestShots) -> DistanceTest | None:
    """Distances of the whole pairs; None when there is none."""
    pairs = pair_rows(shots.pairs)
    if not pairs.numbers:
        return None
    first, second = pairs.rows.T
    direction = directions(shots.points_mm, first, second)
    covariance = shots.covariance_mm2[first] + shots.covariance_mm2[second]
    return DistanceTest(
        pairs.numbers,
        distances_mm(shots.commanded[:, :3], first, second),
        distances_mm(shots.points_mm, first, second),
        np.sqrt(np.einsum("mi,mij,mj->m", direction, covariance, direction)),
    )


def line_tests(shots: TestShots) -> tuple[LineTest, ...]:
    """Every line of at least three shots, in the order x, y, z."""
    along = line_axes(shots.commanded[:, :3])
    lines = [np.flatnonzero(along == axis) for axis in range(len(AXES))]
    return tuple(
        _line_test(axis, shots.rows(rows))
        for axis, rows in zip(AXES, lines, strict=True)
        if len(rows) >= SHOTS_OF_A_LINE
    )


def rotation_test(shots: TestShots) -> RotationTest | None:
    """Motion of the point while only the platform should turn; None for fewer than two shots."""
    if len(shots) < 2:
        return None
    first, second = farthest_apart(shots.points_mm)
    together = shots.covariance_mm2[first] + shots.covariance_mm2[second]
    moved = _length(shots.points_mm[first] - shots.points_mm[second], together)
    return RotationTest(shots.turn, away_from_mean(shots.points_mm), moved)


def repeatability_test(shots: TestShots) -> RepeatabilityTest | None:
    """Sphere about the mean of points at one commanded pose; None for fewer than two."""
    if len(shots) < 2:
        return None
    radius = _longest(away_from_mean(shots.points_mm), shots.covariance_mm2)
    return RepeatabilityTest(shots.commanded[0, :3], shots.points_mm, radius)


def line_axes(commanded_mm: Array) -> Index:
    """Axis (0, 1, 2) of the line to which each commanded point belongs, (N,).

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


@dataclass(frozen=True, slots=True)
class ValidationVerdict:
    """Decision on a validation, limit by limit; None where no limit was asked for."""

    decision: Decision | None
    requirements: tuple[Requirement, ...]
    worse: tuple[str, ...]
    """Losses against before, in words."""

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons against it, or for leaving it open, in words."""
        needed = (each for each in self.requirements if each.decision in ("fail", "not decided"))
        return (*(each.in_words() for each in needed), *self.worse)


def validation_verdict(
    found: ValidationResult | None,
    limits: AcceptanceConfig,
    mean_before_mm: float | None = None,
) -> ValidationVerdict:
    """Verdict by the limits, and by the mean error of distances before the parameters were loaded.

    None for what was not measured.
    """
    needed = tuple(_requirements(found, limits))
    worse = tuple(_worse_than_before(found, mean_before_mm))
    decisions = [each.decision for each in needed if each.decision is not None]
    if worse:
        decisions.append("fail")
    return ValidationVerdict(decide_all(decisions) if decisions else None, needed, worse)


def _requirements(
    found: ValidationResult | None, limits: AcceptanceConfig
) -> Iterator[Requirement]:
    figures = {} if found is None else found.figures()
    for name, limit in limits_by_figure(limits).items():
        length = figures.get(name)
        if length is None:
            yield Requirement(name, None, limit)
        else:
            yield Requirement(name, length.value_mm, limit, length.standard_uncertainty_mm)


def limits_by_figure(limits: AcceptanceConfig) -> Mapping[str, float | None]:
    """Limits by the names of `ValidationResult.figures`."""
    return {
        "distances, mean error": limits.distance_mean_mm,
        "distances, largest error": limits.distance_max_mm,
        "rotation": limits.rotation_mm,
        **{f"straightness along {axis}": limits.straightness_mm for axis in AXES},
        "repeatability, radius of the sphere": limits.repeatability_mm,
    }


def _worse_than_before(found: ValidationResult | None, before_mm: float | None) -> Iterator[str]:
    """Losses by more than the uncertainty of the difference.

    The journal keeps no uncertainty of the mean before; the same pairs have the same one.
    """
    name = "distances, mean error"
    after = None if found is None else found.comparable_figures()[name]
    if after is None or before_mm is None:
        return
    expanded_mm = float(np.sqrt(2.0)) * after.expanded_uncertainty_mm
    if after.value_mm - before_mm > expanded_mm:
        yield f"{name} {after.value_mm:.3f} mm, before loading it was {before_mm:.3f} mm"


def _rows_of(shots: Shots, purpose: ShotSet) -> Index:
    return np.flatnonzero([each is purpose for each in shots.purposes])


def _absolute_mm(shots: TestShots) -> Array:
    return np.asarray(np.linalg.norm(shots.points_mm - shots.commanded[:, :3], axis=1))


def _line_test(axis: str, shots: TestShots) -> LineTest:
    away = away_from_best_line(shots.points_mm)
    straightness = _longest(away, shots.covariance_mm2)
    return LineTest(axis, shots.commanded[:, :3], shots.points_mm, away, straightness)


def _longest(away_mm: Array, covariance_mm2: Array) -> MeasuredLength:
    """The longest of vectors (N, 3)."""
    worst = int(np.argmax(np.linalg.norm(away_mm, axis=1)))
    return _length(away_mm[worst], covariance_mm2[worst])


def _length(vector_mm: Array, covariance_mm2: Array) -> MeasuredLength:
    """The length of a vector (3,) and its standard deviation; for none, that of the worst axis."""
    length = float(np.linalg.norm(vector_mm))
    if length == 0.0:
        return MeasuredLength(0.0, float(np.sqrt(np.linalg.eigvalsh(covariance_mm2)[-1])))
    along = vector_mm / length
    return MeasuredLength(length, float(np.sqrt(along @ covariance_mm2 @ along)))
